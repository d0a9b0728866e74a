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

from fvswell.case import Case
from fvswell.case_values import RelaxationTimes
from fvswell.column_batch import ColumnBatch
from fvswell.models import BIPHASIC_SWELLING
from fvswell.protocol import Drive, Protocol
from fvswell.time_stepping import Marcher, State, Step
from fvswell.tissue import Array

__all__ = ["phase_durations"]

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
        if p in relative:
            times = _relaxation_times(batch, state, p)
            duration[:, p] = np.where(np.isnan(multiple[:, p]), duration[:, p], multiple[:, p] * times)
        if p < relative[-1]:
            _marcher(batch, state, p, np.nan_to_num(duration[:, p], nan=1.0)).run()
    return duration


def _marcher(batch: ColumnBatch, state: State, phase: int, duration: Array) -> Marcher:
    """Ready to run one phase from a state, which it moves on."""
    drives = {
        name: Drive(drive.target[:, phase, None], drive.over[:, phase, None]) for name, drive in batch.drives().items()
    }
    over = np.sort(np.concatenate([drive.over for drive in drives.values()], axis=1), axis=1)
    protocol = Protocol(duration[:, None], drives, (over,))
    state.phase[:], state.time[:], state.elapsed[:] = 0, 0.0, 0.0
    return Marcher(batch.system, protocol, batch.error_control(_TOLERANCE), state)


def _relaxation_times(batch: ColumnBatch, state: State, phase: int) -> Array:
    """Relaxation time of a phase that begins at a state, (rows,); nan where there is none."""
    rest = batch.equilibrium_heights()[:, phase]
    start = state.loads["height"].copy()
    fraction = np.array([case.time.relaxation_fraction for case in batch.cases])
    threshold = start + fraction * (rest - start)
    times = np.full(len(rest), np.nan)
    trial = deepcopy(state)
    marcher = _marcher(batch, trial, phase, _PATIENCE * batch.consolidation_time())
    last_time, last_height = np.zeros(len(rest)), start.copy()
    last_rate = np.full(len(rest), np.nan)

    def watch(state: State, step: Step) -> None:
        rows = step.rows
        height, rate, time = state.loads["height"][rows], state.fluxes[0, rows, 0], state.elapsed[rows]
        for i in np.flatnonzero((height - threshold[rows]) * (rest - start)[rows] >= 0.0):
            row = rows[i]
            ends = (last_time[row], time[i])
            slopes = (last_rate[row], rate[i])
            if np.isnan(last_rate[row]):  # in the first step after a jump: the chord
                slopes = ((height[i] - last_height[row]) / (time[i] - last_time[row]),) * 2
            spline = CubicHermiteSpline(ends, (last_height[row], height[i]), slopes)
            crossings = spline.solve(threshold[row], extrapolate=False)
            times[row] = crossings[0] if len(crossings) else time[i]
            marcher.stop(row)
        last_time[rows], last_height[rows], last_rate[rows] = time, height, rate

    marcher.observers = [watch]
    marcher.run()
    return np.where(rest == start, np.nan, times)
