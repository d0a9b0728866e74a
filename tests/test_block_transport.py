"""Fluxes and balances in the cells of a block, on grids that stand still."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from blocks import BATH, CLAMPED, CLAMPED_DISC, block_system, distorted_vertices
from fipy import CellVariable, DiffusionTerm
from scipy import sparse
from scipy.sparse.linalg import spsolve
from tissues import reference_tissue

from fvswell.block.block import Block
from fvswell.block.grid import block_grid, graded_nodes, shaped_block_grid
from fvswell.block.transport import BlockInterval
from fvswell.physics.models import BIPHASIC, ELECTROCHEMICAL, MODELS, Mixture, Model
from fvswell.physics.tissue import Array


def fipy_matrix(term: Any, var: CellVariable) -> Array:
    """The matrix that FiPy builds from a term."""
    term.cacheMatrix()
    term._prepareLinearSystem(var, None, (), 1.0)
    return term.matrix.numpyArray


def test_matrix_on_a_rectangular_grid_is_that_of_fipys_diffusion_term() -> None:
    grid = block_grid("plane-strain", graded_nodes(2.0, 5, 3.0, ["end"]), graded_nodes(1.0, 4, 2.0, ["start"]))
    term = block_system(grid, CLAMPED, BIPHASIC).block.term
    var = CellVariable(mesh=grid.mesh, value=0.0)
    var.constrain(0.0, grid.mesh.exteriorFaces)
    interval = BlockInterval(np.ones((1, 1, grid.cells)), 1.0, BATH)
    own = fipy_matrix(term.bind(var, grid.vertices, interval), var)
    stock = fipy_matrix(DiffusionTerm(coeff=1e-3, var=var), var)
    assert np.abs(own).max() > 1e-3
    np.testing.assert_allclose(own, -stock, rtol=0, atol=1e-12 * np.abs(stock).max())


def test_fipy_solves_the_bound_term() -> None:
    """A sweep is a Newton step: from the linear biphasic model's state it lands on the balance."""
    grid = shaped_block_grid("plane-strain", distorted_vertices(6, 4))
    term = block_system(grid, CLAMPED, BIPHASIC).block.term
    base = 1.0 + 0.01 * np.cos(grid.centres[0])[None, None]
    interval = BlockInterval(base, 40.0, BATH)
    var = CellVariable(mesh=grid.mesh, value=0.0)
    term.bind(var, grid.vertices, interval).solve(var=var)
    J = np.ones((1, grid.cells))
    residual = term.balance(np.array(var.value)[None, None], grid.vertices, J, interval).residual
    assert np.abs(var.value).max() > 1e-3
    np.testing.assert_allclose(residual, 0.0, atol=1e-14)


def _potentials(x: Array, kind: str) -> Array:
    """mu_f, ln c~ and psi~ at current positions (complex allowed); even in the radius, as nothing flows at the axis."""
    along = x[0] ** 2 / 4.0 if kind == "axisymmetric" else x[0] / 2.0
    return np.stack(
        [
            0.2 * np.sin(2.0 * along) * (1.0 + x[1]),
            np.log(BATH) + 0.5 * np.cos(1.5 * along + x[1]),
            0.3 * along * x[1] + 0.1 * x[1] ** 2,
        ]
    )


def _moved(X: Array) -> Array:
    bump = np.sin(np.pi * X[0] / 2.0)
    return np.stack([X[0] + 0.15 * bump * (0.5 + X[1]), X[1] - 0.1 * np.cos(np.pi * X[0] / 2.0) * X[1]])


def _by(function: Callable[[Array], Array], x: Array) -> Array:
    """Derivatives by both coordinates, (values, 2, ...)."""
    unit = np.eye(2).reshape(2, 2, *[1] * (x.ndim - 1))
    return np.stack([function(x + 1e-30j * unit[i]).imag / 1e-30 for i in (0, 1)], axis=1)


