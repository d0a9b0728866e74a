"""Donnan equilibrium at a point."""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tissues import random_tissue, reference_tissue

from fvswell.physics.constants import FARADAY, GAS_CONSTANT
from fvswell.physics.electrochemistry import (
    bath_osmotic_pressure,
    electric_potential,
    fixed_charge_density,
    fluid_fraction,
    ion_concentration_derivatives,
    ion_concentrations,
    osmotic_pressure,
)

EPSILON = np.finfo(float).eps
DECADES = st.floats(-14.0, 2.0)


def at(value: float) -> np.ndarray:
    return np.array([[value]])


@settings(max_examples=200, deadline=None, derandomize=True)
@given(charge=DECADES, salt=DECADES, ratio=st.floats(0.3, 3.0), J=st.floats(0.3, 3.0))
def test_ions_over_sixteen_decades(charge: float, salt: float, ratio: float, J: float) -> None:
    """c+ - c- = c_F and c+ c- = g c~^2 to rounding, and each ion to rounding of its own size."""
    tissue = reference_tissue(fixed_charge_density=10.0**charge, activity_ratio=ratio)
    log_salt = salt * np.log(10.0)
    cation, anion = (value.item() for value in ion_concentrations(tissue, at(J), at(log_salt)))
    c_F = fixed_charge_density(tissue, at(J)).item()
    square = ratio * np.exp(2.0 * log_salt)
    assert abs(cation - anion - c_F) <= 3 * EPSILON * cation
    assert abs(cation * anion - square) <= 3 * EPSILON * square
    with localcontext() as context:
        context.prec = 60
        half = Decimal(c_F) / 2
        root = (half * half + Decimal(square)).sqrt()
        for value, exact in ((cation, root + half), (anion, root - half)):
            assert abs(Decimal(value) / exact - 1) < Decimal(4 * EPSILON)


def test_ions_without_fixed_charge_are_those_of_the_bath() -> None:
    tissue = reference_tissue(fixed_charge_density=0.0)
    cation, anion = ion_concentrations(tissue, at(1.1), np.log(at(1.5e-4)))
    assert cation.item() == pytest.approx(1.5e-4, rel=1e-14)
    assert anion.item() == pytest.approx(1.5e-4, rel=1e-14)


def test_reference_ions() -> None:
    cation, anion = ion_concentrations(reference_tissue(), at(1.0), np.log(at(1.5e-4)))
    root = np.sqrt(2e-4**2 + 4 * 1.5e-4**2)
    assert cation.item() == pytest.approx((root + 2e-4) / 2, rel=1e-14)
    assert anion.item() == pytest.approx((root - 2e-4) / 2, rel=1e-14)
    assert cation.item() + anion.item() == pytest.approx(3.605551e-4, rel=1e-6)


def test_derivatives_of_the_concentrations() -> None:
    tissue, J, log_c = random_tissue(50, seed=1), np.linspace(0.5, 1.5, 50)[:, None], np.linspace(-13, -5, 50)[:, None]
    by_J, by_log = (
        [value.imag / 1e-30 for value in ion_concentrations(tissue, J + dJ, log_c + dlog)]
        for dJ, dlog in ((1e-30j, 0.0), (0.0, 1e-30j))
    )
    cation_J, anion_J, both_log = ion_concentration_derivatives(tissue, J, *ion_concentrations(tissue, J, log_c))
    np.testing.assert_allclose([cation_J, anion_J], by_J, rtol=1e-12)
    np.testing.assert_allclose([both_log, both_log], by_log, rtol=1e-12)


def test_charge_and_solid_stay_with_the_solid() -> None:
    """Per volume of the stress-free solid, neither the fixed charge nor the solid changes with J."""
    tissue, J = random_tissue(30, seed=2), np.linspace(0.5, 2.0, 9)[None]
    n_f = fluid_fraction(tissue, J)
    charge = tissue.fixed_charge_density * tissue.fluid_fraction
    np.testing.assert_allclose(
        J * n_f * fixed_charge_density(tissue, J), np.broadcast_to(charge, n_f.shape), rtol=1e-13
    )
    solid = np.broadcast_to(1 - tissue.fluid_fraction, n_f.shape)
    np.testing.assert_allclose(J * (1 - n_f), solid, rtol=1e-13)


def test_potentials_of_the_ions_are_those_of_the_virtual_bath() -> None:
    """RT ln(gamma c+-) +- F xi = RT ln c~ +- F psi~, the activity coefficients being one and the same."""
    tissue, psi = random_tissue(50, seed=3), np.linspace(-2, 2, 50)[:, None]
    log_c = np.linspace(-12, -6, 50)[:, None]
    cation, anion = ion_concentrations(tissue, at(1.1), log_c)
    xi = electric_potential(tissue, cation, log_c, psi) * FARADAY / tissue.thermal_energy
    gamma = -0.5 * np.log(tissue.activity_ratio)
    np.testing.assert_allclose(np.log(cation) + gamma + xi, log_c + psi, rtol=1e-13)
    np.testing.assert_allclose(np.log(anion) + gamma - xi, log_c - psi, rtol=1e-13)


def test_donnan_potential_of_negative_charge_is_negative() -> None:
    """About -16 mV for the reference tissue, -(RT/F) asinh(c_F/(2 c))."""
    tissue, log_c = reference_tissue(), np.log(at(1.5e-4))
    cation, _ = ion_concentrations(tissue, at(1.0), log_c)
    expected = -GAS_CONSTANT * 298.0 / FARADAY * np.arcsinh(2e-4 / 3e-4)
    assert electric_potential(tissue, cation, log_c, at(0.0)).item() == pytest.approx(expected, rel=1e-13)
    assert expected == pytest.approx(-16.06, abs=0.01)


def test_osmotic_pressure_of_uncharged_tissue_is_the_baths() -> None:
    tissue = reference_tissue(fixed_charge_density=0.0, osmotic_coefficient=0.93)
    ions = ion_concentrations(tissue, at(1.2), np.log(at(1.5e-4)))
    bath = bath_osmotic_pressure(at(0.93), tissue.thermal_energy, at(1.5e-4))
    assert osmotic_pressure(tissue, *ions).item() == pytest.approx(bath.item(), rel=1e-14)
    assert bath.item() == pytest.approx(0.93 * 8.314462618 * 298 * 3e-4, rel=1e-14)


def test_much_charge_holds_just_its_counter_ions() -> None:
    """pi -> phi RT c_F and c- -> g c~^2/c_F where the charge is far above the salt."""
    tissue = reference_tissue(fixed_charge_density=1.0)
    cation, anion = ion_concentrations(tissue, at(1.0), np.log(at(1e-6)))
    assert osmotic_pressure(tissue, cation, anion).item() == pytest.approx(0.83 * GAS_CONSTANT * 298.0, rel=1e-11)
    assert anion.item() == pytest.approx(1e-12, rel=1e-11)
