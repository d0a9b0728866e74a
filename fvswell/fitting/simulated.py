"""Histories of a case at the times at which something was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from fvswell.analysis.histories import history_at
from fvswell.case.case import Case
from fvswell.case.errors import CaseError, Problem, nearest_name
from fvswell.errors import SolverError
from fvswell.numerics.state import Record, State, record_room
from fvswell.physics.tissue import Array
from fvswell.results.layout import SAME_TIME
from fvswell.simulation.march import march_all
from fvswell.simulation.relaxation import phase_durations
from fvswell.simulation.setup import Setup, make_setup

__all__ = ["Experiment"]


@dataclass(frozen=True)
class Experiment:
    """A case, and what is wanted of it.

    Parameters
    ----------
    case
        What is simulated.
    quantities
        Names of histories of its result.
    times
        When they are wanted, s since the run began, increasing, shape (times,).
    durations
        Of the phases, s: they stay as they are whatever the parameters.
    """

    case: Case
    quantities: tuple[str, ...]
    times: Array
    durations: tuple[float, ...]

    @classmethod
    def of(cls, case: Case, quantities: Sequence[str], times: Array) -> Experiment:
        """With the durations that the case has, or that its relaxation times come to."""
        return cls(case, tuple(quantities), np.asarray(times, dtype=float), tuple(phase_durations(case)))

    @cached_property
    def is_block(self) -> bool:
        """Whether a run takes a second rather than some milliseconds."""
        return self.case.geometry.kind != "column"

    def histories(self, changes: Mapping[str, float]) -> Array:
        """Histories with some numbers of the case changed, ``(quantities, times)``.

        Parameters
        ----------
        changes
            New numbers in internal units by dotted key.

        Raises
        ------
        CaseError
            If the changed case cannot be, or has no such history.
        SolverError
            If the run has to stop.
        """
        return case_histories(self.case.with_numbers(changes), self.quantities, self.times, self.durations)


def case_histories(case: Case, quantities: Sequence[str], times: Array, durations: Sequence[float]) -> Array:
    """Histories of a case; see `Experiment`.

    Steps that are chosen by the error have outputs anywhere. Steps of given length would become others with outputs
    between them, so histories are interpolated between their ends.
    """
    setup = make_setup(case)
    steps = setup.control().fixed_steps
    if steps == 0:
        return _recorded(setup, quantities, times, durations)
    starts = np.cumsum([0.0, *durations])
    ends = _step_ends(setup, starts, steps)
    recorded = _recorded(setup, quantities, ends, durations)
    values = np.full((len(quantities), len(times)), np.nan)
    for start, end in pairwise(starts):
        own = (times > start) & (times <= end) if start > 0.0 else times <= end
        if own.any():
            values[:, own] = [history_at(ends, history, start, times[own]) for history in recorded]
    return values


def _step_ends(setup: Setup, starts: Array, steps: int) -> Array:
    """Ends of so many equal steps in each phase, and corners of loads, where steps end as well; 0 is the first."""
    equal = [
        start + length * np.arange(1, steps + 1) / steps for start, length in zip(starts, np.diff(starts), strict=False)
    ]
    segments = setup.protocol(np.diff(starts).tolist(), times=())
    ends = np.unique(np.concatenate([[0.0], *equal, starts[segments.phase] + segments.end]))
    return ends[np.diff(ends, append=np.inf) > SAME_TIME * starts[-1]]


def _recorded(setup: Setup, quantities: Sequence[str], times: Array, durations: Sequence[float]) -> Array:
    """Histories at outputs of a run."""
    case = setup.case
    later = times[times > 0.0]
    before = _initial(setup.state)
    with np.errstate(all="ignore"):  # a run that fails on the way says so in words
        record, problem = march_all(setup, setup.protocol(durations, times=later), setup.control()._replace(every=0))
    if problem:
        raise SolverError(f"{case.source}: {problem}")
    found = setup.fields(record)
    unknown = [name for name in quantities if name not in found or found[name].ndim != 1]
    if unknown:
        known = [name for name, values in found.items() if values.ndim == 1]
        raise CaseError([_unknown_quantity(name, known) for name in unknown], case.source)
    values = np.stack([found[name] for name in quantities])
    if len(later) < len(times):
        at_start = setup.fields(before)
        values = np.concatenate([np.stack([at_start[name] for name in quantities]), values], axis=1)
    return values


def _initial(state: State) -> Record:
    """The state before the first phase as a record."""
    record = record_room(state, 1, 0)
    for name in ("unknowns", "contents", "loads", "crossed"):
        getattr(record, name)[0] = getattr(state, name)
    record.filled[0] = 1
    return record


def _unknown_quantity(name: str, known: Sequence[str]) -> Problem:
    near = nearest_name(name, known)
    hint = f"did you mean {near}?" if near else f"there are {', '.join(known)}"
    return Problem("quantity", name, f"is no history of this case; {hint}")
