"""Fluxes of water and ions relative to the solid, in the friction form of Huyghe & Janssen (1997).

Local functions of the state at a point and of the gradients of the three potentials there; gradients are current
gradients along the face normal and fluxes are per current area. With w = 1 - r and g+- = grad ln c~ +- grad psi~
(psi~ standing for F psi~/(R T)):

    water   q  = -k [ grad mu_f + w R T (c+ g+ + c- g-) ]
    cation  j+ = w c+ q - n_f D+ c+ g+
    anion   j- = w c- q - n_f D- c- g-

which is Wilson et al. (2005), Appendix B, for ions without volume. All functions accept complex numbers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fvswell.physics.electrochemistry import fluid_fraction, ion_concentration_derivatives
from fvswell.physics.permeability import hydraulic_permeability
from fvswell.physics.tissue import Array, Tissue

__all__ = [
    "FluxDerivatives",
    "IonFluxParts",
    "MixtureFluxes",
    "darcy_flux",
    "ion_flux_parts",
    "mixture_flux_derivatives",
    "mixture_fluxes",
]


class MixtureFluxes(NamedTuple):
    """Water flux in mm/s, ion fluxes in mmol/(mm2 s)."""

    water: Array
    cation: Array
    anion: Array


class IonFluxParts(NamedTuple):
    """The three parts of an ion flux, mmol/(mm2 s); they add up to the flux."""

    convection: Array
    diffusion: Array
    migration: Array


def darcy_flux(permeability: Array, water_potential_gradient: Array) -> Array:
    """Q = -k grad mu_f, mm/s."""
    return -permeability * water_potential_gradient


def mixture_fluxes(
    tissue: Tissue,
    J: Array,
    cation: Array,
    anion: Array,
    water_potential_gradient: Array,
    log_concentration_gradient: Array,
    potential_gradient: Array,
) -> MixtureFluxes:
    """Fluxes of water, cation and anion; the equations are at the head of this module.

    Parameters
    ----------
    tissue
        Properties at the points.
    J, cation, anion
        Volume ratio and ion concentrations (mmol per mm3 of fluid) at the points.
    water_potential_gradient, log_concentration_gradient, potential_gradient
        Gradients of mu_f (MPa/mm), ln c~ and F psi~/(R T) (1/mm). Everything broadcasts to one shape.
    """
    cation_drive = cation * (log_concentration_gradient + potential_gradient)
    anion_drive = anion * (log_concentration_gradient - potential_gradient)
    w, n_f = tissue.convection_factor, fluid_fraction(tissue, J)
    water = darcy_flux(
        hydraulic_permeability(tissue, J),
        water_potential_gradient + w * tissue.thermal_energy * (cation_drive + anion_drive),
    )
    dragged = w * water
    return MixtureFluxes(
        water=water,
        cation=cation * dragged - n_f * tissue.cation_diffusivity * cation_drive,
        anion=anion * dragged - n_f * tissue.anion_diffusivity * anion_drive,
    )


class FluxDerivatives(NamedTuple):
    """Derivatives of the fluxes of water, anion and charge (first axis, as (q, j-, j+ - j-))."""

    by_state: Array  # (3, 2, ...): by J and ln c~, at fixed gradients
    by_gradient: Array  # (3, 3, ...): by the gradients of mu_f, ln c~ and psi~


def mixture_flux_derivatives(
    tissue: Tissue,
    J: Array,
    cation: Array,
    anion: Array,
    water_potential_gradient: Array,
    log_concentration_gradient: Array,
    potential_gradient: Array,
) -> FluxDerivatives:
    """Derivatives of `mixture_fluxes`, whose arguments these are (real)."""
    cation_J, anion_J, by_log = ion_concentration_derivatives(tissue, J, cation, anion)
    w, RT, n_f = tissue.convection_factor, tissue.thermal_energy, fluid_fraction(tissue, J)
    n_J = (1.0 - n_f) / J
    k = hydraulic_permeability(tissue, J)
    cation_gradient = log_concentration_gradient + potential_gradient
    anion_gradient = log_concentration_gradient - potential_gradient
    dragging = -k * w * RT
    water = -k * water_potential_gradient + dragging * (cation * cation_gradient + anion * anion_gradient)
    cation_D, anion_D = tissue.cation_diffusivity, tissue.anion_diffusivity

    by_state = np.empty((3, 2, *water.shape))
    by_state[0, 0] = tissue.permeability_exponent * water + dragging * (
        cation_J * cation_gradient + anion_J * anion_gradient
    )
    by_state[0, 1] = (2.0 * dragging) * by_log * log_concentration_gradient
    for s, (by_cation, by_anion, by_n) in enumerate(((cation_J, anion_J, n_J), (by_log, by_log, 0.0))):
        j_cation = w * (by_cation * water + cation * by_state[0, s]) - cation_D * cation_gradient * (
            by_n * cation + n_f * by_cation
        )
        by_state[1, s] = w * (by_anion * water + anion * by_state[0, s]) - anion_D * anion_gradient * (
            by_n * anion + n_f * by_anion
        )
        by_state[2, s] = j_cation - by_state[1, s]

    by_gradient = np.empty((3, 3, *water.shape))
    by_gradient[0, 0], by_gradient[0, 1] = -k, dragging * (cation + anion)
    by_gradient[0, 2] = dragging * (cation - anion)
    cation_mobility, anion_mobility = n_f * cation_D * cation, n_f * anion_D * anion
    dragged = w * by_gradient[0]
    by_gradient[1] = anion * dragged
    by_gradient[1, 1] -= anion_mobility
    by_gradient[1, 2] += anion_mobility
    by_gradient[2] = (cation - anion) * dragged
    by_gradient[2, 1] += anion_mobility - cation_mobility
    by_gradient[2, 2] -= anion_mobility + cation_mobility
    return FluxDerivatives(by_state, by_gradient)


def ion_flux_parts(
    tissue: Tissue,
    J: Array,
    concentration: Array,
    diffusivity: Array,
    flux: Array,
    water_flux: Array,
    concentration_gradient: Array,
) -> IonFluxParts:
    """Convection, diffusion and migration of one ion, told in the concentrations found in the tissue.

    Migration is -n_f D c z F grad xi/(R T), with z = +-1 and xi the electric potential in the tissue: what the other
    two leave of the flux.

    Parameters
    ----------
    tissue
        Properties at the points.
    J, concentration, diffusivity
        Volume ratio, concentration (mmol per mm3 of fluid) and free diffusivity (mm2/s) of the ion.
    flux, water_flux
        j in mmol/(mm2 s) and q in mm/s.
    concentration_gradient
        grad c of the ion, mmol/mm4.
    """
    convection = tissue.convection_factor * concentration * water_flux
    diffusion = -fluid_fraction(tissue, J) * diffusivity * concentration_gradient
    return IonFluxParts(convection, diffusion, flux - convection - diffusion)
