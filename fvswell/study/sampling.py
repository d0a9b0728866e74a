"""One model run for a batch of columns: strain histories at equally spaced times of every phase."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from fvswell.case.case import Case
from fvswell.numerics.time_stepping import Marcher, State, Step
from fvswell.physics.models import MODELS
from fvswell.physics.tissue import Array
from fvswell.simulation.column_batch import ColumnBatch

__all__ = ["ModelHistory", "model_history"]


@dataclass(frozen=True)
class ModelHistory:
    """What a model does in every row; nan from where a row stopped on."""

    strain: Array  # (rows, phases, samples), at equally spaced times of the phase, its end included
    equilibrium_strain: Array  # (rows, phases), under the loads that each phase ends with
    initial_height: Array  # (rows,), mm
    balance_error: Array  # (rows,)
    problem: tuple[str, ...]  # why a row is not to be used, "" where nothing is wrong


def model_history(cases: Sequence[Case], model: str, duration: Array) -> ModelHistory:
    """Run a model for cases that share grid, phases and time scheme.

    Parameters
    ----------
    cases
        One for each row.
    model
        Name of the model.
    duration
        Of the phases, s, ``(rows, phases)``.
    """
    batch = ColumnBatch.of(cases, MODELS[model])
    recorder = _HeightRecorder()
    state = batch.start()
    books = batch.books(state)
    marcher = Marcher(batch.system, batch.protocol(duration), batch.control(), state, [recorder, books])
    marcher.run()
    height = recorder.sampled(batch.initial_height, duration, cases[0].time.samples_per_phase)
    problem = [books.refusal(row) or "" for row in range(len(cases))]
    for failure in marcher.failures:
        place = f"{batch.grid.centres[failure.point]:.3g} mm from the filter"
        phase = cases[0].phase[failure.phase].name
        problem[failure.row] = f"stopped at t = {failure.elapsed:.6g} s in phase {phase}: {failure.reason(place)}"
    return ModelHistory(
        strain=height / batch.initial_height[:, None, None] - 1.0,
        equilibrium_strain=batch.equilibrium_heights() / batch.initial_height[:, None] - 1.0,
        initial_height=batch.initial_height,
        balance_error=books.largest,
        problem=tuple(problem),
    )


class _HeightRecorder:
    """Observer that keeps height and rate of every row at the ends of its steps."""

    def __init__(self) -> None:
        self._records: list[Array] = []  # (5, rows of the step): row, phase, time since it began, height, rate

    def __call__(self, state: State, step: Step) -> None:
        own = step.rows
        records = (own, state.phase[own], state.time[own], state.loads["height"][own], state.fluxes[0, own, 0])
        self._records.append(np.array(records, dtype=float))

    def sampled(self, initial: Array, duration: Array, samples: int) -> Array:
        """Heights at equally spaced times of the phases, ``(rows, phases, samples)``, nan where a row did not come to.

        Between the ends of steps by cubic Hermite interpolation, which the rates make as accurate as the steps are.
        """
        rows, phases = duration.shape
        height = np.full((rows, phases, samples), np.nan)
        fractions = np.arange(1, samples + 1) / samples
        record = np.concatenate([np.empty((5, 0)), *self._records], axis=1)
        place = (record[0] * phases + record[1]).astype(int)
        order = np.argsort(place, kind="stable")  # the steps of a row in a phase, in the order they were taken
        visited, first = np.unique(place[order], return_index=True)
        last = initial.copy()
        for index, (begin, end) in zip(visited, pairwise([*first, len(order)]), strict=True):
            row, phase = divmod(index, phases)
            own = record[2:, order[begin:end]]
            time, node_height = np.append(0.0, own[0]), np.append(last[row], own[1])
            chord = (node_height[1] - node_height[0]) / time[1]  # the rate is not known where loads jump
            spline = CubicHermiteSpline(time, node_height, np.append(chord, own[2]), extrapolate=False)
            height[row, phase] = spline(duration[row, phase] * fractions)
            last[row] = node_height[-1]
        return height
