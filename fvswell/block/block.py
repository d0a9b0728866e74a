"""A block of tissue: momentum balance of its vertices and transport balances of its cells, with their exact Jacobian.

The pore pressure p = mu_f + pi of a cell acts on its corners by p times the derivative of the cell's volume, which is
the transpose of the way in which moving corners make room for water. Unknowns and equations are in the order of
`fvswell.block.assembly`; potentials and balances in that of `Model.balances`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from fvswell.block.assembly import JacobianPattern, LocalDerivatives
from fvswell.block.diamonds import Diamonds
from fvswell.block.edges import DegreesOfFreedom, EdgeCondition, EdgeLoads
from fvswell.block.geometry import edge_area_vectors, quadrilateral_gradient
from fvswell.block.grid import BlockGrid
from fvswell.block.laws import face_law
from fvswell.block.mechanics import (
    BlockSolid,
    Mechanics,
    find_edge_forces,
    find_forces,
    find_stiffness,
    mechanics_room,
)
from fvswell.block.sides import EDGE_AXIS, EDGES, OUTWARD
from fvswell.block.transport import (
    Transport,
    TransportTables,
    find_transport,
    find_transport_slopes,
    transport_room,
)
from fvswell.numerics.sparse_lu import DirectSolver
from fvswell.physics.models import Model
from fvswell.physics.osmotic import bath_log_activity, bath_osmotic_pressure
from fvswell.physics.solids import aggregate_modulus
from fvswell.physics.tissue import Array, Tissue

__all__ = ["Block", "BlockState", "Interval", "TransportSystem", "first_point"]


class Interval(NamedTuple):
    """The time that balances are drawn up over, and what acts at its end."""

    base: Array  # (balances, cells) contents that it starts from, per reference volume
    duration: float  # s
    bath: float  # concentration, mmol/mm3
    loads: EdgeLoads


class BlockState(NamedTuple):
    """A state of the block and how far it is from balance."""

    unknowns: Array
    residual: Array  # (unknowns,)
    internal_forces: Array  # (displacements,): what holds the vertices where they are
    positions: Array  # (2, vertices)
    pressure: Array  # (cells,) of the fluid
    transport: Transport
    mechanics: Mechanics
    edge_stiffness: Array  # (4, 4, edge faces)
    sound: Array  # (cells,) whether a cell is neither inverted nor without water


class TransportSystem(NamedTuple):
    """The transport balances on a grid that stands still."""

    residual: Array  # (balances, cells)
    jacobian: sparse.coo_array  # by the potentials: rows and columns are cells, balance by balance


@dataclass(frozen=True)
class Block:
    """A block of tissue with one model; made by `make_block.make_block`."""

    grid: BlockGrid
    model: Model
    cells: Tissue
    faces: Tissue  # at the crossed faces
    edges: Mapping[str, EdgeCondition]
    degrees_of_freedom: DegreesOfFreedom
    diamonds: Diamonds
    solid: BlockSolid
    solid_class: type
    stabilisation: sparse.csr_array  # volumes stored by water potentials, see `block.stabilisation`
    tables: TransportTables
    pattern: JacobianPattern
    solver: DirectSolver
    edge_faces: Array  # boundary faces on free and tied edges
    edge_of_face: Array  # index among EDGES
    of_vertex: Array  # as kernels take it
    concentration: float  # of the bath that the block is equilibrated in, mmol/mm3
    laws: tuple[Any, Any, Any]  # compiled: of the solid, the cells, the faces
    osmotic_share: float = 1.0  # of all osmotic pressures that acts; less on the way to the first equilibrium

    @property
    def balances(self) -> tuple[str, ...]:
        """Names of the transport balances."""
        return self.model.balances

    @cached_property
    def permeable_faces(self) -> tuple[Array, ...]:
        """For each permeable edge in the order of EDGES, its faces, as indices among those that are crossed."""
        permeable = [edge for edge in EDGES if self.edges[edge].permeable]
        return tuple(np.searchsorted(self.diamonds.faces, self.grid.edges[edge]) for edge in permeable)

    def positions(self, unknowns: Array) -> Array:
        """Positions of the vertices, ``(2, vertices)`` mm, from unknowns ``(unknowns,)``."""
        return self.grid.vertices + self.degrees_of_freedom.displacements(unknowns[: self.degrees_of_freedom.number])

    def potentials(self, unknowns: Array) -> Array:
        """Potentials of the cells, ``(balances, cells)``."""
        return unknowns[self.degrees_of_freedom.number :].reshape(len(self.balances), -1)

    def bath_potentials(self, concentration: float) -> Array:
        """Potentials of the grounded bath, ``(balances,)``: mu_f, ln a~ and F psi~/(R T)."""
        law, RT = first_point(self.cells.osmotic), first_point(self.cells.thermal_energy)
        water = -self.osmotic_share * bath_osmotic_pressure(law, RT, concentration)
        return np.array([water, bath_log_activity(law, concentration), 0.0])[: len(self.balances)]

    def transport(
        self, positions: Array, potentials: Array, concentration: float, outside: Array | None = None
    ) -> Transport:
        """Contents and fluxes with the vertices at positions.

        Parameters
        ----------
        positions
            Of the vertices, ``(2, vertices)`` mm.
        potentials
            Of the cells, ``(balances, cells)``.
        concentration
            Of the bath, mmol/mm3.
        outside
            Potentials at the vertices on permeable edges, ``(balances, vertices)``, in place of the bath's.
        """
        if outside is None:
            across, along, log_bath = self._outside(concentration)
        else:
            maps = (self.diamonds.across_outside, self.diamonds.along_outside)
            across, along = (np.ascontiguousarray((part @ outside.T).T) for part in maps)
            log_bath = self._outside(concentration)[2]
        result = transport_room(len(self.balances), self.tables)
        find_transport(
            self.grid.section, self.laws[1], self.laws[2], self.tables, positions, np.ascontiguousarray(potentials),
            across, along, log_bath, result,
        )  # fmt: skip
        return result

    def transport_system(
        self, positions: Array, potentials: Array, interval: Interval, outside: Array | None = None
    ) -> TransportSystem:
        """Residual of the transport balances over an interval, and its derivative by the potentials.

        The vertices stay where they are; arguments as for `transport`. The volume balance has in it what the
        stabilisation stores.
        """
        transport = self.transport(positions, potentials, interval.bath, outside)
        local = self.pattern.room()
        local.storage[:] = self.stabilisation.data
        find_transport_slopes(self.grid.section, self.tables, positions, transport, interval.duration, local.transport)
        local.transport.contents_by_corner[:] = 0.0
        local.transport.points[:] = 0.0
        first, pattern = self.degrees_of_freedom.number, self.pattern
        inside = (pattern.rows >= first) & (pattern.columns >= first)
        size = pattern.size - first
        jacobian = sparse.coo_array(
            (pattern.assemble(local)[inside], (pattern.rows[inside] - first, pattern.columns[inside] - first)),
            shape=(size, size),
        )
        return TransportSystem(self._transport_residual(transport, interval), jacobian)

    def evaluate(self, unknowns: Array, interval: Interval) -> BlockState:
        """Residual of all balances at a state."""
        positions, potentials, loads = self.positions(unknowns), self.potentials(unknowns), interval.loads
        transport = self.transport(positions, potentials, interval.bath)
        pressure = potentials[0] + self.osmotic_share * transport.osmotic[0]
        mechanics, internal = mechanics_room(self.grid.cells), np.empty(self.degrees_of_freedom.number)
        find_forces(
            self.grid.section, self.laws[0], self.solid, positions, pressure, self.of_vertex, mechanics, internal
        )
        external, edge_stiffness = self._pressure_forces(positions, loads.pressure)
        momentum = internal - external
        for edge, index in self.degrees_of_freedom.of_tied_edge.items():
            momentum[index] += OUTWARD[edge] * loads.force[EDGES.index(edge)]
            target = loads.displacement[EDGES.index(edge)]
            if not np.isnan(target):
                momentum[index] = (unknowns[index] - target) * self.momentum_scale[index] / self.length_scale
        residual = np.concatenate([momentum, self._transport_residual(transport, interval).ravel()])
        return BlockState(
            unknowns, residual, internal, positions, pressure, transport, mechanics, edge_stiffness,
            self._sound(mechanics, transport),
        )  # fmt: skip

    def local_derivatives(self, state: BlockState, duration: float) -> LocalDerivatives:
        """What the Jacobian at a state consists of."""
        local, share, transport = self.pattern.room(), self.osmotic_share, state.transport
        gradient = state.mechanics.gradient
        pressure_slope = share * transport.osmotic[1] / self.grid.volumes
        find_stiffness(
            self.grid.section, self.solid, state.positions, state.mechanics, state.pressure, pressure_slope,
            np.empty((5, 8)), local.stiffness,
        )  # fmt: skip
        np.negative(gradient, out=local.pressure_forces)
        if len(self.balances) > 1:
            np.multiply(-share * transport.osmotic[2], gradient, out=local.osmotic_forces)
        local.edge_forces[:] = state.edge_stiffness
        local.storage[:] = self.stabilisation.data
        find_transport_slopes(self.grid.section, self.tables, state.positions, transport, duration, local.transport)
        return local

    def jacobian(self, local: LocalDerivatives, loads: EdgeLoads) -> Array:
        """Derivative of the residual by the unknowns: entries in the order of the pattern."""
        entries = self.pattern.assemble(local)
        for edge, index in self.degrees_of_freedom.of_tied_edge.items():
            if not np.isnan(loads.displacement[EDGES.index(edge)]):
                row = np.flatnonzero(self.pattern.rows == index)
                entries[row] = 0.0
                entries[row[self.pattern.columns[row] == index]] = self.momentum_scale[index] / self.length_scale
        return entries

    def edge_areas(self, positions: Array) -> Array:
        """Current areas of the edges projected on their reference direction, in the order of EDGES."""
        vectors = edge_area_vectors(self.grid.section, *positions[:, self.grid.face_vertices])
        return np.array([OUTWARD[edge] * vectors[EDGE_AXIS[edge]][self.grid.edges[edge]].sum() for edge in EDGES])

    def tied_edge_reactions(self, state: BlockState, loads: EdgeLoads) -> dict[str, float]:
        """Forces that press on the tied edges, positive in compression, without the pressures on their neighbours."""
        forces = {}
        for edge, index in self.degrees_of_freedom.of_tied_edge.items():
            others, _ = self._pressure_forces(state.positions, np.where(np.array(EDGES) == edge, 0.0, loads.pressure))
            forces[edge] = -OUTWARD[edge] * float(state.internal_forces[index] - others[index])
        return forces

    @cached_property
    def length_scale(self) -> float:
        """Size of a cell, mm."""
        x, y = self.grid.vertices[:, self.grid.cell_vertices]
        areas = 0.5 * (x * np.roll(y, -1, axis=0) - y * np.roll(x, -1, axis=0)).sum(axis=0)
        return float(np.sqrt(areas.mean()))

    @cached_property
    def modulus(self) -> Array:
        """Aggregate modulus of the cells, ``(cells,)`` MPa."""
        return np.broadcast_to(aggregate_modulus(self.cells.solid, self.cells.fluid_fraction), self.grid.cells)

    @cached_property
    def measure_scale(self) -> tuple[float, float]:
        """Natural sizes of displacements and of water potentials as a whole: the extent, mm, and the modulus, MPa."""
        return float(np.ptp(self.grid.vertices, axis=1).max()), float(self.modulus.mean())

    @cached_property
    def momentum_scale(self) -> Array:
        """Size of the forces that balance at each free displacement: moduli times areas, N."""
        gradient = np.stack(
            quadrilateral_gradient(self.grid.section, *self.grid.vertices[:, self.grid.cell_vertices])
        ).reshape(2, 4, -1)
        index = self.of_vertex[:, self.grid.cell_vertices]
        moved = index >= 0
        forces = (self.modulus * np.abs(gradient))[moved]
        return np.bincount(index[moved], forces, self.degrees_of_freedom.number)

    @cached_property
    def content_scale(self) -> Array:
        """Natural size of the contents, ``(balances,)``: 1 for J, the bath's concentration for ions."""
        return np.array([1.0, self.concentration, self.concentration])[: len(self.balances)]

    @cached_property
    def residual_scale(self) -> Array:
        """Size of what the equations balance, to judge residuals by."""
        return np.concatenate([self.momentum_scale, np.outer(self.content_scale, self.grid.volumes).ravel()])

    @cached_property
    def unknown_scale(self) -> Array:
        """Natural size of the changes of the unknowns."""
        scale, first = np.ones(self.pattern.size), self.degrees_of_freedom.number
        scale[:first] = self.length_scale
        scale[first : first + self.grid.cells] = self.modulus.mean()
        return scale

    @cached_property
    def entry_scale(self) -> Array:
        """What the entries of the Jacobian are multiplied by to be of relative changes."""
        return self.unknown_scale[self.pattern.columns] / self.residual_scale[self.pattern.rows]

    def _outside(self, concentration: float) -> tuple[Array, Array, float]:
        """What a bath adds to the differences of the potentials across and along the faces, and its ln a~."""
        if concentration not in self._baths:
            bath = self.bath_potentials(concentration)[:, None]
            across, along = (bath * total for total in self._bath_weights)
            self._baths.clear()  # of one bath at a time: ramps give a new one in every stage
            log_bath = float(bath_log_activity(first_point(self.cells.osmotic), concentration))
            self._baths[concentration] = across, along, log_bath
        return self._baths[concentration]

    @cached_property
    def _baths(self) -> dict[float, tuple[Array, Array, float]]:
        return {}

    @cached_property
    def _bath_weights(self) -> tuple[Array, Array]:
        """Weights of the bath in the differences of the potentials across and along the faces, (crossed,)."""
        return self.diamonds.across_outside.sum(axis=1), self.diamonds.along_outside.sum(axis=1)

    @cached_property
    def _edge_vertices(self) -> Array:
        return np.ascontiguousarray(self.grid.face_vertices[:, self.edge_faces], dtype=np.int64)

    def _transport_residual(self, transport: Transport, interval: Interval) -> Array:
        gain: Array = self.grid.volumes * (transport.contents - interval.base)
        return gain + interval.duration * transport.outflow

    def _pressure_forces(self, positions: Array, pressure: Array) -> tuple[Array, Array]:
        """Forces of the pressures on the edges, ``(4,)``, along the displacements, and minus their slopes."""
        faces = len(self.edge_faces)
        slopes, total = np.empty((4, 4, faces)), np.empty(self.degrees_of_freedom.number)
        find_edge_forces(
            self.grid.section, self._edge_vertices, positions, pressure[self.edge_of_face], self.of_vertex, slopes,
            total,
        )  # fmt: skip
        return total, slopes

    def _sound(self, mechanics: Mechanics, transport: Transport) -> Array:
        xx, xy, yx, yy, zz = mechanics.deformation
        upright = ((xx * yy > xy * yx) & (zz > 0.0)).reshape(4, -1).all(axis=0)
        sound: Array = upright & (transport.volume_ratio - 1.0 + self.cells.fluid_fraction > 0.0)
        dry = transport.face_ratio - 1.0 + self.faces.fluid_fraction <= 0.0
        sound[self.diamonds.cells[0, dry]] = False
        return sound

    def with_osmotic_share(self, share: float) -> Block:
        """The block with osmotic pressures, of the bath as well, reduced to a share of what they are."""
        return replace(self, osmotic_share=share)

    def with_open_circuit_ratio(self, ratio: Array | float) -> Block:
        """The block with k_open/k held constant at the crossed faces, ``(crossed,)``."""
        parameters = self.tables.face_parameters.copy()
        parameters[-1] = ratio
        laws = (*self.laws[:2], face_law(self.faces, self.model, open_circuit_of_state=False))
        return replace(self, tables=self.tables._replace(face_parameters=parameters), laws=laws)


def first_point(numbers: Any) -> Any:
    """A law or a number at the first of its points: for what is the same everywhere, such as a bath's properties."""
    if isinstance(numbers, tuple):
        return type(numbers)(*(first_point(number) for number in numbers))
    return float(np.ravel(numbers)[0])
