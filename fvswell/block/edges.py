"""What holds and drives the edges of a block: conditions on displacement, drives, and where it meets the bath."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fvswell.block.grid import BlockGrid
from fvswell.boundary.parts import Mechanical
from fvswell.boundary.sides import EDGE_AXIS, EDGES
from fvswell.physics.tissue import Array

__all__ = [
    "DegreesOfFreedom",
    "EdgeCondition",
    "EdgeLoads",
    "check_edges",
    "degrees_of_freedom",
    "drive_names",
    "edge_loads",
]

_NEIGHBOURS = {edge: tuple(other for other in EDGES if EDGE_AXIS[other] != EDGE_AXIS[edge]) for edge in EDGES}


@dataclass(frozen=True)
class EdgeCondition:
    """An edge: fixed in both directions, on a roller (no normal displacement), free, or tied; open to the bath or not.

    The vertices of a tied edge share one normal displacement, so that it stays straight, and slide along it freely.
    """

    displacement: Mechanical
    permeable: bool = False


@dataclass(frozen=True)
class DegreesOfFreedom:
    """Unknown displacements: each component of each vertex moves with one of them, or is held."""

    number: int
    of_vertex: Array  # (2, vertices): index of the unknown, -1 where held
    of_tied_edge: dict[str, int]  # index of the normal displacement of a tied edge

    def displacements(self, values: Array) -> Array:
        """Displacements of the vertices ``(2, vertices)`` from the unknowns."""
        return np.append(values, 0.0)[self.of_vertex]


class EdgeLoads(NamedTuple):
    """What acts on the edges, in the order of EDGES: pressure, force, and prescribed displacement (nan: none)."""

    pressure: Array
    force: Array
    displacement: Array


def drive_names(edges: Mapping[str, EdgeCondition]) -> tuple[str, ...]:
    """Names of the quantities that a protocol may drive.

    "bath" (mmol/mm3); of a free or tied edge "EDGE.pressure" (MPa, positive in compression, normal to the edge as it
    moves); of a tied edge also "EDGE.force" (N per mm of thickness, or N on the whole disc; positive in compression)
    and "EDGE.displacement" (mm from the stress-free solid, positive along x or y).
    """
    names = ["bath"]
    for edge in EDGES:
        if edges[edge].displacement in ("free", "straight"):
            names.append(f"{edge}.pressure")
        if edges[edge].displacement == "straight":
            names += [f"{edge}.force", f"{edge}.displacement"]
    return tuple(names)


def edge_loads(names: tuple[str, ...], values: Array) -> EdgeLoads:
    """Loads of the edges from the values of the driven quantities, ``(names,)``; nan for those not prescribed.

    Raises
    ------
    ValueError
        If an edge is driven in two ways at once.
    """
    given = dict(zip(names, values, strict=True))

    def of(kind: str) -> Array:
        return np.array([given.get(f"{edge}.{kind}", np.nan) for edge in EDGES], dtype=float)

    kinds = EdgeLoads(of("pressure"), of("force"), of("displacement"))
    for edge, count in zip(EDGES, (~np.isnan(kinds)).sum(axis=0), strict=True):
        if count > 1:
            raise ValueError(f"the {edge} edge is driven in more than one way: give pressure, force or displacement")
    return kinds._replace(pressure=np.nan_to_num(kinds.pressure), force=np.nan_to_num(kinds.force))


def check_edges(rings: bool, edges: Mapping[str, EdgeCondition]) -> list[str]:
    """What is wrong with the conditions on the edges, in sentences; an empty list if nothing is.

    Parameters
    ----------
    rings
        Whether the block is axisymmetric.
    edges
        A condition for each of left, right, bottom and top.
    """
    problems = []
    if rings and (edges["left"].displacement != "roller" or edges["left"].permeable):
        problems.append("the left edge is the axis of the disc: it has to be a roller and impermeable")
    for edge, condition in edges.items():
        if condition.displacement == "straight":
            problems += [
                f"the {edge} edge is straight, but ends at the {neighbour} edge, which is fixed"
                for neighbour in _NEIGHBOURS[edge]
                if edges[neighbour].displacement == "fixed"
            ]
    free = _rigid_motions(rings, edges)
    if free:
        problems.append(
            f"nothing keeps the block from {' or '.join(free)}: make an edge fixed or a roller (a straight edge moves)"
        )
    return problems


def _rigid_motions(rings: bool, edges: Mapping[str, EdgeCondition]) -> list[str]:
    """Rigid motions that the conditions leave open, each alone."""
    fixed = any(edge.displacement == "fixed" for edge in edges.values())
    held = [
        fixed or any(edge.displacement == "roller" and EDGE_AXIS[name] == axis for name, edge in edges.items())
        for axis in (0, 1)
    ]
    turning = any(edge.displacement != "free" for edge in edges.values())
    motions = [] if held[0] or rings else ["moving along x"]
    motions += [] if held[1] else ["moving along the axis" if rings else "moving along y"]
    return motions + ([] if turning or rings else ["turning"])


def degrees_of_freedom(grid: BlockGrid, edges: Mapping[str, EdgeCondition]) -> DegreesOfFreedom:
    """Number the unknown displacements of a block."""
    of_vertex = np.arange(grid.vertices.size).reshape(grid.vertices.shape)
    for edge, condition in edges.items():
        vertices = grid.edge_vertices(edge)
        if condition.displacement == "straight":
            of_vertex[EDGE_AXIS[edge], vertices] = of_vertex[EDGE_AXIS[edge], vertices[0]]
    for edge, condition in edges.items():
        vertices = grid.edge_vertices(edge)
        if condition.displacement == "fixed":
            of_vertex[:, vertices] = -1
        elif condition.displacement == "roller":
            of_vertex[EDGE_AXIS[edge], vertices] = -1
    used, renumbered = np.unique(of_vertex, return_inverse=True)
    first = int(used[0] < 0)
    of_vertex = renumbered.reshape(of_vertex.shape) - first
    tied = {
        edge: int(of_vertex[EDGE_AXIS[edge], grid.edge_vertices(edge)[0]])
        for edge, condition in edges.items()
        if condition.displacement == "straight"
    }
    return DegreesOfFreedom(len(used) - first, of_vertex, tied)
