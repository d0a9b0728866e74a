"""Fixed charge, ions and the water they bind: local relations in the charged tissue.

The *virtual bath* at a point is the salt solution that would be in equilibrium with the tissue there; its
concentration (``virtual_concentration``, c~) and electric potential are continuous where the fixed charge jumps
and are the unknowns of the ion balances. All functions take arrays of any one shape, real or complex.
"""

from __future__ import annotations

import numpy as np

from fvswell.physics.constants import FARADAY
from fvswell.physics.tissue import Array, Tissue

__all__ = [
    "bath_osmotic_pressure",
    "electric_potential",
    "fixed_charge_density",
    "fluid_fraction",
    "ion_concentration_derivatives",
    "ion_concentrations",
    "osmotic_pressure",
]


def fluid_fraction(tissue: Tissue, J: Array) -> Array:
    """n_f = (J - 1 + n_f0)/J: solid and fluid are incompressible, so J changes by the fluid alone."""
    return (J - 1.0 + tissue.fluid_fraction) / J


def fixed_charge_density(tissue: Tissue, J: Array) -> Array:
    """c_F = c_F0 n_f0/(J - 1 + n_f0), mmol of charge per mm3 of fluid; Wilson et al. (2005), eq 7."""
    return tissue.fixed_charge_density * tissue.fluid_fraction / (J - 1.0 + tissue.fluid_fraction)


def ion_concentrations(tissue: Tissue, J: Array, log_concentration: Array) -> tuple[Array, Array]:
    """Cation and anion concentrations in Donnan equilibrium with the virtual bath.

    Parameters
    ----------
    tissue
        Properties at the points.
    J
        Volume ratio.
    log_concentration
        ln of the virtual concentration c~ in mmol/mm3.

    Returns
    -------
    tuple of arrays
        c+ = (S + c_F)/2 and c- = (S - c_F)/2 with S = sqrt(c_F^2 + 4 g c~^2), in mmol per mm3 of fluid; Wilson
        et al. (2005), eq 5. c- is formed as g c~^2/c+, which keeps its digits where c_F is far above c~.
    """
    c_F = fixed_charge_density(tissue, J)
    square = tissue.activity_ratio * np.exp(2.0 * log_concentration)
    cation = 0.5 * (c_F + np.sqrt(c_F * c_F + 4.0 * square))
    return cation, square / cation


def ion_concentration_derivatives(tissue: Tissue, J: Array, cation: Array, anion: Array) -> tuple[Array, Array, Array]:
    """Derivatives of the concentrations: c+ by J, c- by J, and of either by ln c~ (which is the same).

    From c+ - c- = c_F and c+ c- = g c~^2; arguments as `ion_concentrations` takes and gives them.
    """
    total = cation + anion
    share = (anion - cation) / ((J - 1.0 + tissue.fluid_fraction) * total)  # (d c_F/dJ)/S
    return cation * share, -anion * share, 2.0 * cation * anion / total


def osmotic_pressure(tissue: Tissue, cation: Array, anion: Array) -> Array:
    """Pi = phi_int R T (c+ + c-), MPa; Wilson et al. (2005), eq 4."""
    return tissue.osmotic_coefficient * tissue.thermal_energy * (cation + anion)


def bath_osmotic_pressure(osmotic_coefficient: Array, thermal_energy: Array, concentration: Array) -> Array:
    """pi_bath = 2 phi_ext R T c_bath of a monovalent salt solution, MPa; Wilson et al. (2005), eq 4."""
    return 2.0 * osmotic_coefficient * thermal_energy * concentration


def electric_potential(tissue: Tissue, cation: Array, log_concentration: Array, virtual_potential: Array) -> Array:
    """Xi = psi~ - (R T/F) ln(c+/(sqrt(g) c~)), mV.

    ``virtual_potential`` is F psi~/(R T), without unit. The second term is the Donnan potential.
    """
    donnan = np.log(cation) - 0.5 * np.log(tissue.activity_ratio) - log_concentration
    return tissue.thermal_energy / FARADAY * (virtual_potential - donnan)
