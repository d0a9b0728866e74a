"""When a run writes its results, where that does not depend on its steps."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fvswell.case.loads import Sine, TableLoad, settled, shape_of
from fvswell.case.phases import Phase
from fvswell.case.schema import CaseTable
from fvswell.physics.tissue import Array

__all__ = ["output_times"]

_CLOSE_TIMES = 16  # in the part of a phase that follows a jump or the end of a ramp
_CLOSEST = 1e-3  # the first of them, of that part
_IN_A_PERIOD = 16  # outputs in each period of a sine, at least
_SAME = 1e-9  # of the duration of a phase


def output_times(case: CaseTable, durations: Sequence[float]) -> Array:
    """Times of the outputs after the start, s since the run began, increasing.

    Parameters
    ----------
    case
        With its ``output``.
    durations
        Of the phases, s.

    Returns
    -------
    array
        None of it before the run or beyond its end; empty where results are written every so many steps.
    """
    if case.output.per_phase is not None:
        starts = np.cumsum([0.0, *durations])
        return np.concatenate(
            [start + _within(phase, duration, case.output.per_phase)
             for start, phase, duration in zip(starts, case.phase, durations, strict=False)]
        )  # fmt: skip
    return np.array([time for time in case.output.times or () if time > 0.0])


def _within(phase: Phase, duration: float, parts: int) -> Array:
    """Ends of equal parts of a phase, and times in geometric progression after its start and the end of each change.

    What follows a jump goes as the root of the time since, at first.
    """
    shapes = [shape_of(load) for _, load in phase.all_loads()]
    corners = {rest for shape in shapes if 0.0 < (rest := settled(shape)) < duration}
    tables = [shape.times for shape in shapes if isinstance(shape, TableLoad) and len(shape.times) <= parts]
    periods = [duration / shape.period for shape in shapes if isinstance(shape, Sine)]
    parts = max(parts, math.ceil(_IN_A_PERIOD * max(periods, default=0.0)))
    close = duration / parts * np.append(0.0, np.geomspace(_CLOSEST, 1.0, _CLOSE_TIMES, endpoint=False))
    even = duration * (np.arange(1, parts + 1) / parts)  # the last of them is the duration, to the last digit
    times = np.concatenate([even, *(corner + close for corner in (0.0, *corners)), *tables])
    times = np.unique(times[(times > 0.0) & (times <= duration)])
    return times[np.diff(times, append=np.inf) > _SAME * duration]
