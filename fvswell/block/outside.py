"""What lies beyond the boundary faces that are crossed: baths and electrodes, known or found.

On these faces all potentials have values, which are linear in those of the baths (given) and in further unknowns:

    open part, conducting   mu_f and ln a~ of its bath, psi~ of the part: given, or one unknown for the whole part,
                            with the equation that the net current through the part is the given one, or none
    open part, insulating   mu_f and ln a~ of its bath, psi~ an unknown of each face: no current through the face
    electrode in the wall   mu_f and ln a~ unknowns of each face: neither water nor the ion that is not exchanged
                            passes; psi~ +- ln a~ is that of a like electrode in the reference bath plus the potential
                            of the electrode, given or found as above (+ of cations, - of anions)

The reference bath is that of the first open part. In models without ions mu_f is all there is. Vertices between faces
with one value have that value, or the mean of two; where values differ from face to face they are interpolated, and
extrapolated to the ends, linearly along the edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse

from fvswell.block.diamonds import Diamonds
from fvswell.block.grid import BlockGrid
from fvswell.boundary.parts import CONDUCTING, Part
from fvswell.physics.tissue import Array

__all__ = ["Beyond", "Outside", "crossed_parts", "make_outside"]

WATER, ANIONS, CHARGE = 0, 1, 2  # potentials mu_f, ln a~ and F psi~/(R T), and their balances


class Beyond(NamedTuple):
    """What the values beyond the boundary add to the differences of the potentials at the crossed faces."""

    across: Array  # (balances, crossed)
    along: Array  # (balances, crossed)
    log_bath: float  # ln a~ of the reference bath


@dataclass(frozen=True)
class Outside:
    """Constant maps from the values of the baths and the unknowns of the boundary, in this order, to faces.

    The values of the baths are ``(parts, balances)``, see the head of this module; an unknown has the equation of the
    same number.
    """

    across: sparse.csr_array  # (balances * crossed, values): differences of the potentials across faces
    along: sparse.csr_array  # and along them
    closing: sparse.csr_array  # (unknowns, balances * crossed): fluxes that make up the equations
    potential: Array  # (unknowns,) which potential each of them is
    cell: Array  # (unknowns,) that it borders on, the first of several
    volume: Array  # (unknowns,) of all cells that it borders on, mm3
    part: Array  # (unknowns,) index of the part
    shared: Array  # (unknowns,) whether it is the potential of a whole part
    places: Array  # (2, unknowns) on the grid, nan where it is in no single place
    reference: int  # part whose bath is the reference

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return len(self.potential)

    def part_potential(self, part: int) -> int | None:
        """Index of the unknown that is the potential of a part."""
        found = np.flatnonzero(self.shared & (self.part == part))
        return int(found[0]) if len(found) else None


def crossed_parts(parts: Sequence[Part], transports_ions: bool) -> list[int]:
    """Indices of the parts that anything crosses: those that are open, and where ions move those with electrodes."""
    return [
        index for index, part in enumerate(parts) if part.open or (transports_ions and part.electrical in CONDUCTING)
    ]


def make_outside(
    grid: BlockGrid, diamonds: Diamonds, parts: Sequence[Part], faces: Sequence[Array], balances: int
) -> Outside:
    """Number the unknowns of the boundary and set up the maps.

    Parameters
    ----------
    grid, diamonds
        Of the block.
    parts, faces
        Of its boundary, and their faces.
    balances
        Number of transport balances: 1, or 3 where ions are transported.
    """
    crossing = crossed_parts(parts, balances > 1)
    builder = _Builder(grid, diamonds, parts, balances)
    for index in crossing:
        builder.add(index, np.searchsorted(diamonds.faces, faces[index]))
    return builder.finish()


_Entries = tuple[Array, Array, float]  # rows, columns and weight of entries of a matrix


class _Unknown(NamedTuple):
    """Of `Outside`."""

    potential: int
    cell: int
    volume: float
    part: int
    shared: bool


class _Builder:
    """Collects what the boundary faces are made of, part by part."""

    def __init__(self, grid: BlockGrid, diamonds: Diamonds, parts: Sequence[Part], balances: int) -> None:
        self._grid, self._diamonds, self._parts, self._balances = grid, diamonds, parts, balances
        self._given = len(parts) * balances
        self._reference = next((index for index, part in enumerate(parts) if part.open), 0)
        self._forms: list[_Entries] = []  # potentials and faces, values
        self._equations: list[_Entries] = []  # unknowns, balances and faces
        self._unknowns: list[_Unknown] = []
        self._places: list[Array] = []
        self._uniform = np.zeros((balances, len(diamonds.faces)), dtype=bool)

    def add(self, index: int, faces: Array) -> None:
        """Add the faces of a part, which are numbered among those that are crossed."""
        part = self._parts[index]
        if part.open:
            for potential in range(min(self._balances, CHARGE)):
                self._uniform[potential, faces] = True
                self._form(potential, faces, self._bath(index, potential))
        if self._balances == 1:
            return
        if part.open and part.electrical not in CONDUCTING:
            own = self._new(CHARGE, index, faces)
            self._form(CHARGE, faces, own)
            self._equation(own, CHARGE, faces)
            return
        self._form(CHARGE, faces, self._part_potential(index, faces))
        if part.open:
            self._uniform[CHARGE, faces] = True
        else:
            self._electrode(part, index, faces)

    def finish(self) -> Outside:
        """Put the maps together."""
        faces, values = len(self._diamonds.faces), self._given + len(self._unknowns)
        across = _matrix(self._forms, (self._balances * faces, values))
        along = []
        for potential in range(self._balances):
            to_vertices = _vertex_weights(self._grid, self._diamonds, self._uniform[potential])
            of_faces = across[potential * faces : (potential + 1) * faces]
            along.append(self._diamonds.along_outside @ (to_vertices @ of_faces))
        unknowns = self._unknowns
        return Outside(
            across=across,
            along=sparse.vstack(along, format="csr"),
            closing=_matrix(self._equations, (len(unknowns), self._balances * faces)),
            potential=np.array([unknown.potential for unknown in unknowns], dtype=int),
            cell=np.array([unknown.cell for unknown in unknowns], dtype=int),
            volume=np.array([unknown.volume for unknown in unknowns], dtype=float),
            part=np.array([unknown.part for unknown in unknowns], dtype=int),
            shared=np.array([unknown.shared for unknown in unknowns], dtype=bool),
            places=np.concatenate([np.zeros((2, 0)), *self._places], axis=1),
            reference=self._reference,
        )

    def _electrode(self, part: Part, index: int, faces: Array) -> None:
        """Faces of an electrode in the wall, whose own potential has been added to psi~."""
        sign = 1.0 if part.electrode == "cation" else -1.0
        water, salt = self._new(WATER, index, faces), self._new(ANIONS, index, faces)
        self._form(WATER, faces, water)
        self._form(ANIONS, faces, salt)
        self._form(CHARGE, faces, self._bath(self._reference, ANIONS), sign)
        self._form(CHARGE, faces, salt, -sign)
        self._equation(water, WATER, faces)
        self._equation(salt, ANIONS, faces)
        if part.electrode == "anion":  # no cations: j+ = j- + i/F
            self._equation(salt, CHARGE, faces)

    def _part_potential(self, index: int, faces: Array) -> Array:
        """Where the potential of a part stands among the values: given, or an unknown, which is added."""
        if self._parts[index].electrical not in ("floating", "current"):
            return self._bath(index, CHARGE)
        cells, place = self._diamonds.cells[0, faces], self._given + len(self._unknowns)
        self._unknowns.append(_Unknown(CHARGE, int(cells[0]), float(self._grid.volumes[cells].sum()), index, True))
        self._places.append(np.full((2, 1), np.nan))
        self._equation(np.array([place]), CHARGE, faces)
        return np.array([place])

    def _new(self, potential: int, index: int, faces: Array) -> Array:
        """Where unknowns of the faces, which are added, stand among the values."""
        cells, first = self._diamonds.cells[0, faces], self._given + len(self._unknowns)
        self._unknowns += [_Unknown(potential, int(c), float(self._grid.volumes[c]), index, False) for c in cells]
        ends = self._grid.lattice("vertices")[:, self._grid.face_vertices[:, self._diamonds.faces[faces]]]
        self._places.append(ends.mean(axis=1))
        return first + np.arange(len(faces))

    def _bath(self, index: int, potential: int) -> Array:
        """Where a potential of a part's bath stands among the values."""
        return np.array([index * self._balances + potential])

    def _form(self, potential: int, faces: Array, values: Array, weight: float = 1.0) -> None:
        """Let a potential on faces have a share of values, one for all faces or one each."""
        self._forms.append((potential * len(self._diamonds.faces) + faces, np.resize(values, len(faces)), weight))

    def _equation(self, values: Array, balance: int, faces: Array) -> None:
        """Let fluxes through faces take part in the equations of unknowns, one for all faces or one each."""
        unknowns = np.resize(values - self._given, len(faces))
        self._equations.append((unknowns, balance * len(self._diamonds.faces) + faces, 1.0))


