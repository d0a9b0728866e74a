"""Unknown displacements of a block: what the parts of its boundary hold, and what they make move as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from fvswell.block.grid import BlockGrid
from fvswell.block.part_loads import PartLoads
from fvswell.boundary.parts import Part
from fvswell.boundary.sides import EDGE_AXIS
from fvswell.physics.tissue import Array

__all__ = ["DegreesOfFreedom", "degrees_of_freedom"]


@dataclass(frozen=True)
class DegreesOfFreedom:
    """Unknown displacements: each component of each vertex moves with one of them, or is held."""

    number: int
    of_vertex: Array  # (2, vertices): index of the unknown, -1 where held
    normal: Array  # (parts,) index of the normal displacement of a plate, straight or glued; -1 of other parts
    tangential: Array  # (parts,) index of the tangential displacement of a glued plate; -1 where held, and of others
    names: tuple[str, ...]  # of the parts

    def displacements(self, values: Array) -> Array:
        """Displacements of the vertices ``(2, vertices)`` from the unknowns."""
        return np.append(values, 0.0)[self.of_vertex]

    def prescribed(self, loads: PartLoads) -> dict[int, float]:
        """Unknowns whose values are given, and these, mm.

        Raises
        ------
        ValueError
            If a plate that is held is to be moved, or two that move as one are to be moved differently.
        """
        targets: dict[int, float] = {}
        for kind, indices, values in (
            ("displacement", self.normal, loads.displacement),
            ("tangential displacement", self.tangential, loads.tangential_displacement),
        ):
            for part in np.flatnonzero(~np.isnan(values)):
                index, value = int(indices[part]), float(values[part])
                if index < 0 and value != 0.0:
                    raise ValueError(f"the {kind} of {self.names[part]} is held at 0 and cannot be given")
                if targets.get(index, value) != value and index >= 0:
                    raise ValueError(
                        f"the {kind} of {self.names[part]} is that of another part, which is given as well"
                    )
                if index >= 0:
                    targets[index] = value
        return targets


def degrees_of_freedom(grid: BlockGrid, parts: Sequence[Part], faces: Sequence[Array]) -> DegreesOfFreedom:
    """Number the unknown displacements of a block.

    Parameters
    ----------
    grid
        Of the block.
    parts, faces
        Of its boundary, see `parts.faces_of_parts`. The vertices of a straight part share their normal displacement,
        those of a glued plate the tangential one as well; a glued plate on an axis can have none.
    """
    own = np.arange(grid.vertices.size).reshape(grid.vertices.shape)
    pairs: list[Array] = [np.empty((2, 0), dtype=int)]
    held: list[Array] = []
    vertices = [np.unique(grid.face_vertices[:, of_part]) for of_part in faces]
    for part, at in zip(parts, vertices, strict=True):
        normal = EDGE_AXIS[part.edge]
        if part.mechanical == "fixed":
            held.append(own[:, at].ravel())
        elif part.mechanical == "roller":
            held.append(own[normal, at])
        elif part.mechanical in ("straight", "glued-plate"):
            axes = (normal,) if part.mechanical == "straight" else (0, 1)
            pairs += [np.stack([own[axis, at[:-1]], own[axis, at[1:]]]) for axis in axes]
            if part.mechanical == "glued-plate" and grid.section.rings and normal == 1:
                held.append(own[0, at])
    first, second = np.concatenate(pairs, axis=1)
    graph = sparse.coo_array((np.ones(len(first)), (first, second)), shape=(own.size, own.size))
    number, label = connected_components(graph, directed=False)
    lowest = np.full(number, own.size)
    np.minimum.at(lowest, label, np.arange(own.size))
    if held:
        lowest[label[np.concatenate(held)]] = -1
    used, renumbered = np.unique(lowest[label], return_inverse=True)
    below = int(used[0] < 0)
    of_vertex = renumbered.reshape(own.shape) - below

    def of_plates(kinds: tuple[str, ...], tangential: bool) -> Array:
        return np.array(
            [
                of_vertex[EDGE_AXIS[part.edge] ^ tangential, at[0]] if part.mechanical in kinds else -1
                for part, at in zip(parts, vertices, strict=True)
            ],
            dtype=int,
        )

    return DegreesOfFreedom(
        len(used) - below, of_vertex, of_plates(("straight", "glued-plate"), tangential=False),
        of_plates(("glued-plate",), tangential=True), tuple(part.name for part in parts),
    )  # fmt: skip
