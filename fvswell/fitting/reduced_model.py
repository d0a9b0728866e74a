"""The biphasic-swelling model fitted to a fuller one: which value of a property makes it follow best.

In two dimensions currents close inside the tissue, so that no formula gives the permeability with which the
biphasic-swelling model does best; Wilson et al. (2005) fit it. The curves are those of the fuller model in place of
measured ones, and each phase counts by its variation about the mean: what is least is the sum of 1 - R^2.
"""

from __future__ import annotations

import math
import time
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import xarray as xr

from fvswell.analysis.comparison import compared_quantities, phase_lengths
from fvswell.analysis.histories import has_outputs, phase_histories, rounding_of
from fvswell.case.case import Case, CaseError
from fvswell.case.errors import Problem, nearest_name
from fvswell.case.reading import value_type
from fvswell.case.values import Quantity
from fvswell.fitting.evaluator import FitProgress
from fvswell.fitting.fit import FitResult, fit
from fvswell.fitting.measurement import Measurement
from fvswell.fitting.parameters import Parameter, Parameters
from fvswell.fitting.problem import FitProblem, Settings
from fvswell.physics.tissue import Array
from fvswell.prediction.determination import coefficient_of_determination
from fvswell.simulation.run import Progress, run
from fvswell.units import number_or_text

__all__ = ["FITTED_MODEL", "ReducedFit", "ReducedProblem", "fit_reduced_model", "reduced_problem"]

FITTED_MODEL = "biphasic-swelling"
_REFERENCE_MODELS = ("electrochemical",)
_FACTOR = 4.0  # of the case's value, down and up: where to look by default
_AT_LIMIT = 5e-3


@dataclass(frozen=True)
class ReducedProblem:
    """What is fitted to what; made by `reduced_problem`, which checks it."""

    case: Case  # cut off after the last phase that counts
    parameter: str
    reference: str
    phases: tuple[str, ...]
    limits: tuple[float, float]

    @property
    def present(self) -> float:
        """The case's value."""
        return float(getattr(self.case.tissue, self.parameter))

    def fitted_case(self, value: float) -> Case:
        """The case of the fitted model with a value of the property."""
        changes = {"model": FITTED_MODEL, "open_circuit_permeability": "none", f"tissue.{self.parameter}": value}
        return self.case.with_changes(changes)


@dataclass(frozen=True)
class ReducedFit:
    """The best value, and how much better it is."""

    problem: ReducedProblem
    quantities: tuple[str, ...]  # that the histories are of, by phase that counts
    result: FitResult
    before: tuple[float, ...]  # R^2 with the case's value, by phase that counts
    after: tuple[float, ...]  # with the best value
    seconds: float
    reference_result: xr.Dataset
    unfitted_result: xr.Dataset  # with the case's value
    fitted_result: xr.Dataset

    @property
    def best(self) -> float:
        """The value with which it follows best, internal unit."""
        return float(self.result.best.values[0])

    @property
    def ratio(self) -> float:
        """Best value over the case's."""
        return self.best / self.problem.present

    @property
    def at_limit(self) -> bool:
        """Whether the best value lies at an end of where was looked, so that a better one may lie beyond."""
        return any(abs(math.log(self.best / limit)) < _AT_LIMIT for limit in self.problem.limits)

    @property
    def header(self) -> list[str]:
        """Names of the columns of the table, in internal units."""
        return ["value", self.problem.parameter, *(f"r_squared {phase}" for phase in self.problem.phases)]

    @property
    def rows(self) -> list[list[float | str]]:
        """The table: the case's value, and the best."""
        return [["case", self.problem.present, *self.before], ["best", self.best, *self.after]]


