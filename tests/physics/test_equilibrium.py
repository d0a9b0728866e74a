"""Equilibrium with the bath: numbers worked out beforehand, balance of forces, loads nothing can carry."""

from __future__ import annotations

import numpy as np
import pytest
from tissues import BATH, point_of, random_tissue, reference_tissue

from fvswell.physics.equilibrium import equilibrium_volume_ratio, isotropic_equilibrium_volume_ratio
from fvswell.physics.models import BIPHASIC, MODELS
from fvswell.physics.osmotic import OSMOTIC_LAWS, osmotic_pressure_difference
from fvswell.physics.solids import SOLIDS, aggregate_modulus, bulk_modulus, uniaxial_stress

BATHS = np.array([1.5e-4, 1e-4, 5e-5])
# the numbers below were worked out with R = 8.3145 N mm/(mmol K)
COMPARABLE = {"temperature": 298.0 * 8.3145 / 8.314462618}


def test_free_swelling_in_one_direction() -> None:
    J = equilibrium_volume_ratio(reference_tissue(**COMPARABLE), 0.0, BATHS)
    np.testing.assert_allclose(J, [1.054503, 1.127643, 1.236596], atol=1e-6, rtol=0)


def test_equal_osmotic_coefficients() -> None:
    tissue = reference_tissue(osmotic_coefficient=1.0, bath_osmotic_coefficient=1.0, **COMPARABLE)
    assert equilibrium_volume_ratio(tissue, 0.0, BATH) == pytest.approx(1.166001, abs=1e-6)


@pytest.mark.parametrize(
    ("model", "expected"), [("electrochemical", 0.822614), ("biphasic-swelling", 0.822614), ("biphasic", 0.682746)]
)
def test_compressed(model: str, expected: float) -> None:
    tissue = MODELS[model].tissue(reference_tissue(**COMPARABLE))
    assert equilibrium_volume_ratio(tissue, 0.25, BATH) == pytest.approx(expected, abs=1e-6)


def test_free_swelling_in_all_directions() -> None:
    J = isotropic_equilibrium_volume_ratio(reference_tissue(**COMPARABLE), BATHS)
    np.testing.assert_allclose(J, [1.076768, 1.181408, 1.340529], atol=1e-6, rtol=0)


def test_isotropic_stress_is_the_volumetric_term_of_the_paper() -> None:
    tissue = reference_tissue()
    J = isotropic_equilibrium_volume_ratio(tissue, BATH)
    stress = bulk_modulus(tissue.solid, tissue.fluid_fraction) / 2 * (J - 1 / J)
    np.testing.assert_allclose(stress, osmotic_pressure_difference(tissue, J, BATH), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("solid", SOLIDS)
def test_forces_balance_over_random_tissues(solid: str) -> None:
    tissue = random_tissue(500, seed=1, solid=solid)
    pressure = np.random.default_rng(2).uniform(-0.05, 5.0, 500)
    J = equilibrium_volume_ratio(tissue, pressure, BATHS[:, None])
    assert J.shape == (3, 500)
    osmotic = osmotic_pressure_difference(tissue, J, BATHS[:, None])
    stress = uniaxial_stress(tissue.solid, J, tissue.fluid_fraction)
    np.testing.assert_allclose(stress + pressure, osmotic, rtol=1e-11, atol=1e-13)
    assert np.all(J - 1 + tissue.fluid_fraction > 0)


@pytest.mark.parametrize("solid", SOLIDS)
def test_a_point_does_not_depend_on_the_others(solid: str) -> None:
    """To the bit, whether it is found alone or beside others that take longer."""
    tissue = random_tissue(20, seed=5, solid=solid)
    together = equilibrium_volume_ratio(tissue, 0.3, BATH)
    alone = [equilibrium_volume_ratio(point_of(tissue, index), 0.3, BATH) for index in range(20)]
    np.testing.assert_allclose(together, alone, rtol=1e-15)


def test_accurate_to_rounding() -> None:
    """A quarter of the modulus as tension: K/2 (J - 1/J) + P = 0 without shear stiffness is a quadratic."""
    tissue = BIPHASIC.tissue(reference_tissue(poisson_ratio=0.5 - 1e-15))  # G/K = 0 to rounding
    K = bulk_modulus(tissue.solid, tissue.fluid_fraction)
    J = equilibrium_volume_ratio(tissue, -0.25 * K, BATH)
    np.testing.assert_allclose(J, 0.25 + np.sqrt(0.0625 + 1), rtol=1e-14)


def test_no_load_leaves_the_uncharged_solid_alone() -> None:
    J = equilibrium_volume_ratio(BIPHASIC.tissue(reference_tissue()), 0.0, BATH)
    np.testing.assert_allclose(J, 1.0, rtol=1e-15)


def test_load_that_the_solid_cannot_carry_has_no_equilibrium() -> None:
    tissue = reference_tissue()
    pressure = np.array([0.25, 2.0, 5.0])  # the solid carries at most 1.25 MPa at J = 0.2
    J = equilibrium_volume_ratio(BIPHASIC.tissue(tissue), pressure, BATH)
    assert np.isfinite(J[0])
    assert np.isnan(J[1:]).all()
    swollen = equilibrium_volume_ratio(tissue, pressure, BATH)
    assert np.isfinite(swollen).all()  # fixed charge holds the last water with any force
    assert np.all(np.diff(swollen) < 0)


def test_small_load_gives_the_aggregate_modulus() -> None:
    tissue = BIPHASIC.tissue(reference_tissue())
    J = equilibrium_volume_ratio(tissue, 1e-6, BATH)
    np.testing.assert_allclose((J - 1) * aggregate_modulus(tissue.solid, tissue.fluid_fraction), -1e-6, rtol=1e-5)


@pytest.mark.parametrize("osmotic", OSMOTIC_LAWS)
@pytest.mark.parametrize("solid", SOLIDS)
def test_one_state_at_a_time_as_many_points_at_once(solid: str, osmotic: str) -> None:
    """Also where there is no equilibrium: pulled apart, or in a solid whose osmotic coefficient is negative."""
    pressures = np.array([-5.0, -0.05, 0.0, 0.1, 1.0, 30.0])
    for coefficient in (0.83, -0.1):
        tissue = reference_tissue(solid=solid, osmotic=osmotic, osmotic_coefficient=coefficient)
        alone = equilibrium_volume_ratio(tissue, pressures, BATH)
        points = tissue._replace(fluid_fraction=np.full(len(pressures), tissue.fluid_fraction))
        together = equilibrium_volume_ratio(points, pressures, BATH)
        assert np.isfinite(together[2:4]).all() or coefficient < 0.0
        np.testing.assert_allclose(alone, together, rtol=1e-14)
