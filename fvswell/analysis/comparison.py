"""Models of one case beside each other: how far the simpler ones are from the fullest one.

In each phase histories are compared: of a column the global strain, of a block the displacement of its probe along
the axis on which it moves most. Where the displacement of the piston or of an edge is prescribed they are the same by
definition, and those of its pressure are compared instead.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from fvswell.analysis.histories import (
    FEWEST_OUTPUTS,
    all_histories,
    has_outputs,
    local_strain,
    phase_histories,
    profile_at,
    rounding_of,
)
from fvswell.case.acting_loads import acting_loads, moved_part
from fvswell.case.case import MODELS, Case, CaseError
from fvswell.case.errors import Problem, nearest_name, shown
from fvswell.physics.tissue import Array
from fvswell.prediction.determination import NO_VARIATION, coefficient_of_determination
from fvswell.results.moved_grid import AXES
from fvswell.simulation.relaxation import phase_durations
from fvswell.simulation.run import run
from fvswell.simulation.settling import ends_on_rate

__all__ = [
    "BlockDifference",
    "ColumnDifference",
    "Comparison",
    "Difference",
    "common_durations",
    "compare",
    "compare_results",
    "compared_quantities",
    "phase_lengths",
    "reference_model",
    "with_models",
]


@dataclass(frozen=True)
class Difference:
    """A model less the reference in one phase."""

    phase: str
    model: str
    quantity: str  # that the histories are of, in the unit that `fvswell.results.fields` gives
    times: int  # at which R^2 is taken
    r_squared: float  # 1 - sum of squared differences/sum of squares of the reference about its mean
    largest: float  # of the quantity, with its sign
    time: float  # of the largest, s since the run began
    time_in_phase: float  # the same since the phase began
    local_strain: float  # largest in magnitude at that time, with its sign
    local_strain_ratio: float  # over the reference's local strain there, in magnitude


@dataclass(frozen=True)
class ColumnDifference(Difference):
    """A model of a column less the reference in one phase."""

    depth: float  # of the largest local one, mm from the filter in the stress-free solid
    equilibrium_strain: float  # of the model, under the loads that the phase ends with
    reference_equilibrium_strain: float


@dataclass(frozen=True)
class BlockDifference(Difference):
    """A model of a block less the reference in one phase."""

    x: float  # of the largest local one, mm in the stress-free solid
    y: float
    final: float  # the quantity of the model at the last output of the phase
    reference_final: float


@dataclass(frozen=True)
class Comparison:
    """Results of several models of a case, and their differences from one of them."""

    reference: str
    results: dict[str, xr.Dataset]
    differences: tuple[Difference, ...]
    left_out: tuple[str, ...] = ()  # phases with too few outputs to compare

    @property
    def quantity(self) -> str:
        """What the histories of the first phase are of."""
        return self.differences[0].quantity

    @property
    def phases(self) -> tuple[str, ...]:
        """Names of the phases."""
        return tuple(dict.fromkeys(difference.phase for difference in self.differences))

    def of_phase(self, phase: str) -> tuple[Difference, ...]:
        """Differences of all models in a phase."""
        return tuple(difference for difference in self.differences if difference.phase == phase)

    def gap(self, model: str) -> tuple[Array, Array]:
        """Times, s, and how far the ``quantity`` of a model is above the reference's."""
        ends = self.results[self.reference]["phase_end"].values
        times, gaps = [np.zeros(1)], [np.zeros(1)]
        for start, end in pairwise([0.0, *ends]):
            at, histories = all_histories(self.results, self.quantity, start, end)
            times.append(at)
            gaps.append(histories[model] - histories[self.reference])
        return np.concatenate(times), np.concatenate(gaps)

    @property
    def header(self) -> list[str]:
        """Names of the columns of the table, in internal units."""
        return [*(field.name for field in fields(self.differences[0])), "reference"]

    @property
    def rows(self) -> list[list[Any]]:
        """The table: a row for each phase and model."""
        return [[*astuple(difference), self.reference] for difference in self.differences]


def compare(case: Case, models: Sequence[str] = MODELS) -> Comparison:
    """Run models of a case and compare them with the fullest.

    Parameters
    ----------
    case
        What to simulate; its own model does not matter.
    models
        Names of two or more models. The reference is the fullest: electrochemical, else biphasic-swelling.

    Raises
    ------
    CaseError
        If a model is unknown, or the case cannot be run with it.
    SolverError
        If a run had to stop.
    """
    results: dict[str, xr.Dataset] = {}
    cases = with_models(case, models)
    durations = common_durations(cases)
    for model, each in cases.items():
        results[model] = run(each, durations=durations)
        durations = phase_lengths(results[model])
    return compare_results(results)


def common_durations(cases: Mapping[str, Case]) -> list[float] | None:
    """Durations of the phases in a comparison of models, where they have to be known before.

    A phase that ends on a rate lasts as long in all models as in the reference, which stands for the tissue.
    """
    reference = cases[reference_model(list(cases))]
    return phase_durations(reference) if ends_on_rate(reference) else None


def phase_lengths(result: xr.Dataset) -> list[float]:
    """Durations of the phases of a result, s."""
    lengths: list[float] = np.diff(result["phase_end"].values, prepend=0.0).tolist()
    return lengths


def with_models(case: Case, models: Sequence[str]) -> dict[str, Case]:
    """The case with each of two or more models, by name.

    Raises
    ------
    CaseError
        If there are fewer than two different models, with all that is wrong with any of them.
    """
    cases, problems = {}, []
    for model in dict.fromkeys(models):
        try:
            cases[model] = case.with_changes({"model": model})
        except CaseError as error:
            problems += [each for each in error.problems if each not in problems]
    if not problems and len(cases) < 2:
        message = f"must be two or more of {', '.join(MODELS)}"
        problems = [Problem("models", ", ".join(models), message)]
    if problems:
        raise CaseError(problems, case.source)
    return cases


