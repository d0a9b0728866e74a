"""Whether the valid values of a case of a block fit together: edges, loads, probe and times."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from fvswell.block.sides import EDGES, OUTWARD
from fvswell.case.block_schema import EdgeLoad
from fvswell.case.checks import osmotic_problems, repeated_names, times_beyond_end
from fvswell.case.errors import Finding
from fvswell.case.profiles import DepthProfile, PlaneProfile
from fvswell.case.values import Ramp, RelaxationTimes, final_value
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.tissue import Array

if TYPE_CHECKING:
    from fvswell.case.case import BlockCase

__all__ = ["check_block_case"]

_LARGEST_ASPECT_RATIO = 1e5  # of a cell
_DRIVABLE = {"pressure": ("free", "tied"), "force": ("tied",), "displacement": ("tied",)}


def check_block_case(case: BlockCase) -> Iterator[Finding]:
    """Everything wrong between the values of a case, each of which is valid by itself."""
    yield from repeated_names(case)
    yield from times_beyond_end(case)
    yield from _edge_problems(case)
    for edge in EDGES:
        yield from _load_problems(case, edge)
    geometry = case.geometry
    if geometry.probe is not None and (geometry.probe[0] > geometry.width or geometry.probe[1] > geometry.height):
        yield Finding(
            ("geometry", "probe"), f"lies outside the block, which is {geometry.width:g} mm x {geometry.height:g} mm"
        )
    x, y = (np.diff(nodes) for nodes in case.grid_nodes())
    longest = max(x.max() / y.min(), y.max() / x.min())
    if longest > _LARGEST_ASPECT_RATIO:
        yield Finding(
            ("geometry", "cells"),
            f"a cell would be {longest:.2g} times as long as wide, more than {_LARGEST_ASPECT_RATIO:g}: change the "
            "lengths of the block, the cells or their grading",
        )
    if case.assembly != "coupled-term":
        yield Finding(("assembly",), 'is for columns: a block is assembled by "coupled-term"')
    for index, phase in enumerate(case.phase):
        if isinstance(phase.duration, RelaxationTimes):
            yield Finding(("phase", index, "duration"), "relaxation times are of columns: give the duration in s")
    profiles = [(key, value) for key, value in case.tissue if isinstance(value, DepthProfile)]
    for key, _ in profiles:
        yield Finding(("tissue", key), "varies with depth: in a block give {x = [...], y = [...], value = [[...]]}")
    if not profiles:
        yield from osmotic_problems(case, case.tissue_at_points(_sampled_points(case)))


def _edge_problems(case: BlockCase) -> Iterator[Finding]:
    from fvswell.block.edges import EdgeCondition, check_edges  # takes FiPy along, which columns need not wait for

    conditions = {}
    for name in EDGES:
        edge = getattr(case.geometry.edges, name)
        conditions[name] = EdgeCondition(edge.displacement, edge.permeable)
    for problem in check_edges(case.geometry.kind == "axisymmetric", conditions):
        yield Finding(("geometry", "edges"), problem)


def _load_problems(case: BlockCase, edge: str) -> Iterator[Finding]:
    """Loads that an edge cannot take, and jumps of its displacement."""
    kind = getattr(case.geometry.edges, edge).displacement
    left: float | None = 0.0  # the displacement that the previous phase leaves, None where only a run can tell
    for index, phase in enumerate(case.phase):
        load: EdgeLoad | None = getattr(phase, edge)
        if load is None:
            left = left if index and left is not None and _held(case, edge, index) else None
            continue
        for name, edges in _DRIVABLE.items():
            if getattr(load, name) is not None and kind not in edges:
                yield Finding(
                    ("phase", index, edge, name), f"the edge is {kind}: it can be given for {' or '.join(edges)}"
                )
        given = load.displacement
        if isinstance(given, float) and (left is None or not math.isclose(given, left)):
            yield Finding(
                ("phase", index, edge, "displacement"),
                f"jumps, which needs infinite pressure: use {{ramp_to = {given:g}, over = ...}}",
            )
        left = None if given is None else final_value(given)
        inward = 0.0 if left is None else -OUTWARD[edge] * left
        if inward > 0.0 and inward >= (extent := _extent_at_rest(case, edge)):
            yield Finding(
                ("phase", index, edge, "displacement"),
                f"moves the edge through the block, which is less than {extent:.3g} mm thick at rest",
            )
        for name, ramp in load:
            if isinstance(ramp, Ramp) and isinstance(phase.duration, float) and ramp.over > phase.duration:
                yield Finding(("phase", index, edge, name), ramp.longer_than(phase.duration))


def _extent_at_rest(case: BlockCase, edge: str) -> float:
    """More than the thickness of the block at rest, mm: that of a column which swells along one axis alone."""
    thickness = case.geometry.width if edge in ("left", "right") else case.geometry.height
    if case.model == "biphasic":
        return thickness
    if any(isinstance(value, DepthProfile) for _, value in case.tissue):
        return math.inf  # told as a mistake already
    tissue = case.tissue_at_points(_sampled_points(case))
    free = equilibrium_volume_ratio(tissue, 0.0, case.bath.concentration, case.bath.osmotic_coefficient, swelling=True)
    return thickness * max(1.0, float(np.nan_to_num(free).max()))


def _sampled_points(case: BlockCase) -> Array:
    """Points to check the tissue at: the knots of all profiles and an even grid, ``(2, points)``."""
    profiles = [value for _, value in case.tissue if isinstance(value, PlaneProfile)]
    x, y = (
        np.unique(np.concatenate([np.linspace(0.0, length, 50), *(knots[knots <= length] for knots in known)]))
        for length, known in (
            (case.geometry.width, [np.asarray(profile.x) for profile in profiles]),
            (case.geometry.height, [np.asarray(profile.y) for profile in profiles]),
        )
    )
    return np.stack(np.meshgrid(x, y)).reshape(2, -1)


def _held(case: BlockCase, edge: str, phase: int) -> bool:
    """Whether the last load that an edge was given before a phase is a displacement."""
    loads = [load for earlier in case.phase[:phase] if (load := getattr(earlier, edge)) is not None]
    return bool(loads) and loads[-1].displacement is not None
