"""Laws of a single fibre, which carries load in tension only.

With lambda the stretch of a fibre and I = lambda^2, its energy psi(I) per reference volume adds 2 psi' F n (x) F n/J to
the Cauchy stress, n being its direction in the stress-free solid.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fvswell.compiled import anywhere, generic

__all__ = ["FIBRE_LAWS", "LogarithmicFibres", "PowerFibres", "fibre_tension"]


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


@fibre_tension.register(LogarithmicFibres)
def _logarithmic_tension(law: Any, strain: Any) -> Any:
    square = 1.0 + strain
    stretch = np.sqrt(square)
    excess = np.expm1(0.5 * law.exponent * np.log1p(strain))
    slope = ((law.exponent - 1.0) * excess + law.exponent) / (2.0 * square)
    return law.modulus * excess / stretch, law.modulus * slope / stretch
