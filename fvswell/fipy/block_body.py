"""A block whose Newton steps are found by FiPy: transport from our Term in FiPy's matrix, and FiPy's solver.

FiPy has no variables at vertices, so the momentum balance is not its business: its rows and columns, and those of the
boundary, are put around the matrix that FiPy builds of the transport balances, and FiPy's solver takes the whole. All
else is that of a `BlockBody`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from fipy import CellVariable
from scipy import sparse

from fvswell.block.block import Block, BlockState, Interval
from fvswell.block.body import BlockBody
from fvswell.block.linearisation import Linearisation
from fvswell.block.newton import Newton
from fvswell.fipy.block_terms import BlockTransportTerm
from fvswell.fipy.mesh import block_mesh
from fvswell.fipy.terms import direct_solution, matrix_of
from fvswell.physics.tissue import Array

__all__ = ["FipyLinearisation", "FipyNewton", "fipy_block_body"]


class _Factors:
    """A matrix that FiPy's solver takes; as `fvswell.numerics.sparse_lu.Factors`."""

    def __init__(self, matrix: sparse.csr_matrix) -> None:
        self.matrix = matrix

    def solve(self, right_side: Array) -> Array:
        """Solution of the system, nan if the matrix is singular."""
        try:
            return direct_solution(self.matrix, right_side)
        except RuntimeError:  # exactly singular
            return np.full_like(right_side, np.nan)


class FipyLinearisation(Linearisation):
    """A block linearised at a state, with the derivatives of the transport balances by the potentials from FiPy."""

    def __init__(self, block: Block, state: BlockState, interval: Interval) -> None:
        self.block, self.state = block, state
        self._local = block.local_derivatives(state, interval.duration)
        first, pattern = block.degrees_of_freedom.number, block.pattern
        entries = block.jacobian(self._local, interval.loads)
        around = ~pattern.within(first, pattern.size - block.outside.unknowns)
        transport = self._transport(interval).tocoo()
        values = np.concatenate([entries[around], transport.data])
        rows = np.concatenate([pattern.rows[around], transport.row + first])
        columns = np.concatenate([pattern.columns[around], transport.col + first])
        values *= block.unknown_scale[columns] / block.residual_scale[rows]
        shape = (pattern.size, pattern.size)
        matrix = sparse.csr_matrix((values, (rows, columns)), shape=shape)  # FiPy multiplies by it
        self._factors = _Factors(matrix)  # type: ignore[assignment]

    def _transport(self, interval: Interval) -> sparse.csr_array:
        """Derivative of the transport balances by the potentials: the matrix that FiPy builds of our Term."""
        block, state = self.block, self.state
        potentials = block.potentials(state.unknowns)
        mesh = block_mesh(block.grid, state.positions)
        variable = CellVariable(mesh=mesh, value=potentials, elementshape=(len(potentials),))
        beyond = block.beyond(interval.loads, block.outer(state.unknowns))
        term = BlockTransportTerm(block, variable, state.positions, interval.base, beyond)
        matrix: sparse.csr_array = interval.duration * matrix_of(term, interval.duration)
        return matrix


class FipyNewton(Newton):
    """Newton's method for a block with FiPy's matrices and solver."""

    linearise = FipyLinearisation


def fipy_block_body(body: BlockBody) -> BlockBody:
    """The same block, solved with FiPy."""
    return replace(body, method=FipyNewton, _newton=None, _stage=None)
