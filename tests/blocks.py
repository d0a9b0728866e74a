"""Blocks of tissue that several tests use."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import sparse
from tissues import reference_tissue

from fvswell.block.block import make_block
from fvswell.block.edges import EdgeCondition
from fvswell.block.grid import BlockGrid, shaped_block_grid
from fvswell.block.system import BlockSystem
from fvswell.numerics.protocol import Drive, Protocol
from fvswell.physics.models import Mixture, Model
from fvswell.physics.tissue import Array, Tissue

BATH = 1.5e-4
# the 2D case of Wilson et al. (2005): glued below, symmetric on the left, draining on the right, under a plate
GLUED = {
    "left": EdgeCondition("roller"),
    "right": EdgeCondition("free", permeable=True),
    "bottom": EdgeCondition("fixed"),
    "top": EdgeCondition("tied"),
}
UNCONFINED = GLUED | {"bottom": EdgeCondition("roller")}
FREE = UNCONFINED | {"top": EdgeCondition("free", permeable=True)}
CLAMPED = dict.fromkeys(("left", "right", "bottom", "top"), EdgeCondition("fixed", permeable=True))
CLAMPED_DISC = CLAMPED | {"left": EdgeCondition("roller")}


def distorted_vertices(columns: int, rows: int, width: float = 2.0, height: float = 1.0, amount: float = 0.07) -> Array:
    """Vertices of a grid whose inner vertices are shifted smoothly; (2, rows + 1, columns + 1)."""
    x, y = np.meshgrid(np.linspace(0.0, 1.0, columns + 1), np.linspace(0.0, 1.0, rows + 1))
    shift = amount * np.sin(2 * np.pi * x) * np.sin(2 * np.pi * y)
    shift[[0, -1]] = shift[:, [0, -1]] = 0.0
    return np.stack([width * (x + shift), height * (y - shift)])


def rough_grid(kind: str, columns: int = 5, rows: int = 4, seed: int = 3) -> BlockGrid:
    """A 2 mm x 1 mm block whose inner vertices are shifted at random."""
    x, y = np.meshgrid(np.linspace(0.0, 2.0, columns + 1), np.linspace(0.0, 1.0, rows + 1))
    vertices = np.stack([x, y])
    size = np.array([2.0 / columns, 1.0 / rows])[:, None, None]
    vertices[:, 1:-1, 1:-1] += np.random.default_rng(seed).uniform(-0.25, 0.25, (2, rows - 1, columns - 1)) * size
    return shaped_block_grid(kind, vertices)


def block_system(
    grid: BlockGrid, edges: dict[str, EdgeCondition], model: Model, tissue: Tissue | None = None,
    ratio: Array | None = None,
) -> BlockSystem:  # fmt: skip
    """A system of reference tissue, the same everywhere."""
    tissue = reference_tissue() if tissue is None else tissue
    mixture = Mixture(model, tissue, np.array([[0.93]]), ratio)
    return BlockSystem(make_block(grid, edges, mixture, mixture, tissue))


def protocol(durations: Sequence[float], targets: Sequence[Sequence[float]], **drives: Any) -> Protocol:
    """Phases of a single body; drives as name=[(target, over), ...], with __ for the dot in a name."""

    def drive(values: Sequence[tuple[float, float]]) -> Drive:
        table = np.array(values, dtype=float).T
        return Drive(table[:1], table[1:])

    return Protocol(
        np.array([durations], dtype=float),
        {name.replace("__", "."): drive(values) for name, values in drives.items()},
        tuple(np.array([times], dtype=float) for times in targets),
    )


def random_unknowns(system: BlockSystem, seed: int = 5) -> Array:
    """A state far from rest, admissible, (unknowns,)."""
    block = system.block
    draw = np.random.default_rng(seed)
    unknowns = draw.uniform(-0.02, 0.02, block.pattern.size)
    potentials = unknowns[block.degrees_of_freedom.number :].reshape(len(block.balances), -1)
    potentials *= 5.0
    if len(potentials) > 1:
        potentials[1] += np.log(BATH)
    return unknowns


def jacobian_matrix(system: BlockSystem, values: Array) -> sparse.csc_array:
    """The Jacobian of a block from its values."""
    pattern = system.block.pattern
    return sparse.csc_array((values, (pattern.rows, pattern.columns)), shape=(pattern.size, pattern.size))
