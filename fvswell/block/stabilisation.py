"""Keeping checkerboards out of the pressure of a block just after its load jumps.

Before water has had time to flow, cells neither take up nor lose any, and bilinear displacements with one pressure in
each cell then leave the pressures of cells around a vertex free to alternate (the element Q1-P0 of incompressible
elasticity). As Silvester & Kechkar (1990) do for Stokes flow on blocks of four cells, the alternating part

    chi = mu_1 - mu_2 + mu_3 - mu_4    around each inner vertex

is made to cost something: cell i stores besides its water the volume +-(strength V/G) chi, V and G being the mean
volume and shear modulus of the four cells. What one cell stores its neighbours lack, so the total volume is conserved.
chi is zero for fields that are linear or depend on one direction of the grid only, and falls with the square of the
cell size for smooth ones, so what a cell stores (a difference of chi twice over) falls with its fourth power.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from fvswell.block.grid import BlockGrid
from fvswell.physics.tissue import Array

__all__ = ["STRENGTH", "alternating_storage"]

STRENGTH = 0.02


def alternating_storage(grid: BlockGrid, shear_modulus: Array, strength: float = STRENGTH) -> sparse.csr_array:
    """Volume stored by each cell per water potential, ``(cells, cells)`` mm3/MPa: symmetric, positive semidefinite.

    Parameters
    ----------
    grid
        Of the block.
    shear_modulus
        Of the cells, ``(cells,)`` MPa.
    strength
        How much is stored; `STRENGTH` keeps the checkerboards out, and more changes the answer for nothing.
    """
    columns, rows = grid.shape
    cell = np.arange(grid.cells).reshape(rows, columns)
    around = np.stack([cell[:-1, :-1], cell[:-1, 1:], cell[1:, 1:], cell[1:, :-1]]).reshape(4, -1)
    vertices = around.shape[1]
    signs = np.repeat([1.0, -1.0, 1.0, -1.0], vertices)
    alternating = sparse.csr_array(
        (signs, (np.tile(np.arange(vertices), 4), around.ravel())), shape=(vertices, grid.cells)
    )
    weights = strength * grid.volumes[around].mean(axis=0) / shear_modulus[around].mean(axis=0)
    return (alternating.T @ sparse.diags_array(weights) @ alternating).tocsr()
