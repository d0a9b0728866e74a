"""Small columns that run in a moment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fvswell.case.case import Case, load_case

CASES = Path(__file__).parent.parent / "cases"

SMALL = {
    "geometry.cells": 10,
    "geometry.grading": 5,
    "time.steps_per_phase": 8,
    "phase.loading.duration": 300.0,
    "phase.unloading.duration": 300.0,
}


def small_compression(**changes: Any) -> Case:
    """The reference compression on few cells in few steps; ``__`` in a name stands for a dot."""
    return _small("confined_compression", changes)


def small_swelling(**changes: Any) -> Case:
    """The reference swelling on few cells in few steps."""
    return _small("free_swelling", changes)


def impossible_compression() -> Case:
    """A piston that goes down faster than the water can leave: the run has to stop on the way."""
    return small_compression(
        model="biphasic",
        phase__loading__duration=10.0,
        phase__unloading__duration=10.0,
        phase__loading__piston_displacement={"ramp_to": -0.35, "over": 5.0},
    )


def _small(name: str, changes: dict[str, Any]) -> Case:
    named = {key.replace("__", "."): value for key, value in changes.items()}
    return load_case(CASES / f"{name}.toml").with_changes(SMALL | named)
