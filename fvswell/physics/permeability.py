"""Permeability to water: of the tissue itself, and as it appears when no electric current can flow."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fvswell.compiled import generic, point
from fvswell.physics.constants import FARADAY
from fvswell.physics.tissue import convection_factor, fluid_fraction

__all__ = [
    "PERMEABILITIES",
    "ConstantPermeability",
    "ExponentialPermeability",
    "HolmesMowPermeability",
    "KozenyCarmanPermeability",
    "SolidFractionPermeability",
    "hydraulic_permeability",
    "open_circuit_permeability_with_ion_volumes",
    "open_circuit_ratio",
    "permeability",
]


class ExponentialPermeability(NamedTuple):
    """k = k0 exp(M (J - 1)); constant with M = 0."""

    hydraulic_permeability: Any  # k0, mm4/(N s)
    permeability_exponent: Any = 0.0  # M


class ConstantPermeability(NamedTuple):
    """k = k0."""

    hydraulic_permeability: Any


class HolmesMowPermeability(NamedTuple):
    """Holmes & Mow (1990): k = k0 ((J - 1 + n_f0)/n_f0)^a exp(M (J^2 - 1)/2), which vanishes with the water."""

    hydraulic_permeability: Any  # k0, mm4/(N s)
    permeability_exponent: Any  # M
    permeability_power: Any  # a


class SolidFractionPermeability(NamedTuple):
    """A power of the solid fraction, k = alpha (1 - n_f)^-M; Schroeder et al. (2008)."""

    permeability_coefficient: Any  # alpha, mm4/(N s)
    permeability_exponent: Any  # M


class KozenyCarmanPermeability(NamedTuple):
    """Kozeny and Carman: k = k0 (n_f/n_f0)^3 ((1 - n_f0)/(1 - n_f))^2."""

    hydraulic_permeability: Any


PERMEABILITIES: dict[str, type] = {
    "constant": ConstantPermeability,
    "exponential": ExponentialPermeability,
    "holmes-mow": HolmesMowPermeability,
    "solid-fraction": SolidFractionPermeability,
    "kozeny-carman": KozenyCarmanPermeability,
}


@generic
def permeability(law: Any, J: Any, fluid_fraction: Any) -> Any:
    """Permeability k in Darcy's law, mm4/(N s).

    Parameters
    ----------
    law
        A law with its parameters.
    J
        Volume ratio.
    fluid_fraction
        n_f0 of the stress-free solid.
    """


@permeability.register(ExponentialPermeability)
def _exponential(law: Any, J: Any, fluid_fraction: Any) -> Any:
    return law.hydraulic_permeability * np.exp(law.permeability_exponent * (J - 1.0))


@permeability.register(ConstantPermeability)
def _constant(law: Any, J: Any, fluid_fraction: Any) -> Any:
    return law.hydraulic_permeability + 0.0 * J


@permeability.register(HolmesMowPermeability)
def _holmes_mow(law: Any, J: Any, fluid_fraction: Any) -> Any:
    water = (J - 1.0 + fluid_fraction) / fluid_fraction
    exponent = 0.5 * law.permeability_exponent * (J * J - 1.0)
    return law.hydraulic_permeability * np.exp(law.permeability_power * np.log(water) + exponent)


@permeability.register(SolidFractionPermeability)
def _solid_fraction(law: Any, J: Any, fluid_fraction: Any) -> Any:
    return law.permeability_coefficient * np.exp(law.permeability_exponent * np.log(J / (1.0 - fluid_fraction)))


@permeability.register(KozenyCarmanPermeability)
def _kozeny_carman(law: Any, J: Any, fluid_fraction: Any) -> Any:
    """The solid fraction is (1 - n_f0)/J, so the two factors are ((J - 1 + n_f0)/(n_f0 J))^3 and J^2."""
    pore = (J - 1.0 + fluid_fraction) / fluid_fraction
    return law.hydraulic_permeability * (pore * pore * pore) / J


@point
def hydraulic_permeability(tissue: Any, J: Any) -> Any:
    """Permeability k of the tissue, mm4/(N s)."""
    return permeability(tissue.permeability, J, tissue.fluid_fraction)


@point
def open_circuit_ratio(tissue: Any, J: Any, cation: Any, anion: Any) -> Any:
    """k_open/k at zero current and zero salt gradient: the streaming potential drives water back.

    k_open = k/(1 + k w^2 R T c_F^2/(n_f (D+ c+ + D- c-))), the limit of Wilson et al. (2005), Appendix B, for ions
    without volume.

    Parameters
    ----------
    tissue
        Properties at the point.
    J, cation, anion
        Volume ratio and ion concentrations (mmol per mm3 of fluid).
    """
    conductance = fluid_fraction(tissue, J) * (tissue.cation_diffusivity * cation + tissue.anion_diffusivity * anion)
    dragged = convection_factor(tissue) * (cation - anion)
    return 1.0 / (1.0 + hydraulic_permeability(tissue, J) * tissue.thermal_energy * (dragged * dragged) / conductance)


def open_circuit_permeability_with_ion_volumes(
    tissue: Any, J: Any, cation: Any, anion: Any, cation_volume: float, anion_volume: float
) -> Any:
    """Open-circuit permeability from the full friction matrix; Wilson et al. (2005), Appendix B, mm4/(N s).

    Parameters
    ----------
    tissue
        Properties at the points.
    J, cation, anion
        Volume ratio and ion concentrations (mmol per mm3 of fluid), arrays of one shape.
    cation_volume, anion_volume
        Molar volumes in mm3/mmol; both positive (2.33 and 15.17 in the paper).
    """
    RT, r = tissue.thermal_energy, tissue.hindrance_factor
    n_f, k, cation, anion = np.broadcast_arrays(
        fluid_fraction(tissue, J), hydraulic_permeability(tissue, J), cation, anion
    )
    B_cation = RT * n_f * cation / tissue.cation_diffusivity
    B_anion = RT * n_f * anion / tissue.anion_diffusivity
    friction = np.zeros((*n_f.shape, 3, 3))  # water, cation, anion
    friction[..., 0, 0] = n_f**2 / k + (1.0 - r) ** 2 * (B_cation + B_anion)
    friction[..., 1, 1], friction[..., 2, 2] = B_cation, B_anion
    friction[..., 0, 1] = friction[..., 1, 0] = -(1.0 - r) * B_cation
    friction[..., 0, 2] = friction[..., 2, 0] = -(1.0 - r) * B_anion
    volume_fraction = np.stack([n_f, n_f * cation_volume * cation, n_f * anion_volume * anion], axis=-1)
    charge_per_volume = FARADAY * np.array([0.0, 1.0 / cation_volume, -1.0 / anion_volume])
    L = volume_fraction[..., :, None] * np.linalg.inv(friction) * volume_fraction[..., None, :]
    L_p = L.sum(axis=(-2, -1))
    L_ep = np.einsum("a,...ab->...", charge_per_volume, L)
    L_e = np.einsum("a,b,...ab->...", charge_per_volume, charge_per_volume, L)
    return L_p - L_ep**2 / L_e
