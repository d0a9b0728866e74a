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

__all__ = [
    "STRAIN",
    "AnyLoad",
    "Load",
    "Protocol",
    "Sine",
    "TableLoad",
    "finding",
    "load_slope",
    "load_value",
    "make_protocol",
]

START, TARGET, SINCE, OVER, AMPLITUDE, FREQUENCY = range(6)  # columns of Protocol.table
STRAIN = -1  # of Protocol.measured

_STRAIGHT = 1e-9  # slopes that differ by less of themselves are one
_STEPS_PER_PERIOD = 12  # at least: a small sine on a large load would else be lost in the tolerance


class Load(NamedTuple):
    """A load in one phase: from where it is to ``target`` in the time ``over``, there at once by default."""

    target: float
    over: float = 0.0

    def corners(self) -> list[float]:
        """Times at which the load turns, s since the phase began."""
        return [self.over] if self.over > 0.0 else []

    def rows(self, ends: Array) -> Array:
        """Rows of the table, (segments, 6), for segments that end at these times."""
        rows = np.zeros((len(ends), 6))
        ramping = ends <= self.over
        rows[:, START] = np.where(ramping, np.nan, self.target)
        rows[:, TARGET] = self.target
        rows[:, OVER] = np.where(ramping, self.over, 0.0)
        return rows

    @property
    def longest_step(self) -> float:
        """Longest step that resolves the load, s."""
        return np.inf


class TableLoad(NamedTuple):
    """A load in one phase that is linear between points, and stays at the last one.

    If the first point is later than the start of the phase, it is reached on a ramp.
    """

    times: Array  # (points,) s since the phase began, increasing
    values: Array  # (points,)

    def corners(self) -> list[float]:
        """Times at which the load turns, s since the phase began."""
        times, slopes = self.times, np.diff(self.values) / np.diff(self.times)
        larger = np.maximum(np.abs(slopes[1:]), np.abs(slopes[:-1]))
        turning = np.flatnonzero(np.abs(np.diff(slopes)) > _STRAIGHT * larger) + 1
        at = np.unique([0, *turning, len(times) - 1])
        corners: list[float] = times[at].tolist()
        return [time for time in corners if time > 0.0]

    def rows(self, ends: Array) -> Array:
        """Rows of the table, (segments, 6), for segments that end at these times."""
        corners = np.array(self.corners())
        knots = np.concatenate([self.times[:1], corners[corners > self.times[0]]])
        values = self.values[np.searchsorted(self.times, knots)]
        after = np.searchsorted(knots, ends)  # knot at the end of the piece that holds each segment
        rows = np.zeros((len(ends), 6))
        first, last = after == 0, after == len(knots)
        between = ~first & ~last
        rows[:, START] = rows[:, TARGET] = values[-1]
        rows[first, START], rows[first, TARGET], rows[first, OVER] = np.nan, values[0], knots[0]
        piece = after[between]
        rows[between, START], rows[between, TARGET] = values[piece - 1], values[piece]
        rows[between, SINCE], rows[between, OVER] = knots[piece - 1], knots[piece] - knots[piece - 1]
        return rows

    @property
    def target(self) -> float:
        """Value that it ends with."""
        return float(self.values[-1])

    @property
    def longest_step(self) -> float:
        """Longest step that resolves the load, s: none ends beyond a corner."""
        return np.inf


class Sine(NamedTuple):
    """A load in one phase, mean + amplitude sin(2 pi t/period)."""

    mean: float
    amplitude: float
    period: float  # s

    @property
    def target(self) -> float:
        """Value that it swings about."""
        return self.mean

    def corners(self) -> list[float]:
        """None."""
        return []

    def rows(self, ends: Array) -> Array:
        """Rows of the table, (segments, 6), for segments that end at these times."""
        row = [self.mean, self.mean, 0.0, 0.0, self.amplitude, 2.0 * np.pi / self.period]
        return np.tile(row, (len(ends), 1))

    @property
    def longest_step(self) -> float:
        """Longest step that resolves the load, s."""
        return self.period / _STEPS_PER_PERIOD


AnyLoad = Load | TableLoad | Sine


