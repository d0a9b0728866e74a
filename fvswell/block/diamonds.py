"""The diamonds around the faces of a block: how differences of potentials across and along a face follow from cells.

The diamond of a face joins the two cell centres and the two ends of the face; at the boundary, the middle of the face
stands for the missing cell. Potentials at the ends are interpolated from the cells around with constant weights:
bilinear inside, linear along a closed edge (no gradient of a potential is normal to it, as nothing flows), and the
value outside where the boundary is crossed, see `fvswell.block.outside`. Inside, they are understood as the potentials
at the points that the same weights give from the cell centres. These are the ends in the reference state, and near them
on the moved grid, so that the gradient is exact for linear fields on both; along a closed edge it is in the reference
state only, and of second order on the moved grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from fvswell.block.geometry import diamond_metric
from fvswell.block.grid import BlockGrid
from fvswell.physics.tissue import Array

__all__ = ["Diamonds", "diamonds"]


@dataclass(frozen=True)
class Diamonds:
    """The faces that are crossed and constant maps to them: from cells, and from values outside at vertices."""

    faces: Array  # (crossed,) index among the faces of the grid
    cells: Array  # (2, crossed): the cells on either side, the second -1 at the boundary
    across: sparse.csr_array  # potential of the second side less that of the first, from cells
    across_outside: sparse.csr_array  # from vertices
    along: sparse.csr_array  # potential at the second end less that at the first, from cells
    along_outside: sparse.csr_array
    mean: sparse.csr_array  # plain mean of the two cells; nothing at the boundary
    outflow: sparse.csr_array  # (cells, crossed): what leaves each cell
    places: sparse.csr_array  # (places, vertices): every place where a diamond has a point
    place_of_point: Array  # (6, crossed): of the points of `geometry.diamond_metric`
    reference_volumes: Array  # (crossed,)

    @property
    def boundary(self) -> Array:
        """Whether a face lies on the boundary, ``(crossed,)``."""
        return self.cells[1] < 0

    def local_points(self, vertices: Array) -> Array:
        """Points of every diamond, ``(2, 6, crossed)``, from the positions of the vertices ``(2, vertices)``."""
        return np.stack([(self.places @ component)[self.place_of_point] for component in vertices])

    @property
    def points(self) -> sparse.csr_array:
        """The points from vertices, ``(6 crossed, vertices)``."""
        return self.places[self.place_of_point.ravel()]


def diamonds(grid: BlockGrid, open_faces: Array) -> Diamonds:
    """Diamonds of the inner faces and of those on the boundary that are crossed, as indices among the grid's faces."""
    faces = np.sort(np.concatenate([np.flatnonzero(grid.face_cells[1] >= 0), open_faces]))
    first, second = grid.face_cells[:, faces]
    ends = grid.face_vertices[:, faces]
    outside = second < 0

    n_vertices = grid.vertices.shape[1]
    outer = np.zeros(n_vertices, dtype=bool)
    outer[grid.face_vertices[:, open_faces]] = True
    weights, inner = _interpolation(grid)
    weights = sparse.diags_array(np.where(outer, 0.0, 1.0)) @ weights
    to_outside = sparse.diags_array(np.where(outer, 1.0, 0.0)).tocsr()

    pick_first = _selection(first, grid.cells)
    pick_second = _selection(second, grid.cells)
    ends_vertices = [_selection(end, n_vertices) for end in ends]
    middle = sparse.diags_array(np.where(outside, 0.5, 0.0)) @ (ends_vertices[0] + ends_vertices[1])
    # places: centres of cells, middles of faces on the boundary, vertices, and what stands for vertices in the inside
    from_corners = _corner_mean(grid)
    inside = sparse.diags_array(np.where(inner & ~outer, 1.0, 0.0))
    vertex = sparse.eye_array(n_vertices)
    places = sparse.vstack(
        [from_corners, middle.tocsr()[outside], vertex, vertex - inside + inside @ weights @ from_corners], format="csr"
    )
    middles = grid.cells + np.cumsum(outside) - 1
    first_vertex = grid.cells + np.count_nonzero(outside)
    place_of_point = np.stack(
        [first, np.where(outside, middles, second), *(ends + first_vertex), *(ends + first_vertex + n_vertices)]
    )
    local = np.stack([(places @ component)[place_of_point] for component in grid.vertices])
    along = ends_vertices[1] - ends_vertices[0]
    return Diamonds(
        faces=faces,
        cells=np.stack([first, second]),
        across=(pick_second - pick_first).tocsr(),
        across_outside=middle.tocsr(),
        along=_clean(along @ weights),
        along_outside=_clean(along @ to_outside),
        mean=(sparse.diags_array(np.where(outside, 0.0, 0.5)) @ (pick_first + pick_second)).tocsr(),
        outflow=(pick_first - pick_second).T.tocsr(),
        places=places,
        place_of_point=place_of_point,
        reference_volumes=np.ascontiguousarray(diamond_metric(grid.section, *local)[0]),
    )


