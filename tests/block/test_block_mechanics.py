"""Forces of the solid: patches, rigid motion, and a manufactured deformation."""

from __future__ import annotations

import numpy as np
import pytest
from blocks import (
    CLAMPED,
    CLAMPED_DISC,
    FREE,
    distorted_vertices,
    jacobian_matrix,
    no_time,
    rough_grid,
    uniform_block,
)
from scipy.optimize import brentq
from scipy.sparse.linalg import spsolve
from tissues import BATH, reference_tissue

from fvswell.block.block import Block
from fvswell.block.equilibrium import NoEquilibrium, equilibrated_body
from fvswell.block.grid import BlockGrid, shaped_block_grid
from fvswell.block.laws import solid_law as compiled_solid
from fvswell.block.mechanics import block_solid, cell_stress, deformation_gradient, find_forces, mechanics_room
from fvswell.numerics.state import State
from fvswell.physics.equilibrium import isotropic_equilibrium_volume_ratio
from fvswell.physics.models import BIPHASIC, BIPHASIC_SWELLING, ELECTROCHEMICAL
from fvswell.physics.osmotic import osmotic_pressure_difference
from fvswell.physics.solids import SOLIDS, cauchy_stress
from fvswell.physics.tissue import Array, Tissue


def forces_at_vertices(grid: BlockGrid, tissue: Tissue, positions: Array) -> Array:
    """Forces that hold the vertices of a deformed solid, (2, vertices)."""
    every = np.arange(positions.size).reshape(positions.shape)
    result, total = mechanics_room(grid.cells), np.empty(positions.size)
    find_forces(
        grid.section, compiled_solid(tissue), block_solid(grid, tissue), positions, np.zeros(grid.cells), every,
        result, total,
    )  # fmt: skip
    return total.reshape(positions.shape)


def equilibrated(block: Block) -> State:
    return equilibrated_body(block)[1]


@pytest.mark.parametrize("solid_law", SOLIDS)
def test_homogeneous_finite_deformation_is_exact_on_distorted_quads(solid_law: str) -> None:
    grid = rough_grid("plane-strain")
    tissue = reference_tissue(solid_law)
    F = np.array([[1.2, 0.35], [-0.1, 0.8]])
    positions = F @ grid.vertices
    forces = forces_at_vertices(grid, tissue, positions)
    inner = np.setdiff1d(np.arange(positions.shape[1]), np.concatenate([grid.edge_vertices(e) for e in grid.edges]))
    np.testing.assert_allclose(forces[:, inner], 0.0, atol=1e-14)
    sigma = cauchy_stress(tissue.solid, tissue.fluid_fraction, (*F.ravel(), 1.0))
    edge = F @ np.array([0.0, 1.0])  # the right edge
    normal = np.array([edge[1], -edge[0]])
    traction = np.array([[sigma.xx, sigma.xy], [sigma.xy, sigma.yy]]) @ normal
    on_right = grid.edge_vertices("right")
    corners = on_right[[0, -1]]
    other = forces[:, np.setdiff1d(on_right, corners)].sum(axis=1)
    assert np.abs(traction).min() > 0.01
    np.testing.assert_allclose(other, traction * 0.75, rtol=1e-12)  # two half faces of four belong to the corners
    solid = block_solid(grid, tissue)
    stress = cell_stress(solid, type(tissue.solid), deformation_gradient(solid, 1.0, positions))
    np.testing.assert_allclose(stress.xy, sigma.xy, rtol=1e-12)


def test_rigid_motion_gives_no_stress() -> None:
    grid = rough_grid("plane-strain")
    turn = np.array([[np.cos(0.8), -np.sin(0.8)], [np.sin(0.8), np.cos(0.8)]])
    positions = turn @ grid.vertices + np.array([[3.0], [-1.0]])
    forces = forces_at_vertices(grid, reference_tissue(), positions)
    np.testing.assert_allclose(forces, 0.0, atol=1e-14)


@pytest.mark.parametrize("concentration", [1.5e-4, 1e-4, 5e-5])
def test_free_swelling_of_a_disc(concentration: float) -> None:
    expected = isotropic_equilibrium_volume_ratio(reference_tissue(), concentration)
    state = equilibrated(uniform_block(rough_grid("axisymmetric"), FREE, ELECTROCHEMICAL, concentration=concentration))
    np.testing.assert_allclose(state.contents[0], expected, rtol=0, atol=1e-12)


def test_free_swelling_of_a_square_held_out_of_plane() -> None:
    tissue = reference_tissue()

    def unbalanced(J: float) -> float:
        stretch = np.sqrt(J)
        stress = cauchy_stress(tissue.solid, tissue.fluid_fraction, (stretch, 0.0, 0.0, stretch, 1.0)).xx
        return float(stress - osmotic_pressure_difference(tissue, J, BATH))

    state = equilibrated(uniform_block(rough_grid("plane-strain"), FREE, BIPHASIC_SWELLING))
    np.testing.assert_allclose(state.contents[0], brentq(unbalanced, 1.0, 1.2, xtol=1e-14), rtol=0, atol=1e-12)


