"""Where the parts of the boundary lie on the grid of a block: their faces and vertices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fvswell.block.grid import BlockGrid
from fvswell.boundary.parts import Part
from fvswell.boundary.sides import EDGE_AXIS
from fvswell.physics.tissue import Array

__all__ = ["SAME_PLACE", "edge_places", "faces_of_parts", "nearest_lines"]

SAME_PLACE = 1e-9  # of the length of an edge: places that are closer are one


def edge_places(grid: BlockGrid, edge: str) -> Array:
    """Places of the vertices of an edge along it, in the stress-free solid, mm."""
    places: Array = grid.vertices[1 - EDGE_AXIS[edge], grid.edge_vertices(edge)]
    return places


def nearest_lines(nodes: Array, places: Sequence[float] | Array) -> Array:
    """Indices of the grid lines at ``nodes``, which increase, that are nearest to places, ``(places,)``."""
    lines: Array = np.abs(nodes[:, None] - np.asarray(places, dtype=float)).argmin(axis=0)
    return lines


def faces_of_parts(grid: BlockGrid, parts: Sequence[Part]) -> tuple[Array, ...]:
    """Faces of each part, in the order in which they lie along their edge.

    Raises
    ------
    ValueError
        If a part begins or ends between two grid lines; all such parts in one message.
    """
    faces, problems = [], []
    for part in parts:
        places = edge_places(grid, part.edge)
        ends = np.array([part.start, min(part.end, places[-1])])
        lines = nearest_lines(places, ends)
        for end, line, verb in zip(ends, lines, ("begins", "ends"), strict=True):
            if abs(places[line] - end) > SAME_PLACE * np.ptp(places):
                problems.append(
                    f"the part {part.name} {verb} at {end:g} mm, where the grid has no line: the nearest is at "
                    f"{places[line]:g} mm"
                )
        faces.append(grid.edges[part.edge][lines[0] : lines[1]])
    if problems:
        raise ValueError("; ".join(problems))
    return tuple(faces)