def reduced_problem(
    case: Case,
    parameter: str = "hydraulic_permeability",
    reference: str = "electrochemical",
    phases: Sequence[str] | None = None,
    limits: Sequence[float | str] | None = None,
) -> ReducedProblem:
    """Check what is to be fitted to what.

    Parameters
    ----------
    case
        Of a column or a block. The fitted model uses the property as it is, without open-circuit correction.
    parameter
        A property of the tissue that is one number, such as "hydraulic_permeability".
    reference
        The model to follow.
    phases
        Names of those that count; the first without it. Later ones are not run.
    limits
        Least and largest value to look at, numbers in internal units or quantities; without them a quarter of the
        case's value and four times it.

    Raises
    ------
    CaseError
        If the parameter, a phase, a limit or the case does not do.
    """
    problems = []
    if reference not in _REFERENCE_MODELS:
        allowed = " or ".join(_REFERENCE_MODELS)
        problems.append(Problem("against", reference, f"must be a fuller model than {FITTED_MODEL}: {allowed}"))
    names = [phase.name for phase in case.phase]
    chosen = names[:1] if phases is None else list(dict.fromkeys(phases))
    for name in chosen:
        if name not in names:
            near = nearest_name(name, names)
            problems.append(
                Problem("phases", name, f"did you mean {near}?" if near else f"must be of {', '.join(names)}")
            )
    within, found = _limits(case, parameter, limits)
    problems += found
    if problems:
        raise CaseError(problems, case.source)
    last = max(names.index(name) for name in chosen)
    problem = ReducedProblem(_until(case, last), parameter, reference, tuple(chosen), within)
    for value in within:
        problem.fitted_case(value)
    return problem


def fit_reduced_model(
    problem: ReducedProblem,
    reference_path: Path | None = None,
    fitted_path: Path | None = None,
    replace: bool = False,
    report: Callable[[Progress], None] | None = None,
    report_fit: Callable[[FitProgress], None] | None = None,
) -> ReducedFit:
    """Run the reference once, and the fitted model until the best value is found.

    Parameters
    ----------
    problem
        Checked.
    reference_path, fitted_path
        Files for the results of the reference and of the fitted model; without them they are in memory only.
    replace
        Whether these may be replaced.
    report
        Called after every step of the reference.
    report_fit
        Called after every run of the fitted model.

    Raises
    ------
    CaseError
        If nothing changes in a phase that counts, or the property changes nothing.
    SolverError
        If a run had to stop.
    """
    began = time.perf_counter()
    reference = run(problem.case, problem.reference, path=reference_path, replace=replace, report=report)
    durations = phase_lengths(reference)
    spans = dict(zip([phase.name for phase in problem.case.phase], pairwise(np.cumsum([0.0, *durations])), strict=True))
    quantities = dict(zip(spans, compared_quantities(problem.case, reference), strict=True))
    case = problem.fitted_case(problem.present)
    if any(not isinstance(phase.duration, float) for phase in case.phase):
        case = case.with_changes(
            {f"phase.{name}.duration": length for name, length in zip(spans, durations, strict=True)}
        )
    curves = {phase: _curve(problem, reference, quantities[phase], phase, spans[phase]) for phase in problem.phases}
    measurements = [
        Measurement(phase, case, quantities[phase], at, values, noise=float(np.linalg.norm(values - values.mean())))
        for phase, (at, values) in curves.items()
    ]
    low, high = problem.limits
    sought = Parameter(
        problem.parameter, (f"tissue.{problem.parameter}",), float(np.clip(problem.present, low, high)), low, high, True
    )
    whole = FitProblem(measurements, Parameters([sought]), Settings(starts=1), case.title, case.source)
    result = _fitted(whole, problem, report_fit)
    unfitted = run(case, durations=durations)
    value = float(result.best.values[0])
    best_case = case.with_changes({f"tissue.{problem.parameter}": value})
    fitted = run(best_case, path=fitted_path, replace=replace, durations=durations)
    rounding = {phase: rounding_of(reference, quantities[phase]) for phase in problem.phases}
    before, after = (
        tuple(
            float(coefficient_of_determination(each.values, vector[span.points], rounding[each.name]))
            for each, span in zip(measurements, whole.spans, strict=True)
        )
        for vector in (_present_curves(whole, problem.present), result.best.curves)
    )
    return ReducedFit(
        problem, tuple(quantities[phase] for phase in problem.phases), result, before, after,
        time.perf_counter() - began, reference, unfitted, fitted,
    )  # fmt: skip


