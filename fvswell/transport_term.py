"""All balances of a column as one coupled FiPy Term with an exact Jacobian.

The balance of each quantity over an interval reads, for a cell of reference width W between two faces,

    W (content - base) + dt (flux through the upper face - flux through the lower face) = 0

with ``base`` the content the interval starts from. Fluxes are two-point: they depend on the state at the face and on
the differences of the potentials across it. Derivatives are exact: by complex step in the state at a point, and by
linearity in the gradients. Unknowns are stacked as ``(balances, rows, cells)``; rows do not interact.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fvswell.column import Column, Loads
from fvswell.grid import ColumnGrid
from fvswell.tissue import Array

from fipy.terms.unaryTerm import _UnaryTerm  # isort: skip  (after fvswell.grid, which chooses FiPy's solvers)

__all__ = ["Balance", "BandedJacobian", "CoupledTransportTerm", "Interval", "band_storage", "complex_step", "derivative"]

_STEP = 1e-40  # far below rounding of anything it is added to: the imaginary part is the derivative exactly


class Interval(NamedTuple):
    """The time a balance is drawn up over: contents it starts from, length (rows, 1) in s, loads at its end."""

    base: Array  # (balances, rows, cells)
    duration: Array  # (rows, 1)
    loads: Loads


class Balance(NamedTuple):
    """Residual of the balances (balances, rows, cells), contents, and fluxes through all faces (.., cells + 1)."""

    residual: Array
    contents: Array
    fluxes: Array


class BandedJacobian(NamedTuple):
    """Jacobian in LAPACK's band storage, unknowns ordered row by row, cell by cell, balance by balance."""

    bands: Array  # (unknowns, 3 * bandwidth + 1): the transpose of LAPACK's array, so that it is Fortran-ordered
    bandwidth: int  # sub- and superdiagonals
    pressure: Array  # (balances, rows, cells): derivative of the residual by the applied pressure


def complex_step(state: Array) -> Array:
    """Perturbed copies of a state, shape ``(variables, directions, ...)``, for derivatives by complex step."""
    perturbed = np.repeat(state[:, None].astype(complex), len(state), axis=1)
    for direction in range(len(state)):
        perturbed[direction, direction] += 1j * _STEP
    return perturbed


def derivative(value: Array) -> Array:
    """Derivatives from values at perturbed states; the directions stay on the axis after the values' own."""
    return value.imag / _STEP


