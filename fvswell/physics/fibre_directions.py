"""Families of fibres: how their directions are distributed, and the stress that follows.

A family has an amount of one, so the modulus of its law is that of all its fibres together, whatever their directions.
Integrals over directions are taken over those that are in tension alone, whose boundary is known: there they are
smooth, and a few Gauss points are exact to 1e-6 of the stress, for stretches up to 1.3. With C = F^T F and I = n . C n,

    S = mean of 2 psi' n (x) n,        dS = (mean of 2 psi'' n (x) n (x) n (x) n) : dC

is the second Piola-Kirchhoff stress, and its derivative, as the integrand is zero at the boundary. Directions are those
in the stress-free solid: x and y in the plane of a block (of a disc the radius and the height), z out of it (the hoop);
the axis of a column is y.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from fvswell.compiled import anywhere, generic, point
from fvswell.compiled.dual import value_of
from fvswell.physics.fibre_laws import fibre_tension, tension_over_directions

__all__ = [
    "FIBRE_DIRECTIONS",
    "IsotropicDirections",
    "OneDirection",
    "PlanarAcrossX",
    "PlanarAcrossZ",
    "PlanarDirections",
    "SecondPiola",
    "axial_fibre_stress",
    "fibre_stress",
    "mean_fibre_stress",
    "one_direction",
    "planar_directions",
]


class IsotropicDirections(NamedTuple):
    """All directions alike."""


class PlanarDirections(NamedTuple):
    """All directions in the plane of x and z alike: of the hoops and radii of a disc, across the axis of a column."""


class PlanarAcrossX(NamedTuple):
    """All directions in the plane of y and z alike: of a disc, around it and along its axis."""


class PlanarAcrossZ(NamedTuple):
    """All directions in the plane of x and y alike: that of a block in plane strain."""


class OneDirection(NamedTuple):
    """One direction, or two that mirror each other in the plane of x and y and share the amount: components of n (x) n.

    `one_direction` makes them of angles.
    """

    xx: Any
    yy: Any
    zz: Any
    xy: Any


def one_direction(angle: Any, tilt: Any = 0.0) -> OneDirection:
    """The family along a direction.

    Parameters
    ----------
    angle
        From x toward y, in degrees: 0 is along x, 90 along y.
    tilt
        Out of the plane of x and y, to both sides, in degrees: 90 is along z, the hoop.
    """
    cosine, sine, out = np.cos(np.radians(angle)), np.sin(np.radians(angle)), np.sin(np.radians(tilt)) ** 2
    return OneDirection(cosine**2 * (1.0 - out), sine**2 * (1.0 - out), out, cosine * sine * (1.0 - out))


def planar_directions(normal: str = "y") -> Any:
    """The family of all directions in a plane, whose normal is "x", "y" or "z"."""
    planes: dict[str, Any] = {"x": PlanarAcrossX, "y": PlanarDirections, "z": PlanarAcrossZ}
    return planes[normal]()


FIBRE_DIRECTIONS: dict[str, Callable[..., Any]] = {  # with the parameters of each
    "isotropic": IsotropicDirections,
    "planar": planar_directions,
    "along": one_direction,
}


class SecondPiola(NamedTuple):
    """Components of the second Piola-Kirchhoff stress, MPa; shears out of the plane are zero."""

    xx: Any
    yy: Any
    zz: Any
    xy: Any


def _gauss(points: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Gauss points on 0 to 1 and their weights."""
    u, weights = np.polynomial.legendre.leggauss(points)
    return tuple((0.5 * (u + 1.0)).tolist()), tuple((0.5 * weights).tolist())