def reference_model(models: Sequence[str]) -> str:
    """The fullest of some models."""
    return max(models, key=MODELS.index)


def compare_results(results: Mapping[str, xr.Dataset], measured: str | None = None) -> Comparison:
    """Compare results of one case, by model; each must have run to its end.

    Models are compared by the history ``measured``, else by what the case says; see `compared_quantities`.

    Raises
    ------
    CaseError
        If no phase has the outputs that a comparison needs.
    """
    reference = reference_model(list(results))
    base = results[reference]
    case = Case.from_toml(base.attrs["case_toml"])
    measured = measured or case.output.measured
    quantities = compared_quantities(case, base) if measured is None else [measured] * len(case.phase)
    _check_histories(results, quantities)
    spans = list(pairwise([0.0, *base["phase_end"].values]))
    enough = [has_outputs(results.values(), *span) for span in spans]
    if not any(enough):
        message = f"leaves no phase with {FEWEST_OUTPUTS} outputs, which a comparison needs"
        raise CaseError([Problem("output", "", message)], case.source)
    differences = [
        _difference(results, reference, model, _Phase(index, phase.name, quantity, *span, case.geometry.kind))
        for index, (phase, quantity, span) in enumerate(zip(case.phase, quantities, spans, strict=True))
        if enough[index]
        for model in results
        if model != reference
    ]
    left_out = tuple(phase.name for phase, compared in zip(case.phase, enough, strict=True) if not compared)
    return Comparison(reference, dict(results), tuple(differences), left_out)


def _check_histories(results: Mapping[str, xr.Dataset], names: Iterable[str]) -> None:
    """Refuse to compare by what a result does not have."""
    for model, result in results.items():
        histories = [str(name) for name in result if result[name].dims == ("time",)]
        for name in names:
            if name not in histories:
                near = nearest_name(name, histories)
                hint = f"; did you mean {near}?" if near else ""
                message = f"the {model} model has no such history: {', '.join(histories)}{hint}"
                raise CaseError([Problem("measured", shown(name), message)], "compare")


class _Phase(NamedTuple):
    """A phase in which histories of a quantity are compared."""

    number: int  # from 0
    name: str
    quantity: str
    start: float  # s since the run began
    end: float
    geometry: str  # of the case


def _difference(results: Mapping[str, xr.Dataset], reference: str, model: str, phase: _Phase) -> Difference:
    """Difference of one model from the reference in one phase."""
    pair = {name: results[name] for name in (model, reference)}
    result, base = pair.values()
    span, quantity = (phase.start, phase.end), phase.quantity
    at, histories = phase_histories(pair, quantity, *span)
    every, at_every = all_histories(pair, quantity, *span)
    own, data = at_every.values()
    farthest = int(np.nanargmax(np.abs(own - data)))
    time = float(every[farthest])
    cell, local = _local_difference(result, base, time)
    r_squared = coefficient_of_determination(histories[reference], histories[model], rounding_of(base, quantity))
    common: dict[str, Any] = {
        "phase": phase.name,
        "model": model,
        "quantity": quantity,
        "times": len(at),
        "r_squared": float(r_squared),
        "largest": float(own[farthest] - data[farthest]),
        "time": time,
        "time_in_phase": time - phase.start,
        **local,
    }
    return _WHOLE[phase.geometry](common, pair, cell, phase)


def _of_column(common: dict[str, Any], pair: dict[str, xr.Dataset], cell: int, phase: _Phase) -> Difference:
    result, base = pair.values()
    own, reference = (float(each["equilibrium_strain"][phase.number]) for each in (result, base))
    return ColumnDifference(
        **common, depth=float(base["x"][cell]), equilibrium_strain=own, reference_equilibrium_strain=reference
    )


def _of_block(common: dict[str, Any], pair: dict[str, xr.Dataset], cell: int, phase: _Phase) -> Difference:
    place: dict[str, Any] = {axis: float(pair[common["model"]][f"face_{axis}"][cell]) for axis in AXES}
    _, histories = all_histories(pair, phase.quantity, phase.start, phase.end)
    final, reference_final = (float(history[-1]) for history in histories.values())
    return BlockDifference(**common, **place, final=final, reference_final=reference_final)


_WHOLE = {"column": _of_column, "plane-strain": _of_block, "axisymmetric": _of_block}  # by kind of the geometry


def compared_quantities(case: Case, result: xr.Dataset) -> list[str]:
    """Name of the history that models are compared by in each phase.

    Parameters
    ----------
    case
        That was run.
    result
        Of the reference.
    """
    free = max(case.geometry.histories, key=lambda name: float(np.ptp(result[name].values)))
    quantities = []
    for acting in acting_loads(case):
        moved = moved_part(case, acting)
        quantities.append(free if moved is None else f"{moved}_pressure")
    return quantities


def _local_difference(result: xr.Dataset, base: xr.Dataset, time: float) -> tuple[int, dict[str, float]]:
    """Cell with the largest difference of the local strain at a time, and that by the names of `Difference`."""
    own, reference = (profile_at(r, local_strain(r), time) for r in (result, base))
    cell = int(np.argmax(np.abs(own - reference)))
    gap, whole = float(own[cell] - reference[cell]), float(reference[cell])
    return cell, {"local_strain": gap, "local_strain_ratio": abs(gap / whole) if abs(whole) > NO_VARIATION else np.nan}
