"""What presses on the parts of the boundary of a block, and how far they have moved.

Forces and pressures are normal to the edge on which a part lies in the stress-free body, positive in compression, and
without the hydrostatic pressure of a bath. The force of a part that is held or driven is what holds its vertices where
they are, less what the pressures on the parts beside it do there. What two such parts of one edge hold at the vertex
between them is divided as it would be under a uniform pressure.
"""

from __future__ import annotations

import numpy as np

from fvswell.block.block import Block, BlockState
from fvswell.block.geometry import edge_area_vectors, edge_pressure_forces
from fvswell.block.part_loads import PartLoads
from fvswell.boundary.parts import Part
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

    The mean is over the area of the stress-free solid; on an axis over its vertices.
    """
    means = []
    for index, (part, unit) in enumerate(zip(block.parts, _unit_forces(block), strict=True)):
        weights = np.abs(unit)
        if not weights.any():
            weights[block.grid.face_vertices[:, block.part_faces[index]]] = 1.0
        means.append(displacements[..., EDGE_AXIS[part.edge], :] @ weights / weights.sum())
    return np.stack(means, axis=-1)


def part_forces(block: Block, state: BlockState, loads: PartLoads) -> Array:
    """Forces that press on the parts, ``(parts,)`` N: of a disc, or of a block 1 mm thick."""
    held = _vertex_forces(block, state)
    own, baths = (_pressure_forces(block, state.positions, of) for of in (loads.pressure, loads.bath_pressure))
    pressed = sum((*own, *baths), np.zeros_like(held))
    forces = loads.pressure * part_areas(block, state.positions)
    units = _unit_forces(block)
    for index, part in enumerate(block.parts):
        if not _holds(part) or not units[index].any():
            continue
        beside = [k for k, other in enumerate(block.parts) if other.edge == part.edge and _holds(other)]
        axis, total = EDGE_AXIS[part.edge], sum((units[k] for k in beside), np.zeros(held.shape[1]))
        reaction = held[axis] - pressed[axis] + sum((own[k][axis] for k in beside), np.zeros(held.shape[1]))
        share = np.divide(units[index], total, out=np.zeros_like(total), where=total != 0.0)
        forces[index] = -OUTWARD[part.edge] * float(share @ reaction)
    return forces


def _holds(part: Part) -> bool:
    """Whether vertices of a part cannot move freely along its normal."""
    return part.mechanical != "free"


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
        ends, count = block.grid.face_vertices[:, faces], positions.shape[1]
        forces = np.stack(edge_pressure_forces(block.grid.section, *positions[:, ends])).reshape(2, -1)
        found.append(pressure * np.stack([np.bincount(ends.ravel(), force, count) for force in forces]))
    return found


def _unit_forces(block: Block) -> list[Array]:
    """Normal forces of a unit pressure on each part of the stress-free solid at the vertices, ``(vertices,)`` each."""
    forces = _pressure_forces(block, block.grid.vertices, np.ones(len(block.parts)))
    return [force[EDGE_AXIS[part.edge]] for force, part in zip(forces, block.parts, strict=True)]
