"""Putting a block together from its grid, the parts of its boundary and its tissue."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fvswell.block.assembly import JacobianPattern
from fvswell.block.block import Block
from fvswell.block.diamonds import diamonds
from fvswell.block.displacements import DegreesOfFreedom, degrees_of_freedom
from fvswell.block.grid import BlockGrid
from fvswell.block.laws import cell_law, face_law, solid_law
from fvswell.block.mechanics import block_solid
from fvswell.block.outside import Outside, crossed_parts, make_outside
from fvswell.block.part_checks import check_parts
from fvswell.block.parts import faces_of_parts, vertex_areas
from fvswell.block.stabilisation import STRENGTH, alternating_storage
from fvswell.block.transport import transport_tables
from fvswell.boundary.parts import LOADED, Part
from fvswell.numerics.sparse_lu import DirectSolver
from fvswell.physics.models import Model
from fvswell.physics.solids import shear_modulus
from fvswell.physics.tissue import Array, Tissue, tissue_parameters

__all__ = ["make_block", "unknown_places"]


def make_block(
    grid: BlockGrid, parts: Sequence[Part], model: Model, cells: Tissue, faces: Tissue, solid: Tissue,
    concentration: float, stabilisation: float = STRENGTH, sample: BlockGrid | None = None,
) -> Block:  # fmt: skip
    """Put a block together.

    Where the model has the streaming potential in its permeability, k_open/k follows the state; see
    `Block.with_open_circuit_ratio`.

    Parameters
    ----------
    grid
        Of the stress-free solid.
    parts
        Of the boundary, which together cover every edge once; they begin and end on lines of the grid.
    model
        What is transported.
    cells, faces, solid
        The tissue as the model sees it, at ``grid.centres``, at ``grid.face_centres`` (all faces) and at
        ``mechanics.integration_points(grid)``.
    concentration
        Of the bath that the block is equilibrated in, mmol/mm3.
    stabilisation
        Strength of what keeps checkerboards out, see `fvswell.block.stabilisation`.
    sample
        The same grid as the parts are given on it, if that is not the stress-free one.

    Raises
    ------
    ValueError
        If the parts contradict each other, leave the block loose or do not fit the grid; all problems in one message.
    """
    given = grid if sample is None else sample
    width, height = np.ptp(given.vertices, axis=1)
    if problems := check_parts(grid.section.rings, (width, height), parts):
        raise ValueError("; ".join(problems))
    of_parts, balances = faces_of_parts(given, parts), len(model.balances)
    none = np.zeros(0, dtype=int)
    crossed = diamonds(grid, np.concatenate([of_parts[i] for i in crossed_parts(parts, model.transports_ions)]))
    outside = make_outside(grid, crossed, parts, of_parts, balances)
    unknown = degrees_of_freedom(grid, parts, of_parts)
    pressed = [i for i, part in enumerate(parts) if LOADED[part.mechanical] or part.open]
    pressed_faces = np.concatenate([none, *(of_parts[i] for i in pressed)])
    modulus = np.broadcast_to(shear_modulus(cells.solid, cells.fluid_fraction), grid.cells)
    storage = alternating_storage(grid, modulus, stabilisation)
    own = _at_points(faces, crossed.faces)
    parameters = tissue_parameters(own, len(crossed.faces))
    tables = transport_tables(
        grid.cell_vertices, grid.volumes, storage, crossed, tissue_parameters(cells, grid.cells),
        np.vstack([parameters, np.ones(len(crossed.faces))]),
    )  # fmt: skip
    pattern = JacobianPattern(grid, crossed, outside, unknown, pressed_faces, storage, balances)
    return Block(
        grid=grid, model=model, cells=cells, faces=own, parts=tuple(parts), part_faces=of_parts,
        vertex_areas=vertex_areas(grid, parts, of_parts), degrees_of_freedom=unknown, diamonds=crossed,
        outside=outside, solid=block_solid(grid, solid), solid_class=type(solid.solid), stabilisation=storage,
        tables=tables, pattern=pattern,
        solver=DirectSolver(pattern.rows, pattern.columns, unknown_places(grid, unknown, outside, balances)),
        pressed_faces=pressed_faces, part_of_face=np.repeat(pressed, [len(of_parts[i]) for i in pressed]).astype(int),
        of_vertex=np.ascontiguousarray(unknown.of_vertex, dtype=np.int64), concentration=concentration,
        laws=(solid_law(solid), cell_law(cells), face_law(own, model, model.open_circuit)),
    )  # fmt: skip


def unknown_places(grid: BlockGrid, unknown: DegreesOfFreedom, outside: Outside, balances: int) -> Array:
    """Where on the grid the unknowns are, ``(2, unknowns)``; nan for those of plates and parts, in no single place."""
    places = np.empty((2, unknown.number))
    for unknowns in unknown.of_vertex:
        places[:, unknowns[unknowns >= 0]] = grid.lattice("vertices")[:, unknowns >= 0]
    moved = np.bincount(unknown.of_vertex[unknown.of_vertex >= 0], minlength=unknown.number)
    places[:, moved > 1] = np.nan
    return np.concatenate([places, np.tile(grid.lattice("cells"), balances), outside.places], axis=1)


def _at_points(tissue: Any, index: Array) -> Any:
    """A tissue, or a law, at a subset of its points."""
    if isinstance(tissue, tuple):
        return type(tissue)(*(_at_points(part, index) for part in tissue))
    return tissue[index] if np.ndim(tissue) > 0 and len(tissue) > 1 else tissue
