"""The grid of a block of tissue: quadrilaterals in rows and columns, of any shape. It moves with the solid.

Cells, vertices and faces are numbered as FiPy's Grid2D numbers them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fvswell.block.geometry import SECTIONS, Section, quadrilateral_volume
from fvswell.physics.tissue import Array

__all__ = ["BlockGrid", "block_grid", "shaped_block_grid"]


@dataclass(frozen=True)
class BlockGrid:
    """Topology and reference geometry. Cells and vertices are numbered row by row, from the bottom left.

    Corners of a cell are in counterclockwise order. Faces along x are numbered first, row by row, then those along y. A
    face has its first cell, that with the lower number, on the left of the way from its first vertex to its second; the
    second cell is -1 at the boundary. The integration points are numbered corner by corner:
    that of corner i in cell c has the index ``i * cells + c``.
    """

    section: Section
    shape: tuple[int, int]  # cells in a row, rows
    vertices: Array  # (2, vertices) mm
    cell_vertices: Array  # (4, cells)
    face_vertices: Array  # (2, faces)
    face_cells: Array  # (2, faces)
    edges: dict[str, Array]  # faces of each edge

    @property
    def cells(self) -> int:
        """Number of cells."""
        return self.cell_vertices.shape[1]

    @cached_property
    def centres(self) -> Array:
        """Means of the corners of the cells, ``(2, cells)`` mm."""
        return self.vertices[:, self.cell_vertices].mean(axis=1)

    @cached_property
    def face_centres(self) -> Array:
        """Middles of the faces, ``(2, faces)`` mm."""
        return self.vertices[:, self.face_vertices].mean(axis=1)

    @cached_property
    def volumes(self) -> Array:
        """Reference volumes of the cells, mm3 (per mm of thickness in plane strain: mm2), ``(cells,)``."""
        volumes: Array = quadrilateral_volume(self.section, *self.vertices[:, self.cell_vertices])
        return volumes

    def lattice(self, of: str) -> Array:
        """Places of the "cells" or "vertices" in the rows and columns, counted in half cells, ``(2, ...)``."""
        first, more = {"vertices": (0, 1), "cells": (1, 0)}[of]
        columns, rows = (first + 2 * np.arange(count + more) for count in self.shape)
        return np.stack([np.tile(columns, len(rows)), np.repeat(rows, len(columns))]).astype(float)

    def edge_vertices(self, edge: str) -> Array:
        """Vertices on an edge."""
        return np.unique(self.face_vertices[:, self.edges[edge]])


def block_grid(kind: str, x: Array, y: Array) -> BlockGrid:
    """Rectangular cells between the given node coordinates (mm).

    ``kind`` is "plane-strain" (x, y) or "axisymmetric" (radius, height; the left edge is the axis).
    """
    return shaped_block_grid(kind, np.stack(np.meshgrid(x, y)))


def shaped_block_grid(kind: str, vertices: Array) -> BlockGrid:
    """Grid with vertices at given places, ``(2, rows + 1, columns + 1)`` mm.

    Raises
    ------
    ValueError
        If a cell is inverted, degenerate or not convex, or a ring grid does not begin at the axis.
    """
    section = SECTIONS[kind]
    rows, columns = vertices.shape[1] - 1, vertices.shape[2] - 1
    if section.rings and vertices[0, :, 0].any():
        raise ValueError("the left edge of an axisymmetric block is the axis: it has to lie at radius 0")
    flat = vertices.reshape(2, -1)
    number = np.arange(flat.shape[1]).reshape(rows + 1, columns + 1)
    corners = [number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]]
    cell_vertices = np.stack([corner.ravel() for corner in corners])
    _check_convex(flat[:, cell_vertices])

    face_vertices, face_cells = _faces(number)
    below, beside = columns * (rows + 1), np.arange(rows) * (columns + 1)
    edges = {
        "left": below + beside, "right": below + columns + beside,
        "bottom": np.arange(columns), "top": columns * rows + np.arange(columns),
    }  # fmt: skip
    return BlockGrid(section, (columns, rows), flat, cell_vertices, face_vertices, face_cells, edges)


def _check_convex(corners: Array) -> None:
    ahead, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    turn = (ahead[0] * back[1] - ahead[1] * back[0]) / np.maximum((ahead**2).sum(axis=0), (back**2).sum(axis=0))
    bad = np.flatnonzero((turn < 1e-9).any(axis=0))
    if len(bad):
        raise ValueError(f"{len(bad)} cells of the grid are inverted or degenerate, the first is cell {bad[0]}")


def _faces(number: Array) -> tuple[Array, Array]:
    """Vertices and cells of the faces, ``(2, faces)`` each, from the numbers of the vertices in rows and columns."""
    rows, columns = number.shape[0] - 1, number.shape[1] - 1
    cell = np.arange(rows * columns).reshape(rows, columns)
    below, left = np.full((rows + 1, columns), -1), np.full((rows, columns + 1), -1)
    above, right = below.copy(), left.copy()
    below[1:], above[:-1], left[:, 1:], right[:, :-1] = cell, cell, cell, cell
    cells = np.stack([np.concatenate([a.ravel(), b.ravel()]) for a, b in ((below, left), (above, right))])
    ends = [
        np.concatenate([along_x.ravel(), along_y.ravel()])
        for along_x, along_y in ((number[:, 1:], number[:-1]), (number[:, :-1], number[1:]))
    ]
    outside = cells[0] < 0  # the only cell comes first, and the way turns round
    return np.where(outside, ends[::-1], ends), np.where(outside, cells[::-1], cells)
