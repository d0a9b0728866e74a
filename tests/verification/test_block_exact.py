"""Blocks against exact solutions: Mandel's problem and unconfined compression of a disc, small strain."""

from __future__ import annotations

import numpy as np
import pytest
from blocks import UNCONFINED, integrate, make_control, make_protocol, phase, uniform_block
from tissues import reference_tissue

from fvswell.block.equilibrium import equilibrated_body
from fvswell.block.grid import block_grid
from fvswell.exact.mandel import MandelBlock
from fvswell.exact.unconfined_compression import DiscStiffness, TransverselyIsotropicDisc, UnconfinedDisc
from fvswell.numerics.graded_grid import graded_nodes
from fvswell.physics.fibre_directions import PlanarDirections
from fvswell.physics.fibre_laws import PowerFibres
from fvswell.physics.fibres import FibreFamily, with_fibres
from fvswell.physics.models import BIPHASIC
from fvswell.physics.tissue import Array, Tissue

_SCALED_TIMES = np.array([0.01, 0.05, 0.1, 0.5, 1.0])
_SMALL = 1e-6  # MPa: strains of 1e-6, so that the solid is linear to that


def _history(
    kind: str, cells: int, duration: float, force: float, tissue: Tissue, tolerance: float = 1e-4
) -> tuple[Array, Array, Array, Array]:
    """Pressures (times, cells in the bottom row), their places, displacements of the top and of the right edge."""
    grid = block_grid(kind, graded_nodes(1.0, cells, 5.0, ["end"]), graded_nodes(0.5, 2))
    body, state = equilibrated_body(uniform_block(grid, UNCONFINED, BIPHASIC, tissue))
    block, rim = body.block, grid.edge_vertices("right")[0]
    times = _SCALED_TIMES * duration
    control = make_control(tolerance=tolerance, expected_strain=_SMALL, first_step=1e-5 * duration)
    run = integrate(body, state, make_protocol([phase(body, top__force=force)], [times[-1]], times), control)
    assert run.complete
    unknowns = run.filled("unknowns")
    assert len(unknowns) == len(times)
    pressure = np.array([block.potentials(each)[0, :cells] for each in unknowns])
    outward = np.array([(block.positions(each) - grid.vertices)[0, rim] for each in unknowns])
    return pressure, grid.centres[0, :cells], run.load("top.displacement"), outward


def test_mandel() -> None:
    exact = MandelBlock(1.0, 0.5, 0.2, 1e-3, force=_SMALL)
    tissue = reference_tissue(poisson_ratio=0.2)
    errors = []
    for cells in (20, 40):
        pressure, x, top, outward = _history("plane-strain", cells, 1.0 / exact.diffusivity, _SMALL, tissue)
        times = _SCALED_TIMES / exact.diffusivity
        gap = np.abs(pressure - exact.fluid_pressure(x, times)).max() / _SMALL
        errors.append(gap)
        np.testing.assert_allclose(2.0 * top, exact.axial_strain(times), rtol=2e-3)
        np.testing.assert_allclose(outward, exact.edge_displacement(times), rtol=2e-3)
    assert errors[-1] < 1e-3
    assert errors[0] / errors[1] > 3.0  # second order
    middle = pressure[:, 0] / _SMALL
    np.testing.assert_allclose(middle, [0.52188, 0.54944, 0.54771, 0.29639, 0.12942], atol=1e-3)
    assert middle[1] > middle[0]  # Mandel and Cryer's effect: the pressure first rises


def test_unconfined_compression_of_a_disc() -> None:
    exact = UnconfinedDisc(1.0, 0.5, 0.2, 1e-3)
    tissue = reference_tissue(poisson_ratio=0.2)
    scale = 1.0 / (exact.aggregate_modulus * exact.permeability)
    errors = []
    for cells in (20, 40):
        pressure, r, top, outward = _history("axisymmetric", cells, scale, np.pi * _SMALL, tissue)
        creep = exact.creep(r, _SCALED_TIMES * scale, _SMALL)
        errors.append(np.abs(pressure - creep.fluid_pressure).max() / _SMALL)
        np.testing.assert_allclose(2.0 * top, creep.axial_strain, rtol=2e-3)
        np.testing.assert_allclose(outward, creep.rim_displacement, rtol=4e-3)
    assert errors[-1] < 1e-3
    assert errors[0] / errors[1] > 3.0


def test_disc_with_planar_fibres() -> None:
    """Cohen, Lai & Mow (1998): all fibres across the axis are in tension, of stiffness 4 xi at small strain."""
    E, nu, modulus = 0.5, 0.4, 1.0
    lame, G, fibres = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu)), 4 * modulus
    stiffness = DiscStiffness(lame + 2 * G + 3 / 8 * fibres, lame + fibres / 8, lame, lame + 2 * G)
    exact = TransverselyIsotropicDisc(1.0, stiffness, 1e-3)
    tissue = reference_tissue(poisson_ratio=nu)
    family = FibreFamily(PlanarDirections(), PowerFibres(modulus))
    tissue = tissue._replace(solid=with_fibres(tissue.solid, [family]))
    scale = 1.0 / (stiffness.radial * exact.permeability)
    errors = []
    for cells in (20, 40):
        pressure, r, top, outward = _history("axisymmetric", cells, scale, np.pi * _SMALL, tissue)
        creep = exact.creep(r, _SCALED_TIMES * scale, _SMALL)
        errors.append(np.abs(pressure - creep.fluid_pressure).max() / _SMALL)
        np.testing.assert_allclose(2.0 * top, creep.axial_strain, rtol=2e-3)
        np.testing.assert_allclose(outward, creep.rim_displacement, rtol=4e-3)
    assert errors[-1] < 1e-3
    assert errors[0] / errors[1] > 3.0


@pytest.mark.slow
def test_mandel_on_a_fine_grid() -> None:
    exact = MandelBlock(1.0, 0.5, 0.2, 1e-3, force=_SMALL)
    pressure, x, *_ = _history(
        "plane-strain", 120, 1.0 / exact.diffusivity, _SMALL, reference_tissue(poisson_ratio=0.2), 1e-5
    )
    gap = np.abs(pressure - exact.fluid_pressure(x, _SCALED_TIMES / exact.diffusivity)).max() / _SMALL
    assert gap < 1e-4