class Protocol(NamedTuple):
    """Segments of the phases of a run, and when outputs are due."""

    phase: Any  # (segments,) index of the phase
    end: Any  # (segments,) s since the phase began
    table: Any  # (segments, loads, 6), see the head of this module
    longest_step: Any  # (segments,) s, that resolves the loads
    extent: Any  # (loads,) how far each load goes, as far as that is known
    slope_matters: Any  # (loads,) whether the rates of the contents depend on the slope of the load
    duration: Any  # (phases,) s; found by the run where ``multiple`` or ``until`` is given
    phase_start: Any  # (phases,) s since the run began; set by the run
    output_times: Any  # (times,) s since the run began, increasing
    multiple: Any  # (phases,) relaxation times that a phase lasts; nan where its duration is given
    equilibrium_strain: Any  # (phases,) that a relaxation goes to
    fraction: float  # of the way to it, at which a relaxation time ends
    until: Any  # (phases,) 1/s of what is measured: the phase is over when it changes more slowly; nan for no such end
    measured: Any  # (phases,) index of the load that is measured there, or STRAIN
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
    phases: Sequence[Sequence[AnyLoad | None]],
    duration: Sequence[float],
    output_times: Sequence[float] | Array = (),
    multiple: Sequence[float] | None = None,
    equilibrium_strain: Sequence[float] | None = None,
    fraction: float = 0.99,
    slope_matters: Sequence[bool] | None = None,
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
    slope_matters
        For each load, whether the rates of the contents depend on how fast it changes, as they do on that of a
        displacement: they are then found anew at its corners. Without it, all.
    """
    count = len(phases)
    of_phase, ends, rows, longest = [], [], [], []
    for p, loads in enumerate(phases):
        given = [load for load in loads if load is not None]
        corners = {corner for load in given for corner in load.corners() if corner < duration[p]}
        end = np.array([*sorted(corners), duration[p]])
        of_phase.append(np.full(len(end), p))
        ends.append(end)
        rows.append(np.stack([_found(end) if load is None else load.rows(end) for load in loads], axis=1))
        longest.append(np.full(len(end), min([load.longest_step for load in given], default=np.inf)))
    table = np.concatenate(rows)
    matters = [True] * table.shape[1] if slope_matters is None else slope_matters
    multiples = np.full(count, np.nan) if multiple is None else np.array(multiple, dtype=float)
    rest = np.full(count, np.nan) if equilibrium_strain is None else np.array(equilibrium_strain, dtype=float)
    return Protocol(
        phase=np.concatenate(of_phase), end=np.concatenate(ends), table=table,
        longest_step=np.concatenate(longest), extent=_extents(table), slope_matters=np.array(matters),
        duration=np.array(duration, dtype=float), phase_start=np.zeros(count),
        output_times=np.array(output_times, dtype=float), multiple=multiples, equilibrium_strain=rest,
        fraction=fraction, until=np.full(count, np.nan), measured=np.full(count, STRAIN),
        last_phase=_last_found(multiples),
    )  # fmt: skip


def finding(protocol: Protocol, until: Sequence[float], measured: Sequence[int]) -> Protocol:
    """The protocol of a run that finds how long phases last which end on a rate, and ends with the last of them.

    Parameters
    ----------
    protocol
        With the longest durations that they may have.
    until
        Rates of what is measured (1/s) at which the phases end; nan for those that do not.
    measured
        Index of the load that is measured in each phase, or ``STRAIN``.
    """
    rates = np.array(until, dtype=float)
    unknown = np.fmax(rates, protocol.multiple)
    return protocol._replace(
        until=rates, measured=np.array(measured, dtype=np.int64), output_times=np.zeros(0),
        last_phase=_last_found(unknown),
    )  # fmt: skip


def _last_found(values: Array) -> int:
    """The last phase whose duration is to be found, or the last of all if none is."""
    given = np.flatnonzero(~np.isnan(values))
    return int(given[-1]) if len(given) else len(values) - 1


def _extents(table: Array) -> Array:
    """Range of each load over all segments, (loads,), the values that phases start with left out."""
    values, swing = table[:, :, [START, TARGET]], np.abs(table[:, :, AMPLITUDE])
    low = np.nanmin(values, axis=2, initial=np.inf) - swing
    high = np.nanmax(values, axis=2, initial=-np.inf) + swing
    extents: Array = high.max(axis=0) - low.min(axis=0)
    return np.where(np.isfinite(extents), extents, 0.0)


def _found(ends: Array) -> Array:
    """Rows of the table for a load that is not prescribed."""
    rows = np.zeros((len(ends), 6))
    rows[:, :2] = np.nan
    return rows
