"""What is done to the columns: phases of load, piston position and bath, each a step or a ramp.

Arrays have one row for each column and one entry for each phase, so that every column of a batch has its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fvswell.tissue import Array

__all__ = ["Drive", "Protocol"]


@dataclass(frozen=True)
class Drive:
    """A quantity that goes in each phase from where it is to ``target``, linearly in the time ``over`` (0: a step)."""

    target: Array  # (rows, phases); nan where the quantity is not driven
    over: Array  # (rows, phases), s

    def at(self, rows: Array, phase: Array, time: Array, start: Array) -> Array:
        """Value in the given rows, each in its phase at a time since the phase began, all ``(rows,)``."""
        target, over = self.target[rows, phase], self.over[rows, phase]
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(over > 0.0, np.minimum(time / over, 1.0), 1.0)
        return start + (target - start) * share


@dataclass(frozen=True)
class Protocol:
    """Phases of a batch of columns; where the pressure is not driven the height is."""

    duration: Array  # (rows, phases), s
    pressure: Drive  # on the piston, MPa
    height: Drive  # of the piston, mm
    bath: Drive  # concentration, mmol/mm3
    targets: tuple[Array, ...]  # for each phase (rows, k): times since it began that a step must end at, increasing

    @property
    def phases(self) -> int:
        """Number of phases."""
        return self.duration.shape[1]

    def is_jump(self, rows: Array, phase: Array, pressure: Array, bath: Array) -> Array:
        """Whether load or bath jump as the phase begins, from the given values, ``(rows,)``."""
        jump = np.zeros(len(rows), dtype=bool)
        for drive, value in ((self.pressure, pressure), (self.bath, bath)):
            target, over = drive.target[rows, phase], drive.over[rows, phase]
            jump |= (over == 0.0) & (target != value) & ~np.isnan(target)
        return jump

    def next_target(self, rows: Array, phase: Array, time: Array) -> Array:
        """First target after a time since the phase began, ``(rows,)``."""
        result = np.empty(len(rows))
        for p in np.unique(phase):
            own = phase == p
            targets = self.targets[p][rows[own] if len(self.targets[p]) > 1 else np.zeros(own.sum(), dtype=int)]
            ahead = np.where(targets > time[own, None], targets, np.inf)
            result[own] = ahead.min(axis=1)
        return np.minimum(result, self.duration[rows, phase])
