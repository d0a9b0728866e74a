"""The stress-free block behind one that was measured in equilibrium with its first bath."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fvswell.block.block import Block
from fvswell.block.body import BlockBody
from fvswell.block.equilibrium import NoEquilibrium, equilibrated_body
from fvswell.block.grid import BlockGrid, shaped_block_grid
from fvswell.block.mechanics import integration_points
from fvswell.case.case import Case
from fvswell.numerics.state import State
from fvswell.physics.models import Model
from fvswell.physics.reference_state import stress_free_at, stress_free_tissue
from fvswell.physics.tissue import Array, Tissue

__all__ = ["BlockTissues", "stress_free_block", "tissues_at"]

_MAX_ITERATIONS = 200
_CONVERGED = 1e-11  # of the largest extent: where the vertices come to lie

BlockTissues = tuple[Tissue, Tissue, Tissue]  # in the cells, at all faces, at the integration points


def tissues_at(case: Case, model: Model, grid: BlockGrid) -> BlockTissues:
    """Tissue at the points of a grid, as a model sees it, with the numbers that the case gives."""
    cells, faces, solid = (
        model.tissue(case.tissue_at(at)) for at in (grid.centres, grid.face_centres, integration_points(grid))
    )
    return cells, faces, solid


def stress_free_block(
    case: Case, model: Model, sample: BlockGrid, make: Callable[[BlockGrid, BlockTissues], Block]
) -> tuple[BlockBody, State]:
    """The block whose vertices come to lie where those of the sample are, with the sample's numbers there.

    A fixed point: the vertices of the stress-free solid are moved by what those of the swollen one are off. The volume
    ratio of a cell is that of the two grids.

    Parameters
    ----------
    case, model
        Whose numbers are those of the equilibrated sample.
    sample
        Grid of the sample.
    make
        Puts a block together from the grid of the stress-free solid and its tissue.

    Raises
    ------
    NoEquilibrium
        If no such block is found.
    """
    measured = tissues_at(case, model, sample)
    _, guess = stress_free_tissue(measured[0], case.bath.concentration)
    if np.isnan(guess).any():
        raise NoEquilibrium("no stress-free solid would be such a sample in this bath")
    shape = _rows_and_columns(sample)
    vertices = sample.vertices / float(np.mean(guess)) ** (1.0 / 3.0)
    for _ in range(_MAX_ITERATIONS):
        try:
            grid = shaped_block_grid(case.geometry.kind, vertices.reshape(2, *shape))
        except ValueError:
            break
        swollen = sample.volumes / grid.volumes
        if not np.all(swollen * (1.0 - np.broadcast_to(measured[0].fluid_fraction, grid.cells)) < 1.0):
            break
        body, state = equilibrated_body(make(grid, _stress_free(measured, sample, swollen)))
        off = sample.vertices - body.block.positions(state.unknowns)
        if np.abs(off).max() <= _CONVERGED * np.ptp(sample.vertices, axis=1).max():
            return body, state
        vertices = vertices + off
    raise NoEquilibrium("no stress-free block was found that comes to the sample in its bath")


def _rows_and_columns(grid: BlockGrid) -> tuple[int, int]:
    """Vertices along y and along x."""
    columns = len(grid.edges["bottom"]) + 1
    return grid.vertices.shape[1] // columns, columns


def _stress_free(measured: BlockTissues, sample: BlockGrid, swollen: Array) -> BlockTissues:
    """Stress-free numbers of tissue whose cells were measured at the volume ratios ``swollen``; faces take the mean."""
    first, second = sample.face_cells
    at_faces = 0.5 * (swollen[first] + swollen[np.where(second < 0, first, second)])
    ratios = (swollen, at_faces, np.tile(swollen, 4))
    cells, faces, solid = (stress_free_at(tissue, J) for tissue, J in zip(measured, ratios, strict=True))
    return cells, faces, solid
