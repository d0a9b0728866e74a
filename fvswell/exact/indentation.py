"""Indentation of an elastic layer that is glued to bone, by a rigid, flat-ended, frictionless indenter.

Hayes, Keer, Herrmann & Mockros (1972). At small strain the load is

    P = 2 a E w kappa(a/h, nu)/(1 - nu^2)

for the displacement w of an indenter of radius a, kappa being what the bone adds to the half space. With
m = 3 - 4 nu it follows from the integral equation

    phi(t) - (a/h)/pi int_0^1 [K(t + s) + K(t - s)] phi(s) ds = 1,        kappa = int_0^1 phi(t) dt,
    K(x) = int_0^inf (1 - L(u)) cos(u x a/h) du,
    L(u) = (2 m sinh 2u - 4u)/(2 m cosh 2u + 4 u^2 + m^2 + 1),

which is solved on Gauss points. A biphasic layer is elastic in both limits: in equilibrium with its drained constants;
in the first instant it keeps its volume, so with the same shear modulus G, nu = 1/2 and E = 3 G.
"""

from __future__ import annotations

import numpy as np

from fvswell.physics.tissue import Array

__all__ = ["indentation_force", "instantaneous_indentation_force", "thin_layer_factor"]

_POINTS = 40  # on the radius; phi is smooth
_LARGEST_WAVE_NUMBER, _WAVE_POINTS = 24.0, 200  # 1 - L falls as u^2 exp(-2 u)
_LARGEST_ASPECT = 10.0  # a/h up to which both are plenty


def thin_layer_factor(aspect: float, poisson_ratio: float) -> float:
    """Kappa: the load on the layer over that on a half space; 1 for a narrow indenter.

    Parameters
    ----------
    aspect
        Radius of the indenter over the height of the layer, a/h, at most 10.
    poisson_ratio
        From 0 to 1/2.

    Raises
    ------
    ValueError
        If one of them is out of range.
    """
    if not 0.0 <= aspect <= _LARGEST_ASPECT:
        raise ValueError(f"radius over height must be from 0 to {_LARGEST_ASPECT:g}, not {aspect:g}")
    if not 0.0 <= poisson_ratio <= 0.5:
        raise ValueError(f"Poisson's ratio must be from 0 to 0.5, not {poisson_ratio:g}")
    points, weights = _gauss(_POINTS, 1.0)
    wave, wave_weights = _gauss(_WAVE_POINTS, _LARGEST_WAVE_NUMBER)
    spectrum = wave_weights * _missing_stiffness(wave, poisson_ratio)
    # cos(u (t + s)) + cos(u (t - s)) = 2 cos(u t) cos(u s)
    waves = np.cos(np.outer(points, wave) * aspect)
    kernel = 2.0 * aspect / np.pi * (waves * spectrum) @ waves.T
    phi = np.linalg.solve(np.eye(len(points)) - kernel * weights, np.ones(len(points)))
    return float(weights @ phi)


def indentation_force(
    displacement: Array | float, radius: float, height: float, youngs_modulus: float, poisson_ratio: float
) -> Array | float:
    """Load (N) on an indenter pushed in by ``displacement`` mm, once the layer is in equilibrium.

    Parameters
    ----------
    displacement
        Small against the height, mm, positive into the layer; a number or an array.
    radius, height
        Of the indenter and of the layer, mm.
    youngs_modulus, poisson_ratio
        Of the drained solid, MPa.
    """
    factor = thin_layer_factor(radius / height, poisson_ratio)
    return 2.0 * radius * youngs_modulus * factor / (1.0 - poisson_ratio**2) * displacement


def instantaneous_indentation_force(
    displacement: Array | float, radius: float, height: float, youngs_modulus: float, poisson_ratio: float
) -> Array | float:
    """Load (N) right after a sudden displacement, before any water has moved; arguments as in `indentation_force`."""
    shear_modulus = youngs_modulus / (2.0 * (1.0 + poisson_ratio))
    return indentation_force(displacement, radius, height, 3.0 * shear_modulus, 0.5)


def _missing_stiffness(u: Array, poisson_ratio: float) -> Array:
    """1 - L(u) = (2 m exp(-2 u) + 4 u^2 + 4 u + m^2 + 1)/(2 m cosh 2u + 4 u^2 + m^2 + 1), without cancellation."""
    m = 3.0 - 4.0 * poisson_ratio
    decay = np.exp(-2.0 * u)
    rest = 4.0 * u * u + m * m + 1.0
    result: Array = (2.0 * m * decay + rest + 4.0 * u) * decay / (m * (1.0 + decay * decay) + rest * decay)
    return result


def _gauss(count: int, end: float) -> tuple[Array, Array]:
    """Gauss points and weights from 0 to ``end``."""
    points, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * end * (points + 1.0), 0.5 * end * weights
