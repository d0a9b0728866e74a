"""The biphasic-swelling model fitted to a fuller one: which value of a property makes it follow best.

In two dimensions currents close inside the tissue, so that no formula gives the permeability with which the
biphasic-swelling model does best; Wilson et al. (2005) fit it. Here a bounded minimiser in one variable looks for it,
over the logarithm of the property.
"""

from __future__ import annotations

import math
import time
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
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
from fvswell.errors import SolverError
from fvswell.physics.tissue import Array
from fvswell.prediction.determination import coefficient_of_determination
from fvswell.simulation.run import Progress, run
from fvswell.units import number_or_text

__all__ = ["FITTED_MODEL", "Fit", "FitProblem", "Trial", "fit", "fit_problem", "run_fit"]

FITTED_MODEL = "biphasic-swelling"
_REFERENCE_MODELS = ("electrochemical",)
_FACTOR = 4.0  # of the case's value, down and up: where to look by default
_RESOLUTION = 1e-3  # of the value
_NO_EFFECT = 1e-9  # of the misfit
_AT_LIMIT = 5.0 * _RESOLUTION


@dataclass(frozen=True)
class FitProblem:
    """What is fitted to what; made by `fit_problem`, which checks it."""

    case: Case  # cut off after the last phase that counts
    parameter: str
    reference: str
    phases: tuple[str, ...]
    limits: tuple[float, float]

    @property
    def present(self) -> float:
        """The case's value."""
        return float(getattr(self.case.tissue, self.parameter))

    def best(self, trials: Sequence[Trial]) -> Trial:
        """The trial that follows best; the case's value counts if it lies within the limits."""
        low, high = self.limits
        return min((trial for trial in trials if low <= trial.value <= high), key=lambda trial: trial.squares)

    def fitted_case(self, value: float) -> Case:
        """The case of the fitted model with a value of the property."""
        changes = {"model": FITTED_MODEL, "open_circuit_permeability": "none", f"tissue.{self.parameter}": value}
        return self.case.with_changes(changes)


@dataclass(frozen=True)
class Trial:
    """A run of the fitted model."""

    run: int  # from 1 on
    value: float
    squares: float  # sum over all phases that count, each relative to the reference's about its mean
    r_squared: tuple[float, ...]  # of each of these phases


@dataclass(frozen=True)
class Fit:
    """The best value, and how much better it is."""

    problem: FitProblem
    quantities: tuple[str, ...]  # that the histories are of, by phase
    trials: tuple[Trial, ...]  # in order; the first has the case's value
    seconds: float
    reference_result: xr.Dataset
    unfitted_result: xr.Dataset  # with the case's value
    fitted_result: xr.Dataset

    @property
    def before(self) -> Trial:
        """With the case's value."""
        return self.trials[0]

    @property
    def best(self) -> Trial:
        """With the best value."""
        return self.problem.best(self.trials)

    @property
    def ratio(self) -> float:
        """Best value over the case's."""
        return self.best.value / self.problem.present

    @property
    def header(self) -> list[str]:
        """Names of the columns of the table of trials, in internal units."""
        return ["run", self.problem.parameter, *(f"r_squared {phase}" for phase in self.problem.phases)]

    @property
    def rows(self) -> list[list[float]]:
        """The table: a row for each trial."""
        return [[trial.run, trial.value, *trial.r_squared] for trial in self.trials]

    @property
    def at_limit(self) -> bool:
        """Whether the best value lies at an end of where was looked, so that a better one may lie beyond."""
        return any(abs(math.log(self.best.value / limit)) < _AT_LIMIT for limit in self.problem.limits)


def fit(
    case: Case,
    parameter: str = "hydraulic_permeability",
    reference: str = "electrochemical",
    phases: Sequence[str] | None = None,
    limits: tuple[float | str, float | str] | None = None,
) -> Fit:
    """Fit the biphasic-swelling model to a fuller one by a property of its tissue.

    Parameters
    ----------
    case
        Of a column or a block. The fitted model uses the property as it is, without open-circuit correction.
    parameter
        A property that is one number, such as "hydraulic_permeability".
    reference
        The model to follow.
    phases
        Names of those that count; the first without it. Later ones are not run.
    limits
        Least and largest value to look at, numbers in internal units or quantities; without them a quarter of the
        case's value and four times it.

    Returns
    -------
    Fit
        The trials, the best of them and the results of both models.

    Raises
    ------
    CaseError
        If the parameter, a phase, a limit or the case does not do.
    SolverError
        If a run had to stop.
    """
    return run_fit(fit_problem(case, parameter, reference, phases, limits))


