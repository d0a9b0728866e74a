"""Loads over time: a protocol is a row of segments in which every load follows one simple law.

Times in a phase count from its start. A load in a segment goes from ``start`` at time ``since`` linearly toward
``target``, which it reaches after ``over`` (0: it is there at once), and a sine may be added; start = nan stands for
the value that the load has as the phase begins, and target = nan for a load that is not prescribed but found.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from fvswell.compiled import point
from fvswell.physics.tissue import Array

__all__ = ["Load", "Protocol", "load_slope", "load_value", "make_protocol"]

START, TARGET, SINCE, OVER, AMPLITUDE, FREQUENCY = range(6)  # columns of Protocol.table


class Load(NamedTuple):
    """A load in one phase: from where it is to ``target`` in the time ``over``, there at once by default."""

    target: float
    over: float = 0.0


class Protocol(NamedTuple):
    """Segments of the phases of a run, and when outputs are due."""

    phase: Any  # (segments,) index of the phase
    end: Any  # (segments,) s since the phase began
    table: Any  # (segments, loads, 6), see the head of this module
    duration: Any  # (phases,) s; found by the run where ``multiple`` is given
    phase_start: Any  # (phases,) s since the run began; set by the run
    output_times: Any  # (times,) s since the run began, increasing
    multiple: Any  # (phases,) relaxation times that a phase lasts; nan where its duration is given
    equilibrium_strain: Any  # (phases,) that a relaxation goes to
    fraction: float  # of the way to it, at which a relaxation time ends
    last_phase: int  # the run is over at its end, or when its relaxation time has been found


@point
def load_value(table: Any, segment: Any, load: Any, time: Any, phase_loads: Any) -> Any:
    """Value of a load at a time since the phase began, the law of the segment continued beyond its ends."""
    start, target, over = table[segment, load, START], table[segment, load, TARGET], table[segment, load, OVER]
    if np.isnan(start):
        start = phase_loads[load]
    value = target
    if over > 0.0 and not np.isnan(target):
        value = start + (target - start) * ((time - table[segment, load, SINCE]) / over)
    if table[segment, load, AMPLITUDE] != 0.0:
        value += table[segment, load, AMPLITUDE] * np.sin(table[segment, load, FREQUENCY] * time)
    return value


@point
def load_slope(table: Any, segment: Any, load: Any, time: Any, phase_loads: Any) -> Any:
    """Derivative of `load_value` by time."""
    start, target, over = table[segment, load, START], table[segment, load, TARGET], table[segment, load, OVER]
    if np.isnan(start):
        start = phase_loads[load]
    slope = 0.0
    if over > 0.0 and not np.isnan(target):
        slope = (target - start) / over
    frequency = table[segment, load, FREQUENCY]
    if table[segment, load, AMPLITUDE] != 0.0:
        slope += table[segment, load, AMPLITUDE] * frequency * np.cos(frequency * time)
    return slope


def make_protocol(
    phases: Sequence[Sequence[Load | None]],
    duration: Sequence[float],
    output_times: Sequence[float] | Array = (),
    multiple: Sequence[float] | None = None,
    equilibrium_strain: Sequence[float] | None = None,
    fraction: float = 0.99,
) -> Protocol:
    """Protocol of a run.

    Parameters
    ----------
    phases
        For each phase, each load of the body; None for a load that is found, not prescribed.
    duration
        Of the phases, s; where ``multiple`` is given, the longest that the run may take to find it.
    output_times
        Since the run began, s, increasing.
    multiple, equilibrium_strain, fraction
        Where a duration is a number of relaxation times: that number (else nan), the strain at which the phase would be
        in equilibrium, and the fraction of the way to it that ends a relaxation time. The run ends with the last such
        phase.
    """
    of_phase: list[int] = []
    ends: list[float] = []
    table = []
    for p, loads in enumerate(phases):
        corners = sorted({load.over for load in loads if load is not None and 0.0 < load.over < duration[p]})
        for end in (*corners, duration[p]):
            of_phase.append(p)
            ends.append(end)
            table.append([_row(load, end) for load in loads])
    multiples = np.full(len(phases), np.nan) if multiple is None else np.array(multiple, dtype=float)
    relative = np.flatnonzero(~np.isnan(multiples))
    rest = np.full(len(phases), np.nan) if equilibrium_strain is None else np.array(equilibrium_strain, dtype=float)
    return Protocol(
        phase=np.array(of_phase, dtype=np.int64), end=np.array(ends), table=np.array(table),
        duration=np.array(duration, dtype=float), phase_start=np.zeros(len(phases)),
        output_times=np.array(output_times, dtype=float), multiple=multiples, equilibrium_strain=rest,
        fraction=fraction, last_phase=int(relative[-1]) if len(relative) else len(phases) - 1,
    )  # fmt: skip


def _row(load: Load | None, end: float) -> list[float]:
    """Row of the table for a load in a segment that ends at a time."""
    if load is None:
        return [np.nan, np.nan, 0.0, 0.0, 0.0, 0.0]
    ramping = end <= load.over
    return [np.nan if ramping else load.target, load.target, 0.0, load.over if ramping else 0.0, 0.0, 0.0]
