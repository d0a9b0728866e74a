"""One model of one case, as a study needs it: the strain at equally spaced times of every phase."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fvswell.column.balances import HEIGHT
from fvswell.physics.tissue import Array
from fvswell.simulation.column_run import ColumnRun
from fvswell.simulation.march import march_all

__all__ = ["ModelHistory", "model_history", "sample_times"]


@dataclass(frozen=True)
class ModelHistory:
    """What a model does; nan from where the run stopped on."""

    strain: Array  # (phases, samples), at equally spaced times of the phase, its end included
    equilibrium_strain: Array  # (phases,), under the loads that each phase ends with
    initial_height: float  # mm
    balance_error: float
    problem: str  # why the run is not to be used, "" where nothing is wrong


def model_history(run: ColumnRun, durations: Sequence[float]) -> ModelHistory:
    """Run a model of a case whose phases have the given durations (s); it has not been run before."""
    samples = run.case.time.samples_per_phase
    protocol = run.protocol(durations, times=sample_times(durations, samples))
    control = run.control()._replace(every=0)
    record, problem = march_all(run, protocol, control)
    outputs = int(record.filled[0])
    strain = np.full(len(durations) * samples, np.nan)
    strain[:outputs] = record.loads[:outputs, HEIGHT] / run.initial_height - 1.0
    return ModelHistory(
        strain=strain.reshape(len(durations), samples),
        equilibrium_strain=run.equilibrium_strains(),
        initial_height=run.initial_height,
        balance_error=float(record.errors[:outputs].max(initial=0.0)),
        problem=problem,
    )


def sample_times(durations: Sequence[float], samples: int) -> list[float]:
    """Equally spaced times of all phases, s since the run began."""
    shares = np.arange(1, samples + 1) / samples
    starts = np.cumsum([0.0, *durations[:-1]])
    times: list[float] = (starts[:, None] + np.array(durations)[:, None] * shares).ravel().tolist()
    return times
