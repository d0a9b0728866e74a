"""The grid of a column in the stress-free solid; it moves with the solid.

With J the volume ratio of each cell, the current width of a cell is J times its reference width, so volume is conserved
to rounding. The stretch of a face is the current distance between the points on either side of it (two cell centres, or
an end and a cell centre) over the reference distance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fvswell.numerics.graded_grid import graded_widths
from fvswell.physics.tissue import Array

__all__ = ["ColumnGrid", "column_grid", "grid_of_widths"]


class ColumnGrid(NamedTuple):
    """Reference geometry of a column of ``n`` cells; face i lies below cell i, face n above the last."""

    widths: Array  # (n,) mm
    centres: Array  # (n,) mm
    nodes: Array  # (n + 1,) mm
    metric: Array  # (5, n + 1), see `fvswell.column.balances`

    def face_stretch(self, J: Array) -> Array:
        """Stretch of the faces ``(..., n + 1)`` from the volume ratios of the cells ``(..., n)``."""
        stretch = np.empty((*J.shape[:-1], J.shape[-1] + 1))
        stretch[..., :-1] = self.metric[2, :-1] * J
        stretch[..., -1] = 0.0
        stretch[..., 1:] += self.metric[1, 1:] * J
        return stretch


def column_grid(height: float, cells: int, grading: float) -> ColumnGrid:
    """Make the grid of a column of the given reference height (mm), finest at x = 0."""
    return grid_of_widths(graded_widths(height, cells, grading))


def grid_of_widths(widths: Array) -> ColumnGrid:
    """Make the grid of cells of given widths (mm), from x = 0 on."""
    nodes = np.concatenate([[0.0], np.cumsum(widths)])
    halves = np.concatenate([[0.0], 0.5 * widths, [0.0]])
    below, above = halves[:-1], halves[1:]
    distance = below + above
    inner = np.full(len(nodes), 0.5)
    inner[[0, -1]] = 0.0
    return ColumnGrid(
        widths, 0.5 * (nodes[1:] + nodes[:-1]), nodes,
        np.stack([distance, below / distance, above / distance, inner, inner]),
    )  # fmt: skip
