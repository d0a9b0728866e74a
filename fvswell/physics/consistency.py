"""How far an osmotic law is from being the derivative of an energy."""

from __future__ import annotations

from typing import Any

import numpy as np

from fvswell.compiled.dual import slope_of, variables
from fvswell.physics.osmotic import bath_log_activity, ion_concentrations, log_activity, osmotic_pressure
from fvswell.physics.tissue import Array, Tissue, fixed_charge_density

__all__ = ["symmetry_error"]


def symmetry_error(tissue: Tissue, J: Array | float, bath_concentration: Array | float) -> Array:
    """Relative difference of the two mixed derivatives of the mixture's energy, in equilibrium with a bath.

    Water and salt are let in at the cost mu_f dJ + 2 R T ln a~ dM, with M = J n_f c- the salt per reference volume, so
    a mixture that has an energy has d mu_f/dM at constant J equal to 2 R T d ln a~/dJ at constant M. The solid drops
    out, and so do the ions' volumes. Osmotic and activity coefficients that do not belong together break the symmetry:
    over a cycle of baths and loads they make energy out of nothing, or lose it.

    Parameters
    ----------
    tissue
        Properties at the points.
    J, bath_concentration
        Volume ratio, and concentration of the bath in mmol/mm3.

    Returns
    -------
    array
        (d mu_f/dM - 2 R T d ln a~/dJ) over the mean of the two.
    """
    law, RT = tissue.osmotic, tissue.thermal_energy
    J, bath = np.broadcast_arrays(np.asarray(J, dtype=float), bath_concentration)
    _, anion = ion_concentrations(law, fixed_charge_density(tissue, J), bath_log_activity(law, bath))
    pore = J - 1.0 + tissue.fluid_fraction
    volume, salt = variables(J, pore * anion)
    charge = fixed_charge_density(tissue, volume)
    anions: Any = salt / (volume - 1.0 + tissue.fluid_fraction)
    pressure = osmotic_pressure(law, RT, charge, charge + anions, anions)
    activity = log_activity(law, charge, charge + anions, anions)
    by_salt, by_volume = -np.asarray(slope_of(pressure, 1)), 2.0 * RT * np.asarray(slope_of(activity, 0))
    error: Array = (by_salt - by_volume) / (0.5 * (by_salt + by_volume))
    return error
