"""Equilibrium with a bath: the volume ratio at which nothing moves any more.

In equilibrium the virtual bath in the tissue is the real bath, so one equation in J remains: the stress of the solid
and the applied pressure balance the osmotic pressure above the bath's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from fvswell.physics.bracketed_root import bracketed_root, bracketed_root_at
from fvswell.physics.osmotic import osmotic_pressure_difference
from fvswell.physics.solids import isotropic_stress, uniaxial_stress
from fvswell.physics.tissue import Array, Tissue

__all__ = ["equilibrium_volume_ratio", "isotropic_equilibrium_volume_ratio"]

_LEAST_WATER, _MOST_WATER = 1e-12, 1e6  # of the water in the stress-free solid: beyond them there is no root
_FEW = 16  # states of a uniform tissue that are solved one by one


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

    In u the osmotic pressure is about an exponential, on which Newton's steps stay short, and J > 1 - n_f0.
    """
    pressure, bath = np.asarray(applied_pressure), np.asarray(bath_concentration)
    states = np.broadcast(pressure, bath)
    if states.size > _FEW or not all(isinstance(number, float) for number in _numbers(tissue)):
        return _roots(tissue, stress, pressure, bath)
    with np.errstate(all="ignore"):  # as in _roots
        found = [_root_at(tissue, stress, float(p), float(c)) for p, c in states]
    return np.array(found).reshape(states.shape)


def _numbers(tissue: Tissue) -> tuple[Any, ...]:
    """Everything that an equilibrium depends on."""
    return (*tissue.solid, *tissue.osmotic, tissue.fluid_fraction, tissue.fixed_charge_density, tissue.thermal_energy)


def _root_at(tissue: Tissue, stress: Callable[..., Any], pressure: float, bath: float) -> float:
    """The root in one state, as `_roots` finds it: arrays of a few numbers take five times longer than numbers do."""
    fluid_fraction = tissue.fluid_fraction

    def residual(u: complex) -> Any:
        J = 1.0 - fluid_fraction + np.exp(u)
        return stress(tissue.solid, J, fluid_fraction) + pressure - osmotic_pressure_difference(tissue, J, bath)

    u = np.log(fluid_fraction)
    low, high = u + np.log(_LEAST_WATER), u + np.log(_MOST_WATER)
    if not residual(low) < 0.0:
        return np.nan
    return float(1.0 - fluid_fraction + np.exp(bracketed_root_at(residual, u, low, high)))


def _roots(tissue: Tissue, stress: Callable[..., Any], pressure: Array, bath: Array) -> Array:
    """The roots at many points; one that has converged is left as it is, so that it does not depend on the others."""
    fluid_fraction = np.asarray(tissue.fluid_fraction)

    def residual(u: Array) -> Array:
        J = 1.0 - fluid_fraction + np.exp(u)
        value: Array = stress(tissue.solid, J, fluid_fraction) + pressure - osmotic_pressure_difference(tissue, J, bath)
        return value

    water = np.log(fluid_fraction)
    # stiff laws overflow far from the root
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        none = ~(residual(water + np.log(_LEAST_WATER)) < 0.0)
        low, high, start = (
            np.broadcast_to(water + np.log(share), none.shape) for share in (_LEAST_WATER, _MOST_WATER, 1.0)
        )
        u = bracketed_root(residual, start, low, high, none)
    return 1.0 - fluid_fraction + np.exp(u)