def fit_problem(
    case: Case,
    parameter: str,
    reference: str,
    phases: Sequence[str] | None = None,
    limits: Sequence[float | str] | None = None,
) -> FitProblem:
    """Check what `fit` is asked for; same parameters and errors."""
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
    problem = FitProblem(_until(case, last), parameter, reference, tuple(chosen), within)
    for value in within:
        problem.fitted_case(value)
    return problem


def run_fit(
    problem: FitProblem,
    reference_path: Path | None = None,
    fitted_path: Path | None = None,
    replace: bool = False,
    report: Callable[[Progress], None] | None = None,
    report_trial: Callable[[Trial], None] | None = None,
) -> Fit:
    """Run the reference once, and the fitted model until the best value is found.

    Parameters
    ----------
    problem
        Checked.
    reference_path, fitted_path
        Files for the results of the reference and of the best trial; without them they are in memory only.
    replace
        Whether these may be replaced.
    report
        Called after every step of the reference.
    report_trial
        Called after every trial.

    Raises
    ------
    CaseError
        If nothing changes in a phase that counts, or the property changes nothing.
    SolverError
        If a run had to stop.
    """
    from scipy.optimize import minimize_scalar  # a tenth of a second to import

    began = time.perf_counter()
    target = _Target(
        problem, run(problem.case, problem.reference, path=reference_path, replace=replace, report=report)
    )  # fmt: skip
    target.check()
    trials: list[Trial] = []

    def attempt(value: float) -> xr.Dataset:
        try:
            result = run(problem.fitted_case(value), durations=target.durations)
        except SolverError as error:
            raise SolverError(f"with {problem.parameter} = {value:.6g}: {error}", error.result) from None
        r_squared = target.r_squared(result)
        trials.append(Trial(len(trials) + 1, value, sum(1.0 - each for each in r_squared), r_squared))
        if report_trial is not None:
            report_trial(trials[-1])
        return result

    def squares(logarithm: float) -> float:
        attempt(math.exp(logarithm))
        return trials[-1].squares

    unfitted = attempt(problem.present)
    low, high = (math.log(limit) for limit in problem.limits)
    minimize_scalar(squares, bounds=(low, high), method="bounded", options={"xatol": _RESOLUTION})
    squares_found = [trial.squares for trial in trials]
    if np.ptp(squares_found) <= _NO_EFFECT * max(squares_found):
        message = f"makes no difference to the {FITTED_MODEL} model of this case: there is nothing to fit"
        raise CaseError([Problem("parameter", problem.parameter, message)], problem.case.source)
    best = problem.best(trials)
    fitted = run(problem.fitted_case(best.value), path=fitted_path, replace=replace, durations=target.durations)
    return Fit(
        problem=problem,
        quantities=tuple(target.quantities[phase] for phase in problem.phases),
        trials=tuple(trials),
        seconds=time.perf_counter() - began,
        reference_result=target.result,
        unfitted_result=unfitted,
        fitted_result=fitted,
    )


@dataclass(frozen=True)
class _Target:
    """The result of the reference, whose histories are to be followed."""

    problem: FitProblem
    result: xr.Dataset

    @cached_property
    def durations(self) -> list[float]:
        """Durations of the phases, s."""
        return phase_lengths(self.result)

    @cached_property
    def quantities(self) -> dict[str, str]:
        """What the histories are of, by phase."""
        names = [phase.name for phase in self.problem.case.phase]
        return dict(zip(names, compared_quantities(self.problem.case, self.result), strict=True))

    def check(self) -> None:
        """Raise CaseError if there is nothing to follow in a phase that counts."""
        for phase in self.problem.phases:
            message = f"{self.quantities[phase]} does not change in it: there is nothing to fit"
            if not has_outputs([self.result], *self._span(phase)):
                message = "has too few outputs to follow: give more output times, or output.per_phase"
            elif np.ptp(self._histories(phase, {})["data"]) > self._rounding(phase):
                continue
            raise CaseError([Problem("phases", phase, message)], self.problem.case.source)

    def r_squared(self, result: xr.Dataset) -> tuple[float, ...]:
        """How well a result follows, in each phase that counts."""
        found = []
        for phase in self.problem.phases:
            pair = self._histories(phase, {"own": result})
            found.append(float(coefficient_of_determination(pair["data"], pair["own"], self._rounding(phase))))
        return tuple(found)

    def _histories(self, phase: str, others: dict[str, xr.Dataset]) -> dict[str, Array]:
        return phase_histories({"data": self.result, **others}, self.quantities[phase], *self._span(phase))[1]

    def _rounding(self, phase: str) -> float:
        return rounding_of(self.result, self.quantities[phase])

    def _span(self, phase: str) -> tuple[float, float]:
        spans = pairwise([0.0, *self.result["phase_end"].values])
        return dict(zip(self.quantities, spans, strict=True))[phase]


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
