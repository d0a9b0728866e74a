"""Laws of the solid: stress-free at rest, right stiffness, and the derivative of their energies."""

from __future__ import annotations

import numpy as np
import pytest
from tissues import random_tissue, reference_tissue

from fvswell.physics.solid import (
    SOLIDS,
    aggregate_modulus,
    bulk_modulus,
    cauchy_stress,
    shear_modulus,
    uniaxial_stiffness,
    uniaxial_stress,
)
from fvswell.physics.tissue import Array, Tissue

ROWS = 40


def neo_hookean(tissue: Tissue, I1: Array, I2: Array, J: Array) -> Array:
    G, K = shear_modulus(tissue), bulk_modulus(tissue)
    return G / 2 * (I1 - 3 * J ** (2 / 3)) + K / 4 * (J**2 - 1 - 2 * np.log(J))


def neo_hookean_log(tissue: Tissue, I1: Array, I2: Array, J: Array) -> Array:
    G = shear_modulus(tissue)
    lame = bulk_modulus(tissue) - 2 / 3 * G
    return G / 2 * (I1 - 3) - G * np.log(J) + lame / 2 * np.log(J) ** 2


def holmes_mow(tissue: Tissue, I1: Array, I2: Array, J: Array) -> Array:
    G, H, beta = shear_modulus(tissue), aggregate_modulus(tissue), tissue.stiffening_coefficient
    lame = H - 2 * G
    exponent = beta / H * ((2 * G - lame) * (I1 - 3) + lame * (I2 - 3) - H * np.log(J**2))
    return H / (4 * beta) * (np.exp(exponent) - 1)


ENERGIES = {"neo-hookean": neo_hookean, "neo-hookean-log": neo_hookean_log, "holmes-mow": holmes_mow}


def energy(tissue: Tissue, F: Array) -> Array:
    """Strain energy for deformation gradients (rows, 3, 3), per reference volume; shape (rows, 1)."""
    C = np.swapaxes(F, 1, 2) @ F
    I1 = np.trace(C, axis1=1, axis2=2)
    I2 = 0.5 * (I1**2 - np.trace(C @ C, axis1=1, axis2=2))
    return ENERGIES[tissue.solid](tissue, I1[:, None], I2[:, None], np.linalg.det(F)[:, None])


def in_plane_gradients(seed: int) -> Array:
    """Random deformation gradients with z as a principal direction, volumes from about half to double."""
    draw = np.random.default_rng(seed)
    F = np.zeros((ROWS, 3, 3))
    F[:, :2, :2] = np.eye(2) + draw.uniform(-0.25, 0.25, (ROWS, 2, 2))
    F[:, 2, 2] = draw.uniform(0.8, 1.3, ROWS)
    return F


def left_cauchy_green(F: Array) -> tuple[Array, Array, Array, Array]:
    b = F @ np.swapaxes(F, 1, 2)
    return b[:, 0, 0, None], b[:, 1, 1, None], b[:, 2, 2, None], b[:, 0, 1, None]


