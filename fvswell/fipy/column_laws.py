"""Potentials of the cells of a column and fluxes through its faces, with their slopes, all cells and faces at once.

They come from the laws at a point by dual numbers and are what the coefficients of FiPy's stock terms are made of,
independently of the kernels. Gradients are by the coordinate of the stress-free solid.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fvswell.column.balances import (
    BATH_PRESSURE,
    CONCENTRATION,
    current_along,
    pressure_on_tissue,
    reference_concentration,
)
from fvswell.column.column import Column
from fvswell.compiled.dual import slope_of, value_of, variables
from fvswell.physics.constants import FARADAY
from fvswell.physics.fluxes import mixture_fluxes, potential_gradient_of_current
from fvswell.physics.osmotic import (
    bath_log_activity,
    bath_osmotic_pressure,
    ion_concentrations,
    log_activity,
    osmotic_pressure,
)
from fvswell.physics.permeability import hydraulic_permeability, open_circuit_ratio
from fvswell.physics.solids import uniaxial_stress
from fvswell.physics.tissue import Array, fixed_charge_density

__all__ = ["CellPotentials", "FaceFluxes", "cell_potentials", "end_potentials", "face_fluxes"]


class CellPotentials(NamedTuple):
    """The potentials mu_f and ln a~ of the cells."""

    values: Array  # (2, cells)
    by_contents: Array  # (2, 2, cells): by J and s


class FaceFluxes(NamedTuple):
    """Fluxes at the faces, linear in the gradients but for what ``fluxes`` has more."""

    fluxes: Array  # (balances, faces)
    by_state: Array  # (balances, 2, faces): by J and ln a~ there
    by_gradient: Array  # (balances, potentials, faces)
    potential: Array  # (cells,) psi~ of the cells, as F psi~/(R T): zero at the first open end


def cell_potentials(column: Column, contents: Array, loads: Array) -> CellPotentials:
    """Potentials that follow from contents (balances, cells) by the momentum balance and Donnan equilibrium."""
    tissue, ions = column.cells, column.model.transports_ions
    held: Any = variables(contents[0], contents[1] if ions else np.zeros_like(contents[0]))
    J, s = held
    charge = fixed_charge_density(tissue, J)
    if ions:
        anion = s / (J - 1.0 + tissue.fluid_fraction)
        cation = charge + anion
        activity = log_activity(tissue.osmotic, charge, cation, anion)
    else:
        activity = bath_log_activity(tissue.osmotic, reference_concentration(loads, column.ends)) + 0.0 * s
        cation, anion = ion_concentrations(tissue.osmotic, charge, activity)
    pi = osmotic_pressure(tissue.osmotic, tissue.thermal_energy, charge, cation, anion)
    mu = uniaxial_stress(tissue.solid, J, tissue.fluid_fraction) + pressure_on_tissue(loads, column.ends) - pi
    zero = np.zeros(len(contents[0]))
    return CellPotentials(
        np.array([value_of(mu), value_of(activity)]),
        np.array([[slope_of(potential, k) + zero for k in (0, 1)] for potential in (mu, activity)]),
    )


def end_potentials(column: Column, loads: Array) -> Array:
    """The potentials mu_f and ln a~ of the baths at both ends, (2, ends)."""
    tissue, faces = column.faces, len(column.grid.widths) + 1
    values = np.empty((2, 2))
    for end, face in ((0, 0), (1, faces - 1)):
        concentration = loads[CONCENTRATION + 2 * end]
        pi = bath_osmotic_pressure(tissue.osmotic, tissue.thermal_energy, concentration)
        values[0, end] = loads[BATH_PRESSURE + 2 * end] - np.broadcast_to(pi, faces)[face]
        values[1, end] = np.broadcast_to(bath_log_activity(tissue.osmotic, concentration), faces)[face]
    return values


def face_fluxes(
    column: Column, initial_ratio: Array, contents: Array, potentials: Array, gradients: Array, loads: Array
) -> FaceFluxes:
    """Fluxes at all faces; none but the current passes closed ends, and the anions that an electrode exchanges.

    Parameters
    ----------
    column, initial_ratio
        The column, and k_open/k at the faces where its model holds it constant, else 1.
    contents
        Of the cells, (balances, cells).
    potentials, gradients
        mu_f and ln a~ of the lower bath, the cells and the upper bath, (2, cells + 2), and their gradients (2, faces).
    loads
        Values of `COLUMN_LOADS`.
    """
    last, stretch = len(column.grid.widths), column.grid.face_stretch(contents[0])
    activity = 0.5 * (potentials[1, 1:] + potentials[1, :-1])
    activity[[0, last]] = potentials[1, [0, last + 1]]
    closed = ~np.array([column.parts[0].open, *[True] * (last - 1), column.parts[1].open])
    current = current_along(loads) / FARADAY
    if column.model.transports_ions:
        fluxes = _ion_fluxes(column, stretch, activity, gradients, current)
        fluxes.fluxes[2, closed] = current
    else:
        state: Any = variables(stretch, activity, gradients[0])
        water = _water_flux(column, initial_ratio, loads, *state)
        slopes = np.array([[slope_of(water, k) + 0.0 * stretch for k in range(3)]])
        fluxes = FaceFluxes(value_of(water)[None], slopes[:, :2], slopes[:, 2:], np.zeros(last))
    fluxes.fluxes[:2, closed] = 0.0
    for end, sign in enumerate(column.ends[1]):
        if column.model.transports_ions and sign < 0.0:
            fluxes.fluxes[1, end * last] = -current
    fluxes.by_state[..., closed] = 0.0
    fluxes.by_gradient[..., closed] = 0.0
    return fluxes


def _ion_fluxes(column: Column, stretch: Array, activity: Array, gradients: Array, current: float) -> FaceFluxes:
    """Fluxes of water, anions and charge, psi~ being what makes the given current flow.

    Its gradient is an unknown of its own, but at the end where the current is given: there it is eliminated.
    """
    tissue, grid, grounded = column.faces, column.grid, 0 if column.parts[0].open else -1
    state: Any = variables(stretch, activity, *gradients, np.zeros_like(stretch))
    J, log_a, by_mu, by_salt, by_psi = state
    cation, anion = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), log_a)
    driving = tissue, J, cation, anion, by_mu / J, by_salt / J
    eliminated = potential_gradient_of_current(*driving, current)
    gradient: Any = value_of(eliminated * J)
    rows = []
    for potential_gradient in ((by_psi + gradient) / J, eliminated):
        through: Any = mixture_fluxes(*driving, potential_gradient)
        fluxes = (through.water, through.anion, through.cation - through.anion)
        values = np.array([value_of(flux) for flux in fluxes])
        slopes = np.array([[slope_of(flux, k) + 0.0 * stretch for k in range(5)] for flux in fluxes])
        rows.append((values, slopes))
    (values, slopes), (at_end, end_slopes) = rows
    given = -1 - grounded
    values[:, given], slopes[:, :, given] = at_end[:, given], end_slopes[:, :, given]
    slopes[2, :, given] = 0.0
    rise = gradient * grid.metric[0]
    psi = np.cumsum(rise[:-1]) if grounded == 0 else -np.cumsum(rise[:0:-1])[::-1]
    return FaceFluxes(values, slopes[:, :2], slopes[:, 2:], psi)


def _water_flux(column: Column, initial_ratio: Array, loads: Array, J: Any, log_activity: Any, gradient: Any) -> Any:
    """Flux of water where ions are in equilibrium with the bath, or do not matter."""
    tissue = column.faces
    k: Any = hydraulic_permeability(tissue, J)
    if column.model.open_circuit and column.open_circuit == "state":
        activity = bath_log_activity(tissue.osmotic, reference_concentration(loads, column.ends))
        ions = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), activity)
        return -k * open_circuit_ratio(tissue, J, *ions) * (gradient / J)
    return -k * initial_ratio * (gradient / J)
