"""Donnan equilibrium at a point, and the osmotic pressure of its ions."""

from __future__ import annotations

from decimal import Decimal, localcontext
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tissues import BATH, random_tissue, reference_tissue

from fvswell.physics.constants import GAS_CONSTANT
from fvswell.physics.osmotic import (
    NoSwelling,
    bath_log_activity,
    bath_osmotic_pressure,
    ion_concentrations,
    log_activity,
    osmotic_pressure,
    osmotic_pressure_difference,
    virtual_concentration,
)
from fvswell.physics.tissue import Array, Tissue, fixed_charge_density, fluid_fraction

EPSILON = np.finfo(float).eps
RT = GAS_CONSTANT * 298.0
DECADES = st.floats(-14.0, 2.0)


def ions(tissue: Tissue, J: Any, activity: Any) -> tuple[Any, Any]:
    found: tuple[Any, Any] = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), activity)
    return found


@settings(max_examples=200, deadline=None, derandomize=True)
@given(charge=DECADES, salt=DECADES, ratio=st.floats(0.3, 3.0), J=st.floats(0.3, 3.0))
def test_ions_over_sixteen_decades(charge: float, salt: float, ratio: float, J: float) -> None:
    """c+ - c- = c_F and c+ c- = g c~^2 to rounding, and each ion to rounding of its own size."""
    tissue = reference_tissue(fixed_charge_density=10.0**charge, activity_ratio=ratio)
    log_salt = salt * np.log(10.0)
    cation, anion = (float(value) for value in ions(tissue, J, log_salt))
    c_F = float(fixed_charge_density(tissue, J))
    square = float(ratio * np.exp(2.0 * log_salt))
    assert abs(cation - anion - c_F) <= 3 * EPSILON * cation
    assert abs(cation * anion - square) <= 3 * EPSILON * square
    with localcontext() as context:
        context.prec = 60
        half = Decimal(c_F) / 2
        root = (half * half + Decimal(square)).sqrt()
        for value, exact in ((cation, root + half), (anion, root - half)):
            assert abs(Decimal(value) / exact - 1) < Decimal(4 * EPSILON)


def test_ions_without_fixed_charge_are_those_of_the_bath() -> None:
    cation, anion = ions(reference_tissue(fixed_charge_density=0.0), 1.1, np.log(BATH))
    assert cation == pytest.approx(BATH, rel=1e-14)
    assert anion == pytest.approx(BATH, rel=1e-14)


def test_reference_ions() -> None:
    cation, anion = ions(reference_tissue(), 1.0, np.log(BATH))
    root = np.sqrt(2e-4**2 + 4 * BATH**2)
    assert cation == pytest.approx((root + 2e-4) / 2, rel=1e-14)
    assert anion == pytest.approx((root - 2e-4) / 2, rel=1e-14)
    assert cation + anion == pytest.approx(3.605551e-4, rel=1e-6)


def test_activity_of_the_ions_is_the_virtual_baths() -> None:
    """`log_activity` takes `ion_concentrations` back; a bath is its own virtual bath."""
    tissue, activity = random_tissue(50, seed=3), np.linspace(-13.0, -5.0, 50)
    cation, anion = ions(tissue, 1.1, activity)
    found = log_activity(tissue.osmotic, fixed_charge_density(tissue, 1.1), cation, anion)
    np.testing.assert_allclose(found, activity, rtol=1e-14)
    np.testing.assert_allclose(virtual_concentration(tissue.osmotic, activity), np.exp(activity), rtol=1e-15)
    concentration = np.geomspace(1e-6, 1e-2, 50)
    own = virtual_concentration(tissue.osmotic, bath_log_activity(tissue.osmotic, concentration))
    np.testing.assert_allclose(own, concentration, rtol=1e-14)


def test_charge_and_solid_stay_with_the_solid() -> None:
    """Per volume of the stress-free solid, neither the fixed charge nor the solid changes with J."""
    tissue, J = random_tissue(30, seed=2), np.linspace(0.5, 2.0, 9)[:, None]
    n_f = fluid_fraction(tissue, J)
    charge = tissue.fixed_charge_density * tissue.fluid_fraction
    held = J * n_f * fixed_charge_density(tissue, J)
    np.testing.assert_allclose(held, np.broadcast_to(charge, n_f.shape), rtol=1e-13)
    np.testing.assert_allclose(J * (1 - n_f), np.broadcast_to(1 - tissue.fluid_fraction, n_f.shape), rtol=1e-13)


def test_osmotic_pressure_of_uncharged_tissue_is_the_baths() -> None:
    tissue = reference_tissue(fixed_charge_density=0.0, osmotic_coefficient=0.93)
    pressure = osmotic_pressure(tissue.osmotic, RT, 0.0, *ions(tissue, 1.2, np.log(BATH)))
    bath = bath_osmotic_pressure(tissue.osmotic, RT, BATH)
    assert pressure == pytest.approx(bath, rel=1e-14)
    assert bath == pytest.approx(0.93 * 8.314462618 * 298 * 3e-4, rel=1e-14)
    assert osmotic_pressure_difference(tissue, 1.2, BATH) == pytest.approx(0.0, abs=1e-14 * bath)


def test_much_charge_holds_just_its_counter_ions() -> None:
    """pi -> phi RT c_F and c- -> g c~^2/c_F where the charge is far above the salt."""
    tissue = reference_tissue(fixed_charge_density=1.0)
    cation, anion = ions(tissue, 1.0, np.log(1e-6))
    assert osmotic_pressure(tissue.osmotic, RT, 1.0, cation, anion) == pytest.approx(0.83 * RT, rel=1e-11)
    assert anion == pytest.approx(1e-12, rel=1e-11)


def test_swelling_pressure_falls_with_the_volume_and_with_the_bath() -> None:
    tissue, J = random_tissue(50, seed=4, osmotic_coefficient=0.93), np.linspace(0.6, 1.6, 40)[:, None]
    pressure = [osmotic_pressure_difference(tissue, J, concentration) for concentration in (5e-5, 1e-4, 1.5e-4)]
    assert all(np.all(np.diff(values, axis=0) < 0.0) for values in pressure)
    own: Array = np.array(pressure)[:, :, np.asarray(tissue.osmotic.activity_ratio) <= 1.0]
    assert np.all(np.diff(own, axis=0) < 0.0)


def test_biphasic_model_feels_no_ions() -> None:
    law = NoSwelling()
    assert osmotic_pressure(law, RT, 2e-4, 3e-4, 1e-4) == 0.0
    assert bath_osmotic_pressure(law, RT, BATH) == 0.0
    assert osmotic_pressure_difference(reference_tissue()._replace(osmotic=law), 1.1, BATH) == 0.0
