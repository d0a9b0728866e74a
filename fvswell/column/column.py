"""A column of tissue: uniaxial strain between a filter and a piston.

The momentum balance is closed per cell, p = sigma_s(J) + P, so J itself is the unknown of the volume balance and the
water potential follows from it. J is continuous in time when the load jumps; the potential is not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fvswell.physics.fluxes import FluxDerivatives
from fvswell.physics.models import Mixture, PointState
from fvswell.physics.solid import uniaxial_stiffness, uniaxial_stress
from fvswell.physics.tissue import Array

__all__ = ["Column", "Loads"]


class Loads(NamedTuple):
    """What acts on each column at one time; arrays of shape ``(rows, 1)``."""

    applied_pressure: Array  # on the piston, MPa, compression positive
    bath_concentration: Array  # mmol/mm3


@dataclass(frozen=True)
class Column:
    """Local laws of a column, at its cells and at its faces (filter and inner faces).

    The *state* at a point is what the laws depend on by value: (J, ln c~) where ions are transported, else J alone.
    It leads the unknowns; the others enter through their gradients only.
    """

    cells: Mixture
    faces: Mixture

    @property
    def balances(self) -> tuple[str, ...]:
        """Names of the balances, in the order of the unknowns."""
        return self.cells.model.balances

    @property
    def state_size(self) -> int:
        """2 (J, ln c~) where ions are transported, else 1 (J)."""
        return 2 if self.cells.model.transports_ions else 1

    @property
    def smallest_volume_ratio(self) -> Array:
        """J of the solid without water, 1 - n_f0."""
        return 1.0 - self.cells.tissue.fluid_fraction

    def rows(self, index: Array) -> Column:
        """The laws of a subset of the rows."""
        return Column(self.cells.rows(index), self.faces.rows(index))

    def log_concentration(self, state: Array, loads: Loads) -> Array:
        """Ln c~: an unknown where ions are transported, else that of the bath."""
        return state[1] if self.state_size > 1 else np.log(loads.bath_concentration)

    def at_cells(self, state: Array, loads: Loads) -> PointState:
        """Local state of the cells."""
        return self.cells.at(state[0], self.log_concentration(state, loads))

    def at_faces(self, state: Array, loads: Loads) -> PointState:
        """Local state at the faces."""
        return self.faces.at(state[0], self.log_concentration(state, loads))

    def water_potential(self, cells: PointState, loads: Loads) -> Array:
        """mu_f = sigma_s(J) + P - pi of the cells, MPa."""
        stress = uniaxial_stress(self.cells.tissue, cells.J)
        return stress + loads.applied_pressure - self.cells.osmotic_pressure(cells)

    def water_potential_derivatives(self, cells: PointState) -> Array:
        """Derivatives of mu_f by the state, (state size, rows, cells); by the applied pressure it is 1."""
        by_state = np.empty((self.state_size, *cells.J.shape))
        for index, slope in enumerate(self.cells.osmotic_pressure_derivatives(cells)):
            by_state[index] = -slope
        by_state[0] += uniaxial_stiffness(self.cells.tissue, cells.J)
        return by_state

    def content_scale(self, loads: Loads) -> Array:
        """Natural size of the contents: 1 for J, the bath's concentration for ions; ``(balances, rows, 1)``."""
        concentration = loads.bath_concentration
        return np.stack([np.ones_like(concentration), concentration, concentration][: len(self.balances)])

    def fluxes(self, faces: PointState, reference_gradients: Array) -> Array:
        """Fluxes at the faces from *reference* gradients of the potentials; current gradients are these over J."""
        return self.faces.fluxes(faces, reference_gradients / faces.J)

    def flux_derivatives(self, faces: PointState, reference_gradients: Array, fluxes: Array) -> FluxDerivatives:
        """Derivatives of ``fluxes`` (given) by the state and by the reference gradients."""
        by_state, by_gradient = self.faces.flux_derivatives(faces, reference_gradients / faces.J)
        by_state[:, 0] -= fluxes / faces.J  # a stretched face sees smaller gradients
        return FluxDerivatives(by_state, by_gradient / faces.J)

    def filter_potentials(self, loads: Loads) -> Array:
        """Potentials at the filter, shape ``(balances, rows, 1)``."""
        return self.cells.bath_potentials(loads.bath_concentration)
