"""The linear solver of columns against a dense one."""

from __future__ import annotations

import numpy as np
import pytest

from fvswell.numerics.block_tridiagonal import solve_block_tridiagonal
from fvswell.physics.tissue import Array


def system(unknowns: int, cells: int, seed: int) -> tuple[Array, Array, Array, Array, Array]:
    draw = np.random.default_rng(seed)
    lower, diagonal, upper = draw.uniform(-1.0, 1.0, (3, unknowns, unknowns, cells))
    diagonal += 4.0 * np.eye(unknowns)[:, :, None]
    first, second = draw.uniform(-1.0, 1.0, (2, unknowns, cells))
    return lower, diagonal, upper, first, second


def dense(lower: Array, diagonal: Array, upper: Array) -> Array:
    """The matrix ordered cell by cell."""
    unknowns, _, cells = lower.shape
    matrix = np.zeros((cells, unknowns, cells, unknowns))
    for i in range(cells):
        matrix[i, :, i] = diagonal[:, :, i]
        if i > 0:
            matrix[i, :, i - 1] = lower[:, :, i]
        if i < cells - 1:
            matrix[i, :, i + 1] = upper[:, :, i]
    return matrix.reshape(cells * unknowns, cells * unknowns)


@pytest.mark.parametrize("unknowns", [1, 2])
@pytest.mark.parametrize("cells", [2, 3, 10, 51])
def test_against_a_dense_solver(unknowns: int, cells: int) -> None:
    parts = system(unknowns, cells, seed=cells)
    matrix, sides = dense(*parts[:3]), [side.T.ravel() for side in parts[3:]]
    expected = [np.linalg.solve(matrix, side).reshape(cells, unknowns).T for side in sides]
    solve_block_tridiagonal(*parts)
    for found, exact in zip(parts[3:], expected, strict=True):
        np.testing.assert_allclose(found, exact, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("unknowns", [1, 2])
def test_couplings_beyond_the_ends_do_not_matter(unknowns: int) -> None:
    one, other = system(unknowns, 6, seed=1), system(unknowns, 6, seed=1)
    other[0][:, :, 0] = 7.0
    other[2][:, :, -1] = -3.0
    solve_block_tridiagonal(*one)
    solve_block_tridiagonal(*other)
    np.testing.assert_array_equal(one[3], other[3])
    np.testing.assert_array_equal(one[4], other[4])


@pytest.mark.parametrize("unknowns", [1, 2])
def test_singular_system_has_no_number_for_an_answer(unknowns: int) -> None:
    parts = system(unknowns, 5, seed=2)
    for part in parts[:3]:
        part[:, :, 2] = 0.0  # an equation that says nothing
    with np.errstate(all="ignore"):
        solve_block_tridiagonal(*parts)
    assert not np.isfinite(parts[3]).all()
