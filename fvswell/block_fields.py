"""Fields of a block at a time, from the state of the time loop."""

from __future__ import annotations

import numpy as np

from fvswell.block import Block
from fvswell.block_geometry import SECTIONS, edge_area_vectors, polygon_volume
from fvswell.constants import FARADAY
from fvswell.electrochemistry import electric_potential, fixed_charge_density, fluid_fraction
from fvswell.time_stepping import State
from fvswell.tissue import Array

__all__ = ["block_fields", "cell_vectors"]

Record = dict[str, Array]


def block_fields(block: Block, state: State) -> Record:
    """Every field that the model of a block has, by name.

    Returns
    -------
    dict
        At vertices ``displacement_x``, ``displacement_y`` (mm, from the stress-free solid); in cells, ``(cells,)``:
        volume ratio, pressures, effective stresses (means over the cell; zz is out of the plane, or the hoop),
        concentrations, potential, and fluxes per current area as vectors (``water_flux_x``, ...); and the driven
        quantities, scalars, with ``_`` for the dot in their names.
    """
    unknowns, bath = state.unknowns[0, 0], float(state.loads["bath"][0])
    term, positions, potentials = block.term, block.positions(unknowns), block.potentials(unknowns)
    J = block.volume_ratio(positions)
    log_concentration = term.log_concentration(potentials, bath)
    cells = term.cells.at(J, log_concentration)
    osmotic = np.broadcast_to(term.cells.osmotic_pressure(cells), J.shape)[0]
    corners = positions[:, block.grid.cell_vertices]
    stress = block.solid.cell_stress(block.solid.deformation_gradient(corners))
    displacement = positions - block.grid.vertices
    record: Record = {
        "bath_concentration": np.array(bath),
        **{name.replace(".", "_"): value[0] for name, value in state.loads.items() if name != "bath"},
        "displacement_x": displacement[0],
        "displacement_y": displacement[1],
        "volume_ratio": J[0],
        "fluid_fraction": fluid_fraction(term.cells.tissue, J)[0],
        "fluid_pressure": potentials[0, 0] + osmotic,
        "water_potential": potentials[0, 0],
        **{f"effective_stress_{name}": value for name, value in stress._asdict().items()},
    }
    fluxes = {"water_flux": state.fluxes[0, 0]}
    if term.cells.model.swelling:
        tissue = term.cells.tissue
        psi = potentials[2] if term.cells.model.transports_ions else np.zeros_like(J)
        record |= {
            "osmotic_pressure": osmotic,
            "fixed_charge_density": fixed_charge_density(tissue, J)[0],
            "cation_concentration": cells.cation[0],
            "anion_concentration": cells.anion[0],
            "virtual_concentration": np.exp(log_concentration)[0],
            "electric_potential": electric_potential(tissue, cells.cation, log_concentration, psi)[0],
        }
    if term.cells.model.transports_ions:
        _, anion, current = state.fluxes[:, 0]
        fluxes |= {"cation_flux": anion + current, "anion_flux": anion, "current_density": FARADAY * current}
    for name, totals in fluxes.items():
        record[f"{name}_x"], record[f"{name}_y"] = cell_vectors(block, positions, totals)
    return record


def cell_vectors(block: Block, positions: Array, totals: Array) -> Array:
    """Mean flux vectors in the cells ``(2, cells)`` from the totals through all faces of the grid ``(faces,)``.

    By the divergence theorem for the moment of the flux about the cell's centre; exact for a uniform flux.
    """
    grid = block.grid
    plane = SECTIONS["plane-strain"]
    ends = positions[:, grid.face_vertices]
    lengths = np.hypot(*edge_area_vectors(plane, ends))
    areas = np.hypot(*edge_area_vectors(grid.section, ends))
    along_plane = np.divide(totals * lengths, areas, out=np.zeros_like(totals), where=areas > 0.0)  # 0 on an axis
    centres = positions[:, grid.cell_vertices].mean(axis=1)
    moments = np.zeros_like(centres)
    for side, sign in ((0, 1.0), (1, -1.0)):
        faces = np.flatnonzero(grid.face_cells[side] >= 0)
        cell = grid.face_cells[side, faces]
        arms = ends[..., faces].mean(axis=1) - centres[:, cell]
        for component in (0, 1):
            np.add.at(moments[component], cell, sign * along_plane[faces] * arms[component])
    return moments / polygon_volume(plane, *positions[:, grid.cell_vertices])
