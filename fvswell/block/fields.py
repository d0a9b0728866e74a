"""Fields of a block at a time, from the state of the time loop."""

from __future__ import annotations

import numpy as np

from fvswell.block.block import Block
from fvswell.block.geometry import SECTIONS, edge_area_vectors, polygon_volume
from fvswell.numerics.time_stepping import State
from fvswell.physics.constants import FARADAY
from fvswell.physics.electrochemistry import electric_potential, fixed_charge_density, fluid_fraction
from fvswell.physics.fluxes import ion_flux_parts
from fvswell.physics.models import PointState
from fvswell.physics.tissue import Array

__all__ = ["block_fields", "cell_gradients", "cell_vectors"]

Record = dict[str, Array]


def block_fields(block: Block, state: State) -> Record:
    """Every field that the model of a block has, by name.

    Returns
    -------
    dict
        At vertices ``displacement_x``, ``displacement_y`` (mm, from the stress-free solid); in cells, ``(cells,)``:
        volume ratio, pressures, effective stresses (means over the cell; zz is out of the plane, or the hoop),
        concentrations, potential, and fluxes per current area as vectors (``water_flux_x``, ...), those of ions in
        parts too (``cation_flux_diffusion_x``, ...); and the driven quantities, scalars, with ``_`` for the dot.
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
    vectors = {"water_flux": cell_vectors(block, positions, state.fluxes[0, 0])}
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
        anion, current = (cell_vectors(block, positions, totals) for totals in state.fluxes[1:, 0])
        vectors |= {"cation_flux": anion + current, "anion_flux": anion, "current_density": FARADAY * current}
        vectors |= _ion_flux_parts(block, positions, cells, vectors, bath)
    for name, vector in vectors.items():
        record[f"{name}_x"], record[f"{name}_y"] = vector
    return record


def _ion_flux_parts(block: Block, positions: Array, cells: PointState, fluxes: Record, bath: float) -> Record:
    """Convection, diffusion and migration in the cells, ``(2, cells)`` each."""
    term, tissue = block.term, block.term.cells.tissue
    # at the bath the laws take J of the cell inside
    outside = term.faces.at(cells.J[:, term.diamonds.cells[0]], np.full((1, len(term.diamonds.faces)), np.log(bath)))
    ions = (
        ("cation", cells.cation, outside.cation, tissue.cation_diffusivity),
        ("anion", cells.anion, outside.anion, tissue.anion_diffusivity),
    )
    record: Record = {}
    for ion, inside, at_faces, diffusivity in ions:
        gradient = cell_gradients(block, positions, inside[0], at_faces[0])
        parts = ion_flux_parts(
            tissue, cells.J, inside, diffusivity, fluxes[f"{ion}_flux"], fluxes["water_flux"], gradient
        )  # fmt: skip
        record |= {f"{ion}_flux_{part}": value for part, value in parts._asdict().items()}
    return record


def cell_gradients(block: Block, positions: Array, inside: Array, outside: Array) -> Array:
    """Gradients in the cells ``(2, cells)``, by least squares from the neighbours; exact for linear values.

    Parameters
    ----------
    block, positions
        The block and where its vertices are.
    inside, outside
        Values in the cells ``(cells,)``, and in the middles of the crossed faces ``(crossed,)``, of which those on
        permeable edges count.
    """
    grid, crossed = block.grid, block.term.diamonds
    centres = positions[:, grid.cell_vertices].mean(axis=1)
    middles = positions[:, grid.face_vertices[:, crossed.faces]].mean(axis=1)
    first, second = crossed.cells
    way = np.where(crossed.boundary, middles, centres[:, second]) - centres[:, first]
    rise = np.where(crossed.boundary, outside, inside[second]) - inside[first]
    way_squared = (way**2).sum(axis=0)
    normal, right = np.zeros((grid.cells, 2, 2)), np.zeros((grid.cells, 2))
    for cells, kept in ((first, slice(None)), (second, ~crossed.boundary)):
        np.add.at(normal, cells[kept], (way[:, None] * way / way_squared).T[kept])
        np.add.at(right, cells[kept], (way * rise / way_squared).T[kept])
    return np.einsum("cij,cj->ic", np.linalg.pinv(normal, hermitian=True), right)


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
