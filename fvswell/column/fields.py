"""Fields of a column at a time, from the state of the time loop."""

from __future__ import annotations

import numpy as np

from fvswell.column.column import Column, Loads
from fvswell.column.grid import ColumnGrid
from fvswell.numerics.time_stepping import State
from fvswell.physics.constants import FARADAY
from fvswell.physics.electrochemistry import (
    electric_potential,
    fixed_charge_density,
    fluid_fraction,
    ion_concentrations,
    osmotic_pressure,
)
from fvswell.physics.fluxes import ion_flux_parts
from fvswell.physics.models import Mixture, PointState
from fvswell.physics.solid import uniaxial_stress
from fvswell.physics.tissue import Array

__all__ = ["column_fields"]

Record = dict[str, Array]


def column_fields(grid: ColumnGrid, laws: Column, state: State, initial_height: float) -> Record:
    """Every field that the model of a single column has, by name.

    Parameters
    ----------
    grid, laws, state
        The column; its batch has one row.
    initial_height
        Height of the equilibrated sample, mm.
    """
    J, mixture = state.unknowns[0], laws.cells
    pressure, bath, height = (float(state.loads[name][0]) for name in ("pressure", "bath", "height"))
    loads = Loads(np.full((1, 1), pressure), np.full((1, 1), bath))
    unknowns = state.unknowns[: laws.state_size]
    log_concentration = np.broadcast_to(laws.log_concentration(unknowns, loads), J.shape)
    cells = laws.at_cells(unknowns, loads)
    stress = uniaxial_stress(mixture.tissue, J)
    record: Record = {
        "global_strain": np.array(height / initial_height - 1.0),
        "global_strain_from_stress_free": np.array(height / grid.widths.sum() - 1.0),
        "height": np.array(height),
        "applied_pressure": np.array(pressure),
        "bath_concentration": np.array(bath),
        "volume_ratio": J[0],
        "fluid_fraction": fluid_fraction(mixture.tissue, J)[0],
        "fluid_pressure": (stress + pressure)[0],
        "water_potential": laws.water_potential(cells, loads)[0],
        "effective_stress": stress[0],
        "displacement": np.concatenate([[0.0], np.cumsum((J[0] - 1.0) * grid.widths)]),
        "water_flux": state.fluxes[0, 0],
    }
    if mixture.model.swelling:
        potential = state.unknowns[2] if mixture.model.transports_ions else np.zeros_like(J)
        record |= _charged_fields(mixture, cells, log_concentration, potential)
    if mixture.model.transports_ions:
        record |= _ion_fluxes(grid, laws, state, loads)
    return record


def _charged_fields(mixture: Mixture, state: PointState, log_concentration: Array, potential: Array) -> Record:
    tissue, (J, cation, anion) = mixture.tissue, state
    return {
        "osmotic_pressure": osmotic_pressure(tissue, cation, anion)[0],
        "fixed_charge_density": fixed_charge_density(tissue, J)[0],
        "cation_concentration": cation[0],
        "anion_concentration": anion[0],
        "virtual_concentration": np.exp(log_concentration)[0],
        "electric_potential": electric_potential(tissue, cation, log_concentration, potential)[0],
    }


def _ion_fluxes(grid: ColumnGrid, laws: Column, state: State, loads: Loads) -> Record:
    """Ion fluxes and their parts at the nodes; zero at the piston."""
    J, log_c, _ = state.unknowns
    tissue, bath = laws.faces.tissue, np.log(loads.bath_concentration)
    J_face = grid.face_stretch(J)
    log_c_face = np.concatenate([bath, 0.5 * (log_c[:, 1:] + log_c[:, :-1])], axis=1)
    at_faces = ion_concentrations(tissue, J_face, log_c_face)
    in_cells = ion_concentrations(laws.cells.tissue, J, log_c)
    at_filter = ion_concentrations(tissue.points(slice(0, 1)), _filter_stretch(grid, J), bath)
    water, anion, current = state.fluxes[:, 0]
    record: Record = {"current_density": FARADAY * current}
    ions = (("cation", anion + current, tissue.cation_diffusivity), ("anion", anion, tissue.anion_diffusivity))
    for index, (ion, flux, diffusivity) in enumerate(ions):
        gradient = np.diff(in_cells[index], axis=1, prepend=at_filter[index]) / (grid.distances * J_face)
        parts = ion_flux_parts(
            tissue, J_face, at_faces[index], diffusivity, flux[None, :-1], water[None, :-1], gradient
        )  # fmt: skip
        record[f"{ion}_flux"] = flux
        for part, value in parts._asdict().items():
            record[f"{ion}_flux_{part}"] = np.append(value[0], 0.0)
    return record


def _filter_stretch(grid: ColumnGrid, J: Array) -> Array:
    """J at the filter, from the two cells above it; the fluxes use that of the first cell there, (rows, 1)."""
    return J[:, :1] - (J[:, 1:2] - J[:, :1]) * grid.distances[0] / grid.distances[1]
