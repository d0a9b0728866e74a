"""Electric currents through tissue at small changes: coefficients of a uniform state, electrodes, potentials.

With the electric potential eliminated in favour of the current i,

    (q, j-) = -L grad y + tau i,        grad psi~ = p . grad y - rho i,        y = (mu_f, ln a~),

psi~ being the potential of the virtual bath. Onsager's relations make tau_q (electro-osmosis, the water that a current
drags along) minus p_mu (the streaming potential per pressure). Currents are densities along +x, A/mm2; potentials mV.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from fvswell.compiled.dual import variables
from fvswell.physics.constants import FARADAY
from fvswell.physics.fluxes import MixtureFluxes, mixture_fluxes, potential_gradient_of_current
from fvswell.physics.osmotic import ion_concentrations
from fvswell.physics.tissue import Array, Tissue, fixed_charge_density, fluid_fraction

__all__ = ["ElectricalCoefficients", "WallElectrode", "donnan_slopes", "electrical_coefficients", "wall_anion_flux"]

WallElectrode = Literal["cation", "anion"]


class ElectricalCoefficients(NamedTuple):
    """What a current does in a uniform state, and what potential arises where none flows; arrays ``(rows,)``."""

    water_per_charge: Array  # tau_q, mm3/C: electro-osmosis
    anion_per_charge: Array  # tau_-, mmol/C
    potential_per_water_potential: Array  # p_mu, mV/MPa: streaming potential
    potential_per_log_activity: Array  # p_a, mV: diffusion potential
    conductivity: Array  # 1/rho at uniform mu_f and ln a~, C2/(N mm2 s); 1 of them is 1e6 S/m
    still_conductivity: Array  # where no water flows, at uniform ln a~: the ions' own n_f F^2 b/(R T)
    anion_transport_number: Array  # share of a current that anions carry, the same: c- D-/b

    @property
    def potential_per_potential(self) -> Array:
        """P = (p_mu, p_a), shape ``(rows, 2)``."""
        return np.stack([self.potential_per_water_potential, self.potential_per_log_activity], axis=-1)

    @property
    def flux_per_charge(self) -> Array:
        """Tau = (tau_q, tau_-), shape ``(rows, 2)``."""
        return np.stack([self.water_per_charge, self.anion_per_charge], axis=-1)


def electrical_coefficients(tissue: Tissue, J: Array, log_activity: Array) -> ElectricalCoefficients:
    """Coefficients in the state J, ln a~; arrays ``(rows,)``."""
    cation, anion = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), log_activity)

    def slope(water: Array | float, activity: float, current: float) -> Array:
        """Gradient of F psi~/(R T), 1/mm."""
        gradients = (value + np.zeros_like(J) for value in (water, activity, current / FARADAY))
        gradient: Array = potential_gradient_of_current(tissue, J, cation, anion, *gradients)
        return gradient

    def fluxes(water: Array | float, activity: float, current: float) -> MixtureFluxes:
        gradients = water + np.zeros_like(J), activity + np.zeros_like(J), slope(water, activity, current)
        flux: MixtureFluxes = mixture_fluxes(tissue, J, cation, anion, *gradients)
        return flux

    driven, pressed = fluxes(0.0, 0.0, 1.0), fluxes(1.0, 0.0, 0.0)
    holding = -driven.water / pressed.water  # the gradient of mu_f that stops the water
    still = fluxes(holding, 0.0, 1.0)
    thermal = tissue.thermal_energy / FARADAY
    return ElectricalCoefficients(
        driven.water,
        driven.anion,
        thermal * slope(1.0, 0.0, 0.0),
        thermal * slope(0.0, 1.0, 0.0),
        -1.0 / (thermal * slope(0.0, 0.0, 1.0)),
        -1.0 / (thermal * slope(holding, 0.0, 1.0)),
        -FARADAY * still.anion,
    )


def wall_anion_flux(electrode: WallElectrode) -> float:
    """Anions that pass an electrode in a wall along +x, mmol/C of current: none, or all of the current."""
    return 0.0 if electrode == "cation" else -1.0 / FARADAY


def donnan_slopes(tissue: Tissue, J: Array, log_activity: Array) -> Array:
    """Derivatives of the Donnan potential xi - psi~ (mV) by the contents J and J n_f c-, shape ``(rows, 2)``.

    The electric potential in the tissue is xi = psi~ - (R T/F) ln(gamma_int c+/a~), where gamma_int^2 c+ c- = a~^2.
    """
    _, anion = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), log_activity)
    volume, salt = variables(J, J * fluid_fraction(tissue, J) * anion)
    anion = salt / (volume * fluid_fraction(tissue, volume))
    potential = -0.5 * tissue.thermal_energy / FARADAY * np.log((anion + fixed_charge_density(tissue, volume)) / anion)
    return np.stack(np.broadcast_arrays(*potential.slopes), axis=-1)
