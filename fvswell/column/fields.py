"""Fields of a column at its outputs, all outputs at once: arrays (outputs, cells) or (outputs, nodes)."""

from __future__ import annotations

import numpy as np

from fvswell.column.balances import COLUMN_LOADS, electrode_rise
from fvswell.column.column import Column
from fvswell.column.histories import column_histories
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
from fvswell.physics.tissue import (
    Array,
    Tissue,
    first_rows,
    fixed_charge_density,
    fluid_fraction,
    tissue_at,
    tissue_parameters,
)

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
    height, pressure, bath = _load(loads, "height"), _load(loads, "pressure"), _reference_concentration(column, loads)
    if column.parts[1].open:
        pressure = pressure + _load(loads, "piston_bath_pressure")
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
        "bath_concentration": bath,
        "volume_ratio": J,
        "fluid_fraction": fluid_fraction(tissue, J),
        "fluid_pressure": stress + pressure[:, None],
        "water_potential": mu,
        "effective_stress": stress,
        "displacement": np.concatenate([np.zeros((outputs, 1)), moved], axis=1),
    }
    rise, fluxes = _fluxes(column, J, mu, activity, cation, anion, loads)
    histories = column_histories(column, initial_volume_ratio, record, rise.sum(axis=1))
    fields |= histories | fluxes
    level = histories.get(f"{column.parts[0].name}_potential", np.zeros(outputs))
    if column.model.swelling:
        fields |= {
            "osmotic_pressure": osmotic,
            "fixed_charge_density": charge,
            "cation_concentration": cation,
            "anion_concentration": anion,
            "virtual_concentration": virtual_concentration(tissue.osmotic, activity),
            # F xi/(R T) = F psi~/(R T) - ln(gamma_int c+/a~), and gamma_int^2 c+ c- = a~^2
            "electric_potential": level[:, None]
            + np.cumsum(rise[:, :-1], axis=1)
            - 0.5 * tissue.thermal_energy / FARADAY * np.log(cation / anion),
        }
    return fields | balance_errors(record, column.model.transports_ions)


def _load(loads: Array, name: str) -> Array:
    """A load at the outputs."""
    return loads[:, COLUMN_LOADS.index(name)]


def _reference_concentration(column: Column, loads: Array) -> Array:
    """Salt concentration of the bath of the first open part."""
    end = "piston" if column.parts[1].open and not column.parts[0].open else "filter"
    return _load(loads, f"{end}_bath_concentration")


def _fluxes(
    column: Column, J: Array, mu: Array, activity: Array, cation: Array, anion: Array, loads: Array
) -> tuple[Array, Fields]:
    """Rise of the potential across the faces, mV, and the fluxes at the nodes with the parts of those of ions.

    See `fvswell.column.balances`.
    """
    grid, tissue = column.grid, column.faces
    distance, _, _, mean_below, mean_above = grid.metric
    stretch = grid.face_stretch(J)
    opened = column.ends[0] != 0.0
    shut = ~np.array([opened[0], *[True] * (len(grid.widths) - 1), opened[1]])
    outside = _outside(column, loads)
    in_cells = activity
    mu, activity = (_with_ends(values, ends, column) for values, ends in zip((mu, activity), outside, strict=True))
    mu_gradient = np.diff(mu) / (distance * stretch)
    if not column.model.transports_ions:
        k = hydraulic_permeability(tissue, stretch) * _open_circuit(column, stretch, loads)
        return np.zeros(stretch.shape), {"water_flux": np.where(shut, 0.0, -k * mu_gradient)}
    at_face = mean_below * activity[:, :-1] + mean_above * activity[:, 1:]
    at_face[:, 0], at_face[:, -1] = activity[:, 0], activity[:, -1]
    at_faces = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, stretch), at_face)
    ions: tuple[Array, Array] = at_faces
    gradient = np.diff(activity) / (distance * stretch)
    current = _load(loads, "filter_current")[:, None] / FARADAY
    slope = potential_gradient_of_current(tissue, stretch, *ions, mu_gradient, gradient, current)
    flux = mixture_fluxes(tissue, stretch, *ions, mu_gradient, gradient, slope)
    water, j_cation, j_anion = (np.where(shut, 0.0, part) for part in flux)
    nothing_passes = shut.copy()
    rise = tissue.thermal_energy / FARADAY * np.where(shut, 0.0, slope * distance * stretch)
    for end, sign in enumerate(column.ends[1]):
        if sign != 0.0:
            (j_cation if sign > 0.0 else j_anion)[:, -end] = sign * current[:, 0]
            rise[:, -end] = _electrode_rise(column, end, J, in_cells, loads)
            nothing_passes[-end] = False
    fields: Fields = {"water_flux": water, "current_density": FARADAY * (j_cation - j_anion)}
    at_ends = _end_concentrations(column, J, outside[1])
    for name, at_faces, in_cells, ends, diffusivity, total in (
        ("cation", ions[0], cation, at_ends[0], tissue.cation_diffusivity, j_cation),
        ("anion", ions[1], anion, at_ends[1], tissue.anion_diffusivity, j_anion),
    ):
        slopes = np.diff(_with_ends(in_cells, ends, column)) / (distance * stretch)
        _extrapolate_to_electrodes(column, slopes)
        parts = ion_flux_parts(tissue, stretch, at_faces, diffusivity, total, water, slopes)
        fields[f"{name}_flux"] = total
        for part, value in parts._asdict().items():
            fields[f"{name}_flux_{part}"] = np.where(nothing_passes, 0.0, value)
    return rise, fields


