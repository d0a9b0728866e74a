"""All balances of a column as one coupled FiPy Term with an exact Jacobian.

The balance of each quantity over an interval of time reads, for a cell of reference width W between two faces,

    W (content - base) + dt (flux through the upper face - flux through the lower face) = 0

with ``base`` the content the interval starts from. Fluxes are two-point: they depend on the state at the face and on
the differences of the potentials across it. Unknowns are stacked as ``(balances, rows, cells)``; rows do not interact.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fvswell.column.column import Column, Loads
from fvswell.column.grid import ColumnGrid
from fvswell.column.linearisation import Linearisation, NewtonStep, cell_blocks, newton_step
from fvswell.numerics.newton_term import NewtonSystem, NewtonTerm
from fvswell.physics.models import PointState
from fvswell.physics.tissue import Array

__all__ = ["Balance", "CoupledTransportTerm", "Interval"]


class Interval(NamedTuple):
    """The time a balance is drawn up over: contents it starts from, length (rows, 1) in s, loads at its end."""

    base: Array  # (balances, rows, cells)
    duration: Array  # (rows, 1)
    loads: Loads
    filter_potentials: Array  # (balances, rows, 1): those of the bath

    @classmethod
    def under(cls, laws: Column, base: Array, duration: Array, loads: Loads) -> Interval:
        """An interval under the given loads."""
        return cls(base, duration, loads, laws.filter_potentials(loads))

    def rows(self, index: Array) -> Interval:
        """The interval of a subset of the rows."""
        loads = Loads(*(load[index] for load in self.loads))
        return Interval(self.base[:, index], self.duration[index], loads, self.filter_potentials[:, index])


class Balance(NamedTuple):
    """The balances at a state, and the local states they were drawn up from."""

    residual: Array  # (balances, rows, cells)
    contents: Array  # (balances, rows, cells)
    fluxes: Array  # (balances, rows, cells + 1)
    cells: PointState
    faces: PointState  # the filter and the inner faces
    gradients: Array  # (balances, rows, faces): of the potentials, by the reference coordinate

    def rows(self, index: Array) -> Balance:
        """The balances of a subset of the rows."""

        def own(state: PointState) -> PointState:
            return PointState(*(values[index] if values.ndim else values for values in state))

        stacked = {name: getattr(self, name)[:, index] for name in ("residual", "contents", "fluxes", "gradients")}
        return self._replace(cells=own(self.cells), faces=own(self.faces), **stacked)

    def put(self, index: Array, other: Balance) -> None:
        """Take over a subset of the rows from the balances of just those."""
        for name in ("residual", "contents", "fluxes", "gradients"):
            getattr(self, name)[:, index] = getattr(other, name)
        for state, part in ((self.cells, other.cells), (self.faces, other.faces)):
            for values, own in zip(state, part, strict=True):
                if values.ndim:
                    values[index] = own


class CoupledTransportTerm(NewtonTerm):
    """The coupled balances of a batch of columns on one grid.

    The solver calls `balance` and `linearise`. With a variable and an interval (`bind`), the term is also an ordinary
    FiPy Term: it can be swept, cached and added to others; then the batch has one row.
    """

    def __init__(self, grid: ColumnGrid, laws: Column, var: Any = None, interval: Interval | None = None) -> None:
        super().__init__(coeff=1.0, var=var)
        self.grid, self.laws, self.interval = grid, laws, interval

    def rows(self, index: Array) -> CoupledTransportTerm:
        """The term of a subset of the rows."""
        return type(self)(self.grid, self.laws.rows(index))

    def bind(self, var: Any, interval: Interval) -> CoupledTransportTerm:
        """The same balances as a FiPy Term in a vector `fipy.CellVariable` of the unknowns."""
        return type(self)(self.grid, self.laws, var, interval)

    def balance(self, unknowns: Array, interval: Interval) -> Balance:
        """Residual, contents and fluxes at a state."""
        laws, loads = self.laws, interval.loads
        cells = laws.at_cells(unknowns[: laws.state_size], loads)
        faces = laws.at_faces(self._face_state(unknowns, interval), loads)
        potentials = np.empty((*unknowns.shape[:2], unknowns.shape[2] + 1))
        potentials[..., :1] = interval.filter_potentials
        potentials[0, :, 1:] = laws.water_potential(cells, loads)
        potentials[1:, :, 1:] = unknowns[1:]
        gradients = (potentials[..., 1:] - potentials[..., :-1]) / self.grid.distances
        contents = laws.cells.contents(cells)
        fluxes = np.zeros_like(potentials)  # none at the piston
        fluxes[..., :-1] = laws.fluxes(faces, gradients)
        net = fluxes[..., 1:] - fluxes[..., :-1]
        residual = self.grid.widths * (contents - interval.base) + interval.duration * net
        return Balance(residual, contents, fluxes, cells, faces, gradients)

    def linearise(self, balance: Balance) -> Linearisation:
        """Exact derivatives of contents and fluxes where the balances were drawn up."""
        S, shape = self.laws.state_size, balance.residual.shape
        storage = np.zeros((shape[0], *shape))
        storage[:, :S] = self.laws.cells.content_derivatives(balance.cells)
        water = self.laws.water_potential_derivatives(balance.cells)
        by_state, by_gradient = self.laws.flux_derivatives(balance.faces, balance.gradients, balance.fluxes[..., :-1])
        by_difference = by_gradient / self.grid.distances
        by_upper, by_lower = by_difference.copy(), -by_difference
        by_upper[:, 0] *= water[0]
        by_lower[:, 0, :, 1:] *= water[0, :, :-1]
        for variable in range(1, S):
            by_upper[:, variable] += by_difference[:, 0] * water[variable]
            by_lower[:, variable, :, 1:] -= by_difference[:, 0, :, 1:] * water[variable, :, :-1]
        for variable in range(S):
            lower_weight, upper_weight = self._face_weights(variable)
            by_upper[:, variable] += by_state[:, variable] * upper_weight
            by_lower[:, variable] += by_state[:, variable] * lower_weight
        by_lower[..., 0] = 0.0
        return Linearisation(storage, by_upper, by_lower, by_difference[:, 0, :, 0])

    def newton_step(self, unknowns: Array, interval: Interval, balance: Balance, with_pressure: bool) -> NewtonStep:
        """Newton step from a state at which the balances are ``balance``."""
        return newton_step(
            self.linearise(balance), self.grid.widths, interval.duration, balance.residual, balance.fluxes[..., :-1],
            with_pressure,
        )  # fmt: skip

    def _face_state(self, unknowns: Array, interval: Interval) -> Array:
        """State at the faces: the stretch of the face, and the mean of the cells' ln c~ (the bath's at the filter)."""
        state = np.empty((self.laws.state_size, *unknowns.shape[1:]))
        state[0] = self.grid.face_stretch(unknowns[0])
        if len(state) > 1:
            state[1, :, 1:] = 0.5 * (unknowns[1, :, 1:] + unknowns[1, :, :-1])
            state[1, :, :1] = interval.filter_potentials[1]
        return state

    def _face_weights(self, variable: int) -> tuple[Array, Array]:
        """Weights of the cells below and above in the state at a face."""
        if variable == 0:
            return self.grid.lower_weight, self.grid.upper_weight
        return self.grid.inner_half, self.grid.inner_half

    def newton_system(self, unknowns: Array) -> NewtonSystem:
        """Jacobian and residual of a batch of one row."""
        if self.interval is None:
            raise ValueError("bind the term to a variable and an interval before FiPy builds its matrix")
        balance = self.balance(unknowns, self.interval)
        blocks = cell_blocks(self.grid.widths, self.interval.duration, self.linearise(balance))
        return NewtonSystem(*_entries(blocks), balance.residual)


def _entries(blocks: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
    """Value, row and column of the entries for one row of a batch, in FiPy's order: variable by variable."""
    V, _, _, n = blocks[0].shape
    equation, variable, cell = np.ogrid[:V, :V, :n]
    parts = []
    for block, shift in zip(blocks, (0, -1, 1), strict=True):
        own = cell[..., max(0, -shift) : n - max(0, shift)]
        rows, columns = np.broadcast_arrays(equation * n + own, variable * n + own + shift)
        parts.append((block[:, :, 0].ravel(), rows.ravel(), columns.ravel()))
    values, rows, columns = (np.concatenate(part) for part in zip(*parts, strict=True))
    return values, rows, columns
