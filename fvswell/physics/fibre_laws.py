"""Laws of a single fibre, which carries load in tension only.

With lambda the stretch of a fibre and I = lambda^2, its energy psi(I) per reference volume adds 2 psi' F n (x) F n/J to
the Cauchy stress, n being its direction in the stress-free solid.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fvswell.compiled import anywhere, generic, point

__all__ = ["FIBRE_LAWS", "LogarithmicFibres", "PowerFibres", "fibre_tension", "tension_over_directions"]

_MOST_TERMS = 2000  # z^k/k! of any z whose exponential is a float


def _gauss_of_squares(points: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Squares and weights of an integral of u^2 f(u^2) over u from 0 to 1: exact for polynomials in u^2.

    They are those of the Gauss rule with twice the points over u from -1 to 1, of which one half is enough.
    """
    u, weights = np.polynomial.legendre.leggauss(2 * points)
    return tuple((u[points:] ** 2).tolist()), tuple((weights[points:] * u[points:] ** 2).tolist())


_SQUARES, _WEIGHTS = _gauss_of_squares(9)
_FOUR, _SIX = _gauss_of_squares(4), _gauss_of_squares(6)
_SOFT = 15.0  # exponent k1 up to which four points are enough


class PowerFibres(NamedTuple):
    """Exponential of a power: psi = xi/(alpha beta) (exp(alpha (I - 1)^beta) - 1); xi/beta (I - 1)^beta with alpha = 0.

    The energy of FEBio's "fiber-exp-pow" lacks the factor 1/beta, and FEBio's distributions integrate over the sphere
    where ours average: its ksi is ours over beta and, if isotropic, over 4 pi.
    """

    modulus: Any  # xi, MPa; with beta = 2 and alpha = 0 the fibre's stiffness at small strain is 4 xi
    exponent: Any = 0.0  # alpha
    power: Any = 2.0  # beta, at least 2


class LogarithmicFibres(NamedTuple):
    """Wilson et al. (2004, 2007): nominal stress d psi/d lambda = E1 (exp(k1 ln lambda) - 1)."""

    modulus: Any  # E1, MPa; the fibre's stiffness at small strain is E1 k1
    exponent: Any  # k1


FIBRE_LAWS: dict[str, type] = {"power": PowerFibres, "logarithmic": LogarithmicFibres}


@generic
def fibre_tension(law: Any, strain: Any) -> Any:
    """2 psi' and 2 psi'', MPa.

    Parameters
    ----------
    law
        A law with its parameters.
    strain
        I - 1, positive: a float or an array. Derivatives are made from what is returned.
    """


@generic
def tension_over_directions(law: Any, strain: Any) -> Any:
    """Integral of 2 psi'(e u^2) u^2 over u from 0 to 1, MPa: over all directions about an axis that alone is stretched.

    Parameters
    ----------
    law
        A law with its parameters.
    strain
        e = I - 1 along the axis, positive: a float or an array.
    """


@tension_over_directions.register(object)
def _by_quadrature(law: Any, strain: Any) -> Any:
    total = 0.0 * strain
    for k in range(len(_SQUARES)):
        tension, _ = fibre_tension(law, strain * _SQUARES[k])
        total = total + _WEIGHTS[k] * tension
    return total


@fibre_tension.register(PowerFibres)
def _power_tension(law: Any, strain: Any) -> Any:
    raised, stiffening = 1.0 + 0.0 * strain, 0.0 * strain
    # powers and exponentials take long, and the commonest law needs neither
    if anywhere(law.power != 2.0):
        raised = strain ** (law.power - 2.0)
    scale = 2.0 * law.modulus * raised
    if anywhere(law.exponent != 0.0):
        stiffening = law.exponent * raised * (strain * strain)
        scale = scale * np.exp(stiffening)
    return scale * strain, scale * (law.power - 1.0 + law.power * stiffening)


@tension_over_directions.register(PowerFibres)
def _power_over_directions(law: Any, strain: Any) -> Any:
    """2 xi e^(beta - 1) times the sum over k of z^k/(k! (2 beta (k + 1) + 1)), z = alpha e^beta: all terms positive."""
    raised = 1.0 + 0.0 * strain
    if anywhere(law.power != 2.0):
        raised = strain ** (law.power - 2.0)
    z, step = law.exponent * raised * (strain * strain), 2.0 * law.power
    place, term = step + 1.0, 1.0 + 0.0 * strain
    total = term / place
    for k in range(1, _MOST_TERMS):
        term = term * z / k
        place = place + step
        total = total + term / place
        if not anywhere(term > 1e-17 * total * place):
            break
    return 2.0 * law.modulus * (raised * strain) * total


@fibre_tension.register(LogarithmicFibres)
def _logarithmic_tension(law: Any, strain: Any) -> Any:
    square = 1.0 + strain
    stretch = np.sqrt(square)
    excess = np.expm1(0.5 * law.exponent * np.log1p(strain))
    slope = ((law.exponent - 1.0) * excess + law.exponent) / (2.0 * square)
    return law.modulus * excess / stretch, law.modulus * slope / stretch


@tension_over_directions.register(LogarithmicFibres)
def _logarithmic_over_directions(law: Any, strain: Any) -> Any:
    """The integrand has no singularity near, so few points are exact to 1e-6 for stretches up to 1.3."""
    if anywhere(law.exponent > _SOFT):
        return _logarithmic_sum(law, strain, _SIX)
    return _logarithmic_sum(law, strain, _FOUR)


@point
def _logarithmic_sum(law: Any, strain: Any, rule: Any) -> Any:
    squares, weights = rule
    total = 0.0 * strain
    for k in range(len(squares)):
        own = strain * squares[k]
        total = total + weights[k] * np.expm1(0.5 * law.exponent * np.log1p(own)) / np.sqrt(1.0 + own)
    return law.modulus * total
