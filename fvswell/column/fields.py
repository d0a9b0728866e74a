"""Fields of a column at its outputs, all outputs at once: arrays (outputs, cells) or (outputs, nodes)."""

from __future__ import annotations

import numpy as np

from fvswell.column.balances import COLUMN_LOADS
from fvswell.column.column import Column
from fvswell.numerics.conservation import balance_errors
from fvswell.numerics.state import Record
from fvswell.physics.constants import FARADAY
from fvswell.physics.fluxes import ion_flux_parts, mixture_fluxes, potential_gradient_of_current
from fvswell.physics.osmotic import (
    bath_log_activity,
    bath_osmotic_pressure,
    ion_concentrations,
    log_activity,
    osmotic_pressure,
    virtual_concentration,
)
from fvswell.physics.permeability import hydraulic_permeability, open_circuit_ratio
from fvswell.physics.solids import uniaxial_stress
from fvswell.physics.tissue import Array, fixed_charge_density, fluid_fraction

__all__ = ["column_fields"]

Fields = dict[str, Array]


def column_fields(column: Column, initial_volume_ratio: Array, record: Record) -> Fields:
    """Every field that the model of a column has, by name; the first axis is that of the outputs.

    Parameters
    ----------
    column
        That was run.
    initial_volume_ratio
        J of the cells in equilibrium before the first phase.
    record
        Its outputs.
    """
    outputs = int(record.filled[0])
    contents, loads = record.contents[:outputs], record.loads[:outputs]
    J, grid, tissue = contents[:, 0], column.grid, column.cells
    pressure, height, bath = (
        loads[:, COLUMN_LOADS.index(name)] for name in ("pressure", "height", "filter_concentration")
    )
    charge = fixed_charge_density(tissue, J)
    if column.model.transports_ions:
        anion = contents[:, 1] / (J - 1.0 + tissue.fluid_fraction)
        cation = charge + anion
        activity = log_activity(tissue.osmotic, charge, cation, anion)
    else:
        activity = np.broadcast_to(bath_log_activity(tissue.osmotic, bath[:, None]), J.shape)
        cation, anion = ion_concentrations(tissue.osmotic, charge, activity)
    osmotic = np.broadcast_to(osmotic_pressure(tissue.osmotic, tissue.thermal_energy, charge, cation, anion), J.shape)
    stress = uniaxial_stress(tissue.solid, J, tissue.fluid_fraction)
    mu = stress + pressure[:, None] - osmotic
    moved = np.cumsum((J - 1.0) * grid.widths, axis=1)
    fields: Fields = {
        "global_strain": height / (initial_volume_ratio @ grid.widths) - 1.0,
        "global_strain_from_stress_free": height / grid.widths.sum() - 1.0,
        "height": height,
        "piston_pressure": pressure,
        "bath_concentration": bath,
        "volume_ratio": J,
        "fluid_fraction": fluid_fraction(tissue, J),
        "fluid_pressure": stress + pressure[:, None],
        "water_potential": mu,
        "effective_stress": stress,
        "displacement": np.concatenate([np.zeros((outputs, 1)), moved], axis=1),
    }
    potential, fluxes = _fluxes(column, J, mu, activity, cation, anion, loads)
    fields |= fluxes
    if column.model.swelling:
        fields |= {
            "osmotic_pressure": osmotic,
            "fixed_charge_density": charge,
            "cation_concentration": cation,
            "anion_concentration": anion,
            "virtual_concentration": virtual_concentration(tissue.osmotic, activity),
            # F xi/(R T) = F psi~/(R T) - ln(gamma_int c+/a~), and gamma_int^2 c+ c- = a~^2
            "electric_potential": tissue.thermal_energy / FARADAY * (potential - 0.5 * np.log(cation / anion)),
        }
    return fields | balance_errors(record, column.model.transports_ions)


