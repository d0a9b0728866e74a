"""Equilibrium with a bath: the volume ratio at which nothing moves any more.

At rest the virtual bath in the tissue is the real bath, so one equation in J remains: the stress of the solid
and the applied pressure balance the osmotic pressure above the bath's.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fvswell.physics.differentiation import COMPLEX_STEP
from fvswell.physics.electrochemistry import bath_osmotic_pressure, ion_concentrations, osmotic_pressure
from fvswell.physics.solid import cauchy_stress, uniaxial_stress
from fvswell.physics.tissue import Array, Tissue

__all__ = [
    "equilibrium_volume_ratio",
    "isotropic_equilibrium_volume_ratio",
    "isotropic_stress",
    "osmotic_pressure_difference",
]

_CONVERGED_STEP = 1e-9  # of ln(volume of water); Newton is quadratic, so the step taken last leaves 1e-18
_LEAST_WATER, _MOST_WATER = 1e-12, 1e6  # of the water in the stress-free solid: beyond them there is no root
_LONGEST_STEP = 1.0
_MAX_ITERATIONS = 100


def equilibrium_volume_ratio(
    tissue: Tissue,
    applied_pressure: Array | float,
    bath_concentration: Array | float,
    bath_osmotic_coefficient: Array | float,
    swelling: bool,
) -> Array:
    """Volume ratio of a column (uniaxial strain) at rest: sigma_s(J) + P = pi(J, c_bath) - pi_bath.

    Parameters
    ----------
    tissue
        Properties at the points.
    applied_pressure
        Pressure of the piston P, MPa, compression positive.
    bath_concentration
        Salt concentration of the bath, mmol/mm3, positive.
    bath_osmotic_coefficient
        phi_ext.
    swelling
        Whether the osmotic pressures take part (they do not in the biphasic model).

    Returns
    -------
    array
        J, broadcast shape of all arguments; nan where no volume of water balances the load.
    """
    osmotic = (bath_concentration, bath_osmotic_coefficient) if swelling else None
    return _root(tissue, uniaxial_stress, applied_pressure, osmotic)


def isotropic_equilibrium_volume_ratio(
    tissue: Tissue,
    bath_concentration: Array | float,
    bath_osmotic_coefficient: Array | float,
    applied_pressure: Array | float = 0.0,
) -> Array:
    """Volume ratio at rest of a sample free in all directions under a drained all-round pressure.

    Parameters as for ``equilibrium_volume_ratio``; the stress of the solid is that of b = J^(2/3) I.
    """
    return _root(tissue, isotropic_stress, applied_pressure, (bath_concentration, bath_osmotic_coefficient))


def isotropic_stress(tissue: Tissue, J: Array) -> Array:
    """Cauchy stress of the solid (MPa) stretched equally in all directions to the volume ratio J."""
    square = np.exp(2.0 / 3.0 * np.log(J))
    return cauchy_stress(tissue, square, square, square, np.zeros_like(square)).xx


def osmotic_pressure_difference(
    tissue: Tissue, J: Array, bath_concentration: Array | float, bath_osmotic_coefficient: Array | float
) -> Array:
    """pi(J, c_bath) - pi_bath in Donnan equilibrium with the bath, MPa; broadcast shape, J may be complex."""
    cation, anion = ion_concentrations(tissue, J, np.log(bath_concentration))
    outside = bath_osmotic_pressure(
        np.asarray(bath_osmotic_coefficient), tissue.thermal_energy, np.asarray(bath_concentration)
    )
    return osmotic_pressure(tissue, cation, anion) - outside


def _root(
    tissue: Tissue,
    stress: Callable[[Tissue, Array], Array],
    applied_pressure: Array | float,
    osmotic: tuple[Array | float, Array | float] | None,
) -> Array:
    """Solve stress + P - (pi - pi_bath) = 0 by a Newton method in u = ln(J - 1 + n_f0), kept in a bracket.

    In u the osmotic pressure is about an exponential, on which Newton's steps stay short, and J > 1 - n_f0.
    """
    solid_fraction = 1.0 - tissue.fluid_fraction

    def residual(u: Array) -> Array:
        J = solid_fraction + np.exp(u)
        value = stress(tissue, J) + applied_pressure
        return value if osmotic is None else value - osmotic_pressure_difference(tissue, J, *osmotic)

    water = np.log(tissue.fluid_fraction)
    # stiff laws overflow far from the root
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        none = ~(residual(water + np.log(_LEAST_WATER)) < 0.0)
        low = np.broadcast_to(water + np.log(_LEAST_WATER), none.shape).copy()
        high = np.broadcast_to(water + np.log(_MOST_WATER), none.shape).copy()
        u = np.broadcast_to(water, none.shape)
        for _ in range(_MAX_ITERATIONS):
            f = residual(u + 1j * COMPLEX_STEP)
            low, high = np.where(f.real < 0.0, u, low), np.where(f.real > 0.0, u, high)
            step = np.clip(-f.real * COMPLEX_STEP / f.imag, -_LONGEST_STEP, _LONGEST_STEP)
            target = u + step
            bracketed = (target >= low) & (target <= high)  # false for nan as well
            u, previous = np.where(bracketed, target, 0.5 * (low + high)), u
            done = np.abs(u - previous) <= _CONVERGED_STEP
            if np.all(done | none):
                break
    return np.where(none | ~done, np.nan, solid_fraction + np.exp(u))
