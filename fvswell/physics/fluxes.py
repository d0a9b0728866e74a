"""Fluxes of water and ions relative to the solid, in the friction form of Huyghe & Janssen (1997).

Functions of the state at a point and of the gradients of the three potentials there; gradients are current gradients
along the face normal and fluxes are per current area. With w = 1 - r and g+- = grad ln a~ +- grad psi~ (psi~ standing
for F psi~/(R T)):

    water   q  = -k [ grad mu_f + w R T (c+ g+ + c- g-) ]
    cation  j+ = w c+ q - n_f D+ c+ g+
    anion   j- = w c- q - n_f D- c- g-

which is Wilson et al. (2005), Appendix B, for ions without volume.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from fvswell.compiled import point
from fvswell.physics.permeability import hydraulic_permeability
from fvswell.physics.tissue import convection_factor, fluid_fraction

__all__ = [
    "IonFluxParts",
    "MixtureFluxes",
    "fluxes_of_unit_current",
    "ion_flux_parts",
    "mixture_fluxes",
    "potential_gradient_of_current",
]


class MixtureFluxes(NamedTuple):
    """Water flux in mm/s, ion fluxes in mmol/(mm2 s)."""

    water: Any
    cation: Any
    anion: Any


class IonFluxParts(NamedTuple):
    """The three parts of an ion flux, mmol/(mm2 s); they add up to the flux."""

    convection: Any
    diffusion: Any
    migration: Any


@point
def mixture_fluxes(
    tissue: Any,
    J: Any,
    cation: Any,
    anion: Any,
    water_potential_gradient: Any,
    log_activity_gradient: Any,
    potential_gradient: Any,
) -> Any:
    """Fluxes of water, cation and anion; the equations are at the head of this module.

    Parameters
    ----------
    tissue
        Properties at the point.
    J, cation, anion
        Volume ratio and ion concentrations (mmol per mm3 of fluid).
    water_potential_gradient, log_activity_gradient, potential_gradient
        Gradients of mu_f (MPa/mm), ln a~ and F psi~/(R T) (1/mm).
    """
    cation_drive = cation * (log_activity_gradient + potential_gradient)
    anion_drive = anion * (log_activity_gradient - potential_gradient)
    w, n_f = convection_factor(tissue), fluid_fraction(tissue, J)
    drive = water_potential_gradient + w * tissue.thermal_energy * (cation_drive + anion_drive)
    water = -hydraulic_permeability(tissue, J) * drive
    dragged = w * water
    return MixtureFluxes(
        water,
        cation * dragged - tissue.cation_diffusivity * (n_f * cation_drive),
        anion * dragged - tissue.anion_diffusivity * (n_f * anion_drive),
    )


@point
def potential_gradient_of_current(
    tissue: Any,
    J: Any,
    cation: Any,
    anion: Any,
    water_potential_gradient: Any,
    log_activity_gradient: Any,
    current: Any,
) -> Any:
    """Gradient of F psi~/(R T) (1/mm) at which a given current flows; the fluxes are linear in it.

    Parameters
    ----------
    tissue, J, cation, anion, water_potential_gradient, log_activity_gradient
        As in `mixture_fluxes`.
    current
        j+ - j- (the current density over Faraday's constant), mmol/(mm2 s).
    """
    w, n_f, k = convection_factor(tissue), fluid_fraction(tissue, J), hydraulic_permeability(tissue, J)
    dragged, energy = w * (cation - anion), w * tissue.thermal_energy
    by_cation, by_anion = tissue.cation_diffusivity * (n_f * cation), tissue.anion_diffusivity * (n_f * anion)
    drive = water_potential_gradient + energy * ((cation + anion) * log_activity_gradient)
    at_zero = -k * drive * dragged - (by_cation - by_anion) * log_activity_gradient  # current without the potential
    return (at_zero - current) / (by_cation + by_anion + k * tissue.thermal_energy * (dragged * dragged))


@point
def fluxes_of_unit_current(tissue: Any, J: Any, cation: Any, anion: Any) -> Any:
    """Fluxes by a current, with the other two gradients as they are, and the resistance to it.

    Parameters
    ----------
    tissue, J, cation, anion
        As in `mixture_fluxes`.

    Returns
    -------
    tuple
        The derivatives of the fluxes by the current j+ - j-, and the fall of F psi~/(R T) per length (1/mm) by it.
    """
    w, n_f, k = convection_factor(tissue), fluid_fraction(tissue, J), hydraulic_permeability(tissue, J)
    dragged = w * (cation - anion)  # the current is carried by the ions themselves, and by those that water drags
    conductance = n_f * (tissue.cation_diffusivity * cation + tissue.anion_diffusivity * anion)
    resistance = 1.0 / (conductance + k * tissue.thermal_energy * (dragged * dragged))
    return mixture_fluxes(tissue, J, cation, anion, 0.0, 0.0, -resistance), resistance


@point
def ion_flux_parts(
    tissue: Any, J: Any, concentration: Any, diffusivity: Any, flux: Any, water_flux: Any, concentration_gradient: Any
) -> Any:
    """Convection, diffusion and migration of one ion, in terms of the concentrations found in the tissue.

    Migration is -n_f D c z F grad xi/(R T), with z = +-1 and xi the electric potential in the tissue: what the other
    two leave of the flux.

    Parameters
    ----------
    tissue
        Properties at the point.
    J, concentration, diffusivity
        Volume ratio, concentration (mmol per mm3 of fluid) and free diffusivity (mm2/s) of the ion.
    flux, water_flux
        j in mmol/(mm2 s) and q in mm/s.
    concentration_gradient
        grad c of the ion, mmol/mm4.
    """
    convection = convection_factor(tissue) * concentration * water_flux
    diffusion = -fluid_fraction(tissue, J) * diffusivity * concentration_gradient
    return IonFluxParts(convection, diffusion, flux - convection - diffusion)
