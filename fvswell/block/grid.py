"""The grid of a block of tissue: quadrilaterals in rows and columns, of any shape, graded toward chosen edges.

FiPy's mesh holds topology and reference geometry; arrays hold what the solver reads. The grid moves with the solid.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from fipy import Grid2D
from fipy.meshes.mesh2D import Mesh2D

from fvswell.block.geometry import SECTIONS, Section, polygon_volume
from fvswell.column.grid import graded_widths
from fvswell.physics.tissue import Array

__all__ = ["BlockGrid", "block_grid", "graded_nodes", "shaped_block_grid"]


@dataclass(frozen=True)
class BlockGrid:
    """Topology and reference geometry. Cells and vertices are numbered row by row, from the bottom left.

    Corners of a cell are in counterclockwise order. A face has its first cell on the left of the way from its first
    vertex to its second; the second cell is -1 at the boundary. The integration points are numbered corner by corner:
    that of corner i in cell c has the index ``i * cells + c``.
    """

    mesh: Any  # fipy.meshes.mesh2D.Mesh2D
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
        return polygon_volume(self.section, *self.vertices[:, self.cell_vertices])

    def lattice(self, of: str) -> Array:
        """Places of the "cells" or "vertices" in the rows and columns, counted in half cells, ``(2, ...)``."""
        first, more = {"vertices": (0, 1), "cells": (1, 0)}[of]
        columns, rows = (first + 2 * np.arange(count + more) for count in self.shape)
        return np.stack([np.tile(columns, len(rows)), np.repeat(rows, len(columns))]).astype(float)

    def edge_vertices(self, edge: str) -> Array:
        """Vertices on an edge."""
        return np.unique(self.face_vertices[:, self.edges[edge]])


def graded_nodes(length: float, cells: int, grading: float = 1.0, finest: Collection[str] = ()) -> Array:
    """Node coordinates from 0 to ``length``, cells in geometric progression from the finest.

    Parameters
    ----------
    length, cells
        Length in mm and number of cells.
    grading
        Largest cell over smallest.
    finest
        Ends at which the smallest cells lie: "start", "end" or both.
    """
    if unknown := set(finest) - {"start", "end"}:
        raise ValueError(f"no such end: {', '.join(sorted(unknown))}; the ends are start and end")
    if not finest:
        grading = 1.0
    if len(set(finest)) == 2:
        half = graded_widths(0.5 * length, (cells + 1) // 2, grading)
        widths = np.concatenate([half[: cells // 2], half[::-1]])
    else:
        widths = graded_widths(length, cells, grading)[:: -1 if "end" in finest else 1]
    nodes = np.concatenate([[0.0], np.cumsum(widths)])
    return length * nodes / nodes[-1]


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

    pattern = Grid2D(dx=np.ones(columns), dy=np.ones(rows))
    mesh = Mesh2D(flat, np.asarray(pattern.faceVertexIDs), np.asarray(pattern.cellFaceIDs))
    face_cells = np.ma.filled(mesh.faceCellIDs, -1)
    face_vertices = _oriented(np.asarray(mesh.faceVertexIDs), face_cells[0], cell_vertices)
    side = {"left": number[:, 0], "right": number[:, -1], "bottom": number[0], "top": number[-1]}
    on_edge = {edge: np.isin(face_vertices, ends).all(axis=0) & (face_cells[1] < 0) for edge, ends in side.items()}
    edges = {edge: np.flatnonzero(mask) for edge, mask in on_edge.items()}
    return BlockGrid(mesh, section, (columns, rows), flat, cell_vertices, face_vertices, face_cells, edges)


def _check_convex(corners: Array) -> None:
    ahead, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    turn = (ahead[0] * back[1] - ahead[1] * back[0]) / np.maximum((ahead**2).sum(axis=0), (back**2).sum(axis=0))
    bad = np.flatnonzero((turn < 1e-9).any(axis=0))
    if len(bad):
        raise ValueError(f"{len(bad)} cells of the grid are inverted or degenerate, the first is cell {bad[0]}")


def _oriented(face_vertices: Array, first_cell: Array, cell_vertices: Array) -> Array:
    """The faces' vertices in the order in which they follow each other around the first cell."""
    corners = cell_vertices[:, first_cell]
    forward = ((corners == face_vertices[0]) & (np.roll(corners, -1, axis=0) == face_vertices[1])).any(axis=0)
    return np.where(forward, face_vertices, face_vertices[::-1])