class CoupledTransportTerm(_UnaryTerm):  # type: ignore[misc]
    """The coupled balances of a batch of columns on one grid.

    The solver calls `balance` and `jacobian`. With a variable and an interval set (`bind`), the term is also an ordinary
    FiPy Term: it can be swept, cached and added to others; then the batch has one row.
    """

    def __init__(self, grid: ColumnGrid, laws: Column, var: Any = None, interval: Interval | None = None) -> None:
        super().__init__(coeff=1.0, var=var)
        self.grid, self.laws, self.interval = grid, laws, interval

    def rows(self, index: Array) -> CoupledTransportTerm:
        """The term of a subset of the rows."""
        return CoupledTransportTerm(self.grid, self.laws.rows(index))

    def bind(self, var: Any, interval: Interval) -> CoupledTransportTerm:
        """The same balances as a FiPy Term in a vector `fipy.CellVariable` of the unknowns."""
        return CoupledTransportTerm(self.grid, self.laws, var, interval)

    def balance(self, unknowns: Array, interval: Interval) -> Balance:
        """Residual, contents and fluxes at a state, all real."""
        loads = interval.loads
        state = unknowns[: self.laws.state_size]
        contents = self.laws.contents(state, loads)
        potentials = self._potentials(unknowns, self.laws.water_potential(state, loads))
        gradients = self._reference_gradients(potentials, loads)
        crossing = self.laws.fluxes(self._face_state(unknowns, loads), loads, gradients)
        fluxes = np.concatenate([crossing, np.zeros_like(crossing[..., :1])], axis=-1)
        residual = self.grid.widths * (contents - interval.base) + interval.duration * np.diff(fluxes)
        return Balance(residual, contents, fluxes)

    def jacobian(self, unknowns: Array, interval: Interval) -> BandedJacobian:
        """Derivative of the residual by the unknowns and by the applied pressure."""
        loads, S = interval.loads, self.laws.state_size
        perturbed = complex_step(unknowns[:S])
        potential = self.laws.water_potential(perturbed, loads)
        by_potential = self._potential_derivative(derivative(potential), unknowns.shape)
        storage = np.zeros((len(unknowns), *unknowns.shape))
        storage[:, :S] = self.grid.widths * derivative(self.laws.contents(perturbed, loads))

        gradients = self._reference_gradients(self._potentials(unknowns, potential[0].real), loads)
        face_state = self._face_state(unknowns, loads)
        by_state = derivative(self.laws.fluxes(complex_step(face_state), loads, gradients[:, None]))
        unit = np.eye(len(unknowns))[:, :, None, None]
        by_gradient = self.laws.fluxes(face_state, loads, unit) / self.grid.distances

        upper = np.einsum("egrf,gvrf->evrf", by_gradient, by_potential)
        lower = -np.einsum("egrf,gvrf->evrf", by_gradient[..., 1:], by_potential[..., :-1])
        for variable in range(S):
            lower_weight, upper_weight = self._face_weights(variable)
            upper[:, variable] += by_state[:, variable] * upper_weight
            lower[:, variable] += by_state[:, variable, :, 1:] * lower_weight[1:]
        by_pressure = np.zeros(unknowns.shape)
        by_pressure[..., 0] = -interval.duration[:, 0] * by_gradient[:, 0, :, 0]
        dt = interval.duration
        diagonal = storage - dt * upper
        diagonal[..., :-1] += dt * lower
        bands, bandwidth = band_storage(diagonal, below=-dt * lower, above=dt * upper[..., 1:])
        return BandedJacobian(bands, bandwidth, by_pressure)

    def content_scale(self, loads: Loads) -> Array:
        """Size of the contents of the cells, to judge residuals by: (balances, 1 or rows, cells)."""
        return self.laws.content_scale(loads) * self.grid.widths

    def _potentials(self, unknowns: Array, water_potential: Array) -> Array:
        potentials = unknowns.copy()
        potentials[0] = water_potential
        return potentials

    def _potential_derivative(self, water: Array, shape: tuple[int, ...]) -> Array:
        """d potentials/d unknowns, (potentials, unknowns, rows, cells): the water potential by state, else 1."""
        by_unknowns = np.zeros((shape[0], *shape))
        by_unknowns[0, : len(water)] = water
        for variable in range(1, shape[0]):
            by_unknowns[variable, variable] = 1.0
        return by_unknowns

    def _reference_gradients(self, potentials: Array, loads: Loads) -> Array:
        bath = self.laws.filter_potentials(loads)
        return np.diff(potentials, axis=-1, prepend=bath) / self.grid.distances

    def _face_state(self, unknowns: Array, loads: Loads) -> Array:
        """State at the faces: the stretch of the face, and means of the other state unknowns (the bath's at a filter)."""
        state = unknowns[: self.laws.state_size].copy()
        state[0] = self.grid.face_stretch(unknowns[0])
        if len(state) > 1:
            inner = 0.5 * (unknowns[1 : len(state), :, 1:] + unknowns[1 : len(state), :, :-1])
            state[1:, :, 1:] = inner
            state[1:, :, :1] = self.laws.filter_potentials(loads)[1 : len(state)]
        return state

    def _face_weights(self, variable: int) -> tuple[Array, Array]:
        """Weights of the cells below and above in the state at a face."""
        if variable == 0:
            return self.grid.lower_weight, self.grid.upper_weight
        half = np.full(len(self.grid.widths), 0.5)
        half[0] = 0.0
        return half, half

    def _buildMatrix(  # noqa: N802  (FiPy's name)
        self, var: Any, SparseMatrix: Any, boundaryConditions: Any = (), dt: Any = None,  # noqa: N803
        transientGeomCoeff: Any = None, diffusionGeomCoeff: Any = None,  # noqa: N803
    ) -> tuple[Any, Any, Array]:
        """FiPy's hook: the matrix of a Newton step, and the right side that makes its solution the new state."""
        if self.interval is None:
            raise ValueError("bind the term to a variable and an interval before FiPy builds its matrix")
        unknowns = np.array(var.value).reshape(len(self.laws.balances), 1, -1)
        jacobian = self.jacobian(unknowns, self.interval)
        rows, columns, values = _variable_major(jacobian, unknowns.shape)
        matrix = SparseMatrix(mesh=var.mesh)
        matrix.addAt(values, rows, columns)
        residual = self.balance(unknowns, self.interval).residual
        return var, matrix, matrix * unknowns.ravel() - residual.ravel()

    def _getDefaultSolver(self, var: Any, solver: Any, *args: Any, **kwargs: Any) -> Any:  # noqa: N802
        from fipy import LinearLUSolver

        return solver or LinearLUSolver(tolerance=1e-14)  # the default skips small steps silently


def band_storage(diagonal: Array, below: Array, above: Array) -> tuple[Array, int]:
    """Blocks (equation, variable, row, cell) to LAPACK bands; ``below`` couples a cell to the one before it."""
    V, _, R, n = diagonal.shape
    bandwidth = 2 * V - 1
    bands = np.zeros((R, n, V, 3 * bandwidth + 1))
    for block, cells, offset in (
        (diagonal, slice(None), 0),
        (below, slice(None, -1), V),
        (above, slice(1, None), -V),
    ):
        for variable in range(V):
            start = 2 * bandwidth + offset - variable
            bands[:, cells, variable, start : start + V] = np.moveaxis(block[:, variable], 0, -1)
    return bands.reshape(R * n * V, -1), bandwidth


def _variable_major(jacobian: BandedJacobian, shape: tuple[int, ...]) -> tuple[Array, Array, Array]:
    """Row, column and value of the entries, in FiPy's order: all cells of the first variable, then of the next."""
    V, _, n = shape
    column, band = np.nonzero(jacobian.bands)
    row = column + band - 2 * jacobian.bandwidth

    def reorder(index: Array) -> Array:
        return index % V * n + index // V

    return reorder(row), reorder(column), jacobian.bands[column, band]
