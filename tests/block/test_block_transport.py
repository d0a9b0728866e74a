"""Fluxes and balances in the cells of a block, on grids that stand still."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from blocks import CLAMPED, CLAMPED_DISC, beyond, distorted_vertices, uniform_block
from scipy import sparse
from scipy.sparse.linalg import spsolve
from tissues import BATH, reference_tissue

from fvswell.block.block import Block
from fvswell.block.grid import block_grid, shaped_block_grid
from fvswell.numerics.graded_grid import graded_nodes
from fvswell.physics.fluxes import mixture_fluxes
from fvswell.physics.models import BIPHASIC, ELECTROCHEMICAL, MODELS, Model
from fvswell.physics.osmotic import ion_concentrations
from fvswell.physics.permeability import hydraulic_permeability
from fvswell.physics.tissue import Array, Tissue, fixed_charge_density


def test_matrix_on_a_rectangular_grid_is_the_two_point_one() -> None:
    """Between cell centres the flux is k area/distance times the difference of the potentials, and no more."""
    x, y = graded_nodes(2.0, 5, 3.0, ["end"]), graded_nodes(1.0, 4, 2.0, ["start"])
    block = uniform_block(block_grid("plane-strain", x, y), CLAMPED, BIPHASIC, stabilisation=0.0)
    grid = block.grid
    one = np.ones((1, grid.cells))
    system = block.transport_system(grid.vertices, 0.0 * one, one, 1.0, block.beyond(block.unloaded, np.zeros(0)))
    expected = np.zeros((grid.cells, grid.cells))
    for face, (first, second) in enumerate(grid.face_cells.T):
        ends = grid.vertices[:, grid.face_vertices[:, face]]
        other = ends.mean(axis=1) if second < 0 else grid.centres[:, second]
        conductance = 1e-3 * np.hypot(*np.diff(ends).T[0]) / np.hypot(*(other - grid.centres[:, first]))
        expected[first, first] += conductance
        if second >= 0:
            expected[second, second] += conductance
            expected[first, second] -= conductance
            expected[second, first] -= conductance
    np.testing.assert_allclose(system.jacobian.toarray(), expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)
def test_jacobian_by_the_potentials_is_the_derivative_of_the_residual(model: Model) -> None:
    grid = shaped_block_grid("plane-strain", distorted_vertices(5, 4))
    block, count = uniform_block(grid, CLAMPED, model, reference_tissue(permeability_exponent=2.0)), len(model.balances)
    draw, positions = np.random.default_rng(4), _moved(grid.vertices)
    potentials = draw.uniform(-0.1, 0.1, (count, grid.cells))
    if count > 1:
        potentials[1] += np.log(BATH)
    balance = (np.zeros_like(potentials), 3.0, block.beyond(block.unloaded, np.zeros(0)))
    exact = block.transport_system(positions, potentials, *balance).jacobian.toarray()
    scale, step = np.repeat([1.0, BATH, BATH][:count], grid.cells), 1e-3

    def shifted(j: int, times: float) -> Array:
        at = potentials.ravel().copy()
        at[j] += times * step
        return block.transport_system(positions, at.reshape(potentials.shape), *balance).residual.ravel()

    for j in range(potentials.size):
        slope = (8.0 * (shifted(j, 1) - shifted(j, -1)) - (shifted(j, 2) - shifted(j, -2))) / (12.0 * step)
        assert np.abs((exact[:, j] - slope) / scale).max() < 1e-10, j


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


def _fluxes(tissue: Tissue, J: Array, log_activity: Array, gradients: Array) -> Array:
    """Of the laws at points, (balances, points)."""
    if len(gradients) == 1:
        return np.asarray(-hydraulic_permeability(tissue, J) * gradients)
    ions = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), log_activity)
    flux = mixture_fluxes(tissue, J, *ions, *gradients)
    return np.stack([flux.water, flux.anion, flux.cation - flux.anion])


def _exact_outflow(block: Block, kind: str) -> Array:
    """What the exact fluxes through the images of the reference faces take out of each cell."""
    grid, count = block.grid, len(block.balances)
    point, weight = np.polynomial.legendre.leggauss(6)
    a, b = grid.vertices[:, grid.face_vertices[:, block.diamonds.faces]].transpose(1, 0, 2)
    total = np.zeros((count, len(block.diamonds.faces)))
    for s, w in zip(0.5 * (1.0 + point), 0.5 * weight, strict=True):
        X = a + s * (b - a)
        F, x = _by(_moved, X), _moved(X)
        span = np.einsum("ij...,j...->i...", F, b - a)
        area = w * np.stack([span[1], -span[0]])
        J = F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]
        if kind == "axisymmetric":
            area, J = area * 2 * np.pi * x[0], J * x[0] / X[0]
        gradients = np.einsum("pi...,i...->p...", _by(lambda y: _potentials(y, kind), x), area)
        total += _fluxes(block.faces, J, _potentials(x, kind)[1], gradients[:count])
    return (block.diamonds.outflow @ total.T).T


@pytest.mark.parametrize("kind", ["plane-strain", "axisymmetric"])
@pytest.mark.parametrize("model", [BIPHASIC, ELECTROCHEMICAL], ids=lambda model: model.name)
def test_manufactured_potentials_converge_at_second_order_on_a_moved_distorted_grid(kind: str, model: Model) -> None:
    tissue, duration, errors = reference_tissue(permeability_exponent=2.0), 1e6, []
    count = len(model.balances)
    for n in (6, 12, 24):
        grid = shaped_block_grid(kind, distorted_vertices(2 * n, n))
        block = uniform_block(grid, CLAMPED_DISC if kind == "axisymmetric" else CLAMPED, model, tissue)
        positions = _moved(grid.vertices)
        outside = beyond(block, _potentials(positions, kind)[:count])
        exact = _potentials(positions[:, grid.cell_vertices].mean(axis=1), kind)[:count]
        base = block.transport(positions, exact, outside).contents
        base = base + duration * _exact_outflow(block, kind) / grid.volumes
        potentials = exact + 0.1
        # rows of ions are smaller by a concentration
        scale = sparse.diags_array(np.repeat([1.0, 1e4, 1e4][:count], grid.cells))
        for _ in range(10):
            system = block.transport_system(positions, potentials, base, duration, outside)
            step = spsolve((scale @ system.jacobian).tocsc(), scale @ system.residual.ravel())
            potentials = potentials - step.reshape(potentials.shape)
            if np.abs(step).max() < 1e-10:
                break
        assert np.abs(step).max() < 1e-8
        errors.append(np.sqrt(((potentials - exact) ** 2).mean(axis=1)))
    orders = np.log2(errors[-2] / errors[-1])
    assert (orders > 1.8).all(), (errors, orders)
    assert errors[-1].max() < 2e-3


@pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)
def test_nothing_flows_in_equilibrium(model: Model) -> None:
    grid = shaped_block_grid("plane-strain", distorted_vertices(6, 4))
    block = uniform_block(grid, CLAMPED, model)
    bath = np.broadcast_to(block.bath_potentials(BATH)[:, None], (len(model.balances), grid.cells))
    outside = block.beyond(block.unloaded, np.zeros(0))
    np.testing.assert_allclose(block.transport(_moved(grid.vertices), bath, outside).fluxes, 0.0, atol=1e-16)