def _matrix(entries: list[_Entries], shape: tuple[int, int]) -> sparse.csr_array:
    """Matrix of entries, which are summed up where they are in one place."""
    none = np.zeros(0, dtype=int)
    rows, columns = (np.concatenate([none, *(entry[k] for entry in entries)]) for k in (0, 1))
    weights = np.concatenate([np.zeros(0), *(np.full(len(rows), weight) for rows, _, weight in entries)])
    return sparse.csr_array((weights, (rows, columns)), shape=shape)


def _vertex_weights(grid: BlockGrid, diamonds: Diamonds, uniform: Array) -> sparse.csr_array:
    """Weights of the crossed boundary faces at the vertices of these faces, ``(vertices, crossed)``.

    Parameters
    ----------
    grid, diamonds
        Of the block.
    uniform
        ``(crossed,)`` whether a face has the same value as those beside it that are of its part.
    """
    crossed = {int(face): number for number, face in enumerate(diamonds.faces) if diamonds.cells[1, number] < 0}
    around: dict[int, list[tuple[str, int]]] = {}  # crossed faces at each vertex, as edge and place on it
    for edge, faces in grid.edges.items():
        for k, face in enumerate(faces):
            for vertex in grid.face_vertices[:, face] if int(face) in crossed else ():
                around.setdefault(int(vertex), []).append((edge, k))
    weights: list[_Entries] = []
    for vertex, beside in around.items():
        numbers = [crossed[int(grid.edges[edge][k])] for edge, k in beside]
        shares = [{number: 1.0} for number in numbers if uniform[number]]
        if not shares and len({edge for edge, _ in beside}) < len(beside):
            shares = [_on_line(grid, diamonds, vertex, *numbers)]
        elif not shares:
            shares = [_extended(grid, diamonds, vertex, *at, crossed, uniform) for at in beside]
        for share in shares:
            weights += [(np.array([vertex]), np.array([n]), weight / len(shares)) for n, weight in share.items()]
    return _matrix(weights, (grid.vertices.shape[1], len(diamonds.faces)))


def _on_line(grid: BlockGrid, diamonds: Diamonds, vertex: int, first: int, second: int) -> dict[int, float]:
    """Weights of two crossed faces at a vertex between or beside them, on the line through their middles."""
    middles = grid.face_centres[:, diamonds.faces[[first, second]]]
    along = middles[:, 1] - middles[:, 0]
    share = float((grid.vertices[:, vertex] - middles[:, 0]) @ along / (along @ along))
    return {first: 1.0 - share, second: share}


def _extended(
    grid: BlockGrid, diamonds: Diamonds, vertex: int, edge: str, place: int, crossed: dict[int, int], uniform: Array
) -> dict[int, float]:
    """Weights of the face that ends a row on an edge, and of the one behind it, at the vertex where the row ends."""
    faces = grid.edges[edge]
    behind = place + (1 if vertex == grid.face_vertices[:, faces[place]].min() else -1)
    own, other = crossed[int(faces[place])], crossed.get(int(faces[behind])) if 0 <= behind < len(faces) else None
    return {own: 1.0} if other is None or uniform[other] else _on_line(grid, diamonds, vertex, own, other)
