"""The sparse direct solver: solutions, bad and singular matrices, and that nested dissection keeps factors sparse."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy import sparse

from fvswell.numerics.dissection import Part, nested_dissection
from fvswell.numerics.fronts import Fronts
from fvswell.numerics.sparse_lu import DirectSolver
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


@pytest.mark.parametrize("method", ["fronts", "superlu"])
@pytest.mark.parametrize("side", [2, 7, 30])
def test_solution_solves_the_system(side: int, method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FVSWELL_SPARSE_SOLVER", method)
    matrix, places = lattice_matrix(side)
    places[:, 1] = np.nan  # as the displacement of a tied edge
    right_side = np.random.default_rng(1).normal(size=side**2)
    solution = DirectSolver(matrix.row, matrix.col, places).factorise(matrix.data).solve(right_side)
    assert np.abs(matrix @ solution - right_side).max() < 1e-13


def test_a_method_that_there_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FVSWELL_SPARSE_SOLVER", "guess")
    matrix, places = lattice_matrix(2)
    with pytest.raises(ValueError, match="FVSWELL_SPARSE_SOLVER is 'guess' in the environment; it can be fronts or s"):
        DirectSolver(matrix.row, matrix.col, places)


def test_factors_serve_several_threads() -> None:
    matrix, places = lattice_matrix(30)
    solver = DirectSolver(matrix.row, matrix.col, places)
    right_sides = np.random.default_rng(1).normal(size=(8, 900))

    def solved(scale: float) -> list[Array]:
        factors = solver.factorise(scale * matrix.data)
        return [scale * factors.solve(right_side) for right_side in right_sides]

    with ThreadPoolExecutor(4) as threads:
        for solutions in threads.map(solved, [1.0, 2.0, 4.0, 8.0]):
            assert np.abs(matrix @ np.transpose(solutions) - right_sides.T).max() < 1e-13


@pytest.mark.parametrize("diagonal", [0.0, 1e-15, 1e-4])
def test_a_part_without_good_pivots_of_its_own(diagonal: float) -> None:
    side = 150
    matrix = sparse.diags_array([1.0, diagonal, 1.0], offsets=[-1, 0, 1], shape=(side, side)).tocoo()
    places = np.stack([np.arange(side, dtype=float), np.zeros(side)])
    parts = nested_dissection((abs(matrix) + abs(matrix).T).tocsr() + sparse.eye_array(side), places)
    assert len(parts[0].unknowns) % 2  # an odd number of them does not have the pairs that an even number has
    assert (Fronts(matrix.row, matrix.col, parts).factorise(matrix.data) is None) == (diagonal == 0.0)
    right_side = np.random.default_rng(1).normal(size=side)
    solution = DirectSolver(matrix.row, matrix.col, places).factorise(matrix.data).solve(right_side)
    assert np.abs(matrix @ solution - right_side).max() < 1e-10


@pytest.mark.parametrize("defect", ["row of zeros", "no entries in a row", "dependent rows", "not a number"])
@pytest.mark.parametrize("side", [4, 20])
def test_a_singular_matrix_has_no_solution(defect: str, side: int) -> None:
    matrix, places = lattice_matrix(side)
    dense = matrix.toarray()
    if defect == "not a number":
        dense[3, 3] = np.nan
    else:
        dense[3] = 0.7 * dense[1] - 0.3 * dense[5] if defect == "dependent rows" else 0.0
    held = dense != 0.0
    held[3] |= defect == "row of zeros"
    rows, columns = np.nonzero(held)
    factors = DirectSolver(rows, columns, places).factorise(dense[rows, columns])
    assert np.isnan(factors.solve(np.random.default_rng(1).normal(size=side**2))).all()


def test_nothing_to_solve() -> None:
    nothing = np.zeros(0, dtype=int)
    assert DirectSolver(nothing, nothing, np.zeros((2, 0))).factorise(np.zeros(0)).solve(np.zeros(0)).shape == (0,)
    matrix, places = lattice_matrix(7)
    assert (DirectSolver(matrix.row, matrix.col, places).factorise(matrix.data).solve(np.zeros(49)) == 0.0).all()


def lattice_parts(side: int) -> tuple[sparse.csr_array, list[Part]]:
    matrix, places = lattice_matrix(side)
    places[:, [17, 400]] = np.nan
    graph = abs(matrix).tocsr() + abs(matrix).T.tocsr()
    return graph, nested_dissection(graph, places)


def test_nested_dissection_orders_every_unknown_once_and_those_without_a_place_last() -> None:
    _, parts = lattice_parts(30)
    assert (np.sort(np.concatenate([part.unknowns for part in parts])) == np.arange(900)).all()
    assert set(parts[-1].unknowns) == {17, 400}


def test_parts_border_on_those_above_and_below_alone() -> None:
    graph, parts = lattice_parts(30)
    assert len(parts) > 8
    below: list[set[int]] = []
    for part in parts:
        below.append(set(part.unknowns).union(*(below[child] for child in part.children)))
    for part, own in zip(parts, below, strict=True):
        others = set(graph[sorted(own - set(part.unknowns))].indices) if own - set(part.unknowns) else set()
        above = {unknown for other in below if own < other for unknown in other}
        assert others <= own | above


def test_factors_grow_like_n_log_n() -> None:
    def filled(side: int) -> float:
        matrix, places = lattice_matrix(side)
        return DirectSolver(matrix.row, matrix.col, places).factorise(matrix.data).entries / side**2

    assert filled(128) < 2.2 * filled(32)  # log 128^2 / log 32^2 = 1.4; line by line it is 4
