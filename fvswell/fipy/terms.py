"""Our balances as FiPy Terms: matrix and residual come from the compiled kernels.

A term stands for the outflow of every quantity from every cell, as FiPy's ``- DiffusionTerm(...)`` does, linearised
where its variable stands, so a sweep is a Newton step. Contents are the unknowns, so their storage is FiPy's own term:

    equation = TransientTerm(var=contents) + ColumnFluxTerm(body, contents, loads)

and sources, or other equations coupled with ``&``, may be added. Contents are per volume of the stress-free solid, and
the variable is on the mesh of that: what moves is in the fluxes.

FiPy builds matrices through private hooks of its terms; they are touched here alone.
"""

from __future__ import annotations

from abc import abstractmethod
from copy import copy
from typing import Any, NamedTuple

import numpy as np
from fipy import CellVariable
from fipy.solvers.scipy import LinearLUSolver
from fipy.terms.unaryTerm import _UnaryTerm

from fvswell.column.stage import ColumnBody
from fvswell.compiled import kernel
from fvswell.physics.tissue import Array

__all__ = [
    "ColumnFluxTerm", "Linearisation", "LinearisedTerm", "call_balances", "contents_variable", "direct_solution",
    "direct_solver", "matrix_of",
]  # fmt: skip


class Linearisation(NamedTuple):
    """What a term takes out of the cells and its derivatives, in FiPy's order: variable by variable, cell by cell."""

    outflow: Array
    values: Array  # entries of the derivative of the outflow
    rows: Array
    columns: Array


class LinearisedTerm(_UnaryTerm):
    """A Term in a `fipy.CellVariable`, a vector if there are several unknowns; it can be swept, cached and added."""

    def __init__(self, var: Any) -> None:
        super().__init__(coeff=1.0, var=var)

    @abstractmethod
    def linearise(self, values: Array, dt: float | None) -> Linearisation:
        """Linearise at values of the variable, in the shape that they have there; ``dt`` is that of the sweep, s."""

    def __neg__(self) -> LinearisedTerm:
        term = copy(self)
        term.coeff = -self.coeff
        return term

    def _buildMatrix(
        self,
        var: Any,
        SparseMatrix: Any,
        boundaryConditions: Any = (),
        dt: Any = None,
        transientGeomCoeff: Any = None,
        diffusionGeomCoeff: Any = None,
    ) -> tuple[Any, Any, Array]:
        """FiPy's hook: a matrix, and a right side such that the residual is the outflow where the variable stands."""
        values = np.array(var.value)
        linear = self.linearise(values, dt)
        matrix = SparseMatrix(mesh=var.mesh)
        matrix.addAt(self.coeff * linear.values, linear.rows, linear.columns)
        return var, matrix, matrix * values.ravel() - self.coeff * linear.outflow

    def _getDefaultSolver(self, var: Any, solver: Any, *args: Any, **kwargs: Any) -> Any:
        return solver or direct_solver()


def direct_solver() -> Any:
    """FiPy's LU solver to rounding: with its default tolerance it leaves out small steps without saying so."""
    return LinearLUSolver(tolerance=1e-14, iterations=4)


def direct_solution(matrix: Any, right_side: Array) -> Array:
    """Solve a system that is not that of one equation, ``(unknowns, unknowns)`` sparse, with FiPy's LU solver."""
    solution: Array = direct_solver()._solve_(matrix, np.zeros_like(right_side), right_side.copy())
    return solution


def matrix_of(equation: Any, dt: float) -> Any:
    """The matrix that FiPy builds of an equation, as scipy has it."""
    equation.cacheMatrix()
    equation.justResidualVector(dt=dt, solver=direct_solver())
    return equation.matrix.matrix


@kernel
def call_balances(
    evaluate: Any, cells: Any, faces: Any, metric: Any, contents: Any, loads: Any, ends: Any, fluxes: Any,
    by_lower: Any, by_upper: Any, by_pressure: Any, by_current: Any, potentials: Any,
) -> None:  # fmt: skip
    """Call compiled balances from Python; the arguments are those of `fvswell.column.balances`."""
    evaluate(
        cells, faces, metric, contents, loads, ends, fluxes, by_lower, by_upper, by_pressure, by_current, potentials
    )


def contents_variable(mesh: Any, contents: Array) -> Any:
    """Vector variable of contents (balances, cells), with old values, on the mesh of the stress-free solid."""
    return CellVariable(mesh=mesh, name="contents", value=contents, elementshape=(len(contents),), hasOld=True)


class ColumnFluxTerm(LinearisedTerm):
    """Outflow of water, and of anions where ions are transported, from the cells of a column.

    Parameters
    ----------
    body
        The column, as `fvswell.column.column.Column.body` gives it.
    var
        Contents, see `contents_variable`.
    loads
        Values of `fvswell.column.balances.COLUMN_LOADS`; may be changed between sweeps. Pressure and current have to
        be given.
    """

    def __init__(self, body: ColumnBody, var: Any, loads: Array) -> None:
        super().__init__(var)
        self.body, self.loads = body, loads
        self.pressure_rise = 0.0  # MPa, of the linearised fluxes above those at the loads
        self.current_rise = 0.0  # A/mm2, the same, of a column that finds its current

    def linearise(self, values: Array, dt: float | None) -> Linearisation:
        """Outflow and its derivatives at contents."""
        body = self.body
        balances, n = values.shape
        call_balances(
            body.evaluate, body.cells, body.faces, body.metric, np.ascontiguousarray(values), self.loads,
            body.ends, body.fluxes, body.by_lower, body.by_upper, body.by_pressure, body.by_current, body.potentials,
        )  # fmt: skip
        through = body.fluxes[:balances] + self.current_rise * body.by_current[:balances]
        through[:, [0, n]] += self.pressure_rise * body.by_pressure[:balances]
        by_lower, by_upper = body.by_lower[:balances], body.by_upper[:balances]
        diagonal = by_lower[:, :, 1:] - by_upper[:, :, :-1]
        blocks = ((diagonal, 0, 0), (-by_lower[:, :, 1:n], 1, 0), (by_upper[:, :, 1:n], 0, 1))
        entries, rows, columns = [], [], []
        for block, row, column in blocks:
            balance, unknown, cell = np.indices(block.shape)
            entries.append(block.ravel())
            rows.append((balance * n + cell + row).ravel())
            columns.append((unknown * n + cell + column).ravel())
        return Linearisation(
            np.diff(through, axis=1).ravel(), np.concatenate(entries), np.concatenate(rows), np.concatenate(columns)
        )
