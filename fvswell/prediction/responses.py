"""What a linear column answers to all that has happened at its ends: its volume, or the pressure that holds it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fvswell.exact.driven_column import Drive, DrivenColumn
from fvswell.exact.histories import Answers, Sine, kinks
from fvswell.exact.linear_swelling import LinearColumn
from fvswell.physics.tissue import Array
from fvswell.prediction.changes import Change

__all__ = ["Past", "current_response", "load_response"]


class Past(NamedTuple):
    """A change in a phase that began and ended at these times, s since the first phase began, ``(rows, 1)``."""

    start: Array
    end: Array
    change: Change


def load_response(column: DrivenColumn, time: Array, past: Sequence[Past]) -> Array:
    """Mean change of J of a column under a free piston, or change of the pressure (MPa) where it is held.

    Parameters
    ----------
    column
        About the state linearised about.
    time
        s since the first phase began, ``(rows, times)``.
    past
        Changes since the column was in equilibrium, of contents and pressure (`fvswell.prediction.changes`).

    Returns
    -------
    array
        Shape of ``time``.
    """
    own = column.column.diffusion.shape[-1]

    def free(change: Array) -> Answers:
        return _FreeVolume(column.column, change[:, :own])

    def held(change: Array) -> Answers:
        # at the filter contents follow the pressure that is found: what they change besides is the drive
        by_pressure = column.column.boundary_change(1.0) * change[:, 2:]
        drive = Drive(change[:, :own] - by_pressure, np.zeros_like(by_pressure), change[:, 0], change[:, 2])
        return column.answers("pressure", drive)

    return _superposed(held if column.held else free, time, past)


def current_response(column: DrivenColumn, time: Array, past: Sequence[Past]) -> Array:
    """The same as `load_response` by currents: changes of the current, A/mm2, ``(rows, points, 1)``."""
    unit = column.drive("filter.current")

    def by_current(change: Array) -> Answers:
        drive = unit._replace(wall=unit.wall * change)
        return column.answers("pressure" if column.held else "strain", drive)

    answer = _superposed(by_current, time, past)
    return answer if column.held else answer * column.column.volume_ratio[:, None]


@dataclass(frozen=True)
class _FreeVolume:
    """Mean change of J as the contents at the filter change, ``(rows, contents)``."""

    column: LinearColumn
    contents: Array

    def step(self, time: Array) -> Array:
        return self.column.mean_volume_change(time, self.contents)

    def ramp(self, time: Array) -> Array:
        return self.column.ramped_volume_change(time, self.contents)

    def sine(self, time: Array, angular_frequency: float, phase: Array | float) -> Array:
        nothing = np.zeros(len(self.contents))
        drive = Drive(self.contents, np.zeros_like(self.contents), nothing, nothing)
        strain = DrivenColumn(self.column).answers("strain", drive).sine(time, angular_frequency, phase)
        return strain * self.column.volume_ratio[:, None]


def _superposed(answers_to: Callable[[Array], Answers], time: Array, past: Sequence[Past]) -> Array:
    """Sum of the answers to all kinks and sines of the past."""
    total = np.zeros_like(time)
    for start, end, change in past:
        for kink in kinks(change.times, change.values):
            since = time - start - kink.time
            if np.any(kink.jump):
                total += answers_to(kink.jump).step(since)
            if np.any(kink.change_of_slope):
                total += answers_to(kink.change_of_slope).ramp(since)
        if change.oscillation is not None:
            amplitude, period = change.oscillation
            total += Sine(1.0, period, start, end).answer(answers_to(amplitude), time)
    return total
