"""Steady flow between two baths: Darcy's law along the column, small flows, limits of the full equations."""

from __future__ import annotations

import numpy as np
import pytest
from tissues import point_of, random_tissue, reference_tissue

from fvswell.exact.electrical import electrical_coefficients
from fvswell.exact.linear_swelling import LinearColumn
from fvswell.exact.permeation import held_permeation, steady_permeation
from fvswell.exact.steady_column import Bath, steady_column, still_salt_flux
from fvswell.physics.constants import FARADAY
from fvswell.physics.models import BIPHASIC, BIPHASIC_SWELLING, ELECTROCHEMICAL
from fvswell.physics.osmotic import ion_concentrations, osmotic_pressure_difference
from fvswell.physics.permeability import PERMEABILITIES, hydraulic_permeability, open_circuit_ratio
from fvswell.physics.solids import SOLIDS, uniaxial_stress
from fvswell.physics.tissue import Array, Tissue, fixed_charge_density

BATH, HEIGHT = 1.5e-4, 0.5
FAST = 1e6  # of the ions, for the limit in which they are in equilibrium with the bath

# ---- water alone -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", [BIPHASIC, BIPHASIC_SWELLING])
def test_small_pressures_flow_by_darcy(model: object) -> None:
    """q = k (p_f - p_p)/h0, with the open-circuit permeability of charged tissue."""
    tissue = point_of(random_tissue(5, seed=51), 2)
    linear = LinearColumn.at_equilibrium(model, tissue, HEIGHT, 0.02, BATH)  # type: ignore[arg-type]
    flow = steady_permeation(model, tissue, HEIGHT, (3e-7, 1e-7), BATH, 0.02)  # type: ignore[arg-type]
    k, height = linear.mobility.item(), linear.current_height.item()
    assert flow.water_flux == pytest.approx(k * 2e-7 / height, rel=1e-5)
    assert flow.current_height == pytest.approx(height, rel=1e-5)


@pytest.mark.parametrize("solid", SOLIDS)
@pytest.mark.parametrize("permeability", PERMEABILITIES)
def test_darcy_holds_along_the_column(solid: str, permeability: str) -> None:
    """-(k/J) d sigma_s/dX is the flux everywhere; the ends are at their stresses and positions."""
    tissue = reference_tissue(solid, permeability, permeability_exponent=2.0)
    flow = steady_permeation(BIPHASIC, tissue, HEIGHT, (0.0, 0.1), BATH, 0.15)
    J, X = flow.volume_ratio, flow.position
    middle = 0.5 * (J[1:] + J[:-1])
    stress = uniaxial_stress(tissue.solid, J, tissue.fluid_fraction)
    flux = -hydraulic_permeability(tissue, middle) / middle * np.diff(stress) / np.diff(X)
    np.testing.assert_allclose(flux, flow.water_flux, rtol=3e-4)
    assert flow.water_flux < 0
    np.testing.assert_allclose(stress[[0, -1]], [-0.1 - 0.15, -0.15], rtol=1e-9)
    np.testing.assert_allclose(X[[0, -1]], [0.0, HEIGHT], atol=1e-12)
    assert flow.current_height == pytest.approx(np.trapezoid(J, X), rel=1e-4)


def test_flow_through_a_constant_permeability_by_hand() -> None:
    """k = k0 and sigma = G/2 (J - 1/J) + ... integrates to logarithms and powers; here K = 0, G (J - J^(-1/3))."""
    tissue = reference_tissue(poisson_ratio=-1.0 + 1e-12, youngs_modulus=1e-12)  # G = E/(2 (1 + nu)), K = 0
    G = tissue.solid.youngs_modulus / (2 * (1 + tissue.solid.poisson_ratio))
    flow = steady_permeation(BIPHASIC, tissue, HEIGHT, (0.0, 0.1), BATH)
    low = flow.volume_ratio[0]
    # int k0/J G (1 + J^(-4/3)/3) dJ
    expected = 1e-3 * G / HEIGHT * (np.log(low) - 0.25 * (low ** (-4 / 3) - 1))
    assert flow.water_flux == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("model", [BIPHASIC, BIPHASIC_SWELLING])
@pytest.mark.parametrize("pressures", [(0.2, 0.0), (0.0, 0.1), (0.05, 0.05)])
def test_held_piston_bears_what_a_loaded_one_needs(model: object, pressures: tuple[float, float]) -> None:
    tissue = reference_tissue()
    held = held_permeation(model, tissue, HEIGHT, pressures, BATH, 0.51)  # type: ignore[arg-type]
    free = steady_permeation(model, tissue, HEIGHT, pressures, BATH, held.piston_pressure)  # type: ignore[arg-type]
    assert held.current_height == pytest.approx(0.51, rel=1e-12)
    assert free.water_flux == pytest.approx(held.water_flux, rel=1e-9)
    assert np.sign(held.water_flux) == np.sign(pressures[0] - pressures[1])


