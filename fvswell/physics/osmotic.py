"""Osmotic laws: what the ions do to the pressure of the water, in the tissue and in a bath.

The *virtual bath* at a point is the salt solution that would be in equilibrium with the tissue there. Its activity
a~ = gamma c~ (as ``log_activity``, ln a~) and electric potential are continuous where the fixed charge jumps, and their
gradients drive the ions. In Donnan equilibrium c+ - c- = c_F and gamma_int^2 c+ c- = a~^2.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fvswell.compiled import generic, point
from fvswell.compiled.dual import value_of

__all__ = [
    "OSMOTIC_LAWS",
    "ActivityCoefficients",
    "ChargeDependentCoefficients",
    "ConstantCoefficients",
    "Ideal",
    "NoSwelling",
    "bath_log_activity",
    "bath_osmotic_pressure",
    "coefficients",
    "ion_concentrations",
    "log_activity",
    "osmotic_pressure",
    "virtual_concentration",
]

# gamma = 0.3507 exp(-3.1211 c^0.5060) + 0.6447 of sodium chloride, c in M; Huyghe et al. (2003)
_GAMMA_RANGE, _GAMMA_RATE, _GAMMA_POWER, _GAMMA_LEAST = 0.3507, 3.1211, 0.5060, 0.6447
_CHARGE_INTERACTION = 0.495  # fall of ln gamma_int, and of phi_int/phi_ext, by the share of charge X; the same source
_MOLAR = 1e3  # M in a mmol/mm3
_ION_STEPS, _BATH_STEPS = 2, 2  # of Newton's method: enough for any concentrations, see the tests


class Ideal(NamedTuple):
    """Ideal solutions: phi = 1 and g = 1, in the tissue and in the bath."""


class ConstantCoefficients(NamedTuple):
    """Constant coefficients; Wilson et al. (2005), eq 4 and 5. The activity of a bath is its concentration."""

    osmotic_coefficient: Any  # phi_int, in the tissue
    bath_osmotic_coefficient: Any  # phi_ext
    activity_ratio: Any = 1.0  # g = (gamma_ext/gamma_int)^2


class ChargeDependentCoefficients(NamedTuple):
    """Wilson et al. (2005), eq 14: phi_int = phi_ext - X c_F0, constant at a point of the tissue.

    A fit about c_F = 0.2 M in baths of 0.05 to 0.15 M: in stronger baths it draws water out of the tissue.
    """

    osmotic_coefficient_per_charge: Any  # X, mm3/mmol
    fixed_charge_density: Any  # c_F0 of the tissue, mmol of charge per mm3 of fluid
    bath_osmotic_coefficient: Any
    activity_ratio: Any = 1.0


class ActivityCoefficients(NamedTuple):
    """Activity and osmotic coefficients by concentration; Huyghe et al. (2003) as in Wilson et al. (2005, 2007).

    Of sodium chloride at room temperature. With X = c_F/(c_F + c+ + c-) and gamma of a bath of the ions' mean
    concentration, gamma_int = gamma((c+ + c-)/2) exp(-0.495 X) and phi_int = phi_ext (1 - 0.495 X).
    """

    bath_osmotic_coefficient: Any = 0.93  # phi_ext


class NoSwelling(NamedTuple):
    """The biphasic model: water does not feel the ions."""


OSMOTIC_LAWS: dict[str, type] = {
    "ideal": Ideal,
    "constant": ConstantCoefficients,
    "charge-dependent": ChargeDependentCoefficients,
    "activity": ActivityCoefficients,
}


@generic
def osmotic_pressure(law: Any, thermal_energy: Any, fixed_charge: Any, cation: Any, anion: Any) -> Any:
    """Osmotic pressure pi in the tissue, MPa.

    Parameters
    ----------
    law
        A law with its parameters.
    thermal_energy
        R T, N mm/mmol.
    fixed_charge, cation, anion
        Concentrations, mmol per mm3 of fluid.
    """


@generic
def bath_osmotic_pressure(law: Any, thermal_energy: Any, concentration: Any) -> Any:
    """Osmotic pressure of a bath, pi_bath, MPa; concentration of the monovalent salt in mmol/mm3."""


@generic
def log_activity(law: Any, fixed_charge: Any, cation: Any, anion: Any) -> Any:
    """Give ln a~ of the virtual bath that is in equilibrium with ions in the tissue, a~ in mmol/mm3."""


@generic
def ion_concentrations(law: Any, fixed_charge: Any, log_activity: Any) -> Any:
    """Cation and anion concentrations (mmol per mm3 of fluid) in Donnan equilibrium with a virtual bath."""


@generic
def bath_log_activity(law: Any, concentration: Any) -> Any:
    """Give ln a~ of a bath, concentration in mmol/mm3."""


@generic
def virtual_concentration(law: Any, log_activity: Any) -> Any:
    """Concentration c~ (mmol/mm3) of the virtual bath with a given ln a~."""


@generic
def coefficients(law: Any) -> Any:
    """(phi_int, phi_ext, g) of a law whose coefficients are constant."""


@coefficients.register(Ideal)
def _ideal(law: Any) -> Any:
    return 1.0, 1.0, 1.0


@coefficients.register(ConstantCoefficients)
def _constant(law: Any) -> Any:
    return law.osmotic_coefficient, law.bath_osmotic_coefficient, law.activity_ratio


@coefficients.register(ChargeDependentCoefficients)
def _charge_dependent(law: Any) -> Any:
    fall = law.osmotic_coefficient_per_charge * law.fixed_charge_density
    return law.bath_osmotic_coefficient - fall, law.bath_osmotic_coefficient, law.activity_ratio


@osmotic_pressure.register(Ideal)
@osmotic_pressure.register(ConstantCoefficients)
@osmotic_pressure.register(ChargeDependentCoefficients)
def _constant_pressure(law: Any, thermal_energy: Any, fixed_charge: Any, cation: Any, anion: Any) -> Any:
    """Wilson et al. (2005), eq 4: phi_int R T (c+ + c-)."""
    return coefficients(law)[0] * thermal_energy * (cation + anion)


@bath_osmotic_pressure.register(Ideal)
@bath_osmotic_pressure.register(ConstantCoefficients)
@bath_osmotic_pressure.register(ChargeDependentCoefficients)
def _constant_bath_pressure(law: Any, thermal_energy: Any, concentration: Any) -> Any:
    """Wilson et al. (2005), eq 4: 2 phi_ext R T c."""
    return 2.0 * coefficients(law)[1] * thermal_energy * concentration


@log_activity.register(Ideal)
@log_activity.register(ConstantCoefficients)
@log_activity.register(ChargeDependentCoefficients)
def _constant_log_activity(law: Any, fixed_charge: Any, cation: Any, anion: Any) -> Any:
    return 0.5 * np.log(cation * anion / coefficients(law)[2])


@ion_concentrations.register(Ideal)
@ion_concentrations.register(ConstantCoefficients)
@ion_concentrations.register(ChargeDependentCoefficients)
def _constant_concentrations(law: Any, fixed_charge: Any, log_activity: Any) -> Any:
    """Wilson et al. (2005), eq 5. c- is formed as g c~^2/c+, which keeps its digits where c_F is far above c~."""
    square = coefficients(law)[2] * np.exp(2.0 * log_activity)
    cation = 0.5 * (fixed_charge + np.sqrt(fixed_charge * fixed_charge + 4.0 * square))
    return cation, square / cation


@bath_log_activity.register(Ideal)
@bath_log_activity.register(ConstantCoefficients)
@bath_log_activity.register(ChargeDependentCoefficients)
def _constant_bath_log_activity(law: Any, concentration: Any) -> Any:
    return np.log(concentration)


@virtual_concentration.register(Ideal)
@virtual_concentration.register(ConstantCoefficients)
@virtual_concentration.register(ChargeDependentCoefficients)
def _constant_virtual_concentration(law: Any, log_activity: Any) -> Any:
    return np.exp(log_activity)


@point
def _charge_share(fixed_charge: Any, cation: Any, anion: Any) -> Any:
    """X = c_F/(c_F + c+ + c-)."""
    return fixed_charge / (fixed_charge + cation + anion)


@point
def _salt_coefficient(concentration: Any) -> Any:
    """Gamma of a salt solution, concentration in mmol/mm3, and d ln gamma/d ln c."""
    damping = -_GAMMA_RATE * np.exp(_GAMMA_POWER * np.log(_MOLAR * concentration))
    above = _GAMMA_RANGE * np.exp(damping)
    gamma = above + _GAMMA_LEAST
    return gamma, _GAMMA_POWER * damping * above / gamma


@osmotic_pressure.register(ActivityCoefficients)
def _activity_pressure(law: Any, thermal_energy: Any, fixed_charge: Any, cation: Any, anion: Any) -> Any:
    fall = 1.0 - _CHARGE_INTERACTION * _charge_share(fixed_charge, cation, anion)
    return law.bath_osmotic_coefficient * thermal_energy * fall * (cation + anion)


@bath_osmotic_pressure.register(ActivityCoefficients)
def _activity_bath_pressure(law: Any, thermal_energy: Any, concentration: Any) -> Any:
    return 2.0 * law.bath_osmotic_coefficient * thermal_energy * concentration


@log_activity.register(ActivityCoefficients)
def _activity_of_ions(law: Any, fixed_charge: Any, cation: Any, anion: Any) -> Any:
    gamma, _ = _salt_coefficient(0.5 * (cation + anion))
    share = _charge_share(fixed_charge, cation, anion)
    return 0.5 * np.log(cation * anion) + np.log(gamma) - _CHARGE_INTERACTION * share


@bath_log_activity.register(ActivityCoefficients)
def _activity_of_bath(law: Any, concentration: Any) -> Any:
    gamma, _ = _salt_coefficient(concentration)
    return np.log(gamma * concentration)


@point
def _anion(charge: Any, product: Any) -> Any:
    """c- of ions whose product c+ c- is given; it keeps its digits where the charge is far above it."""
    return 2.0 * product / (charge + np.sqrt(charge * charge + 4.0 * product))


@point
def _guess(charge: Any, square: Any) -> Any:
    """1/gamma_int^2 to a few per cent, without functions that take long."""
    mean = np.sqrt(0.25 * charge * charge + 2.4 * square)
    x = _GAMMA_RATE * np.sqrt(_MOLAR * mean)
    gamma = _GAMMA_LEAST + _GAMMA_RANGE / (1.0 + x * (1.0 + x * (0.5 + x * (1.0 / 6.0 + x / 24.0))))
    share = 2.0 * _CHARGE_INTERACTION * charge / (charge + 2.0 * mean)
    return (1.0 + share * (1.0 + 0.5 * share)) / (gamma * gamma)


@point
def _inverse_activity(charge: Any, anion: Any) -> Any:
    """1/gamma_int^2 of ions, and its derivative by their product, both in logarithms."""
    cation, mean = charge + anion, 0.5 * charge + anion
    gamma, slope = _salt_coefficient(mean)
    share = _CHARGE_INTERACTION * charge / cation  # 2 (0.495 X)
    return np.exp(share) / (gamma * gamma), -(2.0 * slope * cation / mean + share) * anion / (cation + anion)


@ion_concentrations.register(ActivityCoefficients)
def _activity_concentrations(law: Any, fixed_charge: Any, log_activity: Any) -> Any:
    """Newton's method for ln(c+ c-) = ln(a~^2/gamma_int^2), whose right side hardly changes with the left.

    As many steps are taken on values as accuracy to rounding needs from anywhere, so that no point depends on another;
    one more in the numbers that were given makes derivatives exact.
    """
    charge, square = np.real(value_of(fixed_charge)), np.exp(2.0 * np.real(value_of(log_activity)))
    product = square * _guess(charge, square)
    for _ in range(_ION_STEPS):
        factor, slope = _inverse_activity(charge, _anion(charge, product))
        ratio = factor * square / product
        half_step = (ratio - 1.0) / ((ratio + 1.0) * (1.0 - slope))  # of the logarithm, to third order
        product = product * (1.0 + half_step) / (1.0 - half_step)
    factor, slope = _inverse_activity(fixed_charge, _anion(fixed_charge, product))
    found = factor * np.exp(2.0 * log_activity)
    anion = _anion(fixed_charge, product + (found - product) / (1.0 - np.real(value_of(slope))))
    return fixed_charge + anion, anion


@virtual_concentration.register(ActivityCoefficients)
def _activity_virtual_concentration(law: Any, log_activity: Any) -> Any:
    """Newton's method in ln c, in which the activity of a bath is about a straight line of slope 1; as for the ions."""
    target = np.real(value_of(log_activity))
    concentration = np.exp(target)
    for _ in range(_BATH_STEPS):
        gamma, slope = _salt_coefficient(concentration)
        concentration = concentration * np.exp((target - np.log(gamma * concentration)) / (1.0 + slope))
    gamma, slope = _salt_coefficient(concentration)
    return concentration * np.exp((log_activity - np.log(gamma * concentration)) / (1.0 + slope))


