"""From the stress-free solid to what is measured in the bath, and back."""

from __future__ import annotations

import numpy as np
import pytest
from tissues import BATH, point_of, random_tissue, reference_tissue

from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.fibre_directions import IsotropicDirections, one_direction
from fvswell.physics.fibre_laws import PowerFibres
from fvswell.physics.fibres import FibreFamily, with_fibres
from fvswell.physics.osmotic import OSMOTIC_LAWS, osmotic_pressure_difference
from fvswell.physics.permeability import PERMEABILITIES, hydraulic_permeability
from fvswell.physics.reference_state import equilibrated_tissue, stress_free_tissue
from fvswell.physics.solids import SOLIDS, uniaxial_stress
from fvswell.physics.tissue import fixed_charge_density, fluid_fraction

POINTS = 60
AXIAL = one_direction(90.0)
LAWS = [
    *({"solid": solid} for solid in SOLIDS),
    *({"permeability": law} for law in PERMEABILITIES),
    *({"osmotic": law} for law in OSMOTIC_LAWS),
]


@pytest.mark.parametrize("laws", LAWS, ids=str)
def test_there_and_back(laws: dict[str, str]) -> None:
    """To 1e-12, over random tissues and every law; the paper's law draws water out of some."""
    tissue = random_tissue(POINTS, 3, shear_modulus=np.linspace(0.1, 0.4, POINTS), **laws)  # type: ignore[arg-type]
    if "fixed_charge_density" in tissue.osmotic._fields:
        osmotic = tissue.osmotic._replace(fixed_charge_density=tissue.fixed_charge_density)
        tissue = tissue._replace(osmotic=osmotic)
    measured, swollen = equilibrated_tissue(tissue, BATH)
    found, J = stress_free_tissue(measured, BATH)
    np.testing.assert_allclose(J, swollen, rtol=1e-12)
    for name in ("fluid_fraction", "fixed_charge_density"):
        np.testing.assert_allclose(getattr(found, name), getattr(tissue, name), rtol=1e-12)
    for parts in zip(found.permeability, tissue.permeability, strict=True):
        np.testing.assert_allclose(*parts, rtol=1e-12)
    for parts in zip(found.osmotic, tissue.osmotic, strict=True):
        np.testing.assert_allclose(*parts, rtol=1e-12)


def test_numbers_measured_are_those_of_the_swollen_sample() -> None:
    tissue = reference_tissue(permeability_exponent=2.0, osmotic="activity")
    measured, J = equilibrated_tissue(tissue, BATH)
    assert pytest.approx(1.131315, abs=1e-6) == J
    assert measured.fluid_fraction == fluid_fraction(tissue, J)
    assert measured.fixed_charge_density == fixed_charge_density(tissue, J)
    assert measured.permeability.hydraulic_permeability == hydraulic_permeability(tissue, J)
    np.testing.assert_allclose(measured.fluid_fraction, 1 - 0.2 / J, rtol=1e-14)


def test_sample_swells_to_what_was_measured() -> None:
    """n_f .75, c_F .25 M and k 2e-3 measured in 0.15 M: a column of the stress-free numbers comes to them."""
    measured = reference_tissue(
        osmotic="activity", fluid_fraction=0.75, fixed_charge_density=2.5e-4, hydraulic_permeability=2e-3,
        permeability_exponent=1.5,
    )  # fmt: skip
    tissue, J = stress_free_tissue(measured, BATH)
    assert tissue.fluid_fraction < 0.75
    assert tissue.fixed_charge_density > 2.5e-4
    found = equilibrium_volume_ratio(tissue, 0.0, BATH)
    assert found == pytest.approx(float(J), rel=1e-12)
    assert fluid_fraction(tissue, found) == pytest.approx(0.75, rel=1e-12)
    assert fixed_charge_density(tissue, found) == pytest.approx(2.5e-4, rel=1e-12)
    assert hydraulic_permeability(tissue, found) == pytest.approx(2e-3, rel=1e-12)


def test_fibres_hold_the_sample_nearer_to_its_stress_free_state() -> None:
    tissue = reference_tissue(osmotic="activity")
    fibres = [FibreFamily(one_direction(90.0), PowerFibres(2.0, 0.0, 2.0))]
    reinforced = tissue._replace(solid=with_fibres(tissue.solid, fibres))
    (_, plain), (found, J) = (stress_free_tissue(part, BATH) for part in (tissue, reinforced))
    assert 1.0 < J < plain
    assert equilibrium_volume_ratio(found, 0.0, BATH) == pytest.approx(float(J), rel=1e-12)


def test_fibres_that_overflow_when_they_are_stretched_far() -> None:
    """exp(50 (I - 1)^2) is more than a float holds from I = 4.8 on, which a search for the equilibrium may pass."""
    tissue = reference_tissue(osmotic="activity", youngs_modulus=1e-4)
    fibres = [FibreFamily(directions, PowerFibres(0.01, 50.0, 2.0)) for directions in (IsotropicDirections(), AXIAL)]
    for families in (fibres[:1], fibres[1:], fibres):
        reinforced = tissue._replace(solid=with_fibres(tissue.solid, families))
        J = equilibrium_volume_ratio(reinforced, 0.0, np.array([1e-5, BATH]))
        assert np.all((J > 1.05) & (J < 1.5))
        stress = uniaxial_stress(reinforced.solid, J, 0.8)
        np.testing.assert_allclose(
            stress, osmotic_pressure_difference(reinforced, J, np.array([1e-5, BATH])), rtol=1e-9
        )
        found, swollen = stress_free_tissue(reinforced, BATH)
        assert equilibrium_volume_ratio(found, 0.0, BATH) == pytest.approx(float(swollen), rel=1e-12)


def test_a_point_does_not_depend_on_the_others() -> None:
    tissue = random_tissue(20, 4)
    together = stress_free_tissue(tissue, BATH)[1]
    alone = [stress_free_tissue(point_of(tissue, i), BATH)[1] for i in range(20)]
    np.testing.assert_allclose(together, alone, rtol=1e-15)


def test_more_than_a_solid_can_be_swollen_by_has_no_stress_free_state() -> None:
    """At J = 1/(1 - n_f) all of the stress-free volume would be solid."""
    soft = reference_tissue(osmotic="activity", fluid_fraction=0.3, youngs_modulus=1e-3, fixed_charge_density=1e-3)
    assert np.isnan(stress_free_tissue(soft, BATH)[1])