def test_kept_open_circuit_ratio() -> None:
    """It scales the permeability and changes nothing else."""
    tissue = reference_tissue()
    full, half = (steady_permeation(BIPHASIC_SWELLING, tissue, HEIGHT, (0.1, 0.0), BATH, 0.0, r) for r in (1.0, 0.5))
    assert half.water_flux == pytest.approx(0.5 * full.water_flux, rel=1e-12)
    np.testing.assert_allclose(half.position, full.position, rtol=1e-12)


def test_what_permeation_cannot_be_asked() -> None:
    with pytest.raises(ValueError, match="is not in equilibrium with one bath"):
        steady_permeation(ELECTROCHEMICAL, reference_tissue(), HEIGHT, (0.1, 0.0), BATH)
    with pytest.raises(ValueError, match="no volume of water"):
        steady_permeation(BIPHASIC, reference_tissue(), HEIGHT, (0.0, 100.0), BATH)


# ---- water, ions and currents ----------------------------------------------------------------------------


@pytest.mark.parametrize("held", [False, True])
def test_fast_ions_make_the_models_one(held: bool) -> None:
    """Salt that diffuses at once is in equilibrium with the bath, and water flows by k_open."""
    tissue = reference_tissue(cation_diffusivity=5e-4 * FAST, anion_diffusivity=8e-4 * FAST)
    if held:
        full = steady_column(tissue, HEIGHT, Bath(BATH, 0.2), Bath(BATH), 0.0, None, 0.52)
        reduced = held_permeation(BIPHASIC_SWELLING, tissue, HEIGHT, (0.2, 0.0), BATH, 0.52)
    else:
        full = steady_column(tissue, HEIGHT, Bath(BATH, 0.2), Bath(BATH))
        reduced = steady_permeation(BIPHASIC_SWELLING, tissue, HEIGHT, (0.2, 0.0), BATH)
    assert full.water_flux == pytest.approx(reduced.water_flux, rel=1e-6)
    assert full.current_height == pytest.approx(reduced.current_height, rel=1e-6)
    assert full.piston_pressure == pytest.approx(reduced.piston_pressure, abs=1e-6)


def test_fluxes_are_the_laws_of_the_profile() -> None:
    """With other salt and pressure at the two ends and a current: the friction laws on differences of the profile."""
    tissue = point_of(random_tissue(9, seed=52), 4)
    flow = steady_column(tissue, HEIGHT, Bath(1.5e-4, 0.02), Bath(1.2e-4), 2e-7, 0.03)
    J, activity, X = flow.volume_ratio, flow.log_activity, flow.position
    coefficients = LinearColumn(
        ELECTROCHEMICAL, tissue, HEIGHT, 0.5 * (J[1:] + J[:-1]), np.diff(activity) * 0.5 + activity[:-1]
    )
    osmotic = osmotic_pressure_difference(tissue, J, np.exp(activity)) + 2 * 0.93 * tissue.thermal_energy * np.exp(
        activity
    )
    water = uniaxial_stress(tissue.solid, J, tissue.fluid_fraction) - osmotic
    slopes = np.stack([np.diff(water), np.diff(activity)], axis=-1) / (coefficients.volume_ratio * np.diff(X))[:, None]
    driven = electrical_coefficients(tissue, coefficients.volume_ratio, coefficients.log_activity).flux_per_charge
    fluxes = -(coefficients.mobility @ slopes[..., None])[..., 0] + driven * 2e-7
    np.testing.assert_allclose(fluxes[:, 0], flow.water_flux, rtol=1e-3)
    np.testing.assert_allclose(fluxes[:, 1], flow.anion_flux, rtol=1e-3)
    assert FARADAY * (flow.cation_flux - flow.anion_flux) == pytest.approx(2e-7)


def uncharged(**changes: float) -> Tissue:
    """Stiff and nearly impermeable tissue without fixed charge: salt diffuses and nothing else happens."""
    return reference_tissue(fixed_charge_density=0.0, youngs_modulus=1e4, hydraulic_permeability=1e-13, **changes)


def test_uncharged_salt_diffuses_by_fick() -> None:
    """n_f 2 D+ D-/(D+ + D-) (c_f - c_p)/h0; the liquid junction potential is (RT/F) (D+ - D-)/(D+ + D-) ln(c_f/c_p)."""
    tissue = uncharged()
    flux, potential = still_salt_flux(tissue, 1.0, HEIGHT, (1.5e-4, 0.3e-4))
    assert flux == pytest.approx(0.8 * 2 * 5e-4 * 8e-4 / 13e-4 * 1.2e-4 / HEIGHT, rel=1e-12)
    assert potential == pytest.approx(tissue.thermal_energy / FARADAY * (5 - 8) / 13 * np.log(5.0), rel=1e-12)
    full = steady_column(tissue, HEIGHT, Bath(1.5e-4), Bath(0.3e-4))
    assert full.anion_flux == pytest.approx(flux, rel=1e-4)
    assert full.cation_flux == pytest.approx(full.anion_flux, rel=1e-12)
    assert full.potential == pytest.approx(potential, rel=1e-4)


