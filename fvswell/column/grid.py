"""The grid of a column: FiPy's mesh holds topology and reference geometry, arrays hold what the solver reads.

The grid moves with the solid. With J the volume ratio of each cell, the current width of a cell is J times its
reference width, so volume is conserved to rounding. The stretch of a face is the current distance between the
points either side of it (two cell centres, or the filter and a cell centre) over the reference distance.

FiPy's private arrays are read in this module only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from fipy import Grid1D

from fvswell.physics.tissue import Array

__all__ = ["ColumnGrid", "column_grid", "graded_widths"]


@dataclass(frozen=True)
class ColumnGrid:
    """Reference geometry of a column of cells between a filter (face 0) and a piston (the last face).

    Faces are those that water crosses: the filter and the inner faces, ``n`` in all, face i being the lower face of
    cell i. ``upper_weight`` and ``lower_weight`` give a face's stretch from the J of the cell above and below it.
    """

    mesh: Grid1D
    widths: Array  # (n,) mm
    centres: Array  # (n,) mm
    nodes: Array  # (n + 1,) mm
    distances: Array  # (n,) mm
    lower_weight: Array  # (n,)
    upper_weight: Array  # (n,)
    inner_half: Array  # (n,): one half at inner faces, nothing at the filter, for plain means

    def face_stretch(self, J: Array) -> Array:
        """Stretch of the faces, shape of ``J`` (..., n)."""
        stretch = self.upper_weight * J
        stretch[..., 1:] += self.lower_weight[1:] * J[..., :-1]
        return stretch


def graded_widths(length: float, cells: int, grading: float) -> Array:
    """Widths in geometric progression from the finest at x = 0; ``grading`` is the largest over the smallest."""
    widths = np.geomspace(1.0, grading, cells)
    return length * widths / widths.sum()


def column_grid(height: float, cells: int, grading: float) -> ColumnGrid:
    """Make the grid of a column of the given reference height (mm)."""
    mesh = Grid1D(dx=graded_widths(height, cells, grading))
    lower, upper = np.ma.filled(mesh._adjacentCellIDs, -1)
    inner = lower != upper
    if not (np.array_equal(upper[:-1], np.arange(cells)) and np.array_equal(lower[1:-1], np.arange(cells - 1))):
        raise RuntimeError("this FiPy orders the faces of a Grid1D differently; fvswell needs fipy>=4.0.3,<5")
    widths = np.array(mesh.cellVolumes)
    distances = np.array(mesh._cellDistances)[:-1]
    half = np.where(inner[:-1], 0.5, 0.0)
    return ColumnGrid(
        mesh=mesh,
        widths=widths,
        centres=np.array(mesh.cellCenters[0]),
        nodes=np.array(mesh.faceCenters[0]),
        distances=distances,
        lower_weight=half * np.roll(widths, 1) / distances,
        upper_weight=0.5 * widths / distances,
        inner_half=half,
    )
