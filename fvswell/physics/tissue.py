"""The tissue: what it is made of, at the points where it is asked for."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from fvswell.physics.constants import GAS_CONSTANT

__all__ = ["Array", "Tissue"]

Array = np.ndarray[Any, Any]


@dataclass(frozen=True)
class Tissue:
    """Tissue properties at points of the stress-free solid, in internal units.

    Every array broadcasts to ``(rows, points)``: one row for each column of a batch. Quantities with the
    index 0 in the literature (fluid fraction, fixed charge density, permeability) are those of the
    stress-free solid, J = 1.
    """

    solid: str  # constitutive law, see fvswell.physics.solid
    youngs_modulus: Array  # MPa
    poisson_ratio: Array
    stiffening_coefficient: Array  # beta of the Holmes-Mow law; the others do not use it
    hydraulic_permeability: Array  # mm4/(N s)
    permeability_exponent: Array  # M in k = k0 exp(M (J - 1))
    fluid_fraction: Array
    fixed_charge_density: Array  # mmol of charge per mm3 of fluid
    osmotic_coefficient: Array  # phi_int, inside the tissue
    activity_ratio: Array  # g = (gamma_ext / gamma_int)^2
    cation_diffusivity: Array  # mm2/s
    anion_diffusivity: Array  # mm2/s
    hindrance_factor: Array  # r; ions are dragged with w = 1 - r of the water's velocity
    temperature: Array  # K

    @property
    def thermal_energy(self) -> Array:
        """R T in N mm/mmol."""
        return GAS_CONSTANT * self.temperature

    @property
    def convection_factor(self) -> Array:
        """W = 1 - r, the share of the water's velocity that the ions are dragged with."""
        return 1.0 - self.hindrance_factor

    def rows(self, index: Array) -> Tissue:
        """Tissue of a subset of the rows; arrays with a single row serve all rows and stay."""
        return self._map(lambda value: value[index] if value.shape[0] > 1 else value)

    def points(self, index: Array | slice) -> Tissue:
        """Tissue at a subset of the points; arrays with a single point serve all points and stay."""
        return self._map(lambda value: value[:, index] if value.shape[1] > 1 else value)

    def _map(self, function: Any) -> Tissue:
        arrays = {f.name: function(getattr(self, f.name)) for f in fields(self) if f.name != "solid"}
        return Tissue(solid=self.solid, **arrays)
