"""Cases of columns that several tests run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import xarray as xr

import fvswell
from fvswell.case.case import Case
from fvswell.physics.tissue import Array

CASES = Path(__file__).parents[1] / "cases"
NO_HINDRANCE = {"tissue.hindrance_factor": 0.0}
PHASES = {"phase.loading.duration": 600.0, "phase.unloading.duration": 600.0}
EVERY_STEP = {"time": {"scheme": "backward-euler", "steps_per_phase": 50}, "output": {"every": 1}}
CONTROLLED = {"time__scheme": "esdirk43", "time__tolerance": 1e-3}


def compression(**changes: Any) -> Case:
    """Reference confined compression, phases of 600 s in 50 steps; changes by keys with ``__`` for the dot."""
    return _changed("confined_compression.toml", changes)


def swelling(**changes: Any) -> Case:
    """Reference free swelling, phases of 600 s in 50 steps."""
    return _changed("free_swelling.toml", changes)


def _changed(file: str, changes: dict[str, Any]) -> Case:
    durations = {} if "phase" in changes else PHASES
    return fvswell.load_case(CASES / file).with_changes(
        durations | EVERY_STEP | {key.replace("__", "."): value for key, value in changes.items()}
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
    values: Array = result["global_strain"].sel(time=times, method="nearest", tolerance=1e-6).values
    return values
