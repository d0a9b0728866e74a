"""What a tester did, from what it recorded: ramps and holds of its drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fvswell.physics.tissue import Array

__all__ = ["Stage", "Step", "corners", "recognised", "steps_of"]

_TOLERANCE = 0.005  # of the whole way: what lies within is on a straight line
_NOISE = 4.0  # standard deviations of the recorded drive that are no corner
_HELD = 2.0  # tolerances: a stretch that moves by less is a hold
_SAME_RATE = 0.15  # relative: ramps that follow each other at one rate are one
_MOST = 40  # stages; what has more is no row of ramps and holds


@dataclass(frozen=True)
class Stage:
    """A ramp or a hold.

    Parameters
    ----------
    kind
        "ramp" or "hold".
    start, end
        Times, s.
    before, after
        The drive at its start and end.
    """

    kind: str
    start: float
    end: float
    before: float
    after: float

    @property
    def duration(self) -> float:
        """How long it lasts, s."""
        return self.end - self.start

    @property
    def rate(self) -> float:
        """Of the drive, per s."""
        return (self.after - self.before) / self.duration


@dataclass(frozen=True)
class Step:
    """A ramp and the hold that follows it, if one does."""

    start: float
    end: float
    before: float
    after: float
    over: float  # s, that the ramp takes; 0 for a hold that no ramp comes before


def recognised(times: Array, drive: Array) -> tuple[Stage, ...]:
    """Ramps and holds of a drive; none if it is no row of them, as a sine is not.

    Parameters
    ----------
    times
        s, increasing, shape (rows,).
    drive
        Position, displacement or whatever was controlled, shape (rows,).
    """
    tolerance = _tolerance(drive)
    at = corners(times, drive, tolerance)
    if len(at) - 1 > 2 * _MOST:
        return ()
    found: list[Stage] = []
    for first, last in pairwise(at):
        before, after = float(drive[first]), float(drive[last])
        held = abs(after - before) <= _HELD * tolerance
        stage = Stage("hold" if held else "ramp", float(times[first]), float(times[last]), before, after)
        if found and _continues(found[-1], stage):
            stage = Stage(stage.kind, found[-1].start, stage.end, found[-1].before, stage.after)
            found.pop()
        found.append(stage)
    return tuple(found) if len(found) <= _MOST else ()


def steps_of(stages: Sequence[Stage]) -> tuple[Step, ...]:
    """Stages by twos: each ramp with the hold after it."""
    steps: list[Step] = []
    for stage in stages:
        last = steps[-1] if steps else None
        if stage.kind == "hold" and last is not None and 0.0 < last.over == last.end - last.start:
            steps[-1] = Step(last.start, stage.end, last.before, last.after, last.over)
        else:
            over = stage.duration if stage.kind == "ramp" else 0.0
            steps.append(Step(stage.start, stage.end, stage.before, stage.after, over))
    return tuple(steps)


def corners(times: Array, values: Array, tolerance: float | None = None) -> list[int]:
    """Rows between which a curve is straight within a tolerance (Ramer 1972, Douglas & Peucker 1973)."""
    tolerance = _tolerance(values) if tolerance is None else tolerance
    kept = {0, len(times) - 1}
    open_spans = [(0, len(times) - 1)]
    while open_spans:
        first, last = open_spans.pop()
        if last - first < 2:
            continue
        inner = slice(first + 1, last)
        slope = (values[last] - values[first]) / (times[last] - times[first])
        gap = np.abs(values[inner] - values[first] - slope * (times[inner] - times[first]))
        farthest = int(gap.argmax())
        if gap[farthest] > tolerance:
            middle = first + 1 + farthest
            kept.add(middle)
            open_spans += [(first, middle), (middle, last)]
    return sorted(kept)


def _tolerance(values: Array) -> float:
    """Of straight lines: a part of the whole way, and more than the noise of neighbouring rows."""
    noise = 0.0
    if len(values) > 4:
        second = np.diff(values, 2)
        noise = float(np.median(np.abs(second)) / (0.6745 * np.sqrt(6.0)))
    return max(_TOLERANCE * float(np.ptp(values)), _NOISE * noise, 1e-300)


def _continues(last: Stage, stage: Stage) -> bool:
    if last.kind != stage.kind:
        return False
    return last.kind == "hold" or abs(stage.rate - last.rate) <= _SAME_RATE * max(abs(stage.rate), abs(last.rate))
