"""The transport balances in the cells of a block as one coupled FiPy Term with exact derivatives.

The balance of each quantity over an interval reads, for a cell of reference volume V,

    V (content - base) + dt (sum over faces of the flux outward) = 0

with ``base`` the content the interval starts from, per reference volume, and fluxes in total per face. A flux depends
on the state at the face (volume ratio of its diamond, mean ln c~) and on the normal gradients of the potentials,
linear in their differences across and along the face. Potentials are stacked as ``(balances, 1, cells)``.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from fvswell.block.diamonds import Diamonds
from fvswell.block.geometry import diamond_metric, polygon_volume
from fvswell.block.grid import BlockGrid
from fvswell.numerics.newton_term import NewtonSystem, NewtonTerm
from fvswell.physics.differentiation import local_derivative
from fvswell.physics.models import Mixture, PointState
from fvswell.physics.tissue import Array

__all__ = ["BlockBalance", "BlockInterval", "BlockTransportTerm", "FaceState", "TransportDerivatives", "at_points"]


class BlockInterval(NamedTuple):
    """The time a balance is drawn up over: contents it starts from, length in s, and the bath at its end."""

    base: Array  # (balances, 1, cells)
    duration: float
    bath_concentration: float  # mmol/mm3


class FaceState(NamedTuple):
    """What the fluxes through the crossed faces depend on; gradients are multiplied by the areas of the faces."""

    local: PointState  # J of the diamonds and concentrations at mean ln c~, (1, crossed)
    gradients: Array  # (balances, 1, crossed): by_across * across + by_along * along
    across: Array  # (balances, crossed): differences of the potentials across the faces
    along: Array  # and along them
    by_across: Array  # (crossed,), see geometry.diamond_metric
    by_along: Array


class BlockBalance(NamedTuple):
    """Residual of the balances and what it is made of."""

    residual: Array  # (balances, 1, cells)
    contents: Array  # (balances, 1, cells), per reference volume
    fluxes: Array  # (balances, 1, crossed), in total per face
    cells: PointState  # (1, cells)
    faces: FaceState


class TransportDerivatives(NamedTuple):
    """Derivatives of the fluxes and contents by what they depend on locally, axis 0 being the balance."""

    across: Array  # (balances, potentials, crossed): fluxes by differences of potentials across the faces
    along: Array  # (balances, potentials, crossed): and along them
    log_concentration: Array  # (balances, 0 or 1, crossed): fluxes by mean ln c~ where ions are transported
    points: Array  # (balances, 12, crossed): fluxes by the points of the diamonds, all x before all y
    contents: Array  # (balances, 1 or 2, cells): contents by J and, where ions are transported, ln c~


def at_points(mixture: Mixture, index: Array) -> Mixture:
    """The mixture at a subset of its points."""
    ratio = mixture.open_circuit_ratio
    if ratio is not None and ratio.shape[1] > 1:
        ratio = ratio[:, index]
    return replace(mixture, tissue=mixture.tissue.points(index), open_circuit_ratio=ratio)


class BlockTransportTerm(NewtonTerm):
    """The coupled balances of a block.

    The solver calls `balance` and `derivatives`. With a variable, positions of the vertices and an interval set
    (`bind`), the term is also an ordinary FiPy Term for the potentials on the grid as it stands.

    Parameters
    ----------
    grid, diamonds
        The grid and the diamonds of the faces that water crosses.
    cells, faces
        The mixture at the cells and at the crossed faces, with one row.
    """

    def __init__(
        self, grid: BlockGrid, diamonds: Diamonds, cells: Mixture, faces: Mixture,
        var: Any = None, positions: Array | None = None, interval: BlockInterval | None = None,
    ) -> None:  # fmt: skip
        super().__init__(coeff=1.0, var=var)
        self.grid, self.diamonds, self.cells, self.faces = grid, diamonds, cells, faces
        self.positions, self.interval = positions, interval

    def bind(self, var: Any, positions: Array, interval: BlockInterval) -> BlockTransportTerm:
        """The same balances as a FiPy Term in a `fipy.CellVariable` (a vector if there are several potentials)."""
        return BlockTransportTerm(self.grid, self.diamonds, self.cells, self.faces, var, positions, interval)

    def log_concentration(self, potentials: Array, bath_concentration: float) -> Array:
        """Logarithm of c~ in the cells, ``(1, cells)``: an unknown where ions are transported, else the bath's."""
        if self.cells.model.transports_ions:
            return potentials[1]
        return np.full(potentials.shape[1:], np.log(bath_concentration))

    def balance(
        self, potentials: Array, positions: Array, volume_ratio: Array, interval: BlockInterval
    ) -> BlockBalance:
        """Residual, contents and fluxes.

        Parameters
        ----------
        potentials
            ``(balances, 1, cells)``.
        positions
            Of the vertices, ``(2, vertices)`` mm.
        volume_ratio
            J of the cells, ``(1, cells)``.
        interval
            See `BlockInterval`.
        """
        bath = interval.bath_concentration
        cells = self.cells.at(volume_ratio, self.log_concentration(potentials, bath))
        contents = self.cells.contents(cells)
        faces = self.face_state(potentials, positions, bath)
        fluxes = self.faces.fluxes(faces.local, faces.gradients)
        outflow = (self.diamonds.outflow @ fluxes[:, 0].T).T[:, None]
        residual = self.grid.volumes * (contents - interval.base) + interval.duration * outflow
        return BlockBalance(residual, contents, fluxes, cells, faces)

    def face_state(self, potentials: Array, positions: Array, bath_concentration: float) -> FaceState:
        """State at the crossed faces."""
        maps, bath = self.diamonds, self.bath_potentials(bath_concentration)
        volume, by_across, by_along = diamond_metric(self.grid.section, maps.local_points(positions))
        across = (maps.across @ potentials[:, 0].T + maps.across_outside @ bath.T).T
        along = (maps.along @ potentials[:, 0].T + maps.along_outside @ bath.T).T
        local = self.faces.at(
            (volume / maps.reference_volumes)[None],
            self._face_log_concentration(potentials, bath, bath_concentration),
        )
        gradients = (by_across * across + by_along * along)[:, None]
        return FaceState(local, gradients, across, along, by_across, by_along)

    def derivatives(self, positions: Array, balance: BlockBalance) -> TransportDerivatives:
        """Derivatives of the fluxes and contents, with the vertices at positions and the balance found there."""
        faces = balance.faces
        by_state, by_gradient = self.faces.flux_derivatives(faces.local, faces.gradients)
        by_state, by_gradient = by_state[:, :, 0], by_gradient[:, :, 0]
        volume, by_across, by_along = self._metric_derivative(positions)
        by_points = by_state[:, :1] * (volume / self.diamonds.reference_volumes)
        by_points += np.einsum("egf,gf->ef", by_gradient, faces.across)[:, None] * by_across
        by_points += np.einsum("egf,gf->ef", by_gradient, faces.along)[:, None] * by_along
        return TransportDerivatives(
            by_gradient * faces.by_across,
            by_gradient * faces.by_along,
            by_state[:, 1:],
            by_points,
            self.cells.content_derivatives(balance.cells)[:, :, 0],
        )

    def _metric_derivative(self, positions: Array) -> Array:
        """Of the metric by the points of the diamonds, ``(3, 12, crossed)``."""
        points = self.diamonds.local_points(positions)
        section = self.grid.section
        return local_derivative(lambda p: diamond_metric(section, p.reshape(2, 6, 12, -1)), points.reshape(12, -1))

    def bath_potentials(self, bath_concentration: float) -> Array:
        """Potentials of the bath at the vertices, ``(balances, vertices)``."""
        bath = self.cells.bath_potentials(np.array([[bath_concentration]]))[:, 0]
        return np.broadcast_to(bath, (len(bath), self.grid.vertices.shape[1]))

    def _face_log_concentration(self, potentials: Array, bath: Array, bath_concentration: float) -> Array:
        if not self.cells.model.transports_ions:
            return np.full((1, len(self.diamonds.faces)), np.log(bath_concentration))
        return (self.diamonds.mean @ potentials[1, 0] + self.diamonds.across_outside @ bath[1])[None]

    def newton_system(self, unknowns: Array) -> NewtonSystem:
        """Jacobian and residual at the potentials, on the grid as it stands."""
        if self.interval is None or self.positions is None:
            raise ValueError("bind the term to a variable, positions and an interval before FiPy builds its matrix")
        corners = self.positions[:, self.grid.cell_vertices]
        J = (polygon_volume(self.grid.section, *corners) / self.grid.volumes)[None]
        balance = self.balance(unknowns, self.positions, J, self.interval)
        entries = self.potential_jacobian(self.derivatives(self.positions, balance), self.interval.duration)
        return NewtonSystem(entries.data, entries.row, entries.col, balance.residual)

    def potential_jacobian(self, by: TransportDerivatives, duration: float) -> sparse.coo_array:
        """Derivative of the balances by the potentials on the grid as it stands."""
        maps, V = self.diamonds, len(by.across)
        fluxes = [[self._flux_jacobian(by, e, g) for g in range(V)] for e in range(V)]
        storage = np.zeros((V, V, self.grid.cells))
        if V > 1:
            storage[:, 1] = self.grid.volumes * by.contents[:, 1]
            for e in range(V):
                fluxes[e][1] += sparse.diags_array(by.log_concentration[e, 0]) @ maps.mean
        blocks = [
            [duration * (maps.outflow @ fluxes[e][g]) + sparse.diags_array(storage[e, g]) for g in range(V)]
            for e in range(V)
        ]
        return sparse.block_array(blocks).tocoo()

    def _flux_jacobian(self, by: TransportDerivatives, balance: int, potential: int) -> sparse.csr_array:
        across, along = (sparse.diags_array(part[balance, potential]) for part in (by.across, by.along))
        return (across @ self.diamonds.across + along @ self.diamonds.along).tocsr()