def _selection(index: Array, columns: int) -> sparse.csr_array:
    """Matrix that picks entries; -1 picks nothing."""
    chosen = np.flatnonzero(index >= 0)
    return sparse.csr_array((np.ones(len(chosen)), (chosen, index[chosen])), shape=(len(index), columns))


def _corner_mean(grid: BlockGrid) -> sparse.csr_array:
    """Cell centres from vertices."""
    rows = np.tile(np.arange(grid.cells), 4)
    shape = (grid.cells, grid.vertices.shape[1])
    return sparse.csr_array((np.full(rows.size, 0.25), (rows, grid.cell_vertices.ravel())), shape=shape)


def _clean(matrix: sparse.csr_array) -> sparse.csr_array:
    matrix = matrix.tocsr()
    matrix.data[np.abs(matrix.data) < 1e-14] = 0.0  # weights that cancel along an edge
    matrix.eliminate_zeros()
    return matrix


def _interpolation(grid: BlockGrid) -> tuple[sparse.csr_array, Array]:
    """Weights of the cells at each vertex (vertices, cells), and which vertices are inside."""
    columns, rows = grid.shape
    cell = np.arange(grid.cells).reshape(rows, columns)
    vertex = np.arange(grid.vertices.shape[1]).reshape(rows + 1, columns + 1)
    around = np.stack([cell[:-1, :-1], cell[:-1, 1:], cell[1:, 1:], cell[1:, :-1]]).reshape(4, -1)
    inside = vertex[1:-1, 1:-1].ravel()
    parts = [(inside, around, _bilinear_weights(grid.centres[:, around], grid.vertices[:, inside]))]
    for corner in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
        parts.append((vertex[corner][None], cell[corner][None, None], np.ones((1, 1))))  # noqa: PERF401
    for side in (np.s_[0, :], np.s_[-1, :], np.s_[:, 0], np.s_[:, -1]):
        wall, pair = vertex[side], np.stack([cell[side][:-1], cell[side][1:]])
        parts.append((wall[1:-1], pair, _linear_weights(grid.centres[:, pair], grid.vertices[:, wall])))
    at = np.concatenate([np.tile(v, len(c)) for v, c, _ in parts])
    cells = np.concatenate([c.ravel() for _, c, _ in parts])
    weights = np.concatenate([w.ravel() for _, _, w in parts])
    inner = np.zeros(vertex.size, dtype=bool)
    inner[inside] = True
    return sparse.csr_array((weights, (at, cells)), shape=(vertex.size, grid.cells)), inner


def _bilinear_weights(centres: Array, points: Array) -> Array:
    """Weights (4, points) of the corners of quadrilaterals (2, 4, points) that give points inside them."""
    a, b = np.full((2, points.shape[1]), 0.5)
    for _ in range(20):  # Newton on the bilinear map; a few steps suffice
        weights = np.stack([(1 - a) * (1 - b), a * (1 - b), a * b, (1 - a) * b])
        gap = points - (weights * centres).sum(axis=1)
        by_a = (1 - b) * (centres[:, 1] - centres[:, 0]) + b * (centres[:, 2] - centres[:, 3])
        by_b = (1 - a) * (centres[:, 3] - centres[:, 0]) + a * (centres[:, 2] - centres[:, 1])
        determinant = by_a[0] * by_b[1] - by_a[1] * by_b[0]
        a = a + (gap[0] * by_b[1] - gap[1] * by_b[0]) / determinant
        b = b + (by_a[0] * gap[1] - by_a[1] * gap[0]) / determinant
    return np.stack([(1 - a) * (1 - b), a * (1 - b), a * b, (1 - a) * b])


def _linear_weights(pairs: Array, wall: Array) -> Array:
    """Weights (2, points) of two cell centres (2, 2, points) at the inner ones of the vertices along an edge."""
    tangent = wall[:, 2:] - wall[:, :-2]
    span = (tangent * (pairs[:, 1] - pairs[:, 0])).sum(axis=0)
    share = (tangent * (wall[:, 1:-1] - pairs[:, 0])).sum(axis=0) / span
    return np.stack([1.0 - share, share])