def _clustered(points: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Gauss points on 0 to 1, closer and closer toward 1 (v = 1 - u^2), where fibres begin to carry."""
    u, weights = (np.array(values) for values in _gauss(points))
    return tuple((1.0 - u * u).tolist()), tuple((2.0 * u * weights).tolist())


_AZIMUTHS, _AZIMUTH_WEIGHTS = _clustered(12)
_HEIGHTS, _HEIGHT_WEIGHTS = _clustered(8)
_NONE = 1e-300  # of strain, which takes the place of zero and less
_QUARTER = 0.5 * np.pi


@generic
def fibre_stress(directions: Any, law: Any, C_xx: Any, C_yy: Any, C_zz: Any, C_xy: Any) -> Any:
    """Second Piola-Kirchhoff stress of a family, `SecondPiola`.

    Parameters
    ----------
    directions, law
        Of the family.
    C_xx, C_yy, C_zz, C_xy
        Components of C = F^T F.
    """


@generic
def axial_fibre_stress(directions: Any, law: Any, square: Any) -> Any:
    """Its component yy where the stretch along y has this square and there is no other."""


@point
def _number(x: Any) -> Any:
    return np.real(value_of(x))


@point
def _select(condition: Any, first: Any, second: Any) -> Any:
    return 1.0 * condition * first + (1.0 - 1.0 * condition) * second


@point
def _range_in_tension(first: Any, second: Any) -> Any:
    """Angle from the direction of the larger of two principal strains to where their sum is no longer positive."""
    compressed = np.maximum(-second, _NONE)
    return _select(second < 0.0, np.arctan(np.sqrt(np.maximum(first, 0.0) / compressed)), _QUARTER)


@point
def _moments(law: Any, first: Any, second: Any, third: Any) -> Any:
    """Means of 2 psi' n_i^2 and 2 psi'' n_i^2 n_j^2 over the sphere: (1, 2, 3, 11, 22, 33, 12, 13, 23).

    The arguments are the principal values of C - I, in falling order. Directions are (cos p sin t, sin p sin t, cos t).
    """
    s1, s2, s3, d11, d22, d33, d12, d13, d23 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    end = _range_in_tension(first, second)
    for j in range(len(_AZIMUTHS)):
        cosine = np.cos(end * _AZIMUTHS[j])
        n1 = cosine * cosine
        n2 = 1.0 - n1
        across = np.maximum(first * n1 + second * n2, _NONE)
        top = np.sqrt(across / (across + np.maximum(-third, 0.0)))  # cos t of the last direction in tension
        a0, a1, b0, b1, b2 = 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(len(_HEIGHTS)):
            height = top * _HEIGHTS[k]
            up = height * height
            flat = 1.0 - up
            tension, stiffness = fibre_tension(law, np.maximum(across * flat + third * up, _NONE))
            tension = _HEIGHT_WEIGHTS[k] * tension
            stiffness = _HEIGHT_WEIGHTS[k] * stiffness
            a0 = a0 + flat * tension
            a1 = a1 + up * tension
            b0 = b0 + flat * flat * stiffness
            b1 = b1 + flat * up * stiffness
            b2 = b2 + up * up * stiffness
        weight = _AZIMUTH_WEIGHTS[j] * top
        s1 = s1 + weight * n1 * a0
        s2 = s2 + weight * n2 * a0
        s3 = s3 + weight * a1
        d11 = d11 + weight * n1 * n1 * b0
        d22 = d22 + weight * n2 * n2 * b0
        d33 = d33 + weight * b2
        d12 = d12 + weight * n1 * n2 * b0
        d13 = d13 + weight * n1 * b1
        d23 = d23 + weight * n2 * b1
    mean = 1.0 * (first > 0.0) * end / _QUARTER
    return (
        mean * s1, mean * s2, mean * s3, mean * d11, mean * d22, mean * d33, mean * d12, mean * d13, mean * d23
    )  # fmt: skip


@point
def _tension_along(law: Any, square: Any) -> Any:
    """2 psi' of fibres whose stretch has this square."""
    strain = _number(square) - 1.0
    tension, stiffness = fibre_tension(law, np.maximum(strain, _NONE))
    stretched = 1.0 * (strain > 0.0)
    return stretched * tension + stretched * stiffness * (square - (strain + 1.0))


@point
def mean_fibre_stress(directions: Any, law: Any, square: Any) -> Any:
    """A third of the trace, where the squares of all stretches are the same."""
    return _tension_along(law, square) / 3.0


@fibre_stress.register(IsotropicDirections)
def _isotropic(directions: Any, law: Any, C_xx: Any, C_yy: Any, C_zz: Any, C_xy: Any) -> Any:
    """In the frame of the principal stretches, of which z is one and the others lie in the plane."""
    xx, yy, third, xy = _number(C_xx), _number(C_yy), _number(C_zz) - 1.0, _number(C_xy)
    mean, half = 0.5 * (xx + yy) - 1.0, 0.5 * (xx - yy)
    radius = np.sqrt(half * half + xy * xy)
    first, second = mean + radius, mean - radius
    zero = 0.0 * (C_xx + C_yy + C_zz + C_xy)
    if not anywhere(np.maximum(first, third) > 0.0):
        return SecondPiola(zero, zero, zero, zero)
    scale = 1.0 / np.maximum(radius, _NONE)
    cosine, sine = _select(radius > _NONE, half * scale, 1.0), xy * scale  # of twice the angle of the first direction

    largest, least = np.maximum(first, third), np.minimum(second, third)
    middle = np.maximum(second, np.minimum(first, third))
    sa, sb, sc, daa, dbb, dcc, dab, dac, dbc = _moments(law, largest, middle, least)
    z_first, z_last = third > first, third < second
    s1, s2, s3 = _select(z_first, sb, sa), _select(z_last, sb, sc), _select(z_first, sa, _select(z_last, sc, sb))
    d11, d22 = _select(z_first, dbb, daa), _select(z_last, dbb, dcc)
    d33 = _select(z_first, daa, _select(z_last, dcc, dbb))
    d12 = _select(z_first, dbc, _select(z_last, dab, dac))
    d13 = _select(z_last, dac, dab)
    d23 = _select(z_first, dac, dbc)

    rise_xx, rise_yy, rise_zz, rise_xy = C_xx - xx, C_yy - yy, C_zz - (third + 1.0), C_xy - xy
    rise_sum, rise_half = 0.5 * (rise_xx + rise_yy), 0.5 * (rise_xx - rise_yy)
    along = cosine * rise_half + sine * rise_xy
    rise_1, rise_2 = rise_sum + along, rise_sum - along
    S_1 = s1 + d11 * rise_1 + d12 * rise_2 + d13 * rise_zz
    S_2 = s2 + d12 * rise_1 + d22 * rise_2 + d23 * rise_zz
    S_12 = 2.0 * d12 * (cosine * rise_xy - sine * rise_half)
    S_zz = s3 + d13 * rise_1 + d23 * rise_2 + d33 * rise_zz
    S_sum, S_half = 0.5 * (S_1 + S_2), 0.5 * (S_1 - S_2)
    deviation = cosine * S_half - sine * S_12
    return SecondPiola(S_sum + deviation, S_sum - deviation, S_zz, sine * S_half + cosine * S_12)


@axial_fibre_stress.register(IsotropicDirections)
def _isotropic_axial(directions: Any, law: Any, square: Any) -> Any:
    """All directions are stretched, or none: the integral of 2 psi'(e u^2) u^2 over u from 0 to 1, e being I - 1.

    By parts, its derivative by e is (2 psi'(e) - 3 times itself)/(2 e).
    """
    strain = _number(square) - 1.0
    s, d = 0.0 * strain, 0.0 * strain
    if anywhere(strain > 0.0):
        tensed = np.maximum(strain, _NONE)
        s = tension_over_directions(law, tensed)
        tension, _ = fibre_tension(law, tensed)
        d = 0.5 * (tension - 3.0 * s) / tensed
    stretched = 1.0 * (strain > 0.0)
    return stretched * s + stretched * d * (square - (strain + 1.0))


@point
def _planar_moments(law: Any, first: Any, second: Any) -> Any:
    """Means of 2 psi' n_i^2 and 2 psi'' n_i^2 n_j^2 over the directions of a plane: (1, 2, 11, 22, 12).

    The arguments are the principal values of C - I in the plane, in falling order.
    """
    s1, s2, d11, d22, d12 = 0.0, 0.0, 0.0, 0.0, 0.0
    end = _range_in_tension(first, second)
    for j in range(len(_AZIMUTHS)):
        cosine = np.cos(end * _AZIMUTHS[j])
        n1 = cosine * cosine
        n2 = 1.0 - n1
        tension, stiffness = fibre_tension(law, np.maximum(first * n1 + second * n2, _NONE))
        tension = _AZIMUTH_WEIGHTS[j] * tension
        stiffness = _AZIMUTH_WEIGHTS[j] * stiffness
        s1 = s1 + n1 * tension
        s2 = s2 + n2 * tension
        d11 = d11 + n1 * n1 * stiffness
        d22 = d22 + n2 * n2 * stiffness
        d12 = d12 + n1 * n2 * stiffness
    mean = 1.0 * (first > 0.0) * end / _QUARTER
    return mean * s1, mean * s2, mean * d11, mean * d22, mean * d12


@point
def _stress_with_z(law: Any, C_across: Any, C_zz: Any) -> Any:
    """Stress across z and along z of directions in the plane of both, which has no shear."""
    across, z = _number(C_across) - 1.0, _number(C_zz) - 1.0
    s1, s2, d11, d22, d12 = _planar_moments(law, np.maximum(across, z), np.minimum(across, z))
    across_first = across >= z
    rise, rise_z = C_across - (across + 1.0), C_zz - (z + 1.0)
    d_across, d_z = _select(across_first, d11, d22), _select(across_first, d22, d11)
    return (
        _select(across_first, s1, s2) + d_across * rise + d12 * rise_z,
        _select(across_first, s2, s1) + d12 * rise + d_z * rise_z,
    )


@fibre_stress.register(PlanarDirections)
def _planar(directions: Any, law: Any, C_xx: Any, C_yy: Any, C_zz: Any, C_xy: Any) -> Any:
    zero = 0.0 * (C_xx + C_yy + C_zz + C_xy)
    if not anywhere(np.maximum(_number(C_xx), _number(C_zz)) > 1.0):
        return SecondPiola(zero, zero, zero, zero)
    S_xx, S_zz = _stress_with_z(law, C_xx, C_zz)
    return SecondPiola(zero + S_xx, zero, zero + S_zz, zero)


@fibre_stress.register(PlanarAcrossX)
def _planar_across_x(directions: Any, law: Any, C_xx: Any, C_yy: Any, C_zz: Any, C_xy: Any) -> Any:
    zero = 0.0 * (C_xx + C_yy + C_zz + C_xy)
    if not anywhere(np.maximum(_number(C_yy), _number(C_zz)) > 1.0):
        return SecondPiola(zero, zero, zero, zero)
    S_yy, S_zz = _stress_with_z(law, C_yy, C_zz)
    return SecondPiola(zero, zero + S_yy, zero + S_zz, zero)


@fibre_stress.register(PlanarAcrossZ)
def _planar_across_z(directions: Any, law: Any, C_xx: Any, C_yy: Any, C_zz: Any, C_xy: Any) -> Any:
    """In the frame of the principal stretches, as for isotropic directions."""
    xx, yy, xy = _number(C_xx), _number(C_yy), _number(C_xy)
    mean, half = 0.5 * (xx + yy) - 1.0, 0.5 * (xx - yy)
    radius = np.sqrt(half * half + xy * xy)
    zero = 0.0 * (C_xx + C_yy + C_zz + C_xy)
    if not anywhere(mean + radius > 0.0):
        return SecondPiola(zero, zero, zero, zero)
    scale = 1.0 / np.maximum(radius, _NONE)
    cosine, sine = _select(radius > _NONE, half * scale, 1.0), xy * scale
    s1, s2, d11, d22, d12 = _planar_moments(law, mean + radius, mean - radius)
    rise_sum, rise_half, rise_xy = 0.5 * (C_xx + C_yy - (xx + yy)), 0.5 * (C_xx - C_yy - (xx - yy)), C_xy - xy
    along = cosine * rise_half + sine * rise_xy
    S_1 = s1 + d11 * (rise_sum + along) + d12 * (rise_sum - along)
    S_2 = s2 + d12 * (rise_sum + along) + d22 * (rise_sum - along)
    S_12 = 2.0 * d12 * (cosine * rise_xy - sine * rise_half)
    S_sum, S_half = 0.5 * (S_1 + S_2), 0.5 * (S_1 - S_2)
    deviation = cosine * S_half - sine * S_12
    return SecondPiola(zero + S_sum + deviation, zero + S_sum - deviation, zero, zero + sine * S_half + cosine * S_12)


@axial_fibre_stress.register(PlanarDirections)
def _planar_axial(directions: Any, law: Any, square: Any) -> Any:
    """No direction across the axis is stretched."""
    return 0.0 * square


@axial_fibre_stress.register(PlanarAcrossX)
@axial_fibre_stress.register(PlanarAcrossZ)
def _planar_axial_within(directions: Any, law: Any, square: Any) -> Any:
    strain = _number(square) - 1.0
    s1, _, d11, _, _ = _planar_moments(law, strain, 0.0 * strain)
    return s1 + d11 * (square - (strain + 1.0))


@fibre_stress.register(OneDirection)
def _along(directions: Any, law: Any, C_xx: Any, C_yy: Any, C_zz: Any, C_xy: Any) -> Any:
    n = directions
    tension = _tension_along(law, n.xx * C_xx + n.yy * C_yy + n.zz * C_zz + 2.0 * n.xy * C_xy)
    return SecondPiola(n.xx * tension, n.yy * tension, n.zz * tension, n.xy * tension)


@axial_fibre_stress.register(OneDirection)
def _along_axial(directions: Any, law: Any, square: Any) -> Any:
    return directions.yy * _tension_along(law, 1.0 + directions.yy * (square - 1.0))
