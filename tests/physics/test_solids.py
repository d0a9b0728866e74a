"""Laws of the solid: stress-free without strain, right stiffness, and the derivative of their energies."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tissues import random_tissue, reference_tissue

from fvswell.compiled.dual import slope_of, variables
from fvswell.physics.solids import (
    SOLIDS,
    SolidStress,
    aggregate_modulus,
    bulk_modulus,
    cauchy_stress,
    isotropic_stress,
    piola_stress,
    shear_modulus,
    stress_coefficients,
    uniaxial_stress,
)
from fvswell.physics.tissue import Array, Tissue

POINTS = 40
STEP = 1e-40


def neo_hookean(law: Any, n_f: Array, I1: Array, I2: Array, J: Array) -> Array:
    G, K = shear_modulus(law, n_f), bulk_modulus(law, n_f)
    return G / 2 * (I1 - 3 * J ** (2 / 3)) + K / 4 * (J**2 - 1 - 2 * np.log(J))


def neo_hookean_log(law: Any, n_f: Array, I1: Array, I2: Array, J: Array) -> Array:
    G = shear_modulus(law, n_f)
    lame = bulk_modulus(law, n_f) - 2 / 3 * G
    return G / 2 * (I1 - 3) - G * np.log(J) + lame / 2 * np.log(J) ** 2


def holmes_mow(law: Any, n_f: Array, I1: Array, I2: Array, J: Array) -> Array:
    G, H, beta = shear_modulus(law, n_f), aggregate_modulus(law, n_f), law.stiffening_coefficient
    lame = H - 2 * G
    exponent = beta / H * ((2 * G - lame) * (I1 - 3) + lame * (I2 - 3) - H * np.log(J**2))
    return H / (4 * beta) * (np.exp(exponent) - 1)


def solid_fraction(law: Any, n_f: Array, I1: Array, I2: Array, J: Array) -> Array:
    """Poisson's ratio half the solid fraction of the deformed solid, in K alone."""
    G, nu = law.shear_modulus, (1 - n_f) / (2 * J)
    K = 2 * G * (1 + nu) / (3 * (1 - 2 * nu))
    return G / 2 * (I1 - 3 * J ** (2 / 3)) + K / 2 * np.log(J) ** 2


ENERGIES = {
    "neo-hookean": neo_hookean, "neo-hookean-log": neo_hookean_log, "holmes-mow": holmes_mow,
    "solid-fraction": solid_fraction,
}  # fmt: skip


def energy(solid: str, tissue: Tissue, F: Array) -> Array:
    """Strain energy for deformation gradients (points, 3, 3), per reference volume; shape (points,)."""
    C = np.swapaxes(F, 1, 2) @ F
    I1 = np.trace(C, axis1=1, axis2=2)
    I2 = 0.5 * (I1**2 - np.trace(C @ C, axis1=1, axis2=2))
    return ENERGIES[solid](tissue.solid, tissue.fluid_fraction, I1, I2, np.linalg.det(F))


def in_plane_gradients(seed: int) -> Array:
    """Random deformation gradients with z as a principal direction, volumes from about half to double."""
    draw = np.random.default_rng(seed)
    F = np.zeros((POINTS, 3, 3))
    F[:, :2, :2] = np.eye(2) + draw.uniform(-0.25, 0.25, (POINTS, 2, 2))
    F[:, 2, 2] = draw.uniform(0.8, 1.3, POINTS)
    return F


def stress_of(tissue: Tissue, F: Array) -> SolidStress:
    stress: SolidStress = cauchy_stress(tissue.solid, tissue.fluid_fraction, components_of(F))
    return stress


def components_of(F: Array) -> tuple[Array, ...]:
    """Components (xx, xy, yx, yy, zz) of deformation gradients (points, 3, 3)."""
    return F[:, 0, 0], F[:, 0, 1], F[:, 1, 0], F[:, 1, 1], F[:, 2, 2]


def stiffness(tissue: Tissue, J: Array) -> Array:
    """Slope of the uniaxial stress, by complex step."""
    value: Array = uniaxial_stress(tissue.solid, J + 1j * STEP, tissue.fluid_fraction)
    return value.imag / STEP


