"""The sparse direct solver: solutions, singular matrices, and that nested dissection keeps the factors sparse."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from fvswell.numerics.sparse_lu import DirectSolver, nested_dissection
from fvswell.physics.tissue import Array


def lattice_matrix(side: int) -> tuple[sparse.coo_array, Array]:
    """A matrix, not symmetric and neither its pattern, on a square lattice, and the places of its unknowns."""
    draw = np.random.default_rng(3)
    line = sparse.diags_array([1.0, 1.0, 1.0], offsets=[-1, 0, 1], shape=(side, side))
    matrix = sparse.coo_array(sparse.kron(line, line))
    kept = (matrix.row == matrix.col) | (draw.random(matrix.nnz) < 0.8)
    rows, columns = matrix.row[kept], matrix.col[kept]
    values = draw.normal(size=len(rows)) + 10.0 * (rows == columns)
    places = np.stack(np.divmod(np.arange(side**2), side)).astype(float)
    return sparse.coo_array((values, (rows, columns)), shape=matrix.shape), places


@pytest.mark.parametrize("side", [2, 7, 30])
def test_solution_solves_the_system(side: int) -> None:
    matrix, places = lattice_matrix(side)
    places[:, 1] = np.nan  # as the displacement of a tied edge
    right_side = np.random.default_rng(1).normal(size=side**2)
    solution = DirectSolver(matrix.row, matrix.col, places).factorise(matrix.data).solve(right_side)
    assert np.abs(matrix @ solution - right_side).max() < 1e-13


def test_a_singular_matrix_has_no_solution() -> None:
    matrix, places = lattice_matrix(4)
    values = np.where(matrix.row == 3, 0.0, matrix.data)
    assert np.isnan(DirectSolver(matrix.row, matrix.col, places).factorise(values).solve(np.ones(16))).all()


def test_nested_dissection_orders_every_unknown_once_and_those_without_a_place_last() -> None:
    matrix, places = lattice_matrix(30)
    places[:, [17, 400]] = np.nan
    order = nested_dissection(abs(matrix).tocsr() + abs(matrix).T.tocsr(), places)
    assert (np.sort(order) == np.arange(900)).all()
    assert set(order[-2:]) == {17, 400}


def test_factors_grow_like_n_log_n() -> None:
    def filled(side: int) -> float:
        matrix, places = lattice_matrix(side)
        return DirectSolver(matrix.row, matrix.col, places).factorise(matrix.data).entries / side**2

    assert filled(128) < 2.2 * filled(32)  # log 128^2 / log 32^2 = 1.4; line by line it is 4
