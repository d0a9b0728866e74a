"""The tissue at a point: its laws, each with its own parameters, and what the laws share."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fvswell.compiled import law_at, point

__all__ = [
    "Array",
    "Tissue",
    "convection_factor",
    "first_rows",
    "fixed_charge_density",
    "fluid_fraction",
    "tissue_at",
    "tissue_parameters",
]

Array = np.ndarray[Any, Any]


class Tissue(NamedTuple):
    """Tissue at a point, or at many: every number may be an array, all of which broadcast.

    Quantities with the index 0 in the literature (fluid fraction, fixed charge density) are those of the stress-free
    solid, J = 1. Internal units.
    """

    solid: Any  # a law of `fvswell.physics.solids`
    permeability: Any  # a law of `fvswell.physics.permeability`
    osmotic: Any  # a law of `fvswell.physics.osmotic`
    fluid_fraction: Any  # n_f0
    fixed_charge_density: Any  # c_F0, mmol of charge per mm3 of fluid
    cation_diffusivity: Any  # mm2/s
    anion_diffusivity: Any  # mm2/s
    hindrance_factor: Any  # r; ions are dragged with w = 1 - r of the water's velocity
    thermal_energy: Any  # R T, N mm/mmol


def tissue_parameters(tissue: Tissue, points: int) -> Array:
    """All numbers of a tissue at points, law by law, ``(parameters, points)``."""
    numbers = [*tissue.solid, *tissue.permeability, *tissue.osmotic, *tissue[3:]]
    parameters = np.empty((len(numbers), points))
    for row, number in zip(parameters, numbers, strict=True):
        row[:] = number
    return parameters


def first_rows(solid: type, permeability: type, osmotic: type) -> tuple[int, int, int]:
    """Rows in which the parameters of the permeability, of the osmotic law and of the tissue begin."""
    lengths = [len(law._fields) for law in (solid, permeability, osmotic)]  # type: ignore[attr-defined]
    return lengths[0], lengths[0] + lengths[1], sum(lengths)


@point
def tissue_at(solid: Any, permeability: Any, osmotic: Any, first: Any, parameters: Any, i: Any) -> Any:
    """Tissue at one point, from classes of laws and parameters as `tissue_parameters` has them.

    ``first`` holds the rows in which the parameters of the permeability, of the osmotic law and of the tissue begin.
    """
    a, b, c = first
    return Tissue(
        law_at(solid, parameters, 0, i), law_at(permeability, parameters, a, i), law_at(osmotic, parameters, b, i),
        parameters[c, i], parameters[c + 1, i], parameters[c + 2, i], parameters[c + 3, i], parameters[c + 4, i],
        parameters[c + 5, i],
    )  # fmt: skip


@point
def fluid_fraction(tissue: Any, J: Any) -> Any:
    """n_f = (J - 1 + n_f0)/J: solid and fluid are incompressible, so J changes by the fluid alone."""
    return (J - 1.0 + tissue.fluid_fraction) / J


@point
def fixed_charge_density(tissue: Any, J: Any) -> Any:
    """c_F = c_F0 n_f0/(J - 1 + n_f0), mmol of charge per mm3 of fluid; Wilson et al. (2005), eq 7."""
    return tissue.fixed_charge_density * tissue.fluid_fraction / (J - 1.0 + tissue.fluid_fraction)


@point
def convection_factor(tissue: Any) -> Any:
    """Share w = 1 - r of the water's velocity that the ions are dragged with."""
    return 1.0 - tissue.hindrance_factor