def _fluxes(
    column: Column, J: Array, mu: Array, activity: Array, cation: Array, anion: Array, loads: Array
) -> tuple[Array, Fields]:
    """F psi~/(R T) in the cells, and the fluxes at the nodes with the parts of those of ions; see `column.balances`."""
    grid, tissue = column.grid, column.faces
    distance, _, _, mean_below, mean_above = grid.metric
    stretch = grid.face_stretch(J)
    shut = ~np.array([column.open_ends[0], *[True] * (len(grid.widths) - 1), column.open_ends[1]])
    outside = _outside(column, loads)
    mu, activity = (_with_ends(values, ends, column) for values, ends in zip((mu, activity), outside, strict=True))
    mu_gradient = np.diff(mu) / (distance * stretch)
    if not column.model.transports_ions:
        k = hydraulic_permeability(tissue, stretch) * _open_circuit(column, stretch, outside[1])
        return np.zeros_like(J), {"water_flux": np.where(shut, 0.0, -k * mu_gradient)}
    at_face = mean_below * activity[:, :-1] + mean_above * activity[:, 1:]
    at_face[:, 0], at_face[:, -1] = activity[:, 0], activity[:, -1]
    at_faces = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, stretch), at_face)
    ions: tuple[Array, Array] = at_faces
    gradient = np.diff(activity) / (distance * stretch)
    current = loads[:, COLUMN_LOADS.index("current"), None]
    slope = potential_gradient_of_current(tissue, stretch, *ions, mu_gradient, gradient, current)
    flux = mixture_fluxes(tissue, stretch, *ions, mu_gradient, gradient, slope)
    water, j_cation, j_anion = (np.where(shut, 0.0, part) for part in flux)
    fields: Fields = {"water_flux": water, "current_density": FARADAY * (j_cation - j_anion)}
    at_ends = _end_concentrations(column, J, outside[1])
    for name, at_faces, in_cells, ends, diffusivity, total in (
        ("cation", ions[0], cation, at_ends[0], tissue.cation_diffusivity, j_cation),
        ("anion", ions[1], anion, at_ends[1], tissue.anion_diffusivity, j_anion),
    ):
        slopes = np.diff(_with_ends(in_cells, ends, column)) / (distance * stretch)
        parts = ion_flux_parts(tissue, stretch, at_faces, diffusivity, total, water, slopes)
        fields[f"{name}_flux"] = total
        for part, value in parts._asdict().items():
            fields[f"{name}_flux_{part}"] = np.where(shut, 0.0, value)
    rise = np.where(shut, 0.0, slope * distance * stretch)
    return np.cumsum(rise[:, :-1], axis=1), fields


def _outside(column: Column, loads: Array) -> tuple[Array, Array]:
    """mu_f and ln a~ of the baths at both ends, (outputs, 2) each."""
    tissue = column.faces
    concentration = loads[:, [COLUMN_LOADS.index(f"{end}_concentration") for end in ("filter", "piston")]]
    pressure = loads[:, [COLUMN_LOADS.index(f"{end}_pressure") for end in ("filter", "piston")]]
    law = type(tissue.osmotic)(*(_at_ends(value) for value in tissue.osmotic))
    osmotic = bath_osmotic_pressure(law, _at_ends(tissue.thermal_energy), concentration)
    return pressure - osmotic, bath_log_activity(law, concentration)


def _at_ends(value: Array | float) -> Array | float:
    """A property of the faces at both ends of the column."""
    return value[[0, -1]] if isinstance(value, np.ndarray) and value.size > 1 else value


def _with_ends(cells: Array, ends: Array, column: Column) -> Array:
    """Values of the cells between those at open ends; at a closed end that of the cell beside it."""
    lower = ends[:, :1] if column.open_ends[0] else cells[:, :1]
    upper = ends[:, 1:] if column.open_ends[1] else cells[:, -1:]
    return np.concatenate([lower, cells, upper], axis=1)


def _open_circuit(column: Column, stretch: Array, bath_activity: Array) -> Array:
    """k_open/k at the nodes, as the model has it."""
    if column.model.open_circuit and column.open_circuit == "state":
        charge = fixed_charge_density(column.faces, stretch)
        ions = ion_concentrations(column.faces.osmotic, charge, bath_activity[:, :1])
        ratio: Array = open_circuit_ratio(column.faces, stretch, *ions)
        return ratio
    return column.open_circuit_ratio(column.initial_volume_ratio())


def _end_concentrations(column: Column, J: Array, bath_activity: Array) -> tuple[Array, Array]:
    """Ion concentrations just inside both ends, (outputs, 2), where J is extrapolated from the two cells there."""
    widths = column.grid.widths
    ends = []
    for first, second in ((0, 1), (-1, -2)):
        share = widths[first] / (widths[first] + widths[second])
        ends.append(J[:, first] - (J[:, second] - J[:, first]) * share)
    at_ends = np.stack(ends, axis=1)
    law = type(column.faces.osmotic)(*(_at_ends(value) for value in column.faces.osmotic))
    tissue = column.faces._replace(
        fluid_fraction=_at_ends(column.faces.fluid_fraction),
        fixed_charge_density=_at_ends(column.faces.fixed_charge_density),
    )
    concentrations: tuple[Array, Array] = ion_concentrations(law, fixed_charge_density(tissue, at_ends), bath_activity)
    return concentrations
