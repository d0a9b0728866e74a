"""What is done to the bodies of a batch: phases of loads, each a step or a ramp.

Arrays have one row for each body and one entry for each phase, so that every body of a batch has its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from fvswell.numerics.system import LoadValues
from fvswell.physics.tissue import Array

__all__ = ["SAME_TIME", "Drive", "Protocol", "output_times", "phase_targets"]

SAME_TIME = 1e-12  # of the time since the run began: times that are closer are one


@dataclass(frozen=True)
class Drive:
    """A quantity that goes in each phase from where it is to ``target``, linearly in the time ``over`` (0: a step)."""

    target: Array  # (rows, phases); nan where the quantity is not driven
    over: Array  # (rows, phases), s

    def at(self, rows: Array, phase: Array, time: Array, start: Array) -> Array:
        """Value in the given rows, each in its phase at a time since the phase began, all ``(rows,)``."""
        target, over = self.target[rows, phase], self.over[rows, phase]
        share = np.ones(len(rows))
        np.divide(time, over, out=share, where=over > time)
        return start + (target - start) * share


@dataclass(frozen=True)
class Protocol:
    """Phases of a batch: how long, what is driven, and at what times since its start a step must end."""

    duration: Array  # (rows, phases), s
    drives: dict[str, Drive]
    targets: tuple[Array, ...]  # for each phase (rows or 1, k), increasing

    @property
    def phases(self) -> int:
        """Number of phases."""
        return self.duration.shape[1]

    def prescribed(self, rows: Array, phase: Array, time: Array, start: LoadValues) -> LoadValues:
        """Driven quantities of rows at a time since their phases began; ``start`` holds all rows' values then."""
        return {name: drive.at(rows, phase, time, start[name][rows]) for name, drive in self.drives.items()}

    def jumps(self, rows: Array, phase: Array, start: LoadValues) -> Array:
        """Whether a driven quantity jumps as the phase begins, ``(rows,)``."""
        jump = np.zeros(len(rows), dtype=bool)
        for name, drive in self.drives.items():
            target = drive.target[rows, phase]
            jump |= (drive.over[rows, phase] == 0.0) & (target != start[name][rows]) & ~np.isnan(target)
        return jump

    def corners(self, rows: Array, phase: Array, time: Array) -> Array:
        """Whether a ramp ends at this time since the phase began, ``(rows,)``."""
        corner = np.zeros(len(rows), dtype=bool)
        for drive in self.drives.values():
            ended = np.abs(drive.over[rows, phase] - time) <= self.slack(rows, phase)
            corner |= ended & (time > 0.0) & ~np.isnan(drive.target[rows, phase])
        return corner

    def slack(self, rows: Array, phase: Array) -> Array:
        """How far apart two times in a phase may be and still are one, ``(rows,)``."""
        return SAME_TIME * np.cumsum(self.duration[rows], axis=1)[np.arange(len(rows)), phase]

    def next_target(self, rows: Array, phase: Array, time: Array) -> Array:
        """First time after this one, since the phase began, that a step must end at, ``(rows,)``."""
        result = self.duration[rows, phase]
        for p in np.unique(phase):
            own = np.flatnonzero(phase == p)
            targets = np.broadcast_to(self.targets[p], (len(self.duration), self.targets[p].shape[1]))[rows[own]]
            ahead = np.where(targets > time[own, None], targets, np.inf).min(axis=1)
            result[own] = np.minimum(result[own], ahead)
        return result


def phase_targets(
    duration: Array, drives: Iterable[Drive], fixed_steps: int | None, times: Sequence[float]
) -> tuple[Array, ...]:
    """Times since each phase began that a step must end at, (rows, k) for each phase, increasing.

    Parameters
    ----------
    duration
        Of the phases, (rows, phases), s.
    drives
        Their ramps end where a step ends.
    fixed_steps
        Number of equal steps in a phase; None where the error chooses them.
    times
        Output times since the run began, s.
    """
    fractions = np.arange(1, (fixed_steps or 1) + 1) / (fixed_steps or 1)
    ramps = [drive.over for drive in drives]
    targets = []
    for p in range(duration.shape[1]):
        steps, ramp_ends = duration[:, p, None] * fractions, (over[:, p, None] for over in ramps)
        every = np.sort(np.concatenate([steps, *ramp_ends, output_times(times, duration, p)], axis=1), axis=1)
        slack = SAME_TIME * duration[:, : p + 1].sum(axis=1)[:, None]
        every[:, 1:] = np.where(every[:, 1:] > every[:, :-1] + slack, every[:, 1:], np.inf)
        targets.append(np.sort(every, axis=1))
    return tuple(targets)


def output_times(times: Sequence[float], duration: Array, phase: int) -> Array:
    """Times since the run began that lie within a phase, told since it began, (rows, times); inf for the others.

    What lies at the end of a phase, to rounding, belongs to it and not to the next.
    """
    began, length = duration[:, :phase].sum(axis=1)[:, None], duration[:, phase, None]
    since = np.array(times, dtype=float) - began
    slack = SAME_TIME * (began + length)
    since = np.where(np.abs(since - length) <= slack, length, since)
    return np.where((since > slack) & (since <= length), since, np.inf)
