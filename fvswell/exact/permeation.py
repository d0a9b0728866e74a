"""Steady permeation of a column whose ions, if it has any, are in equilibrium with one bath: any law, any strain.

Water flows from the filter's bath at the pressure p_f to the piston's at p_p. The total pressure is uniform, that of
the piston P (its own) and of its bath, so with f(J) = sigma_s(J) - (pi(J) - pi_bath)

    f(J) = p_f - p_p - P at the filter,        f(J) = -P at the piston,        q = -(k(J)/J) df/dX = const.

Integrated over the stress-free height h: q h is the integral of k f'/J over J from the piston to the filter, and the
height times q that of k f'. With a piston that is held, P is what gives its height. For small pressures
q = k (p_f - p_p)/h.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fvswell.physics.differentiation import COMPLEX_STEP
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import Model
from fvswell.physics.osmotic import bath_log_activity, ion_concentrations, osmotic_pressure_difference
from fvswell.physics.permeability import hydraulic_permeability, open_circuit_ratio
from fvswell.physics.solids import uniaxial_stress
from fvswell.physics.tissue import Array, Tissue, fixed_charge_density

__all__ = ["Permeation", "held_permeation", "steady_permeation"]

_POINTS = 60  # of Gauss, between the volume ratios at the ends


@dataclass(frozen=True)
class Permeation:
    """A column that water flows through steadily."""

    water_flux: float  # q, mm/s, positive from the filter to the piston
    piston_pressure: float  # P, MPa, without the pressure of the piston's bath
    current_height: float  # mm
    position: Array  # from the filter in the stress-free solid, mm, (points,)
    volume_ratio: Array  # J there, (points,)


def steady_permeation(
    model: Model,
    tissue: Tissue,
    height: float,
    pressures: tuple[float, float],
    bath_concentration: float,
    piston_pressure: float = 0.0,
    kept_open_circuit_ratio: float | None = None,
) -> Permeation:
    """Flow through a column under a given pressure of the piston.

    Parameters
    ----------
    model
        One without ions of its own, biphasic or biphasic-swelling.
    tissue
        At a point: numbers.
    height
        Of the stress-free solid, mm.
    pressures
        Hydrostatic pressures of the baths of the filter and of the piston, MPa.
    bath_concentration
        Of both baths, mmol/mm3.
    piston_pressure
        Of the piston itself, MPa.
    kept_open_circuit_ratio
        k_open/k of the biphasic-swelling model where it is held constant; None evaluates it in the state.

    Raises
    ------
    ValueError
        If the model transports ions, or the solid does not bear the pressures.
    """
    if model.transports_ions:
        raise ValueError(f"the {model.name} model is not in equilibrium with one bath: see fvswell.exact.steady_column")
    seen, drop = model.tissue(tissue), pressures[0] - pressures[1]
    ends = [
        float(equilibrium_volume_ratio(seen, pressure, bath_concentration))
        for pressure in (piston_pressure - drop, piston_pressure)
    ]
    if np.isnan(ends).any():
        raise ValueError("no volume of water balances these pressures")
    conductance = _conductance(model, tissue, bath_concentration, kept_open_circuit_ratio)
    nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
    share = np.sin(0.25 * np.pi * (nodes + 1.0)) ** 2  # from the filter to the piston, crowded at both
    J = ends[0] + share * (ends[1] - ends[0])
    span = weights * 0.25 * np.pi * np.sin(0.5 * np.pi * (nodes + 1.0)) * (ends[0] - ends[1])
    pieces = conductance(J) * span
    flow = pieces.sum() / height
    if not flow:
        return Permeation(0.0, piston_pressure, ends[0] * height, np.array([0.0, height]), np.array(ends))
    fine = np.linspace(0.0, 1.0, 2 * _POINTS + 1)
    profile = ends[0] + np.sin(0.5 * np.pi * fine) ** 2 * (ends[1] - ends[0])
    inner, inner_weights = np.polynomial.legendre.leggauss(6)
    middle, half = 0.5 * (profile[1:] + profile[:-1]), 0.5 * np.diff(profile)
    passed = -(conductance(middle[:, None] + half[:, None] * inner) @ inner_weights) * half
    position = np.append(0.0, np.cumsum(passed)) / flow
    return Permeation(float(flow), piston_pressure, float((J * pieces).sum() / flow), position, profile)


def held_permeation(
    model: Model,
    tissue: Tissue,
    height: float,
    pressures: tuple[float, float],
    bath_concentration: float,
    current_height: float,
    kept_open_circuit_ratio: float | None = None,
) -> Permeation:
    """Flow through a column between a filter and a piston that stay ``current_height`` mm apart.

    Parameters and errors as for `steady_permeation`.
    """
    from scipy.optimize import brentq  # a tenth of a second to import

    def flowing(pressure: float) -> Permeation:
        return steady_permeation(
            model, tissue, height, pressures, bath_concentration, pressure, kept_open_circuit_ratio
        )

    def excess(pressure: float) -> float:
        return flowing(pressure).current_height - current_height

    # the mean of J lies between those at the ends, so P lies within the drop of what a column at rest needs
    J, drop = current_height / height, pressures[0] - pressures[1]
    seen = model.tissue(tissue)
    still = float(-_balance(seen, bath_concentration)(np.array(J)))
    low, high = min(still, still + drop), max(still, still + drop)
    return flowing(float(brentq(excess, low, high, xtol=1e-14, rtol=1e-14))) if drop else flowing(still)


def _balance(seen: Tissue, bath_concentration: float) -> Callable[[Array], Array]:
    """f(J)."""

    def stress(J: Array) -> Array:
        value: Array = uniaxial_stress(seen.solid, J, seen.fluid_fraction) - osmotic_pressure_difference(
            seen, J, bath_concentration
        )
        return value

    return stress


def _conductance(
    model: Model, tissue: Tissue, bath_concentration: float, kept_open_circuit_ratio: float | None
) -> Callable[[Array], Array]:
    """K f'/J as a function of J."""
    balance = _balance(model.tissue(tissue), bath_concentration)

    def conductance(J: Array) -> Array:
        k = hydraulic_permeability(tissue, J)
        if model.open_circuit and kept_open_circuit_ratio is not None:
            k = k * kept_open_circuit_ratio
        elif model.open_circuit:
            activity = bath_log_activity(tissue.osmotic, bath_concentration)
            ions = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), activity)
            k = k * open_circuit_ratio(tissue, J, *ions)
        value: Array = k * balance(J + 1j * COMPLEX_STEP).imag / COMPLEX_STEP / J
        return value

    return conductance