def test_charged_salt_diffuses_as_in_a_fixed_charge_membrane() -> None:
    """Teorell, Meyer & Sievers: the potential between the baths in closed form, U = (D+ - D-)/(D+ + D-)."""
    tissue = reference_tissue(youngs_modulus=1e4, hydraulic_permeability=1e-13)
    high, low = 1.5e-4, 0.3e-4
    flux, potential = still_salt_flux(tissue, 1.0, HEIGHT, (high, low))
    thermal, U, charge = tissue.thermal_energy / FARADAY, -3 / 13, 2e-4
    root_high, root_low = (np.sqrt(charge**2 + 4 * c**2) for c in (high, low))
    donnan = np.log(high / low * (root_low + charge) / (root_high + charge))
    membrane = thermal * (donnan + U * np.log((root_high + U * charge) / (root_low + U * charge)))
    assert potential == pytest.approx(membrane, rel=1e-10)
    full = steady_column(tissue, HEIGHT, Bath(high), Bath(low))
    assert full.anion_flux == pytest.approx(flux, rel=2e-4)
    assert full.potential == pytest.approx(potential, rel=2e-4)
    assert flux < still_salt_flux(uncharged(), 1.0, HEIGHT, (high, low))[0]


def test_strong_fixed_charge_lets_only_cations_pass() -> None:
    """Permselective: the potential of Nernst, and hardly any salt."""
    tissue = reference_tissue(fixed_charge_density=0.5)
    flux, potential = still_salt_flux(tissue, 1.0, HEIGHT, (1.5e-4, 0.3e-4))
    assert potential == pytest.approx(tissue.thermal_energy / FARADAY * np.log(5.0), rel=1e-3)
    assert flux < 1e-3 * still_salt_flux(uncharged(), 1.0, HEIGHT, (1.5e-4, 0.3e-4))[0]


def test_water_flows_to_the_stronger_bath() -> None:
    """Osmosis through charged tissue, with the ideal coefficients of a tissue that lets ions pass slowly."""
    tissue = reference_tissue(hindrance_factor=0.9)
    flow = steady_column(tissue, HEIGHT, Bath(1.5e-4), Bath(1e-4))
    assert flow.water_flux < 0 < flow.anion_flux


def small(current: float, pressure: float) -> tuple[float, float, float]:
    flow = steady_column(reference_tissue(), HEIGHT, Bath(BATH, pressure), Bath(BATH), current)
    return flow.water_flux, flow.potential, flow.current_height


def test_onsager_in_small_signals() -> None:
    """Electro-osmosis at equal pressures is the streaming potential without current, and both the linear ones."""
    linear = LinearColumn.at_equilibrium(ELECTROCHEMICAL, reference_tissue(), HEIGHT, 0.0, BATH)
    found = electrical_coefficients(linear.tissue, linear.volume_ratio, linear.log_activity)
    osmosis = (small(1e-9, 0.0)[0] - small(-1e-9, 0.0)[0]) / 2e-9
    ohmic = (small(1e-9, 0.0)[1] - small(-1e-9, 0.0)[1]) / 2e-9
    assert osmosis == pytest.approx(found.water_per_charge.item(), rel=1e-6)
    assert ohmic == pytest.approx(-linear.current_height.item() / found.conductivity.item(), rel=1e-6)
    streaming = (small(0.0, 1e-5)[1] - small(0.0, -1e-5)[1]) / 2e-5
    assert streaming == pytest.approx(osmosis, rel=1e-6)


def test_pressure_of_both_baths_alike_changes_nothing() -> None:
    """It presses on the open piston too."""
    tissue = reference_tissue()
    without, under = (steady_column(tissue, HEIGHT, Bath(BATH, p), Bath(1.4e-4, p), 1e-7) for p in (0.0, 0.5))
    np.testing.assert_allclose(under.volume_ratio, without.volume_ratio, rtol=1e-9)
    assert under.water_flux == pytest.approx(without.water_flux, rel=1e-7)


def test_open_circuit_permeability_in_a_small_flow() -> None:
    """Salt stays behind at first order only where ions are dragged with another velocity, which lowers the flow."""
    tissue = reference_tissue(hindrance_factor=0.0)
    flow = steady_column(tissue, HEIGHT, Bath(BATH, 1e-6), Bath(BATH))
    J = np.array([flow.volume_ratio[0]])
    ions = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), np.log(BATH))
    k_open: Array = hydraulic_permeability(tissue, J) * open_circuit_ratio(tissue, J, *ions)
    assert flow.water_flux == pytest.approx((k_open * 1e-6 / flow.current_height).item(), rel=1e-5)


def test_no_steady_state() -> None:
    with pytest.raises(ValueError, match="no steady state"):
        steady_column(reference_tissue(fixed_charge_density=1e-6), HEIGHT, Bath(BATH, -5.0), Bath(BATH))