def _exact_outflow(block: Block, faces: Mixture, kind: str) -> Array:
    """What the exact fluxes through the images of the reference faces take out of each cell."""
    grid = block.grid
    point, weight = np.polynomial.legendre.leggauss(6)
    a, b = grid.vertices[:, grid.face_vertices[:, block.term.diamonds.faces]].transpose(1, 0, 2)
    total = 0.0
    for s, w in zip(0.5 * (1.0 + point), 0.5 * weight, strict=True):
        X = a + s * (b - a)
        F, x = _by(_moved, X), _moved(X)
        span = np.einsum("ij...,j...->i...", F, b - a)
        area = w * np.stack([span[1], -span[0]])
        J = (F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0])[None]
        if kind == "axisymmetric":
            area, J = area * 2 * np.pi * x[0], J * x[0] / X[0]
        values = _potentials(x, kind)
        gradients = np.einsum("pi...,i...->p...", _by(lambda y: _potentials(y, kind), x), area)
        count = len(faces.model.balances)
        log_concentration = values[1][None] if count > 1 else np.full_like(J, np.log(BATH))
        total = total + faces.fluxes(faces.at(J, log_concentration), gradients[:count, None])
    return (block.term.diamonds.outflow @ np.asarray(total)[:, 0].T).T


@pytest.mark.parametrize("kind", ["plane-strain", "axisymmetric"])
@pytest.mark.parametrize("model", [BIPHASIC, ELECTROCHEMICAL], ids=lambda model: model.name)
def test_manufactured_potentials_converge_at_second_order_on_a_moved_distorted_grid(kind: str, model: Model) -> None:
    tissue, duration, errors = reference_tissue(permeability_exponent=2.0), 1e6, []
    for n in (6, 12, 24):
        grid = shaped_block_grid(kind, distorted_vertices(2 * n, n))
        block = block_system(grid, CLAMPED_DISC if kind == "axisymmetric" else CLAMPED, model, tissue).block
        term, positions, count = block.term, _moved(grid.vertices), len(model.balances)
        term.bath_potentials = lambda bath, x=positions, count=count: _potentials(x, kind)[:count]
        outflow = _exact_outflow(block, term.faces, kind)
        J = block.volume_ratio(positions)
        exact = _potentials(positions[:, grid.cell_vertices].mean(axis=1), kind)[:count, None]
        base = term.cells.contents(term.cells.at(J, term.log_concentration(exact, BATH)))
        interval = BlockInterval(base + duration * outflow[:, None] / grid.volumes, duration, BATH)
        potentials = exact + 0.1
        # rows of ions are smaller by a concentration
        scale = sparse.diags_array(np.repeat([1.0, 1e4, 1e4][:count], grid.cells))
        for _ in range(10):
            balance = term.balance(potentials, positions, J, interval)
            matrix = scale @ term.potential_jacobian(term.derivatives(positions, balance), duration)
            step = spsolve(matrix.tocsc(), scale @ balance.residual.ravel()).reshape(potentials.shape)
            potentials = potentials - step
            if np.abs(step).max() < 1e-10:
                break
        assert np.abs(step).max() < 1e-8
        errors.append(np.sqrt(((potentials - exact) ** 2).mean(axis=(1, 2))))
    orders = np.log2(errors[-2] / errors[-1])
    assert (orders > 1.8).all(), (errors, orders)
    assert errors[-1].max() < 2e-3


@pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)
def test_nothing_flows_at_rest(model: Model) -> None:
    grid = shaped_block_grid("plane-strain", distorted_vertices(6, 4))
    term = block_system(grid, CLAMPED, model).block.term
    rest = term.cells.bath_potentials(np.full((1, grid.cells), BATH))
    interval = BlockInterval(np.zeros((len(model.balances), 1, grid.cells)), 1.0, BATH)
    fluxes = term.balance(rest, _moved(grid.vertices), np.ones((1, grid.cells)), interval).fluxes
    np.testing.assert_allclose(fluxes, 0.0, atol=1e-16)