def test_biphasic_block_starts_stress_free_and_glued_one_swells_unevenly() -> None:
    grid = rough_grid("plane-strain")
    glued = FREE | {"bottom": CLAMPED["bottom"]}
    np.testing.assert_allclose(equilibrated(uniform_block(grid, glued, BIPHASIC)).contents[0], 1.0)
    state = equilibrated(uniform_block(grid, glued, ELECTROCHEMICAL))
    assert np.ptp(state.contents[0]) > 0.01
    assert state.contents[0].min() > 1.0


def test_no_equilibrium_is_reported() -> None:
    tissue = reference_tissue(youngs_modulus=0.01, fixed_charge_density=0.0)  # the bath draws water out
    with pytest.raises(NoEquilibrium, match="no equilibrium was found"):
        equilibrated(uniform_block(rough_grid("axisymmetric"), FREE, ELECTROCHEMICAL, tissue))


def _displacement(X: Array) -> Array:
    bump = np.sin(np.pi * X[0] / 2.0) * np.sin(np.pi * X[1])
    return np.stack([0.12 * bump, -0.08 * bump * (1.0 + X[0])])


def _gradient(X: Array) -> Array:
    """F of the manufactured deformation, (2, 2, points)."""
    step = 1e-30j
    by = [(_displacement(X + step * np.eye(2)[:, i].reshape(2, *[1] * (X.ndim - 1))).imag / 1e-30) for i in (0, 1)]
    F = np.stack(by, axis=1)
    F[0, 0] += 1.0
    F[1, 1] += 1.0
    return F


def _pressure(X: Array) -> Array:
    return 0.1 * np.cos(2.0 * X[0]) * (1.0 + X[1])


def _manufactured_forces(block: Block) -> Array:
    """Forces on the corners of the cells in the exact deformation: integral of (P - p J F^-T) : grad N."""
    point, weight = np.polynomial.legendre.leggauss(6)
    a, b = (g.ravel() for g in np.meshgrid(point, point))
    w = np.outer(weight, weight).ravel()
    sa, sb = np.array([-1.0, 1.0, 1.0, -1.0]), np.array([-1.0, -1.0, 1.0, 1.0])
    N = 0.25 * (1 + np.outer(a, sa)) * (1 + np.outer(b, sb))
    slope = 0.25 * np.stack([sa * (1 + np.outer(b, sb)), sb * (1 + np.outer(a, sa))], axis=-1)
    corners = block.grid.vertices[:, block.grid.cell_vertices]
    X = np.einsum("qa,dac->dqc", N, corners)
    jacobian = np.einsum("qae,dac->cqde", slope, corners)
    grad = np.einsum("qae,cqed->adqc", slope, np.linalg.inv(jacobian))
    volume = np.linalg.det(jacobian).T * w[:, None]
    F = _gradient(X)
    rings = block.grid.section.rings
    hoop = 1.0 + _displacement(X)[0] / X[0] if rings else np.ones_like(X[0])
    volume = volume * 2 * np.pi * X[0] if rings else volume
    components = (F[0, 0], F[0, 1], F[1, 0], F[1, 1], hoop)
    s = cauchy_stress(block.cells.solid, block.cells.fluid_fraction, components)
    p = _pressure(X)
    sigma = np.stack([np.stack([s.xx - p, s.xy]), np.stack([s.xy, s.yy - p])])
    cofactor = np.stack([np.stack([F[1, 1], -F[1, 0]]), np.stack([-F[0, 1], F[0, 0]])]) * hoop
    P = np.einsum("ik...,kj...->ij...", sigma, cofactor)
    forces = np.einsum("ij...qc,aj...qc,qc->iac", P, grad, volume)
    if rings:
        P_hoop = (s.zz - p) * (F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0])
        forces[0] += np.einsum("qc,qa,qc->ac", P_hoop / X[0], N, volume)
    return forces


@pytest.mark.parametrize("kind", ["plane-strain", "axisymmetric"])
def test_manufactured_deformation_converges_at_second_order(kind: str) -> None:
    errors = []
    for n in (6, 12, 24):
        grid = shaped_block_grid(kind, distorted_vertices(2 * n, n))
        block = uniform_block(grid, CLAMPED_DISC if kind == "axisymmetric" else CLAMPED, BIPHASIC)
        number, interval = block.degrees_of_freedom.number, no_time(block)
        index, local = block.of_vertex[:, grid.cell_vertices], _manufactured_forces(block)
        moved = index >= 0
        forces = np.bincount(index[moved], local[moved], number)
        unknowns = np.concatenate([np.zeros(number), _pressure(grid.centres)])
        for _ in range(12):
            residual = block.evaluate(unknowns, interval).residual[:number]
            step = spsolve(jacobian_matrix(block, unknowns, interval)[:number, :number].tocsc(), residual - forces)
            unknowns[:number] -= step
            if np.abs(step).max() < 1e-12:
                break
        gap = block.degrees_of_freedom.displacements(unknowns[:number]) - _displacement(grid.vertices)
        errors.append(np.sqrt((gap**2).mean()))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders[-1] > 1.9, (errors, orders)
    assert errors[-1] < 1e-3
