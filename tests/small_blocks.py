"""Small blocks that run in a moment."""

from __future__ import annotations

from typing import Any

from small_cases import CASES

from fvswell.case.case import BlockCase, load_case

SMALL = {
    "geometry.cells": [5, 4],
    "time.scheme": "backward-euler",
    "time.steps_per_phase": 5,
    "phase.swelling.duration": 2e4,
    "phase.compression.duration": 2e4,
}


def small_block(**changes: Any) -> BlockCase:
    """The glued block on few cells in few steps; ``__`` in a name stands for a dot."""
    named = {key.replace("__", "."): value for key, value in changes.items()}
    case = load_case(CASES / "plane_strain.toml").with_changes(SMALL | named)
    assert isinstance(case, BlockCase)
    return case


def inverting_block() -> BlockCase:
    """A block under a plate that goes down faster than water can leave: cells at its free edge collapse."""
    return small_block(
        model="biphasic",
        phase__compression__duration=100.0,
        phase__compression__top={"displacement": {"ramp_to": -4.5, "over": 50.0}},
    )