@pytest.mark.parametrize("solid", SOLIDS)
def test_stress_is_the_derivative_of_the_energy(solid: str) -> None:
    """sigma = (1/J) dW/dF F^T, the energy differentiated by complex step in all nine components of F."""
    tissue, F = random_tissue(ROWS, seed=4, solid=solid), in_plane_gradients(5)
    first_piola = np.zeros_like(F)
    for i in range(3):
        for j in range(3):
            step = F.astype(complex)
            step[:, i, j] += 1e-30j
            first_piola[:, i, j] = energy(tissue, step)[:, 0].imag / 1e-30
    expected = first_piola @ np.swapaxes(F, 1, 2) / np.linalg.det(F)[:, None, None]
    np.testing.assert_allclose(expected, np.swapaxes(expected, 1, 2), rtol=1e-11, atol=1e-13)  # no couple stress
    stress = cauchy_stress(tissue, *left_cauchy_green(F))
    for component, (i, j) in {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1)}.items():
        np.testing.assert_allclose(getattr(stress, component)[:, 0], expected[:, i, j], rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("solid", SOLIDS)
def test_no_stress_without_deformation_whatever_the_rotation(solid: str) -> None:
    tissue = random_tissue(ROWS, seed=6, solid=solid)
    angle = np.linspace(0, 6, ROWS)
    F = np.zeros((ROWS, 3, 3))
    F[:, 0, 0] = F[:, 1, 1] = np.cos(angle)
    F[:, 0, 1], F[:, 1, 0], F[:, 2, 2] = np.sin(angle), -np.sin(angle), 1.0
    for component in cauchy_stress(tissue, *left_cauchy_green(F)):
        np.testing.assert_allclose(component, 0.0, atol=1e-15)


@pytest.mark.parametrize("solid", SOLIDS)
def test_stress_turns_with_the_body(solid: str) -> None:
    """Objectivity: sigma(Q F) = Q sigma(F) Q^T."""
    tissue, F = random_tissue(ROWS, seed=7, solid=solid), in_plane_gradients(8)
    Q = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    turned = F.copy()
    turned[:, :2, :2] = Q @ F[:, :2, :2]
    stress, rotated = (cauchy_stress(tissue, *left_cauchy_green(gradient)) for gradient in (F, turned))

    def in_plane(components: tuple[Array, ...]) -> Array:
        xx, yy, _, xy = (value[:, 0] for value in components)
        return np.moveaxis(np.array([[xx, xy], [xy, yy]]), -1, 0)

    np.testing.assert_allclose(in_plane(rotated), Q @ in_plane(stress) @ Q.T, rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(rotated.zz, stress.zz, rtol=1e-11, atol=1e-14)


@pytest.mark.parametrize("solid", SOLIDS)
def test_small_strain_is_hookes_law(solid: str) -> None:
    """Slopes at rest: H = K + 4G/3 along, K - 2G/3 across, G in shear."""
    tissue = random_tissue(ROWS, seed=9, solid=solid)
    one, step = np.ones((ROWS, 1), dtype=complex), 1e-30j
    stretched = cauchy_stress(tissue, one + 2 * step, one, one, 0 * one)  # b = 1 + 2 strain
    sheared = cauchy_stress(tissue, one, one, one, 0 * one + step)
    K, G = bulk_modulus(tissue), shear_modulus(tissue)
    for value, expected in ((stretched.xx, K + 4 * G / 3), (stretched.yy, K - 2 * G / 3), (stretched.zz, K - 2 * G / 3),
                            (sheared.xy, G)):  # fmt: skip
        np.testing.assert_allclose(value.imag / 1e-30, expected, rtol=1e-12)
    np.testing.assert_allclose(uniaxial_stiffness(tissue, np.ones((ROWS, 1))), aggregate_modulus(tissue), rtol=1e-12)


def test_moduli() -> None:
    tissue = random_tissue(ROWS, seed=1)
    E, nu = tissue.youngs_modulus, tissue.poisson_ratio
    np.testing.assert_allclose(aggregate_modulus(tissue), E * (1 - nu) / ((1 + nu) * (1 - 2 * nu)), rtol=1e-13)
    K, G = bulk_modulus(tissue), shear_modulus(tissue)
    np.testing.assert_allclose(9 * K * G / (3 * K + G), E, rtol=1e-13)


def test_neo_hookean_is_equation_10_of_the_paper() -> None:
    tissue, J = reference_tissue(), np.linspace(0.3, 2.0, 18)[None]
    K, G = 0.5 / (3 * 0.4), 0.5 / 2.6
    expected = K / 2 * (J - 1 / J) + G / J * (J**2 - J ** (2 / 3))
    np.testing.assert_allclose(uniaxial_stress(tissue, J), expected, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(expected, K / 2 * (J - 1 / J) + G * (J - J ** (-1 / 3)), rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("solid", SOLIDS)
def test_column_is_uniaxial_strain(solid: str) -> None:
    tissue, J = random_tissue(ROWS, seed=11, solid=solid), np.linspace(0.4, 1.6, 25)[None]
    one = np.ones_like(J)
    np.testing.assert_allclose(
        uniaxial_stress(tissue, J), cauchy_stress(tissue, J**2, one, one, 0 * one).xx, rtol=1e-11, atol=1e-13
    )


@pytest.mark.parametrize("solid", SOLIDS)
def test_pressing_ever_harder_takes_ever_more_force(solid: str) -> None:
    J = np.linspace(0.25, 2.0, 200)[None]
    assert np.all(uniaxial_stiffness(random_tissue(ROWS, seed=12, solid=solid), J) > 0.0)


@pytest.mark.parametrize("solid", SOLIDS)
def test_stiffness_is_the_slope(solid: str) -> None:
    tissue, J, h = random_tissue(ROWS, seed=13, solid=solid), np.linspace(0.5, 1.5, 11)[None], 1e-5
    slope = (uniaxial_stress(tissue, J + h) - uniaxial_stress(tissue, J - h)) / (2 * h)
    np.testing.assert_allclose(uniaxial_stiffness(tissue, J), slope, rtol=1e-7)
