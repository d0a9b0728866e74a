"""The osmotic laws: the activity law by numbers worked out beforehand, and what sets the laws apart."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from tissues import BATH, random_tissue, reference_tissue

from fvswell.physics.constants import GAS_CONSTANT
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.osmotic import (
    OSMOTIC_LAWS,
    ActivityCoefficients,
    ChargeDependentCoefficients,
    ConstantCoefficients,
    Ideal,
    bath_log_activity,
    bath_osmotic_pressure,
    ion_concentrations,
    log_activity,
    osmotic_pressure,
    virtual_concentration,
)
from fvswell.physics.tissue import Array, Tissue

RT = GAS_CONSTANT * 298.0
LAW = ActivityCoefficients(0.93)
EVERY = {
    "ideal": Ideal(),
    "constant": ConstantCoefficients(0.83, 0.93, 1.0),
    "charge-dependent": ChargeDependentCoefficients(500.0, 2e-4, 0.93, 1.0),
    "activity": LAW,
}


def swelling_pressure(law: object, charge: float, bath: float) -> float:
    """pi - pi_bath of ions in equilibrium with a bath, concentrations in M."""
    charge, bath = charge * 1e-3, bath * 1e-3
    ions = ion_concentrations(law, charge, bath_log_activity(law, bath))
    return float(osmotic_pressure(law, RT, charge, *ions) - bath_osmotic_pressure(law, RT, bath))


@pytest.mark.parametrize(
    ("charge", "bath", "total", "coefficient", "ratio", "pressure"),
    [
        (0.2, 0.05, 0.240960, 0.721206, 1.806170, 0.200154),
        (0.2, 0.15, 0.413800, 0.780000, 1.458120, 0.108435),
        (0.2, 0.5, 1.103747, 0.859380, 1.178257, 0.045932),
        (0.2, 1.0, 2.101180, 0.889990, 1.093739, 0.024850),
        (0.1, 0.15, 0.353743, 0.828544, 1.279270, 0.034916),
        (0.4, 0.15, 0.557591, 0.737705, 1.676747, 0.327893),
    ],
)
def test_activity_law(
    charge: float, bath: float, total: float, coefficient: float, ratio: float, pressure: float
) -> None:
    """c+ + c-, phi_int, g and pi - pi_bath, found with another program."""
    cation, anion = ion_concentrations(LAW, charge * 1e-3, bath_log_activity(LAW, bath * 1e-3))
    pi = osmotic_pressure(LAW, RT, charge * 1e-3, cation, anion)
    found = (1e3 * (cation + anion), pi / (RT * (cation + anion)), cation * anion / (bath * 1e-3) ** 2)
    np.testing.assert_allclose(found, (total, coefficient, ratio), atol=6e-7, rtol=0)
    assert swelling_pressure(LAW, charge, bath) == pytest.approx(pressure, abs=1e-6)


def test_equilibria_with_the_activity_law() -> None:
    tissue = reference_tissue(osmotic="activity")
    J = equilibrium_volume_ratio(tissue, 0.0, np.array([0.05, 0.1, 0.15, 0.5, 1.0]) * 1e-3)
    np.testing.assert_allclose(J, [1.221992, 1.162412, 1.131315, 1.061868, 1.034894], atol=1e-6, rtol=0)
    assert equilibrium_volume_ratio(tissue, 0.25, BATH) == pytest.approx(0.858429, abs=1e-6)


def test_activity_of_salt() -> None:
    """gamma at 0.15 M; what is left in strong solutions; none missing in weak ones."""
    concentration = np.array([0.15e-3, 1.0, 1e-20])
    gamma = np.exp(bath_log_activity(LAW, concentration)) / concentration
    np.testing.assert_allclose(gamma, [0.751, 0.6447, 0.9954], atol=5e-4, rtol=0)


def test_swelling_pressure_of_chondroitin_sulphate() -> None:
    """Measured about 0.30 MPa at c_F 0.4 M in 0.15 M, Ehrlich et al. (1998); the activity law comes nearest."""
    found = {name: swelling_pressure(law, 0.4, 0.15) for name, law in EVERY.items()}
    found["charge-dependent"] = swelling_pressure(ChargeDependentCoefficients(500.0, 4e-4, 0.93, 1.0), 0.4, 0.15)
    expected = {"activity": 0.328, "charge-dependent": 0.213, "ideal": 0.496}
    for name, pressure in expected.items():
        assert found[name] == pytest.approx(pressure, abs=5e-4)
    assert min(found, key=lambda name: abs(found[name] - 0.30)) == "activity"


def test_the_papers_law_draws_water_out_of_tissue_in_strong_baths() -> None:
    assert swelling_pressure(EVERY["charge-dependent"], 0.2, 0.5) == pytest.approx(-0.207, abs=5e-4)
    assert swelling_pressure(EVERY["charge-dependent"], 0.2, 1.0) == pytest.approx(-0.475, abs=5e-4)
    weak = ChargeDependentCoefficients(500.0, 1e-4, 0.93, 1.0)
    assert swelling_pressure(weak, 0.1, 0.15) == pytest.approx(-0.002, abs=5e-4)


@pytest.mark.parametrize("law", [Ideal(), LAW], ids=["ideal", "activity"])
def test_swelling_pressure_is_positive_and_falls_in_every_bath(law: object) -> None:
    baths = np.geomspace(0.015, 3.0, 40)
    pressure = np.array([swelling_pressure(law, 0.2, bath) for bath in baths])
    assert np.all(pressure > 0.0)
    assert np.all(np.diff(pressure) < 0.0)


def test_laws_with_constant_coefficients_are_one() -> None:
    """Ideal: phi = g = 1. Charge-dependent: phi_int = phi_ext - X c_F0."""
    charge, activity = np.geomspace(1e-5, 1e-3, 9), np.log(BATH)
    for law, same in (
        (Ideal(), ConstantCoefficients(1.0, 1.0, 1.0)),
        (ChargeDependentCoefficients(500.0, 3e-4, 0.93, 1.2), ConstantCoefficients(0.78, 0.93, 1.2)),
    ):
        ions, other = ion_concentrations(law, charge, activity), ion_concentrations(same, charge, activity)
        np.testing.assert_allclose(ions, other, rtol=1e-14)
        pressure = osmotic_pressure(law, RT, charge, *ions)
        np.testing.assert_allclose(pressure, osmotic_pressure(same, RT, charge, *ions), rtol=1e-14)
        assert bath_osmotic_pressure(law, RT, BATH) == bath_osmotic_pressure(same, RT, BATH)


@pytest.mark.parametrize("name", OSMOTIC_LAWS)
def test_donnan_equilibrium_over_many_decades(name: str) -> None:
    """Electroneutral, and the activity of the ions is that of the bath; also with c_F far above it, and without."""
    draw = np.random.default_rng(1)
    charge, activity = 10 ** draw.uniform(-12, 0, 5000), draw.uniform(-25, 1, 5000)
    charge[:50] = 0.0
    law = EVERY[name]
    cation, anion = ion_concentrations(law, charge, activity)
    np.testing.assert_allclose(cation - anion, charge, rtol=1e-15, atol=1e-15 * cation.max())
    np.testing.assert_allclose(log_activity(law, charge, cation, anion), activity, rtol=0, atol=2e-14)
    concentration = virtual_concentration(law, activity)
    np.testing.assert_allclose(bath_log_activity(law, concentration), activity, rtol=0, atol=2e-14)
    assert np.all(anion > 0.0)


def test_activity_law_keeps_the_digits_of_a_scarce_co_ion() -> None:
    """c- eleven decades below c_F, from an equation for ln c- alone."""
    charge, bath = 1e-3, 1e-9

    def mismatch(logarithm: float) -> float:
        anion = np.exp(logarithm)
        return float(log_activity(LAW, charge, charge + anion, anion) - bath_log_activity(LAW, bath))

    expected = np.exp(brentq(mismatch, -60.0, -20.0, xtol=1e-14, rtol=1e-15))
    _, anion = ion_concentrations(LAW, charge, bath_log_activity(LAW, bath))
    assert anion < 1e-11 * charge
    assert anion == pytest.approx(expected, rel=1e-13)


def test_a_point_does_not_depend_on_the_others() -> None:
    """To the bit, beside points that take longest."""
    charge, activity = np.geomspace(1e-9, 1.0, 30), np.linspace(-20.0, 0.0, 30)[::-1]
    together = np.array(ion_concentrations(LAW, charge, activity))
    alone = [ion_concentrations(LAW, charge[i : i + 1], activity[i : i + 1]) for i in range(30)]
    np.testing.assert_allclose(together, np.squeeze(np.array(alone), axis=2).T, rtol=4e-16)


def test_derivatives_of_the_ions_are_those_of_the_implicit_equation() -> None:
    """ln a~(c_F, c-) = ln a~ differentiated: d c-/d ln a~ = 1/(d ln a~/d c-), and along c_F."""
    step = 1e-40
    tissue: Tissue = random_tissue(200, seed=3, osmotic="activity")
    charge, activity = np.asarray(tissue.fixed_charge_density), np.linspace(-14.0, -5.0, 200)
    _, anion = ion_concentrations(LAW, charge, activity)

    def found(*arguments: Array) -> Array:
        return np.imag(ion_concentrations(LAW, *arguments)[1]) / step

    def slope(charge: Array, anion: Array) -> Array:
        return np.imag(log_activity(LAW, charge, charge + anion, anion)) / step

    by_anion, by_charge = slope(charge, anion + 1j * step), slope(charge + 1j * step, anion + 0j)
    np.testing.assert_allclose(found(charge, activity + 1j * step), 1.0 / by_anion, rtol=1e-12)
    np.testing.assert_allclose(found(charge + 1j * step, activity), -by_charge / by_anion, rtol=1e-11)
