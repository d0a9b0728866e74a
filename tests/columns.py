"""Columns that several tests run: cases, and the parts of the solver behind them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import fvswell
from fvswell.case.case import Case
from fvswell.column.column import Loads
from fvswell.column.transport_term import CoupledTransportTerm, Interval
from fvswell.numerics.system import Stage
from fvswell.numerics.time_stepping import Marcher, State, Step, StepControl
from fvswell.physics.models import MODELS
from fvswell.physics.tissue import Array
from fvswell.simulation.column_batch import ColumnBatch

CASES = Path(__file__).parents[1] / "cases"
NO_HINDRANCE = {"tissue.hindrance_factor": 0.0}
PHASES = {"phase.loading.duration": 600.0, "phase.unloading.duration": 600.0}


def compression(**changes: Any) -> Case:
    """Reference confined compression, phases of 600 s; changes by keys with ``__`` for the dot."""
    return _changed("confined_compression.toml", changes)


def swelling(**changes: Any) -> Case:
    """Reference free swelling, phases of 600 s."""
    return _changed("free_swelling.toml", changes)


def _changed(file: str, changes: dict[str, Any]) -> Case:
    durations = {} if "phase" in changes else PHASES
    return fvswell.load_case(CASES / file).with_changes(
        durations | {key.replace("__", "."): value for key, value in changes.items()}
    )


def single_phase(case: Case, duration: float, **loads: Any) -> Case:
    """The case with one phase of these loads."""
    return case.with_changes({"phase": [{"name": "only", "duration": duration, **loads}]})


def relaxed(case: Case, duration: float = 2e4, steps: int = 40) -> Case:
    """The case with phases so long that nothing is left to happen at their ends."""
    durations = {f"phase.{phase.name}.duration": duration for phase in case.phase}
    return case.with_changes(durations | {"time.scheme": "backward-euler", "time.steps_per_phase": steps})


def strain_at(result: xr.Dataset, times: Array) -> Array:
    """Global strain at output times."""
    return result["global_strain"].sel(time=times, method="nearest", tolerance=1e-6).values


def march(case: Case, control: StepControl | None = None, model: str | None = None) -> tuple[Marcher, list[Step]]:
    """Run a case by its parts, with a step control of one's own; its steps."""
    batch = ColumnBatch.of([case], MODELS[model or case.model])
    duration = np.array([[phase.duration for phase in case.phase]])
    steps: list[Step] = []
    marcher = Marcher(
        batch.system, batch.protocol(duration), control or batch.control(), batch.start(),
        [lambda state, step: steps.append(step)],
    )  # fmt: skip
    marcher.run()
    return marcher, steps


def moved(
    model: str, seed: int, case: Case | None = None, **changes: Any
) -> tuple[CoupledTransportTerm, Array, Interval]:
    """The term of a short graded column, a random state of it and an interval that leads there."""
    case = (case or compression()).with_changes({"geometry.cells": 12} | changes)
    batch = ColumnBatch.of([case], MODELS[model])
    state: State = batch.start()
    draw = np.random.default_rng(seed)
    unknowns = state.unknowns.copy()
    unknowns[0] += draw.uniform(-0.1, 0.1, unknowns[0].shape)
    unknowns[1:] += draw.uniform(-0.4, 0.4, unknowns[1:].shape)
    base = state.contents * draw.uniform(0.95, 1.05, state.contents.shape)
    laws = batch.system.term.laws
    interval = Interval.under(laws, base, np.array([[2.0]]), Loads(np.array([[0.1]]), np.array([[1.2e-4]])))
    return batch.system.term, unknowns, interval


def stage_of(interval: Interval) -> Stage:
    """The interval as a stage whose piston's pressure is prescribed."""
    prescribed = {
        "pressure": interval.loads.applied_pressure[:, 0], "bath": interval.loads.bath_concentration[:, 0],
        "height": np.array([np.nan]),
    }  # fmt: skip
    return Stage(interval.base, interval.duration[:, 0], prescribed)
