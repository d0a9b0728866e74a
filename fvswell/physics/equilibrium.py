"""Equilibrium with a bath: the volume ratio at which nothing moves any more.

In equilibrium the virtual bath in the tissue is the real bath, so one equation in J remains: the stress of the solid
and the applied pressure balance the osmotic pressure above the bath's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from fvswell.physics.differentiation import COMPLEX_STEP
from fvswell.physics.osmotic import osmotic_pressure_difference
from fvswell.physics.solids import isotropic_stress, uniaxial_stress
from fvswell.physics.tissue import Array, Tissue

__all__ = ["equilibrium_volume_ratio", "isotropic_equilibrium_volume_ratio"]

_CONVERGED_STEP = 1e-9  # of ln(volume of water); Newton is quadratic, so the step taken last leaves 1e-18
_LEAST_WATER, _MOST_WATER = 1e-12, 1e6  # of the water in the stress-free solid: beyond them there is no root
_LONGEST_STEP = 1.0
_MAX_ITERATIONS = 200
_SLOW = 30  # iterations after which every second one halves the bracket: Newton's come down exponentials slowly


def equilibrium_volume_ratio(
    tissue: Tissue, applied_pressure: Array | float, bath_concentration: Array | float
) -> Array:
    """Volume ratio of a column (uniaxial strain) in equilibrium: sigma_s(J) + P = pi(J, c_bath) - pi_bath.

    Parameters
    ----------
    tissue
        Properties at the points, as the model sees them (`Model.tissue`).
    applied_pressure
        Pressure of the piston P, MPa, compression positive.
    bath_concentration
        Salt concentration of the bath, mmol/mm3, positive.

    Returns
    -------
    array
        J, broadcast shape of all arguments; nan where no volume of water balances the load.
    """
    return _root(tissue, uniaxial_stress, applied_pressure, bath_concentration)


def isotropic_equilibrium_volume_ratio(
    tissue: Tissue, bath_concentration: Array | float, applied_pressure: Array | float = 0.0
) -> Array:
    """Volume ratio in equilibrium of a sample free in all directions under a drained all-round pressure.

    Parameters as for `equilibrium_volume_ratio`; the stress of the solid is that of b = J^(2/3) I.
    """
    return _root(tissue, isotropic_stress, applied_pressure, bath_concentration)


def _root(
    tissue: Tissue, stress: Callable[..., Any], applied_pressure: Array | float, bath_concentration: Array | float
) -> Array:
    """Solve stress + P - (pi - pi_bath) = 0 by a Newton method in u = ln(J - 1 + n_f0), kept in a bracket.

    In u the osmotic pressure is about an exponential, on which Newton's steps stay short, and J > 1 - n_f0. A point
    that has converged is left as it is, so that it does not depend on the others.
    """
    fluid_fraction = np.asarray(tissue.fluid_fraction)
    pressure, bath = np.asarray(applied_pressure), np.asarray(bath_concentration)

    def residual(u: Array) -> Array:
        J = 1.0 - fluid_fraction + np.exp(u)
        value: Array = stress(tissue.solid, J, fluid_fraction) + pressure - osmotic_pressure_difference(tissue, J, bath)
        return value

    water = np.log(fluid_fraction)
    # stiff laws overflow far from the root
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        none = ~(residual(water + np.log(_LEAST_WATER)) < 0.0)
        low = np.broadcast_to(water + np.log(_LEAST_WATER), none.shape).copy()
        high = np.broadcast_to(water + np.log(_MOST_WATER), none.shape).copy()
        u = np.broadcast_to(water, none.shape)
        done = none.copy()
        for iteration in range(_MAX_ITERATIONS):
            f = residual(u + 1j * COMPLEX_STEP)
            beyond = np.isnan(f.real)  # a law that overflows, in tension or in compression
            low = np.where((f.real < 0.0) | (beyond & (u < water)), u, low)
            high = np.where((f.real > 0.0) | (beyond & (u > water)), u, high)
            step = np.clip(-f.real * COMPLEX_STEP / f.imag, -_LONGEST_STEP, _LONGEST_STEP)
            halve = iteration > _SLOW and iteration % 2
            target = np.where(np.isfinite(f) & (not halve), u + step, np.nan)
            bracketed = (target >= low) & (target <= high)  # false for nan as well
            u, previous = np.where(done, u, np.where(bracketed, target, 0.5 * (low + high))), u
            done |= (np.abs(u - previous) <= _CONVERGED_STEP) & (not halve)
            if np.all(done):
                break
    return np.where(none | ~done, np.nan, 1.0 - fluid_fraction + np.exp(u))
