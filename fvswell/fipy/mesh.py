"""FiPy's meshes of columns and blocks: of the stress-free solid, and moved with it.

FiPy computes volumes, areas and distances when a mesh is made, and keeps the old ones when its vertices are set.
`move` computes all of them again, so variables on the mesh stay what they are while it moves. Terms keep the geometry
that they were first built with, so equations have to be written anew after a move.

FiPy's private arrays and methods of meshes are touched in this module alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from fipy import FaceVariable, Grid1D, Grid2D
from fipy.meshes.mesh1D import Mesh1D
from fipy.meshes.mesh2D import Mesh2D

from fvswell.block.geometry import quadrilateral_volume
from fvswell.block.grid import BlockGrid
from fvswell.column.grid import ColumnGrid
from fvswell.physics.tissue import Array

__all__ = ["block_mesh", "column_mesh", "column_nodes", "edge_faces", "move"]


def column_nodes(grid: ColumnGrid, J: Array) -> Array:
    """Places of the nodes (cells + 1,) of a column whose cells have given volume ratios, mm; x = 0 is fixed."""
    return np.concatenate([[0.0], np.cumsum(grid.widths * J)])


def column_mesh(grid: ColumnGrid, J: Array | None = None) -> Any:
    """FiPy's mesh of a column.

    Parameters
    ----------
    grid
        Reference geometry.
    J
        Volume ratios of the cells (cells,); without them the mesh is that of the stress-free solid.

    Returns
    -------
    fipy.meshes.mesh1D.Mesh1D
        Cells and faces numbered from x = 0.
    """
    cells = len(grid.widths)
    pattern = Grid1D(dx=np.ones(cells))
    nodes = grid.nodes if J is None else column_nodes(grid, J)
    mesh = Mesh1D(nodes[None], np.asarray(pattern.faceVertexIDs), np.asarray(pattern.cellFaceIDs))
    below, above = (np.asarray(side) for side in mesh._adjacentCellIDs)
    numbers = np.arange(cells)
    if not (np.array_equal(above[:-1], numbers) and np.array_equal(below[1:], numbers)):
        raise RuntimeError("this FiPy numbers the faces of a Grid1D differently; fvswell needs fipy>=4.0.3,<5")
    return mesh


class _BlockMesh(Mesh2D):
    """A mesh whose cells and faces have the volumes and areas of a block: of a slab, or of rings about the axis."""

    def __init__(self, grid: BlockGrid, vertices: Array) -> None:
        self._grid = grid
        pattern = Grid2D(dx=np.ones(grid.shape[0]), dy=np.ones(grid.shape[1]))
        super().__init__(vertices, np.asarray(pattern.faceVertexIDs), np.asarray(pattern.cellFaceIDs))

    def _calcFaceAreas(self) -> Array:
        areas: Array = super()._calcFaceAreas() * self._grid.section.thickness(self._faceCenters[0])
        return areas

    def _calcCellVolumes(self) -> Array:
        x, y = self.vertexCoords[:, self._grid.cell_vertices]
        volumes: Array = quadrilateral_volume(self._grid.section, x, y)
        return volumes


def block_mesh(grid: BlockGrid, vertices: Array | None = None) -> Any:
    """FiPy's mesh of a block.

    Parameters
    ----------
    grid
        Topology and reference geometry.
    vertices
        Places of the vertices ``(2, vertices)`` mm; without them the mesh is that of the stress-free solid.

    Returns
    -------
    fipy.meshes.mesh2D.Mesh2D
        Cells, faces and vertices numbered as those of the grid. Volumes and areas of a disc are those of whole rings.
    """
    mesh = _BlockMesh(grid, np.array(grid.vertices if vertices is None else vertices, dtype=float))
    if not np.array_equal(np.ma.filled(mesh.faceCellIDs, -1), grid.face_cells):
        raise RuntimeError("this FiPy numbers the faces of a Grid2D differently; fvswell needs fipy>=4.0.3,<5")
    return mesh


def edge_faces(mesh: Any, grid: BlockGrid, edge: str) -> Any:
    """The faces of an edge of a block as a mask; FiPy's own `facesLeft` and the like need straight edges."""
    on_edge = np.zeros(mesh.numberOfFaces, dtype=bool)
    on_edge[grid.edges[edge]] = True
    return FaceVariable(mesh=mesh, value=on_edge)


def move(mesh: Any, vertices: Array) -> None:
    """Move the vertices of a mesh to other places, ``(dimensions, vertices)`` mm, and renew its geometry."""
    mesh.vertexCoords = np.array(vertices, dtype=float).reshape(mesh.vertexCoords.shape)
    mesh._setGeometry(scaleLength=1.0)
