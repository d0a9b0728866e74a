"""Vectors and gradients in the cells of a block, from what is known at its faces and in its cells."""

from __future__ import annotations

from typing import Any

import numpy as np

from fvswell.block.block import Block
from fvswell.block.geometry import SECTIONS, edge_area_vectors, quadrilateral_volume
from fvswell.compiled import kernel
from fvswell.physics.tissue import Array

__all__ = ["cell_gradients", "cell_vectors"]

_SINGULAR = 1e-12  # determinant over squared trace: all neighbours lie in one direction
_PLANE = SECTIONS["plane-strain"]


def cell_vectors(block: Block, positions: Array, totals: Array) -> Array:
    """Mean flux vectors in the cells ``(fluxes, 2, cells)`` from the totals through all faces of the grid.

    By the divergence theorem for the moment of the flux about the cell's centre; exact for a uniform flux.

    Parameters
    ----------
    block, positions
        The block and where its vertices are.
    totals
        ``(fluxes, faces)``, positive from the first cell of a face to the second, or outward.
    """
    grid = block.grid
    vectors = np.zeros((len(totals), 2, grid.cells))
    _add_moments(
        grid.section, _PLANE, _integers(grid.cell_vertices), _integers(grid.face_vertices), _integers(grid.face_cells),
        positions, np.ascontiguousarray(totals), vectors,
    )  # fmt: skip
    return vectors / quadrilateral_volume(_PLANE, *positions[:, grid.cell_vertices])


def cell_gradients(block: Block, positions: Array, inside: Array, outside: Array) -> Array:
    """Gradients in the cells ``(values, 2, cells)``, by least squares from the neighbours; exact for linear values.

    Parameters
    ----------
    block, positions
        The block and where its vertices are.
    inside, outside
        Values in the cells ``(values, cells)``, and in the middles of the crossed faces ``(values, crossed)``, of which
        those on permeable edges count.
    """
    grid, crossed = block.grid, block.diamonds
    normal, right = np.zeros((3, grid.cells)), np.zeros((len(inside), 2, grid.cells))
    _add_differences(
        _integers(grid.cell_vertices), _integers(grid.face_vertices[:, crossed.faces]), _integers(crossed.cells),
        positions, np.ascontiguousarray(inside), np.ascontiguousarray(outside), normal, right,
    )  # fmt: skip
    xx, xy, yy = normal
    determinant, trace = xx * yy - xy * xy, xx + yy
    regular = determinant > _SINGULAR * trace * trace
    # of a matrix of rank one, the pseudo-inverse is itself over its squared trace
    scale = np.where(regular, determinant, np.where(trace > 0.0, trace * trace, 1.0))
    inverse = np.where(regular, [yy, -xy, xx], [xx, xy, yy]) / scale
    return np.stack(
        [inverse[0] * right[:, 0] + inverse[1] * right[:, 1], inverse[1] * right[:, 0] + inverse[2] * right[:, 1]],
        axis=1,
    )


def _integers(index: Array) -> Array:
    return np.ascontiguousarray(index, dtype=np.int64)


@kernel
def _add_moments(
    section: Any, plane: Any, cell_vertices: Any, face_vertices: Any, face_cells: Any, positions: Any, totals: Any,
    vectors: Any,
) -> None:  # fmt: skip
    """Add up the moments of the fluxes along the plane about the centres of the cells."""
    for f in range(face_cells.shape[1]):
        first, second = face_vertices[0, f], face_vertices[1, f]
        x, y = (positions[0, first], positions[0, second]), (positions[1, first], positions[1, second])
        along_x, along_y = edge_area_vectors(plane, x, y)
        area_x, area_y = edge_area_vectors(section, x, y)
        area = np.sqrt(area_x * area_x + area_y * area_y)
        if area == 0.0:  # on an axis
            continue
        share = np.sqrt(along_x * along_x + along_y * along_y) / area
        for side in range(2):
            c = face_cells[side, f]
            if c < 0:
                continue
            sign = 1.0 - 2.0 * side
            for component in range(2):
                arm = 0.5 * (positions[component, first] + positions[component, second])
                for corner in range(4):
                    arm -= 0.25 * positions[component, cell_vertices[corner, c]]
                for k in range(totals.shape[0]):
                    vectors[k, component, c] += sign * share * totals[k, f] * arm


@kernel
def _add_differences(
    cell_vertices: Any, face_vertices: Any, face_cells: Any, positions: Any, inside: Any, outside: Any, normal: Any,
    right: Any,
) -> None:  # fmt: skip
    """Add up both sides of the normal equations of the gradients."""
    for f in range(face_cells.shape[1]):
        first, second = face_cells[0, f], face_cells[1, f]
        x, y = 0.0, 0.0
        for corner in range(4):
            x -= 0.25 * positions[0, cell_vertices[corner, first]]
            y -= 0.25 * positions[1, cell_vertices[corner, first]]
            if second >= 0:
                x += 0.25 * positions[0, cell_vertices[corner, second]]
                y += 0.25 * positions[1, cell_vertices[corner, second]]
        if second < 0:
            for end in range(2):
                x += 0.5 * positions[0, face_vertices[end, f]]
                y += 0.5 * positions[1, face_vertices[end, f]]
        weight = 1.0 / (x * x + y * y)
        for side in range(2):
            c = face_cells[side, f]
            if c < 0:
                continue
            normal[0, c] += weight * x * x
            normal[1, c] += weight * x * y
            normal[2, c] += weight * y * y
            for k in range(inside.shape[0]):
                beyond = inside[k, second] if second >= 0 else outside[k, f]
                rise = weight * (beyond - inside[k, first])
                right[k, 0, c] += rise * x
                right[k, 1, c] += rise * y
