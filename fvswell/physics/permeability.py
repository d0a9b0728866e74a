"""Permeability to water: of the tissue itself, and as it appears when no electric current can flow."""

from __future__ import annotations

import numpy as np

from fvswell.physics.constants import FARADAY
from fvswell.physics.electrochemistry import fluid_fraction
from fvswell.physics.tissue import Array, Tissue

__all__ = [
    "hydraulic_permeability",
    "open_circuit_permeability",
    "open_circuit_permeability_with_ion_volumes",
    "open_circuit_ratio",
]


def hydraulic_permeability(tissue: Tissue, J: Array) -> Array:
    """K = k0 exp(M (J - 1)), mm4/(N s)."""
    return tissue.hydraulic_permeability * np.exp(tissue.permeability_exponent * (J - 1.0))


def open_circuit_permeability(tissue: Tissue, J: Array, cation: Array, anion: Array) -> Array:
    """Permeability at zero current and zero salt gradient, ions without volume, mm4/(N s).

    k_open = k/(1 + k w^2 R T c_F^2/(n_f (D+ c+ + D- c-))): the streaming potential drives water back. The limit of
    ``open_circuit_permeability_with_ion_volumes`` for ions without volume.

    Parameters
    ----------
    tissue
        Properties at the points.
    J, cation, anion
        Volume ratio and ion concentrations (mmol per mm3 of fluid), arrays of one shape.
    """
    return hydraulic_permeability(tissue, J) * open_circuit_ratio(tissue, J, cation, anion)


def open_circuit_ratio(tissue: Tissue, J: Array, cation: Array, anion: Array) -> Array:
    """k_open/k, see `open_circuit_permeability`."""
    conductance = fluid_fraction(tissue, J) * (tissue.cation_diffusivity * cation + tissue.anion_diffusivity * anion)
    drag = tissue.thermal_energy * (tissue.convection_factor * (cation - anion)) ** 2
    return 1.0 / (1.0 + hydraulic_permeability(tissue, J) * drag / conductance)


def open_circuit_permeability_with_ion_volumes(
    tissue: Tissue, J: Array, cation: Array, anion: Array, cation_volume: float, anion_volume: float
) -> Array:
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
    n_f, k = fluid_fraction(tissue, J), hydraulic_permeability(tissue, J)
    n_f, k, cation, anion = np.broadcast_arrays(n_f, k, cation, anion)
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
