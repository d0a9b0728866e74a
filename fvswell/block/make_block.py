"""Putting a block together from its grid, its edges and its tissue."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fvswell.block.assembly import JacobianPattern
from fvswell.block.block import Block
from fvswell.block.diamonds import diamonds
from fvswell.block.edges import DegreesOfFreedom, EdgeCondition, check_edges, degrees_of_freedom
from fvswell.block.grid import BlockGrid
from fvswell.block.laws import cell_law, face_law, solid_law
from fvswell.block.mechanics import block_solid
from fvswell.block.stabilisation import STRENGTH, alternating_storage
from fvswell.block.transport import transport_tables
from fvswell.boundary.sides import EDGES
from fvswell.numerics.sparse_lu import DirectSolver
from fvswell.physics.models import Model
from fvswell.physics.solids import shear_modulus
from fvswell.physics.tissue import Array, Tissue, tissue_parameters

__all__ = ["make_block", "unknown_places"]


def make_block(
    grid: BlockGrid, edges: Mapping[str, EdgeCondition], model: Model, cells: Tissue, faces: Tissue, solid: Tissue,
    concentration: float, stabilisation: float = STRENGTH,
) -> Block:  # fmt: skip
    """Put a block together.

    Where the model has the streaming potential in its permeability, k_open/k follows the state; see
    `Block.with_open_circuit_ratio`.

    Parameters
    ----------
    grid
        Of the stress-free solid.
    edges
        A condition for each of left, right, bottom and top.
    model
        What is transported.
    cells, faces, solid
        The tissue as the model sees it, at ``grid.centres``, at ``grid.face_centres`` (all faces) and at
        ``mechanics.integration_points(grid)``.
    concentration
        Of the bath that the block is equilibrated in, mmol/mm3.
    stabilisation
        Strength of what keeps checkerboards out, see `fvswell.block.stabilisation`.

    Raises
    ------
    ValueError
        If the conditions on the edges contradict each other or leave the block loose; all problems in one message.
    """
    if problems := check_edges(grid.section.rings, edges):
        raise ValueError("; ".join(problems))
    crossed = diamonds(grid, [edge for edge in EDGES if edges[edge].permeable])
    unknown = degrees_of_freedom(grid, edges)
    loaded = [i for i, edge in enumerate(EDGES) if edges[edge].displacement in ("free", "straight")]
    modulus = np.broadcast_to(shear_modulus(cells.solid, cells.fluid_fraction), grid.cells)
    storage = alternating_storage(grid, modulus, stabilisation)
    edge_faces = np.concatenate([np.zeros(0, dtype=int), *(grid.edges[EDGES[i]] for i in loaded)])
    own = _at_points(faces, crossed.faces)
    parameters = tissue_parameters(own, len(crossed.faces))
    tables = transport_tables(
        grid.cell_vertices, grid.volumes, storage, crossed, tissue_parameters(cells, grid.cells),
        np.vstack([parameters, np.ones(len(crossed.faces))]),
    )  # fmt: skip
    pattern = JacobianPattern(grid, crossed, unknown, edge_faces, storage, len(model.balances))
    return Block(
        grid=grid, model=model, cells=cells, faces=own, edges=dict(edges), degrees_of_freedom=unknown,
        diamonds=crossed, solid=block_solid(grid, solid), solid_class=type(solid.solid), stabilisation=storage,
        tables=tables, pattern=pattern,
        solver=DirectSolver(pattern.rows, pattern.columns, unknown_places(grid, unknown, len(model.balances))),
        edge_faces=edge_faces, edge_of_face=np.repeat(loaded, [len(grid.edges[EDGES[i]]) for i in loaded]).astype(int),
        of_vertex=np.ascontiguousarray(unknown.of_vertex, dtype=np.int64), concentration=concentration,
        laws=(solid_law(solid), cell_law(cells), face_law(own, model, model.open_circuit)),
    )  # fmt: skip


def unknown_places(grid: BlockGrid, unknown: DegreesOfFreedom, balances: int) -> Array:
    """Where on the grid the unknowns are, ``(2, unknowns)``; nan for tied edges, which are in no single place."""
    places = np.empty((2, unknown.number + balances * grid.cells))
    for unknowns in unknown.of_vertex:
        places[:, unknowns[unknowns >= 0]] = grid.lattice("vertices")[:, unknowns >= 0]
    places[:, list(unknown.of_tied_edge.values())] = np.nan
    places[:, unknown.number :] = np.tile(grid.lattice("cells"), balances)
    return places


def _at_points(tissue: Any, index: Array) -> Any:
    """A tissue, or a law, at a subset of its points."""
    if isinstance(tissue, tuple):
        return type(tissue)(*(_at_points(part, index) for part in tissue))
    return tissue[index] if np.ndim(tissue) > 0 and len(tissue) > 1 else tissue
