"""Where local derivatives go in the Jacobian of a block: one constant sparse map to the entries of a fixed pattern.

Unknowns are the free displacements, then each potential in all cells, then those of the boundary; equations are the
momentum balances of the free displacements, then each transport balance of all cells, then the equations of the
boundary, see `fvswell.block.outside`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from fvswell.block.diamonds import Diamonds
from fvswell.block.displacements import DegreesOfFreedom
from fvswell.block.grid import BlockGrid
from fvswell.block.outside import Outside
from fvswell.block.transport import TransportSlopes
from fvswell.physics.tissue import Array

__all__ = ["JacobianPattern", "LocalDerivatives"]

_FluxPart = tuple[Array, int, sparse.csr_array]  # unknowns, what they change (source), and the map to the faces


class LocalDerivatives(NamedTuple):
    """All that the Jacobian of a block consists of, views of one array. Corners and ends: all x before all y."""

    values: Array
    stiffness: Array  # (8, 8, cells): forces at the corners of cells by positions of the corners
    pressure_forces: Array  # (8, cells): by water potentials
    osmotic_forces: Array  # (8, cells): by ln a~, where ions are transported
    edge_forces: Array  # (4, 4, edge faces): forces at the ends of faces by positions of the ends
    storage: Array  # entries, volumes stored by water potentials
    transport: TransportSlopes


class JacobianPattern:
    """Rows and columns of the entries, which are fixed, and the map from local derivatives to their values."""

    def __init__(
        self, grid: BlockGrid, diamonds: Diamonds, outside: Outside, degrees_of_freedom: DegreesOfFreedom,
        edge_faces: Array, stabilisation: sparse.csr_array, balances: int,
    ) -> None:  # fmt: skip
        self._grid, self._diamonds, self._outside = grid, diamonds, outside
        self._degrees_of_freedom, self._balances = degrees_of_freedom, balances
        self._rows: list[Array] = []
        self._columns: list[Array] = []
        self._sources: list[Array] = []
        self._weights: list[Array] = []
        self._offset = 0
        self._first_outside = degrees_of_freedom.number + balances * grid.cells
        self.size = self._first_outside + outside.unknowns
        corners = degrees_of_freedom.of_vertex[:, grid.cell_vertices].reshape(8, -1)
        ends = degrees_of_freedom.of_vertex[:, grid.face_vertices[:, edge_faces]].reshape(4, -1)
        self._shapes = self._local_shapes(edge_faces.size, stabilisation.nnz)
        self._mechanics(corners, ends)
        entries = stabilisation.tocoo()
        self._add(self._potential(0)[entries.row], self._potential(0)[entries.col])
        self._storage(corners)
        self._fluxes()
        self._compress()

    def room(self) -> LocalDerivatives:
        """Arrays to be filled with derivatives."""
        sizes = [int(np.prod(shape)) for shape in self._shapes]
        values = np.zeros(sum(sizes))
        parts = np.split(values, np.cumsum(sizes)[:-1])
        views = [part.reshape(shape) for part, shape in zip(parts, self._shapes, strict=True)]
        stiffness, pressure_forces, osmotic_forces, edge_forces, storage, *others = views
        return LocalDerivatives(
            values, stiffness, pressure_forces, osmotic_forces, edge_forces, storage, TransportSlopes(*others)
        )

    def within(self, first: int, last: int) -> Array:
        """Whether entries are in rows and columns from ``first`` to ``last``, without it."""
        inside: Array = (self.rows >= first) & (self.rows < last) & (self.columns >= first) & (self.columns < last)
        return inside

    def assemble(self, local: LocalDerivatives) -> Array:
        """Entries of the Jacobian in the order of the pattern."""
        entries: Array = self._scatter @ local.values
        return entries

    def _local_shapes(self, edge_faces: int, storage: int) -> list[tuple[int, ...]]:
        """Shapes of the local derivatives, in their order."""
        V, cells, faces = self._balances, self._grid.cells, len(self._diamonds.faces)
        ions = V > 1
        return [
            (8, 8, cells), (8, cells), (8 * ions, cells), (4, 4, edge_faces), (storage,), (V, 8, cells),
            (V * ions, cells), (V, int(ions), faces), (V, V, faces), (V, V, faces), (V, 12, faces),
        ]  # fmt: skip

    def _mechanics(self, corners: Array, ends: Array) -> None:
        self._add(corners[:, None], corners[None])
        self._add(corners, self._potential(0))
        if self._balances > 1:
            self._add(corners, self._potential(1))
        self._add(ends[:, None], ends[None])

    def _storage(self, corners: Array) -> None:
        balances = np.arange(self._balances)[:, None]
        self._add(self._potential(balances[..., None]), corners)
        if self._balances > 1:
            self._add(self._potential(balances), self._potential(1))

    def _fluxes(self) -> None:
        maps, V = self._diamonds, self._balances
        if V > 1:  # ln a~ at a face is the mean of the cells, on the boundary that outside
            self._add_flux([(self._potential(1), 0, maps.mean), self._from_outside(self._outside.across, 1, 0)], 1)
        for between, outside in ((maps.across, self._outside.across), (maps.along, self._outside.along)):
            inside = [(self._potential(potential), potential, between) for potential in range(V)]
            self._add_flux(inside + [self._from_outside(outside, potential, potential) for potential in range(V)], V)
        points = maps.points.tocoo()
        faces = len(maps.faces)
        point, face = divmod(points.row, faces)
        columns = self._degrees_of_freedom.of_vertex[:, points.col]
        self._add_outflow(
            np.resize(face, columns.size),
            columns=columns.ravel(),
            source=(np.arange(2)[:, None] * 6 + point).ravel(),
            weight=np.tile(points.data, 2),
            sources=12,
        )

    def _from_outside(self, values: sparse.csr_array, potential: int, source: int) -> _FluxPart:
        """How a potential at the faces follows from the unknowns of the boundary."""
        faces, first = len(self._diamonds.faces), values.shape[1] - self._outside.unknowns
        part = values[potential * faces : (potential + 1) * faces, first:]
        return self._first_outside + np.arange(self._outside.unknowns), source, part

    def _add_flux(self, parts: list[_FluxPart], sources: int) -> None:
        """Fluxes that depend on potentials."""
        entries = [(columns, source, part.tocoo()) for columns, source, part in parts]
        self._add_outflow(
            np.concatenate([part.row for *_, part in entries]),
            columns=np.concatenate([columns[part.col] for columns, _, part in entries]),
            source=np.concatenate([np.full(part.nnz, source) for _, source, part in entries]),
            weight=np.concatenate([part.data for *_, part in entries]),
            sources=sources,
        )

    def _add_outflow(self, face: Array, columns: Array, source: Array, weight: Array, sources: int) -> None:
        """What leaves the first cell of a face and enters the second; local values are (balances, sources, faces).

        It takes part in the equations of the boundary as well.
        """
        faces, entries = len(self._diamonds.faces), np.arange(len(face))
        of_face = sparse.csr_array((np.ones(len(face)), (face, entries)), shape=(faces, len(face)))
        for balance in range(self._balances):
            value = (balance * sources + source) * faces + face
            for side, sign in ((0, 1.0), (1, -1.0)):
                cell = self._diamonds.cells[side, face]
                row = np.where(cell < 0, -1, self._potential(balance)[cell])
                self._put(row, columns, value, sign * weight)
            closing = (self._outside.closing[:, balance * faces : (balance + 1) * faces] @ of_face).tocoo()
            row = self._first_outside + closing.row
            self._put(row, columns[closing.col], value[closing.col], closing.data * weight[closing.col])
        self._offset += self._balances * sources * faces

    def _potential(self, potential: int | Array) -> Array:
        """Index of a potential in all cells."""
        return self._degrees_of_freedom.number + potential * self._grid.cells + np.arange(self._grid.cells)

    def _add(self, rows: Array, columns: Array) -> None:
        """Local values, each with one place."""
        rows, columns = np.broadcast_arrays(rows, columns)
        self._put(rows.ravel(), columns.ravel(), np.arange(rows.size), np.ones(rows.size))
        self._offset += rows.size

    def _put(self, rows: Array, columns: Array, values: Array, weights: Array) -> None:
        kept = np.flatnonzero((rows >= 0) & (columns >= 0))  # a held displacement is no unknown
        self._rows.append(rows[kept].astype(np.int32))
        self._columns.append(columns[kept].astype(np.int32))
        self._sources.append((self._offset + values[kept]).astype(np.int32))
        self._weights.append(weights[kept])

    def _compress(self) -> None:
        rows, columns, sources, weights = (
            np.concatenate(part) for part in (self._rows, self._columns, self._sources, self._weights)
        )
        key, place = np.unique(columns.astype(np.int64) * self.size + rows, return_inverse=True)
        self.rows = (key % self.size).astype(np.int32)
        self.columns = (key // self.size).astype(np.int32)
        self._scatter: Any = sparse.csr_array((weights, (place, sources)), shape=(len(key), self._offset))
        for part in (self._rows, self._columns, self._sources, self._weights):
            part.clear()
