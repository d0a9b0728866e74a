"""Constitutive laws of the solid: isotropic, hyperelastic, written for the left Cauchy-Green tensor b.

Every law has the form ``sigma = a0 I + a1 b + a2 b^2``; one function gives the coefficients, so that a column
(uniaxial strain) and plane or axisymmetric deformation share it. All functions accept complex numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from fvswell.physics.differentiation import COMPLEX_STEP
from fvswell.physics.tissue import Array, Tissue

__all__ = [
    "SOLIDS",
    "SolidStress",
    "aggregate_modulus",
    "bulk_modulus",
    "cauchy_stress",
    "shear_modulus",
    "uniaxial_stiffness",
    "uniaxial_stress",
]


class SolidStress(NamedTuple):
    """Components of the Cauchy stress of the solid (MPa); out-of-plane shears are zero."""

    xx: Array
    yy: Array
    zz: Array
    xy: Array


def bulk_modulus(tissue: Tissue) -> Array:
    """K = E / (3 (1 - 2 nu)), MPa."""
    return tissue.youngs_modulus / (3.0 * (1.0 - 2.0 * tissue.poisson_ratio))


def shear_modulus(tissue: Tissue) -> Array:
    """G = E / (2 (1 + nu)), MPa."""
    return tissue.youngs_modulus / (2.0 * (1.0 + tissue.poisson_ratio))


def aggregate_modulus(tissue: Tissue) -> Array:
    """H = K + 4 G / 3, the slope of the uniaxial stress at J = 1 of every law here, MPa."""
    return bulk_modulus(tissue) + 4.0 / 3.0 * shear_modulus(tissue)


def _neo_hookean(tissue: Tissue, J: Array, first: Array, second: Array) -> tuple[Array, Array, Array | float]:
    """Wilson et al. (2005), eq 10: K/2 (J - 1/J) I + G/J (b - J^(2/3) I)."""
    K, G = bulk_modulus(tissue), shear_modulus(tissue)
    return K / 2 * (J - 1 / J) - G * np.exp(-np.log(J) / 3), G / J, 0.0


def _neo_hookean_log(tissue: Tissue, J: Array, first: Array, second: Array) -> tuple[Array, Array, Array | float]:
    """Bonet & Wood (2008), eq 6.29: (mu (b - I) + lambda ln J I) / J."""
    G = shear_modulus(tissue)
    lame = bulk_modulus(tissue) - 2.0 / 3.0 * G
    return (lame * np.log(J) - G) / J, G / J, 0.0


def _holmes_mow(tissue: Tissue, J: Array, first: Array, second: Array) -> tuple[Array, Array, Array | float]:
    """Holmes & Mow (1990), isotropic: W = H/(4 beta) (exp(Q) - 1)."""
    G = shear_modulus(tissue)
    lame = bulk_modulus(tissue) - 2.0 / 3.0 * G
    H = lame + 2.0 * G
    Q = (
        tissue.stiffening_coefficient
        / H
        * ((2.0 * G - lame) * (first - 3.0) + lame * (second - 3.0) - 2.0 * H * np.log(J))
    )
    scale = np.exp(Q) / (2.0 * J)
    return -H * scale, (2.0 * G + lame * (first - 1.0)) * scale, -lame * scale


_Law = Callable[[Tissue, Array, Array, Array], tuple[Array, Array, "Array | float"]]
_LAWS: dict[str, _Law] = {
    "neo-hookean": _neo_hookean,
    "neo-hookean-log": _neo_hookean_log,
    "holmes-mow": _holmes_mow,
}
SOLIDS = tuple(_LAWS)


def cauchy_stress(tissue: Tissue, b_xx: Array, b_yy: Array, b_zz: Array, b_xy: Array) -> SolidStress:
    """Cauchy stress of the solid for a deformation with z as a principal direction.

    Parameters
    ----------
    tissue
        Properties at the points, broadcastable to the shape of ``b_xx``.
    b_xx, b_yy, b_zz, b_xy
        Components of b = F F^T, all of one shape (real or complex).

    Returns
    -------
    SolidStress
        Components in MPa.
    """
    minor = b_xx * b_yy - b_xy * b_xy
    J = np.sqrt(minor * b_zz)
    a0, a1, a2 = _LAWS[tissue.solid](tissue, J, b_xx + b_yy + b_zz, minor + (b_xx + b_yy) * b_zz)
    return SolidStress(
        xx=a0 + a1 * b_xx + a2 * (b_xx * b_xx + b_xy * b_xy),
        yy=a0 + a1 * b_yy + a2 * (b_yy * b_yy + b_xy * b_xy),
        zz=a0 + a1 * b_zz + a2 * b_zz * b_zz,
        xy=a1 * b_xy + a2 * b_xy * (b_xx + b_yy),
    )


def uniaxial_stress(tissue: Tissue, J: Array) -> Array:
    """Axial Cauchy stress of the solid (MPa) under uniaxial strain with stretch J, shape of ``J``."""
    square = J * J
    a0, a1, a2 = _LAWS[tissue.solid](tissue, J, square + 2.0, 2.0 * square + 1.0)
    return a0 + (a1 + a2 * square) * square


def uniaxial_stiffness(tissue: Tissue, J: Array) -> Array:
    """Derivative of `uniaxial_stress` by J (MPa), exact by complex step; ``J`` real."""
    return uniaxial_stress(tissue, J + 1j * COMPLEX_STEP).imag / COMPLEX_STEP
