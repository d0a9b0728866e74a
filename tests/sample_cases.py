"""Cases that several tests use: small ones, which run in a moment, and ones that cannot be run to their end."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fvswell.case.case import Case, load_case

CASES = Path(__file__).parent.parent / "cases"

_EQUAL_STEPS = {"time.scheme": "backward-euler", "time.steps_per_phase": 8}
_COLUMN = _EQUAL_STEPS | {
    "geometry.cells": 10,
    "geometry.grading": 5,
    "phase.loading.duration": 300.0,
    "phase.unloading.duration": 300.0,
}
_BLOCK = _EQUAL_STEPS | {
    "geometry.cells": [5, 4],
    "time.steps_per_phase": 5,
    "phase.swelling.duration": 2e4,
    "phase.compression.duration": 2e4,
}


def small_compression(**changes: Any) -> Case:
    """The reference compression on few cells in few equal steps; ``__`` in a name stands for a dot."""
    return _small("confined_compression", _COLUMN, changes)


def small_swelling(**changes: Any) -> Case:
    """The reference swelling on few cells in few equal steps."""
    return _small("free_swelling", _COLUMN, changes)


def small_block(**changes: Any) -> Case:
    """The glued block on few cells in few equal steps."""
    return _small("plane_strain", _BLOCK, changes)


def impossible_compression() -> Case:
    """A piston that goes down faster than the water can leave: the run has to stop on the way."""
    return small_compression(
        model="biphasic",
        phase__loading__duration=10.0,
        phase__unloading__duration=10.0,
        phase__loading__piston__displacement={"ramp_to": -0.35, "over": 5.0},
    )


def inverting_block() -> Case:
    """A block under a plate that goes down faster than water can leave: cells at its free edge collapse."""
    return small_block(
        model="biphasic",
        phase__compression__duration=100.0,
        phase__compression__top={"displacement": {"ramp_to": -4.5, "over": 50.0}},
    )


def _small(name: str, small: dict[str, Any], changes: dict[str, Any]) -> Case:
    named = {key.replace("__", "."): value for key, value in changes.items()}
    return load_case(CASES / f"{name}.toml").with_changes(small | named)
