"""FiPy's view of coupled balances: a Term whose matrix is the Jacobian of a Newton step.

FiPy builds matrices through private hooks of its terms; they are touched here alone.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, NamedTuple

import numpy as np
from fipy import LinearLUSolver
from fipy.terms.unaryTerm import _UnaryTerm

from fvswell.physics.tissue import Array

__all__ = ["NewtonSystem", "NewtonTerm"]


class NewtonSystem(NamedTuple):
    """Jacobian of the residual, entry by entry, and the residual, in FiPy's order: variable by variable."""

    values: Array
    rows: Array
    columns: Array
    residual: Array


class NewtonTerm(_UnaryTerm):
    """A Term in a `fipy.CellVariable`, a vector if there are several unknowns; it can be swept, cached and added."""

    @abstractmethod
    def newton_system(self, unknowns: Array) -> NewtonSystem:
        """Jacobian and residual at unknowns ``(balances, 1, cells)``."""

    def _buildMatrix(
        self,
        var: Any,
        SparseMatrix: Any,
        boundaryConditions: Any = (),
        dt: Any = None,
        transientGeomCoeff: Any = None,
        diffusionGeomCoeff: Any = None,
    ) -> tuple[Any, Any, Array]:
        """FiPy's hook: the matrix of a Newton step, and the right side that makes its solution the new state."""
        unknowns = np.array(var.value)
        system = self.newton_system(unknowns.reshape(-1, 1, unknowns.shape[-1]))
        matrix = SparseMatrix(mesh=var.mesh)
        matrix.addAt(system.values, system.rows, system.columns)
        return var, matrix, matrix * unknowns.ravel() - system.residual.ravel()

    def _getDefaultSolver(self, var: Any, solver: Any, *args: Any, **kwargs: Any) -> Any:
        return solver or LinearLUSolver(tolerance=1e-14)  # the default skips small steps silently