@osmotic_pressure.register(NoSwelling)
def _no_pressure(law: Any, thermal_energy: Any, fixed_charge: Any, cation: Any, anion: Any) -> Any:
    return 0.0


@bath_osmotic_pressure.register(NoSwelling)
def _no_bath_pressure(law: Any, thermal_energy: Any, concentration: Any) -> Any:
    return 0.0 * concentration


@ion_concentrations.register(NoSwelling)
def _no_concentrations(law: Any, fixed_charge: Any, log_activity: Any) -> Any:
    return 0.0 * fixed_charge, 0.0 * fixed_charge


@bath_log_activity.register(NoSwelling)
def _no_log_activity(law: Any, concentration: Any) -> Any:
    return 0.0 * concentration


@virtual_concentration.register(NoSwelling)
def _any_concentration(law: Any, log_activity: Any) -> Any:
    return np.exp(log_activity)


@point
def osmotic_pressure_difference(tissue: Any, J: Any, bath_concentration: Any) -> Any:
    """Swelling pressure, pi - pi_bath, of tissue in Donnan equilibrium with a bath, MPa."""
    fixed_charge = tissue.fixed_charge_density * tissue.fluid_fraction / (J - 1.0 + tissue.fluid_fraction)
    law, RT = tissue.osmotic, tissue.thermal_energy
    cation, anion = ion_concentrations(law, fixed_charge, bath_log_activity(law, bath_concentration))
    return osmotic_pressure(law, RT, fixed_charge, cation, anion) - bath_osmotic_pressure(law, RT, bath_concentration)
