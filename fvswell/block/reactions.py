"""What presses on the parts of the boundary of a block, and how far they have moved.

Forces and pressures are normal to the edge on which a part lies in the stress-free body, positive in compression, and
without the hydrostatic pressure of a bath. The force of a part that is held or driven is what holds its vertices where
they are, less what the pressures on the parts beside it do there. A vertex between two such parts of one edge counts
for both, in proportion to the areas of the faces beside it.
"""

from __future__ import annotations

import numpy as np

from fvswell.block.block import Block, BlockState
from fvswell.block.geometry import edge_area_vectors, edge_pressure_forces
from fvswell.block.part_loads import PartLoads
from fvswell.boundary.sides import EDGE_AXIS, OUTWARD
from fvswell.physics.tissue import Array

__all__ = ["part_areas", "part_displacements", "part_forces"]


def part_areas(block: Block, positions: Array) -> Array:
    """Areas of the parts, projected on their reference direction, ``(parts,)`` mm2; an axis has none.

    ``positions`` are those of the vertices, ``(2, vertices)``.
    """
    vectors = edge_area_vectors(block.grid.section, *positions[:, block.grid.face_vertices])
    return np.array(
        [
            OUTWARD[part.edge] * vectors[EDGE_AXIS[part.edge]][faces].sum()
            for part, faces in zip(block.parts, block.part_faces, strict=True)
        ]
    )


def part_displacements(block: Block, displacements: Array) -> Array:
    """Mean normal displacements of the parts, ``(..., parts)`` mm, from those of the vertices ``(..., 2, vertices)``.

    The mean is over the area of the stress-free solid; on an axis over its length.
    """
    means = []
    for part, faces in zip(block.parts, block.part_faces, strict=True):
        ends = block.grid.face_vertices[:, faces]
        areas = np.hypot(*edge_area_vectors(block.grid.section, *block.grid.vertices[:, ends]))
        if not areas.any():
            areas = np.hypot(*np.diff(block.grid.vertices[:, ends], axis=1)[:, 0])
        moved = displacements[..., EDGE_AXIS[part.edge], :][..., ends].mean(axis=-2)
        means.append(moved @ areas / areas.sum())
    return np.stack(means, axis=-1)


def part_forces(block: Block, state: BlockState, loads: PartLoads) -> Array:
    """Forces that press on the parts, ``(parts,)`` N: of a disc, or of a block 1 mm thick."""
    held = _vertex_forces(block, state)
    own, baths = (_pressure_forces(block, state.positions, of) for of in (loads.pressure, loads.bath_pressure))
    pressed = sum((*own, *baths), np.zeros_like(held))
    forces = loads.pressure * part_areas(block, state.positions)
    shares = _vertex_shares(block)
    for index, part in enumerate(block.parts):
        if part.mechanical == "free" or (block.grid.section.rings and part.edge == "left"):
            continue
        axis = EDGE_AXIS[part.edge]
        reaction = held[axis] - pressed[axis] + own[index][axis]
        forces[index] = -OUTWARD[part.edge] * float(shares[index] @ reaction)
    return forces


def _vertex_forces(block: Block, state: BlockState) -> Array:
    """What holds the vertices where they are against solid and fluid, ``(2, vertices)``."""
    vertices = block.grid.vertices.shape[1]
    corners = block.grid.cell_vertices.ravel()
    return np.stack(
        [np.bincount(corners, forces.ravel(), vertices) for forces in state.mechanics.forces.reshape(2, 4, -1)]
    )


def _pressure_forces(block: Block, positions: Array, pressures: Array) -> list[Array]:
    """Forces of the pressures on each part at the vertices, ``(2, vertices)`` each."""
    found = []
    for faces, pressure in zip(block.part_faces, pressures, strict=True):
        ends, total = block.grid.face_vertices[:, faces], np.zeros_like(positions)
        forces = edge_pressure_forces(block.grid.section, *positions[:, ends])
        for k, force in enumerate(forces):
            np.add.at(total[k // 2], ends[k % 2], pressure * force)
        found.append(total)
    return found


def _vertex_shares(block: Block) -> list[Array]:
    """Share of each vertex that counts for each part, ``(vertices,)`` each."""
    grid = block.grid
    areas = np.hypot(*edge_area_vectors(grid.section, *grid.vertices[:, grid.face_vertices]))
    beside = [np.zeros(grid.vertices.shape[1]) for _ in block.parts]
    for area, part, faces in zip(beside, block.parts, block.part_faces, strict=True):
        if part.mechanical != "free":
            np.add.at(area, grid.face_vertices[:, faces], areas[faces])
    none = np.zeros(grid.vertices.shape[1])
    total = {
        edge: sum((area for area, part in zip(beside, block.parts, strict=True) if part.edge == edge), none)
        for edge in grid.edges
    }
    return [
        np.divide(area, total[part.edge], out=np.zeros_like(area), where=total[part.edge] > 0.0)
        for area, part in zip(beside, block.parts, strict=True)
    ]
