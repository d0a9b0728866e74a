"""The three models: one set of equations, three declarations of what is transported and what makes it swell.

A `Mixture` is a model applied to a tissue. It offers what the balance laws need as local functions: the potentials
that drive the fluxes, the contents that are conserved, and the fluxes themselves. Unknowns, potentials, contents
and fluxes are stacked along the first axis, one entry for each balance:

    balance   unknown                  potential         content (per reference volume)   flux
    volume    J or mu_f                mu_f              J                                q
    anion     ln c~                    ln c~             J n_f c-                         j-
    charge    psi~ (as F psi~/(R T))   psi~              none                             i/F = j+ - j-
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fvswell.physics.differentiation import COMPLEX_STEP
from fvswell.physics.electrochemistry import (
    bath_osmotic_pressure,
    ion_concentration_derivatives,
    ion_concentrations,
    osmotic_pressure,
)
from fvswell.physics.fluxes import FluxDerivatives, darcy_flux, mixture_flux_derivatives, mixture_fluxes
from fvswell.physics.permeability import hydraulic_permeability, open_circuit_permeability
from fvswell.physics.tissue import Array, Tissue

__all__ = ["BIPHASIC", "BIPHASIC_SWELLING", "ELECTROCHEMICAL", "MODELS", "Mixture", "Model", "PointState"]


@dataclass(frozen=True)
class Model:
    """What a model transports, whether fixed charge makes it swell, and its permeability."""

    name: str
    balances: tuple[str, ...]
    swelling: bool
    open_circuit: bool  # water meets the streaming potential through its permeability alone

    @property
    def transports_ions(self) -> bool:
        """Whether ions diffuse, migrate and are dragged, or are always in equilibrium with the bath."""
        return "anion" in self.balances


BIPHASIC = Model("biphasic", balances=("volume",), swelling=False, open_circuit=False)
BIPHASIC_SWELLING = Model("biphasic-swelling", balances=("volume",), swelling=True, open_circuit=True)
ELECTROCHEMICAL = Model("electrochemical", balances=("volume", "anion", "charge"), swelling=True, open_circuit=False)
MODELS = {model.name: model for model in (BIPHASIC, BIPHASIC_SWELLING, ELECTROCHEMICAL)}


class PointState(NamedTuple):
    """What the local laws depend on by value; concentrations in mmol per mm3 of fluid, without meaning in biphasic."""

    J: Array
    cation: Array
    anion: Array


@dataclass(frozen=True)
class Mixture:
    """A model of a tissue at points: local functions, arrays of shape ``(rows, points)`` or broadcasting to it."""

    model: Model
    tissue: Tissue
    bath_osmotic_coefficient: Array
    open_circuit_ratio: Array | None = None  # k_open/k held constant; None evaluates it with the state

    def rows(self, index: Array) -> Mixture:
        """The mixture of a subset of the rows."""

        def part(value: Array) -> Array:
            return value[index] if value.shape[0] > 1 else value

        ratio = self.open_circuit_ratio
        return replace(
            self,
            tissue=self.tissue.rows(index),
            bath_osmotic_coefficient=part(self.bath_osmotic_coefficient),
            open_circuit_ratio=None if ratio is None else part(ratio),
        )

    def bath_potentials(self, bath_concentration: Array) -> Array:
        """(mu_f, ln c~, psi~) of the grounded bath: the values at a filter."""
        if not self.model.swelling:
            return np.zeros((1, *np.shape(bath_concentration)))
        water = -bath_osmotic_pressure(self.bath_osmotic_coefficient, self.tissue.thermal_energy, bath_concentration)
        if not self.model.transports_ions:
            return water[None]
        return np.stack(np.broadcast_arrays(water, np.log(bath_concentration), 0.0 * water))

    def at(self, J: Array, log_concentration: Array) -> PointState:
        """The local state from J and ln c~, real or complex."""
        if not self.model.swelling:
            return PointState(J, np.zeros(()), np.zeros(()))
        return PointState(J, *ion_concentrations(self.tissue, J, log_concentration))

    def osmotic_pressure(self, state: PointState) -> Array | float:
        """pi, MPa; zero without swelling."""
        return osmotic_pressure(self.tissue, state.cation, state.anion) if self.model.swelling else 0.0

    def osmotic_pressure_derivatives(self, state: PointState) -> tuple[Array | float, ...]:
        """Derivatives of pi by J and, where it is an unknown, by ln c~."""
        if not self.model.swelling:
            return (0.0,)
        cation_J, anion_J, by_log = ion_concentration_derivatives(self.tissue, *state)
        by_J = osmotic_pressure(self.tissue, cation_J, anion_J)
        return (by_J, osmotic_pressure(self.tissue, by_log, by_log)) if self.model.transports_ions else (by_J,)

    def contents(self, state: PointState) -> Array:
        """What each balance conserves, per reference volume: (J, J n_f c-, 0)."""
        J = state.J
        if not self.model.transports_ions:
            return J[None]
        contents = np.zeros((3, *J.shape), dtype=np.result_type(J, state.anion))
        contents[0], contents[1] = J, (J - 1.0 + self.tissue.fluid_fraction) * state.anion
        return contents

    def cation_contents(self, J: Array, log_concentration: Array) -> Array:
        """J n_f c+, cations per reference volume: what the balances of anions and charge make of it."""
        return (J - 1.0 + self.tissue.fluid_fraction) * self.at(J, log_concentration).cation

    def content_derivatives(self, state: PointState) -> Array:
        """Derivatives of the contents by (J, ln c~), (balances, 2, ...), or by J alone, (1, 1, ...)."""
        if not self.model.transports_ions:
            return np.ones((1, 1, *state.J.shape))
        _, anion_J, by_log = ion_concentration_derivatives(self.tissue, *state)
        fluid = state.J - 1.0 + self.tissue.fluid_fraction
        by_state = np.zeros((3, 2, *state.J.shape))
        by_state[0, 0] = 1.0
        by_state[1, 0], by_state[1, 1] = state.anion + fluid * anion_J, fluid * by_log
        return by_state

    def permeability(self, state: PointState) -> Array:
        """Permeability in Darcy's law of this model, mm4/(N s)."""
        if self.model.open_circuit and self.open_circuit_ratio is None:
            return open_circuit_permeability(self.tissue, *state)
        k = hydraulic_permeability(self.tissue, state.J)
        return k * self.open_circuit_ratio if self.model.open_circuit else k

    def fluxes(self, state: PointState, gradients: Array) -> Array:
        """(q, j-, j+ - j-) per current area, from the state at a face and the normal gradients of the potentials."""
        if not self.model.transports_ions:
            return darcy_flux(self.permeability(state), gradients[0])[None]
        flux = mixture_fluxes(self.tissue, *state, *gradients)
        return np.stack([flux.water, flux.anion, flux.cation - flux.anion])

    def flux_derivatives(self, state: PointState, gradients: Array) -> FluxDerivatives:
        """Derivatives of `fluxes` by the state and by the gradients."""
        if self.model.transports_ions:
            return mixture_flux_derivatives(self.tissue, *state, *gradients)
        by_J = darcy_flux(self._permeability_slope(state), gradients[0])
        return FluxDerivatives(by_J[None, None], np.broadcast_to(-self.permeability(state), by_J.shape)[None, None])

    def _permeability_slope(self, state: PointState) -> Array:
        """Derivative of `permeability` by J at a given virtual concentration."""
        if not (self.model.open_circuit and self.open_circuit_ratio is None):
            return self.tissue.permeability_exponent * self.permeability(state)
        cation_J, anion_J, _ = ion_concentration_derivatives(self.tissue, *state)
        step = 1j * COMPLEX_STEP
        shifted = PointState(state.J + step, state.cation + step * cation_J, state.anion + step * anion_J)
        return self.permeability(shifted).imag / COMPLEX_STEP