@pytest.mark.parametrize("solid", ENERGIES)
def test_stress_is_the_derivative_of_the_energy(solid: str) -> None:
    """sigma = (1/J) dW/dF F^T, the energy differentiated by complex step in all nine components of F."""
    tissue, F = random_tissue(POINTS, seed=4, solid=solid), in_plane_gradients(5)
    first_piola = np.zeros_like(F)
    for i in range(3):
        for j in range(3):
            step = F.astype(complex)
            step[:, i, j] += 1e-30j
            first_piola[:, i, j] = energy(solid, tissue, step).imag / 1e-30
    expected = first_piola @ np.swapaxes(F, 1, 2) / np.linalg.det(F)[:, None, None]
    np.testing.assert_allclose(expected, np.swapaxes(expected, 1, 2), rtol=1e-11, atol=1e-13)  # no couple stress
    stress = stress_of(tissue, F)
    for component, (i, j) in {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1)}.items():
        np.testing.assert_allclose(getattr(stress, component), expected[:, i, j], rtol=1e-10, atol=1e-12)
    piola = piola_stress(tissue.solid, tissue.fluid_fraction, components_of(F))
    for found, value in zip(piola, components_of(first_piola), strict=True):
        np.testing.assert_allclose(found, value, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("solid", SOLIDS)
def test_no_stress_without_deformation_whatever_the_rotation(solid: str) -> None:
    tissue = random_tissue(POINTS, seed=6, solid=solid)
    angle = np.linspace(0, 6, POINTS)
    F = np.zeros((POINTS, 3, 3))
    F[:, 0, 0] = F[:, 1, 1] = np.cos(angle)
    F[:, 0, 1], F[:, 1, 0], F[:, 2, 2] = np.sin(angle), -np.sin(angle), 1.0
    for component in stress_of(tissue, F):
        np.testing.assert_allclose(component, 0.0, atol=1e-15)


@pytest.mark.parametrize("solid", SOLIDS)
def test_stress_turns_with_the_body(solid: str) -> None:
    """Objectivity: sigma(Q F) = Q sigma(F) Q^T."""
    tissue, F = random_tissue(POINTS, seed=7, solid=solid), in_plane_gradients(8)
    Q = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    turned = F.copy()
    turned[:, :2, :2] = Q @ F[:, :2, :2]
    stress, rotated = (stress_of(tissue, gradient) for gradient in (F, turned))

    def in_plane(components: SolidStress) -> Array:
        xx, yy, _, xy = components
        return np.moveaxis(np.array([[xx, xy], [xy, yy]]), -1, 0)

    np.testing.assert_allclose(in_plane(rotated), Q @ in_plane(stress) @ Q.T, rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(rotated.zz, stress.zz, rtol=1e-11, atol=1e-14)


@pytest.mark.parametrize("solid", SOLIDS)
def test_small_strain_is_hookes_law(solid: str) -> None:
    """Slopes without strain: H = K + 4G/3 along, K - 2G/3 across, G in shear."""
    tissue = random_tissue(POINTS, seed=9, solid=solid)
    law, n_f = tissue.solid, tissue.fluid_fraction
    one, step = np.ones(POINTS, dtype=complex), 1e-30j
    stretched = cauchy_stress(law, n_f, (one + step, 0 * one, 0 * one, one, one))
    sheared = cauchy_stress(law, n_f, (one, 0 * one + step, 0 * one, one, one))
    K, G = bulk_modulus(law, n_f), shear_modulus(law, n_f)
    for value, expected in ((stretched.xx, K + 4 * G / 3), (stretched.yy, K - 2 * G / 3), (stretched.zz, K - 2 * G / 3),
                            (sheared.xy, G)):  # fmt: skip
        np.testing.assert_allclose(value.imag / 1e-30, expected, rtol=1e-12)
    np.testing.assert_allclose(stiffness(tissue, np.ones(POINTS)), aggregate_modulus(law, n_f), rtol=1e-12)
    volumetric = isotropic_stress(law, one + step, n_f).imag / 1e-30
    np.testing.assert_allclose(volumetric, K, rtol=1e-12)


def test_moduli() -> None:
    tissue = random_tissue(POINTS, seed=1)
    law, n_f = tissue.solid, tissue.fluid_fraction
    E, nu = law.youngs_modulus, law.poisson_ratio
    np.testing.assert_allclose(aggregate_modulus(law, n_f), E * (1 - nu) / ((1 + nu) * (1 - 2 * nu)), rtol=1e-13)
    K, G = bulk_modulus(law, n_f), shear_modulus(law, n_f)
    np.testing.assert_allclose(9 * K * G / (3 * K + G), E, rtol=1e-13)


def test_poisson_ratio_by_solid_fraction_is_the_formula_of_the_paper() -> None:
    """Wilson et al. (2007), written as there."""
    G, n_s, J = 0.3, 0.25, np.linspace(0.3, 2.0, 30)
    log_J = np.log(J)
    bracket = -1 + 3 * (J + n_s) / (n_s - J) + 3 * n_s * J * log_J / (n_s - J) ** 2
    expected = -G / 6 * log_J / J * bracket + G / J * (J**2 - J ** (2 / 3))
    found = uniaxial_stress(SOLIDS["solid-fraction"](G), J, 1 - n_s)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)


def test_poisson_ratio_by_solid_fraction_at_small_strain() -> None:
    """nu = n_s0/2 at J = 1, so E = 2 G (1 + n_s0/2)."""
    law, G, n_s = SOLIDS["solid-fraction"](0.3), 0.3, 0.2
    nu, E = n_s / 2, 2 * G * (1 + n_s / 2)
    assert bulk_modulus(law, 1 - n_s) == pytest.approx(E / (3 * (1 - 2 * nu)), rel=1e-14)
    assert shear_modulus(law, 1 - n_s) == pytest.approx(E / (2 * (1 + nu)), rel=1e-14)


def test_solid_cannot_be_pressed_past_its_water_where_poissons_ratio_follows_it() -> None:
    """The stress is without bound as J -> n_s0, as (n_s0 - J)^-2."""
    law, n_s, pore = SOLIDS["solid-fraction"](0.3), 0.2, np.array([1e-3, 1e-4, 1e-5])
    stress = uniaxial_stress(law, n_s + pore, 1 - n_s)
    np.testing.assert_allclose(stress * pore**2, -0.5 * 0.3 * n_s * np.log(n_s) ** 2, rtol=0.02)


def test_neo_hookean_is_equation_10_of_the_paper() -> None:
    tissue, J = reference_tissue(), np.linspace(0.3, 2.0, 18)
    K, G = 0.5 / (3 * 0.4), 0.5 / 2.6
    expected = K / 2 * (J - 1 / J) + G / J * (J**2 - J ** (2 / 3))
    np.testing.assert_allclose(uniaxial_stress(tissue.solid, J, 0.8), expected, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(expected, K / 2 * (J - 1 / J) + G * (J - J ** (-1 / 3)), rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("solid", SOLIDS)
def test_column_and_free_swelling_are_cases_of_the_general_stress(solid: str) -> None:
    tissue, J = random_tissue(POINTS, seed=11, solid=solid), np.linspace(0.4, 1.6, 25)[:, None]
    law, n_f, one = tissue.solid, tissue.fluid_fraction, np.ones((25, 1))
    axial = cauchy_stress(law, n_f, (J, 0 * one, 0 * one, one, one)).xx
    np.testing.assert_allclose(uniaxial_stress(law, J, n_f), axial, rtol=1e-11, atol=1e-13)
    stretch = J ** (1 / 3)
    equal = cauchy_stress(law, n_f, (stretch, 0 * one, 0 * one, stretch, stretch))
    for component in equal[:3]:
        np.testing.assert_allclose(isotropic_stress(law, J, n_f), component, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("solid", SOLIDS)
def test_pressing_ever_harder_takes_ever_more_force(solid: str) -> None:
    tissue = random_tissue(POINTS, seed=12, solid=solid)
    least = 1.0 - np.min(tissue.fluid_fraction) + 0.02
    assert np.all(stiffness(tissue, np.linspace(least, 2.0, 200)[:, None]) > 0.0)


@pytest.mark.parametrize("solid", SOLIDS)
def test_derivatives_of_the_coefficients(solid: str) -> None:
    """Dual numbers against complex step, in J and both invariants."""
    tissue, draw = random_tissue(POINTS, seed=13, solid=solid), np.random.default_rng(14)
    J, I1, I2 = draw.uniform(0.6, 1.5, POINTS), draw.uniform(2.5, 4.0, POINTS), draw.uniform(2.5, 4.0, POINTS)
    law, n_f = tissue.solid, tissue.fluid_fraction
    found = stress_coefficients(law, *variables(J, I1, I2), n_f)
    for direction in range(3):
        arguments = [value + 1j * STEP * (direction == i) for i, value in enumerate((J, I1, I2))]
        expected = stress_coefficients(law, *arguments, n_f)
        scale = max(np.abs(np.imag(value)).max() for value in expected) / STEP
        for value, exact in zip(found, expected, strict=True):
            slope = slope_of(value, direction) if hasattr(value, "slopes") else 0.0
            np.testing.assert_allclose(slope, np.imag(exact) / STEP, rtol=1e-14, atol=1e-14 * scale)
