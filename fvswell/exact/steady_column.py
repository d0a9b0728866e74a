"""Steady flow of water, ions and current through a column between two baths: the full equations.

In a steady state the fluxes q, j- and i are the same everywhere, and the total pressure too. The gradients that drive
them follow from the fluxes at each point; the fluxes are those with which the potentials come from the one bath to the
other. Solved by collocation of fourth order (`scipy.integrate.solve_bvp`): nothing of the finite volumes is used.
Included are permeation with the salt that it drags along, osmosis, diffusion of salt through charged or uncharged
tissue, and electric currents.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fvswell.compiled.dual import Dual, variables
from fvswell.physics.constants import FARADAY
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.fluxes import mixture_fluxes
from fvswell.physics.osmotic import bath_log_activity, bath_osmotic_pressure, ion_concentrations, osmotic_pressure
from fvswell.physics.permeability import hydraulic_permeability
from fvswell.physics.solids import uniaxial_stress
from fvswell.physics.tissue import Array, Tissue, fixed_charge_density, fluid_fraction

__all__ = ["Bath", "SteadyColumn", "steady_column", "still_salt_flux"]

_TOLERANCE = 1e-9  # of the collocation
_MOST_NODES = 20_000
_POINTS = 40


class Bath(NamedTuple):
    """What an end of the column is open to."""

    concentration: float  # mmol/mm3
    pressure: float = 0.0  # MPa


class SteadyColumn(NamedTuple):
    """Fluxes from the filter to the piston, per current area, and the state of the column."""

    water_flux: float  # mm/s
    anion_flux: float  # mmol/(mm2 s)
    cation_flux: float
    potential: float  # psi~ at the piston less that at the filter, mV
    piston_pressure: float  # without the pressure of the piston's bath, MPa
    current_height: float  # mm
    position: Array  # from the filter in the stress-free solid, mm, (points,)
    volume_ratio: Array  # (points,)
    log_activity: Array  # (points,)


def steady_column(
    tissue: Tissue,
    height: float,
    filter_bath: Bath,
    piston_bath: Bath,
    current: float = 0.0,
    piston_pressure: float | None = 0.0,
    current_height: float | None = None,
) -> SteadyColumn:
    """Solve for the steady state of the electrochemical model.

    Parameters
    ----------
    tissue
        At a point: numbers.
    height
        Of the stress-free solid, mm.
    filter_bath, piston_bath
        Baths at the two ends; the piston's presses on it too.
    current
        Density along +x, A/mm2.
    piston_pressure, current_height
        Pressure of the piston itself, MPa; None for a piston held at ``current_height``, mm.

    Raises
    ------
    ValueError
        If no steady state is found.
    """
    from scipy.integrate import solve_bvp  # a quarter of a second to import

    baths, held = (filter_bath, piston_bath), current_height is not None
    activities = [float(bath_log_activity(tissue.osmotic, bath.concentration)) for bath in baths]
    scales = _scales(tissue, height, baths)

    def pressure_of(unknowns: Array) -> float:
        return float(unknowns[2]) if piston_pressure is None else piston_pressure

    def slopes(_: Array, state: Array, unknowns: Array) -> Array:
        return _slopes(tissue, np.array([*(unknowns[:2] * scales), current / FARADAY]), state)

    def missing(start: Array, end: Array, unknowns: Array) -> Array:
        """Of the potentials of the baths at both ends, and of the height."""
        total = pressure_of(unknowns) + piston_bath.pressure
        left = [start[2], start[3]]
        for state, bath, activity in zip((start, end), baths, activities, strict=True):
            osmotic = bath_osmotic_pressure(tissue.osmotic, tissue.thermal_energy, bath.concentration)
            water, _ = _water_potential(tissue, state[0], state[1])
            left += [float(water + total - bath.pressure + osmotic), float(state[1] - activity)]
        return np.array([*left, end[3] / current_height - 1.0] if held else left)

    share = np.linspace(0.0, 1.0, _POINTS + 1)
    J = [
        current_height / height
        if current_height is not None
        else float(equilibrium_volume_ratio(tissue, pressure_of(share), bath.concentration))
        for bath in baths
    ]
    J_guess, guess = J[0] + share * (J[1] - J[0]), activities[0] + share * (activities[1] - activities[0])
    first = np.stack([J_guess, guess, np.zeros_like(share), share * height * J_guess])
    unknowns = np.array([0.0, 0.0, 0.0] if held else [0.0, 0.0])
    try:
        with np.errstate(all="ignore"):  # an iteration may leave what the laws are for
            found = solve_bvp(slopes, missing, share * height, first, unknowns, tol=_TOLERANCE, max_nodes=_MOST_NODES)
    except np.linalg.LinAlgError:
        found = None
    if found is None or not found.success:
        raise ValueError("no steady state was found between these baths")
    J, activity, potential, depth = found.y
    water, salt = found.p[:2] * scales
    return SteadyColumn(
        float(water),
        float(salt),
        float(salt + current / FARADAY),
        float(potential[-1]) * tissue.thermal_energy / FARADAY,
        pressure_of(found.p),
        float(depth[-1]),
        found.x,
        J,
        activity,
    )


def still_salt_flux(
    tissue: Tissue, J: float, current_height: float, concentrations: tuple[float, float]
) -> tuple[float, float]:
    """Diffusion of salt through a column of uniform J that no water and no current flow through.

    The flux is n_f/h0 times the integral of 2 D+ D- c+ c-/(D+ c+ + D- c-) over ln a~ from the piston's bath to the
    filter's, n_f 2 D+ D-/(D+ + D-) (c_f - c_p)/h0 without fixed charge; the potential psi~ that of Teorell, Meyer &
    Sievers less the Donnan potentials.

    Parameters
    ----------
    tissue
        At a point: numbers.
    J, current_height
        Volume ratio, and height in this state, mm.
    concentrations
        Of the baths of the filter and of the piston, mmol/mm3.

    Returns
    -------
    flux, potential
        Of anions (and of cations), mmol/(mm2 s) toward the piston; psi~ at the piston less that at the filter, mV.
    """
    ends = [bath_log_activity(tissue.osmotic, concentration) for concentration in concentrations]
    nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
    activity = 0.5 * (ends[0] + ends[1]) + 0.5 * (ends[0] - ends[1]) * nodes
    cation, anion = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), activity)
    by_cation, by_anion = cation * tissue.cation_diffusivity, anion * tissue.anion_diffusivity
    span = 0.5 * (ends[0] - ends[1]) * weights
    flux = fluid_fraction(tissue, J) / current_height * (2.0 * by_cation * anion / (by_cation + by_anion))
    flux = flux * tissue.anion_diffusivity
    fall = tissue.thermal_energy / FARADAY * (by_cation - by_anion) / (by_cation + by_anion)
    return float(flux @ span), float(fall @ span)


def _slopes(tissue: Tissue, fluxes: Array, state: Array) -> Array:
    """Derivatives of (J, ln a~, F psi~/(R T), x) by the position in the stress-free solid, ``(4, points)``."""
    J, activity = state[:2]
    cation, anion = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), activity)
    laws = np.empty((len(J), 3, 3))  # fluxes of water, anions and charge by the gradients of the three potentials
    for i, gradient in enumerate(np.eye(3)):
        flux = mixture_fluxes(tissue, J, cation, anion, *gradient)
        laws[:, 0, i], laws[:, 1, i], laws[:, 2, i] = flux.water, flux.anion, flux.cation - flux.anion
    size = np.abs(laws).max(axis=(0, 2))[:, None]  # they differ by many decades
    water, salt, potential = np.linalg.solve(laws / size, fluxes[:, None] / size)[..., 0].T
    _, (by_volume, by_activity) = _water_potential(tissue, J, activity)
    return np.stack([(water - by_activity * salt) / by_volume, salt, potential, np.ones_like(J)]) * J


def _water_potential(tissue: Tissue, J: Array, activity: Array) -> tuple[Array, tuple[Array, Array]]:
    """mu_f less the total pressure, sigma_s - pi, and its derivatives by J and ln a~."""
    volume, log_activity = variables(J, activity)
    charge = fixed_charge_density(tissue, volume)
    ions = ion_concentrations(tissue.osmotic, charge, log_activity)
    pressure = osmotic_pressure(tissue.osmotic, tissue.thermal_energy, charge, *ions)
    potential: Dual = uniaxial_stress(tissue.solid, volume, tissue.fluid_fraction) - pressure
    return potential.value, potential.slopes  # type: ignore[return-value]


def _scales(tissue: Tissue, height: float, baths: tuple[Bath, Bath]) -> Array:
    """Sizes of the fluxes of water and anions: what the osmotic pressure of the salt and its gradient would drive."""
    salt = max(bath.concentration for bath in baths) / height
    water = hydraulic_permeability(tissue, 1.0) * tissue.thermal_energy * salt
    return np.array([float(water), float(tissue.anion_diffusivity * salt)])