def _fitted(whole: FitProblem, problem: ReducedProblem, report: Callable[[FitProgress], None] | None) -> FitResult:
    try:
        return fit(whole, with_profiles=False, processes=1, report=report)
    except CaseError as error:
        if not any("makes no difference" in each.message for each in error.problems):
            raise
        message = f"makes no difference to the {FITTED_MODEL} model of this case: there is nothing to fit"
        raise CaseError([Problem("parameter", problem.parameter, message)], problem.case.source) from None


def _present_curves(whole: FitProblem, value: float) -> Array:
    histories = [
        experiment.histories(whole.changes(np.array([value]), index))
        for index, experiment in enumerate(whole.experiments)
    ]
    return whole.curves(histories)


def _curve(
    problem: ReducedProblem, reference: xr.Dataset, quantity: str, phase: str, span: tuple[float, float]
) -> tuple[Array, Array]:
    """Times and values of the reference in a phase; CaseError if there is nothing to follow."""
    message = f"{quantity} does not change in it: there is nothing to fit"
    if not has_outputs([reference], *span):
        message = "has too few outputs to follow: give more output times, or output.per_phase"
    else:
        at, histories = phase_histories({"data": reference}, quantity, *span)
        if np.ptp(histories["data"]) > rounding_of(reference, quantity):
            return at, histories["data"]
    raise CaseError([Problem("phases", phase, message)], problem.case.source)


def _limits(
    case: Case, parameter: str, limits: Sequence[float | str] | None
) -> tuple[tuple[float, float], list[Problem]]:
    """Where to look, and what is wrong with it and with the parameter."""
    nowhere = (math.nan, math.nan)
    known = [key for key, field in type(case.tissue).model_fields.items() if isinstance(value_type(field), Quantity)]
    if parameter not in known:
        near = nearest_name(parameter, known)
        message = f"did you mean {near}?" if near else f"must be of {', '.join(known)}"
        return nowhere, [Problem("parameter", parameter, message)]
    present = getattr(case.tissue, parameter)
    if not isinstance(present, float) or not present > 0.0:
        return nowhere, [Problem("parameter", parameter, "must be given in the case, as one number above 0")]
    reader = value_type(type(case.tissue).model_fields[parameter])
    assert isinstance(reader, Quantity)
    if limits is None:
        highest = min(bound for bound in (reader.below, reader.at_most, math.inf) if bound is not None)
        return (present / _FACTOR, min(present * _FACTOR, 0.5 * (present + highest))), []
    if len(limits) != 2:
        return nowhere, [Problem("between", ", ".join(map(str, limits)), "must be two values")]
    values, problems = [], []
    for limit in limits:
        try:
            values.append(reader.number(number_or_text(limit)))
        except ValueError as error:
            problems.append(Problem("between", str(limit), str(error)))
    if not problems and not 0.0 < values[0] < values[1]:
        problems.append(Problem("between", f"{values[0]:g}, {values[1]:g}", "must be above 0 and increase"))
    return (nowhere, problems) if problems else ((values[0], values[1]), [])


def _until(case: Case, last: int) -> Case:
    """The case without what comes after a phase."""
    content = tomllib.loads(case.to_toml())
    kept = content["phase"][: last + 1]
    changes: dict[str, object] = {"phase": kept}
    times, durations = case.output.times, [phase["duration"] for phase in kept]
    if times is not None and all(isinstance(duration, float) for duration in durations):
        within = [at for at in times if at <= sum(durations)]
        changes["output.times"] = within or None
    return case.with_changes(changes)
