"""How long phases last that are told in relaxation times.

The relaxation time of a phase is the time in which the biphasic-swelling model, run through the protocol, covers a
given fraction (99 % unless the case says otherwise) of the way from the strain at the start of the phase to the
strain at rest under the phase's loads (Wilson et al. 2005 relate their durations to it, without a criterion).
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from fvswell.case.case import Case
from fvswell.case.errors import Problem, shown
from fvswell.case.values import Ramp, RelaxationTimes
from fvswell.numerics.protocol import Drive, Protocol
from fvswell.numerics.time_stepping import Marcher, State, Step
from fvswell.physics.models import BIPHASIC_SWELLING
from fvswell.physics.tissue import Array
from fvswell.simulation.column_batch import ColumnBatch

__all__ = ["overlong_ramps", "phase_durations", "unrelaxed_phase"]

_TOLERANCE = 1e-4  # of the largest strain, in each step
_PATIENCE = 100.0  # consolidation times after which a sample that has not relaxed never will


def phase_durations(cases: Sequence[Case]) -> Array:
    """Durations of the phases of cases that share grid and phases, ``(rows, phases)``, s.

    Rows whose biphasic-swelling model fails or does not relax get nan.
    """
    told = [[phase.duration for phase in case.phase] for case in cases]
    duration = np.array([[d if isinstance(d, float) else np.nan for d in row] for row in told])
    multiple = np.array([[d.multiple if isinstance(d, RelaxationTimes) else np.nan for d in row] for row in told])
    relative = np.flatnonzero(~np.isnan(multiple).all(axis=0))
    if not len(relative):
        return duration
    batch = ColumnBatch.of(cases, BIPHASIC_SWELLING)
    state = batch.start()
    for p in range(relative[-1] + 1):
        watch = _Relaxation(batch, state, p, multiple[:, p], last=p == relative[-1])
        start = deepcopy(state)
        limit = np.where(np.isnan(multiple[:, p]), duration[:, p], _PATIENCE * batch.consolidation_time())
        watch.march(_marcher(batch, state, p, limit))
        duration[:, p] = np.where(np.isnan(multiple[:, p]), duration[:, p], multiple[:, p] * watch.times)
        if watch.overran:  # a phase shorter than the step that told its length: once more, known now
            state = start
            _marcher(batch, state, p, np.nan_to_num(duration[:, p], nan=1.0)).run()
    return duration


def unrelaxed_phase(case: Case, duration: Array) -> str:
    """What to tell of a case whose durations ``(phases,)`` were not all found; nothing if they were."""
    unknown = np.flatnonzero(~np.isfinite(duration))
    if not len(unknown):
        return ""
    name = case.phase[unknown[0]].name
    return f"the biphasic-swelling model does not relax in phase {name}; give its duration in s"


def overlong_ramps(case: Case, duration: Array) -> list[Problem]:
    """Ramps that outlast their phases, whose durations ``(phases,)`` were found."""
    return [
        Problem(f"phase[{phase.name}].{key}", shown(load._asdict()), load.longer_than(length))
        for phase, length in zip(case.phase, duration.tolist(), strict=True)
        for key, load in phase
        if isinstance(load, Ramp) and load.over > length
    ]


def _marcher(batch: ColumnBatch, state: State, phase: int, duration: Array) -> Marcher:
    """Ready to run one phase from a state, which it moves on."""
    drives = {
        name: Drive(drive.target[:, phase, None], drive.over[:, phase, None]) for name, drive in batch.drives().items()
    }
    over = np.sort(np.concatenate([drive.over for drive in drives.values()], axis=1), axis=1)
    protocol = Protocol(duration[:, None].copy(), drives, (over,))
    state.phase[:], state.time[:], state.elapsed[:] = 0, 0.0, 0.0
    return Marcher(batch.system, protocol, batch.error_control(_TOLERANCE), state)


class _Relaxation:
    """Observer that finds the relaxation times of a phase, and ends it the given multiple of them after its start."""

    def __init__(self, batch: ColumnBatch, state: State, phase: int, multiple: Array, last: bool) -> None:
        self.multiple, self.last = multiple, last
        self.overran = False
        self.height = state.loads["height"].copy()
        self.way = batch.equilibrium_heights()[:, phase] - self.height
        fraction = np.array([case.time.relaxation_fraction for case in batch.cases])
        self.threshold = self.height + fraction * self.way
        self.times = np.full(len(self.way), np.nan)
        self.time, self.rate = np.zeros(len(self.way)), np.full(len(self.way), np.nan)  # of the last step's end

    def march(self, marcher: Marcher) -> None:
        """Run the phase."""
        self.marcher = marcher
        marcher.observers = [self]
        marcher.run()

    def __call__(self, state: State, step: Step) -> None:
        rows = step.rows
        height, rate, time = state.loads["height"][rows], state.fluxes[0, rows, 0], state.elapsed[rows]
        crossed = ((height - self.threshold[rows]) * self.way[rows] >= 0.0) & (self.way[rows] != 0.0)
        for i in np.flatnonzero(crossed & np.isnan(self.times[rows]) & ~np.isnan(self.multiple[rows])):
            row = int(rows[i])
            self.times[row] = self._crossing(row, time[i], height[i], rate[i])
            end = self.multiple[row] * self.times[row]
            if self.last or end <= time[i]:
                self.overran |= not self.last
                self.marcher.stop(row)
            else:
                self.marcher.protocol.duration[row, 0] = end
        self.time[rows], self.height[rows], self.rate[rows] = time, height, rate

    def _crossing(self, row: int, time: float, height: float, rate: float) -> float:
        """When the height passed the threshold within the step that ends now: a cubic through heights and rates."""
        ends, heights = (self.time[row], time), (self.height[row], height)
        slopes = (self.rate[row], rate)
        if np.isnan(slopes[0]):  # in the first step after a jump: the chord
            slopes = ((heights[1] - heights[0]) / (ends[1] - ends[0]),) * 2
        crossings = CubicHermiteSpline(ends, heights, slopes).solve(self.threshold[row], extrapolate=False)
        return float(crossings[0]) if len(crossings) else time
