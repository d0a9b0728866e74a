"""Constitutive laws of the solid: hyperelastic, and the stress in a column and in plane or axisymmetric deformation.

An isotropic law has the form ``sigma = a0 I + a1 b + a2 b^2``, b = F F^T; one function gives the coefficients, and the
stresses follow. Solids with fibres (`fvswell.physics.fibres`) have stresses of their own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fvswell.compiled import generic, point

__all__ = [
    "SOLIDS",
    "HolmesMow",
    "NeoHookean",
    "NeoHookeanLog",
    "SolidFractionNeoHookean",
    "SolidStress",
    "aggregate_modulus",
    "bulk_modulus",
    "cauchy_stress",
    "isotropic_stress",
    "piola_stress",
    "shear_modulus",
    "stress_coefficients",
    "uniaxial_stress",
    "youngs_modulus",
]


class NeoHookean(NamedTuple):
    """Wilson et al. (2005), eq 10: K/2 (J - 1/J) I + G/J (b - J^(2/3) I)."""

    youngs_modulus: Any  # E, MPa
    poisson_ratio: Any  # nu


class NeoHookeanLog(NamedTuple):
    """Bonet & Wood (2008), eq 6.29: (mu (b - I) + lambda ln J I)/J."""

    youngs_modulus: Any
    poisson_ratio: Any


class HolmesMow(NamedTuple):
    """Holmes & Mow (1990), isotropic: W = H/(4 beta) (exp(Q) - 1)."""

    youngs_modulus: Any
    poisson_ratio: Any
    stiffening_coefficient: Any  # beta


class SolidFractionNeoHookean(NamedTuple):
    """Wilson et al. (2007): as neo-Hookean, with Poisson's ratio half the solid fraction, n_s/2 = (1 - n_f0)/(2 J).

    The energy is K/2 (ln J)^2 + G/2 (I1 - 3 J^(2/3)), K = 2 G (1 + nu)/(3 (1 - 2 nu)); K has no bound as the pores
    close.
    """

    shear_modulus: Any  # G, MPa


SOLIDS: dict[str, type] = {
    "neo-hookean": NeoHookean,
    "neo-hookean-log": NeoHookeanLog,
    "holmes-mow": HolmesMow,
    "solid-fraction": SolidFractionNeoHookean,
}


class SolidStress(NamedTuple):
    """Components of the Cauchy stress of the solid (MPa); shears out of the plane are zero."""

    xx: Any
    yy: Any
    zz: Any
    xy: Any


@generic
def bulk_modulus(solid: Any, fluid_fraction: Any) -> Any:
    """K at small strain, MPa; fibres left out, as they carry nothing in compression."""


@generic
def shear_modulus(solid: Any, fluid_fraction: Any) -> Any:
    """G at small strain, MPa; fibres left out."""


@bulk_modulus.register(object)
def _bulk_modulus(solid: Any, fluid_fraction: Any) -> Any:
    return solid.youngs_modulus / (3.0 * (1.0 - 2.0 * solid.poisson_ratio))


@shear_modulus.register(object)
def _shear_modulus(solid: Any, fluid_fraction: Any) -> Any:
    return solid.youngs_modulus / (2.0 * (1.0 + solid.poisson_ratio))


@bulk_modulus.register(SolidFractionNeoHookean)
def _solid_fraction_bulk_modulus(solid: Any, fluid_fraction: Any) -> Any:
    return solid.shear_modulus / 3.0 * (3.0 - fluid_fraction) / fluid_fraction


@shear_modulus.register(SolidFractionNeoHookean)
def _solid_fraction_shear_modulus(solid: Any, fluid_fraction: Any) -> Any:
    return solid.shear_modulus


@point
def aggregate_modulus(solid: Any, fluid_fraction: Any) -> Any:
    """H = K + 4 G/3, the slope of the uniaxial stress at J = 1 (in compression) of every law here, MPa."""
    return bulk_modulus(solid, fluid_fraction) + 4.0 / 3.0 * shear_modulus(solid, fluid_fraction)


@point
def youngs_modulus(solid: Any, fluid_fraction: Any) -> Any:
    """E = 9 K G/(3 K + G) at small strain, MPa; fibres left out."""
    K, G = bulk_modulus(solid, fluid_fraction), shear_modulus(solid, fluid_fraction)
    return 9.0 * K * G / (3.0 * K + G)


@generic
def stress_coefficients(solid: Any, J: Any, first: Any, second: Any, fluid_fraction: Any) -> Any:
    """Coefficients (a0, a1, a2) of sigma = a0 I + a1 b + a2 b^2, MPa.

    Parameters
    ----------
    solid
        A law with its parameters.
    J, first, second
        Volume ratio, and first and second invariant of b.
    fluid_fraction
        n_f0 of the stress-free solid.
    """


@stress_coefficients.register(NeoHookean)
def _neo_hookean(solid: Any, J: Any, first: Any, second: Any, fluid_fraction: Any) -> Any:
    K, G = bulk_modulus(solid, fluid_fraction), shear_modulus(solid, fluid_fraction)
    return 0.5 * K * (J - 1.0 / J) - G * np.exp(-np.log(J) / 3.0), G / J, 0.0


@stress_coefficients.register(NeoHookeanLog)
def _neo_hookean_log(solid: Any, J: Any, first: Any, second: Any, fluid_fraction: Any) -> Any:
    G = shear_modulus(solid, fluid_fraction)
    lame = bulk_modulus(solid, fluid_fraction) - 2.0 / 3.0 * G
    return (lame * np.log(J) - G) / J, G / J, 0.0


@stress_coefficients.register(HolmesMow)
def _holmes_mow(solid: Any, J: Any, first: Any, second: Any, fluid_fraction: Any) -> Any:
    G = shear_modulus(solid, fluid_fraction)
    lame = bulk_modulus(solid, fluid_fraction) - 2.0 / 3.0 * G
    H = lame + 2.0 * G
    Q = (
        solid.stiffening_coefficient
        / H
        * ((2.0 * G - lame) * (first - 3.0) + lame * (second - 3.0) - 2.0 * H * np.log(J))
    )
    scale = np.exp(Q) / (2.0 * J)
    return -H * scale, (2.0 * G + lame * (first - 1.0)) * scale, -lame * scale


@stress_coefficients.register(SolidFractionNeoHookean)
def _solid_fraction_neo_hookean(solid: Any, J: Any, first: Any, second: Any, fluid_fraction: Any) -> Any:
    G, log_J = solid.shear_modulus, np.log(J)
    pore = J - 1.0 + fluid_fraction
    solid_part = (1.0 - fluid_fraction) / pore
    K = G * (2.0 / 3.0 + solid_part)
    volumetric = log_J / J * (K - 0.5 * G * solid_part * (J / pore) * log_J)
    return volumetric - G * np.exp(-log_J / 3.0), G / J, 0.0


@generic
def cauchy_stress(solid: Any, fluid_fraction: Any, F: Any) -> Any:
    """Cauchy stress of the solid for a deformation with z as a principal direction.

    Parameters
    ----------
    solid
        A law with its parameters.
    fluid_fraction
        n_f0 of the stress-free solid.
    F
        Components (xx, xy, yx, yy, zz) of the deformation gradient.

    Returns
    -------
    SolidStress
        Components in MPa.
    """


@generic
def piola_stress(solid: Any, fluid_fraction: Any, F: Any) -> Any:
    """First Piola-Kirchhoff stress P = sigma cof F, components (xx, xy, yx, yy, zz); see `cauchy_stress`."""


@generic
def uniaxial_stress(solid: Any, J: Any, fluid_fraction: Any) -> Any:
    """Axial Cauchy stress of the solid (MPa) under uniaxial strain with stretch J, along y."""


@generic
def isotropic_stress(solid: Any, J: Any, fluid_fraction: Any) -> Any:
    """Mean normal Cauchy stress of the solid (MPa) stretched equally in all directions to the volume ratio J."""


@cauchy_stress.register(object)
def _isotropic_cauchy_stress(solid: Any, fluid_fraction: Any, F: Any) -> Any:
    xx, xy, yx, yy, zz = F
    b_xx, b_yy, b_zz, b_xy = xx * xx + xy * xy, yx * yx + yy * yy, zz * zz, xx * yx + xy * yy
    minor = b_xx * b_yy - b_xy * b_xy
    J = np.sqrt(minor * b_zz)
    a0, a1, a2 = stress_coefficients(solid, J, b_xx + b_yy + b_zz, minor + (b_xx + b_yy) * b_zz, fluid_fraction)
    return SolidStress(
        a0 + a1 * b_xx + a2 * (b_xx * b_xx + b_xy * b_xy),
        a0 + a1 * b_yy + a2 * (b_yy * b_yy + b_xy * b_xy),
        a0 + a1 * b_zz + a2 * (b_zz * b_zz),
        a1 * b_xy + a2 * (b_xy * (b_xx + b_yy)),
    )


@piola_stress.register(object)
def _piola_of_cauchy(solid: Any, fluid_fraction: Any, F: Any) -> Any:
    xx, xy, yx, yy, zz = F
    sigma = cauchy_stress(solid, fluid_fraction, F)
    return (
        (sigma.xx * yy - sigma.xy * xy) * zz, (sigma.xy * xx - sigma.xx * yx) * zz,
        (sigma.xy * yy - sigma.yy * xy) * zz, (sigma.yy * xx - sigma.xy * yx) * zz,
        sigma.zz * (xx * yy - xy * yx),
    )  # fmt: skip


@uniaxial_stress.register(object)
def _isotropic_uniaxial_stress(solid: Any, J: Any, fluid_fraction: Any) -> Any:
    square = J * J
    a0, a1, a2 = stress_coefficients(solid, J, square + 2.0, 2.0 * square + 1.0, fluid_fraction)
    return a0 + (a1 + a2 * square) * square


@isotropic_stress.register(object)
def _isotropic_isotropic_stress(solid: Any, J: Any, fluid_fraction: Any) -> Any:
    square = np.exp(2.0 / 3.0 * np.log(J))
    a0, a1, a2 = stress_coefficients(solid, J, 3.0 * square, 3.0 * (square * square), fluid_fraction)
    return a0 + (a1 + a2 * square) * square