def _extrapolate_to_electrodes(column: Column, slopes: Array) -> None:
    """Slopes of a concentration at walls with electrodes, from those at the two faces next to each."""
    nodes = column.grid.nodes
    for wall, near, far in ((0, 1, 2), (-1, -2, -3)):
        if column.ends[1, wall] != 0.0:
            share = (nodes[near] - nodes[wall]) / (nodes[far] - nodes[near])
            slopes[:, wall] = slopes[:, near] + share * (slopes[:, near] - slopes[:, far])


def _electrode_rise(column: Column, end: int, J: Array, activity: Array, loads: Array) -> Array:
    """Rise of the potential between an electrode in the wall at an end and the centre of the cell there, mV."""
    tissue = _tissue_at_end(column, end)
    reference = bath_log_activity(tissue.osmotic, _reference_concentration(column, loads))
    rise, _ = electrode_rise(
        tissue, column.ends[1, end], end, J[:, -end], activity[:, -end], reference, column.grid.metric[0, -end],
        _load(loads, "filter_current") / FARADAY,
    )  # fmt: skip
    value: Array = tissue.thermal_energy / FARADAY * rise
    return value


def _tissue_at_end(column: Column, end: int) -> Tissue:
    """Tissue at the face at an end: numbers."""
    faces, count = column.faces, len(column.grid.widths) + 1
    laws = type(faces.solid), type(faces.permeability), type(faces.osmotic)
    tissue: Tissue = tissue_at(*laws, first_rows(*laws), tissue_parameters(faces, count), end * (count - 1))
    return tissue


def _outside(column: Column, loads: Array) -> tuple[Array, Array]:
    """mu_f and ln a~ of the baths at both ends, (outputs, 2) each."""
    mu, activity = np.empty((len(loads), 2)), np.empty((len(loads), 2))
    for end, name in enumerate(("filter", "piston")):
        tissue, concentration = _tissue_at_end(column, end), _load(loads, f"{name}_bath_concentration")
        osmotic = bath_osmotic_pressure(tissue.osmotic, tissue.thermal_energy, concentration)
        mu[:, end] = _load(loads, f"{name}_bath_pressure") - osmotic
        activity[:, end] = bath_log_activity(tissue.osmotic, concentration)
    return mu, activity


def _with_ends(cells: Array, ends: Array, column: Column) -> Array:
    """Values of the cells between those at open ends; at a closed end that of the cell beside it."""
    lower = ends[:, :1] if column.parts[0].open else cells[:, :1]
    upper = ends[:, 1:] if column.parts[1].open else cells[:, -1:]
    return np.concatenate([lower, cells, upper], axis=1)


def _open_circuit(column: Column, stretch: Array, loads: Array) -> Array:
    """k_open/k at the nodes, as the model has it."""
    if column.model.open_circuit and column.open_circuit == "state":
        charge = fixed_charge_density(column.faces, stretch)
        activity = bath_log_activity(column.faces.osmotic, _reference_concentration(column, loads)[:, None])
        ratio: Array = open_circuit_ratio(
            column.faces, stretch, *ion_concentrations(column.faces.osmotic, charge, activity)
        )
        return ratio
    return column.open_circuit_ratio(column.initial_volume_ratio())


def _end_concentrations(column: Column, J: Array, bath_activity: Array) -> tuple[Array, Array]:
    """Ion concentrations just inside both ends, (outputs, 2), where J is extrapolated from the two cells there."""
    widths = column.grid.widths
    ends = []
    for end, (first, second) in enumerate(((0, 1), (-1, -2))):
        share = widths[first] / (widths[first] + widths[second])
        at_end = J[:, first] - (J[:, second] - J[:, first]) * share
        tissue = _tissue_at_end(column, end)
        ends.append(ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, at_end), bath_activity[:, end]))
    cation, anion = (np.stack(ions, axis=1) for ions in zip(*ends, strict=True))
    return cation, anion
