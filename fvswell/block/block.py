"""A block of tissue: momentum balance of its vertices and transport balances of its cells, with their exact Jacobian.

The pore pressure p = mu_f + pi of a cell acts on its corners by p times the derivative of the cell's volume, which is
the transpose of the way in which moving corners make room for water. Unknowns and equations are in the order of
`fvswell.block.assembly`; potentials and balances in that of `Model.balances`, parts of the boundary in that given.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from fvswell.block.assembly import JacobianPattern, LocalDerivatives
from fvswell.block.diamonds import Diamonds
from fvswell.block.displacements import DegreesOfFreedom
from fvswell.block.geometry import quadrilateral_gradient
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
from fvswell.block.outside import CHARGE, Beyond, Outside, crossed_parts
from fvswell.block.part_loads import PartLoads, part_loads
from fvswell.block.transport import (
    Transport,
    TransportTables,
    find_transport,
    find_transport_slopes,
    transport_room,
)
from fvswell.boundary.parts import Part, load_names
from fvswell.boundary.sides import OUTWARD
from fvswell.numerics.sparse_lu import DirectSolver
from fvswell.physics.constants import FARADAY
from fvswell.physics.models import Model
from fvswell.physics.osmotic import bath_log_activity, bath_osmotic_pressure
from fvswell.physics.solids import aggregate_modulus
from fvswell.physics.tissue import Array, Tissue

__all__ = ["Block", "BlockState", "Interval", "TransportSystem", "first_point"]


class Interval(NamedTuple):
    """The time that balances are drawn up over, and what acts at its end."""

    base: Array  # (balances, cells) contents that it starts from, per reference volume
    duration: float  # s
    loads: PartLoads


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
    parts: tuple[Part, ...]
    part_faces: tuple[Array, ...]  # faces of the grid on each part
    degrees_of_freedom: DegreesOfFreedom
    diamonds: Diamonds
    outside: Outside
    solid: BlockSolid
    solid_class: type
    stabilisation: sparse.csr_array  # volumes stored by water potentials, see `block.stabilisation`
    tables: TransportTables
    pattern: JacobianPattern
    solver: DirectSolver
    pressed_faces: Array  # boundary faces of parts that can be loaded or are open, on which pressures act
    part_of_face: Array  # index of the part that each of these belongs to
    of_vertex: Array  # as kernels take it
    concentration: float  # of the baths that the block is equilibrated in, mmol/mm3
    laws: tuple[Any, Any, Any]  # compiled: of the solid, the cells, the faces
    osmotic_share: float = 1.0  # of all osmotic pressures that acts; less on the way to the first equilibrium

    @property
    def balances(self) -> tuple[str, ...]:
        """Names of the transport balances."""
        return self.model.balances

    @cached_property
    def crossed_parts(self) -> list[int]:
        """Indices of the parts that water or ions cross."""
        return crossed_parts(self.parts, self.model.transports_ions)

    @cached_property
    def crossed_faces(self) -> tuple[Array, ...]:
        """For each of these parts, its faces, as indices among those that are crossed."""
        return tuple(np.searchsorted(self.diamonds.faces, self.part_faces[part]) for part in self.crossed_parts)

    def positions(self, unknowns: Array) -> Array:
        """Positions of the vertices, ``(2, vertices)`` mm, from unknowns ``(unknowns,)``."""
        return self.grid.vertices + self.degrees_of_freedom.displacements(unknowns[: self.degrees_of_freedom.number])

    def potentials(self, unknowns: Array) -> Array:
        """Potentials of the cells, ``(balances, cells)``."""
        first, last = self.degrees_of_freedom.number, len(unknowns) - self.outside.unknowns
        return unknowns[first:last].reshape(len(self.balances), -1)

    def outer(self, unknowns: Array) -> Array:
        """Unknowns of the boundary, see `fvswell.block.outside`."""
        return unknowns[len(unknowns) - self.outside.unknowns :]

    def bath_potentials(self, concentration: float) -> Array:
        """Potentials of a bath that is grounded and without pressure, ``(balances,)``: mu_f, ln a~, F psi~/(R T)."""
        if concentration not in self._baths:
            law, RT = first_point(self.cells.osmotic), first_point(self.cells.thermal_energy)
            water = -self.osmotic_share * bath_osmotic_pressure(law, RT, concentration)
            if len(self._baths) > len(self.parts):  # ramps give new ones in every stage
                self._baths.clear()
            potentials = np.array([water, bath_log_activity(law, concentration), 0.0])
            self._baths[concentration] = potentials[: len(self.balances)]
        return self._baths[concentration]

    @cached_property
    def unloaded(self) -> PartLoads:
        """Loads of a block that is left alone in the bath that it is equilibrated in."""
        return part_loads(self.parts, np.full(len(load_names(self.parts)), np.nan), self.concentration)

    def beyond(self, loads: PartLoads, outer: Array) -> Beyond:
        """What the baths and the unknowns of the boundary add to the differences of the potentials."""
        baths = np.stack([self.bath_potentials(concentration) for concentration in loads.bath_concentration])
        baths[:, 0] += loads.bath_pressure
        if len(self.balances) > 1:
            baths[:, CHARGE] = loads.potential * (FARADAY / first_point(self.cells.thermal_energy))
        values = np.concatenate([baths.ravel(), outer])
        across, along = (part @ values for part in (self.outside.across, self.outside.along))
        concentration = loads.bath_concentration[self.outside.reference]
        log_bath = float(bath_log_activity(first_point(self.cells.osmotic), concentration))
        return Beyond(across.reshape(len(self.balances), -1), along.reshape(len(self.balances), -1), log_bath)

    def outside_change(self, outer: Array) -> tuple[Array, Array]:
        """How changes of the unknowns of the boundary change the differences across and along the crossed faces."""
        across, along = (part @ outer for part in self._by_outer)
        return across.reshape(len(self.balances), -1), along.reshape(len(self.balances), -1)

    def transport(self, positions: Array, potentials: Array, beyond: Beyond) -> Transport:
        """Contents and fluxes with the vertices at positions.

        Parameters
        ----------
        positions
            Of the vertices, ``(2, vertices)`` mm.
        potentials
            Of the cells, ``(balances, cells)``.
        beyond
            What there is outside.
        """
        result = transport_room(len(self.balances), self.tables)
        find_transport(
            self.grid.section, self.laws[1], self.laws[2], self.tables, positions, np.ascontiguousarray(potentials),
            *beyond, result,
        )  # fmt: skip
        return result

    def transport_at(self, unknowns: Array, loads: PartLoads) -> Transport:
        """Contents and fluxes in a state."""
        beyond = self.beyond(loads, self.outer(unknowns))
        return self.transport(self.positions(unknowns), self.potentials(unknowns), beyond)

    def transport_system(
        self, positions: Array, potentials: Array, base: Array, duration: float, beyond: Beyond
    ) -> TransportSystem:
        """Residual of the transport balances over an interval, and its derivative by the potentials.

        The vertices, and what there is outside, stay as they are; arguments as for `Interval` and `transport`. The
        volume balance has in it what the stabilisation stores.
        """
        transport = self.transport(positions, potentials, beyond)
        local = self.pattern.room()
        local.storage[:] = self.stabilisation.data
        find_transport_slopes(self.grid.section, self.tables, positions, transport, duration, local.transport)
        local.transport.contents_by_corner[:] = 0.0
        local.transport.points[:] = 0.0
        first, pattern = self.degrees_of_freedom.number, self.pattern
        last = pattern.size - self.outside.unknowns
        inside, size = pattern.within(first, last), last - first
        jacobian = sparse.coo_array(
            (pattern.assemble(local)[inside], (pattern.rows[inside] - first, pattern.columns[inside] - first)),
            shape=(size, size),
        )
        return TransportSystem(self._transport_residual(transport, base, duration), jacobian)

    def evaluate(self, unknowns: Array, interval: Interval) -> BlockState:
        """Residual of all balances at a state."""
        positions, potentials, loads = self.positions(unknowns), self.potentials(unknowns), interval.loads
        transport = self.transport(positions, potentials, self.beyond(loads, self.outer(unknowns)))
        pressure = potentials[0] + self.osmotic_share * transport.osmotic[0]
        mechanics, internal = mechanics_room(self.grid.cells), np.empty(self.degrees_of_freedom.number)
        find_forces(
            self.grid.section, self.laws[0], self.solid, positions, pressure, self.of_vertex, mechanics, internal
        )
        external, edge_stiffness = self._pressure_forces(positions, loads)
        momentum = internal - external
        for part, index, force in zip(self.parts, self.degrees_of_freedom.normal, loads.force, strict=True):
            if index >= 0:
                momentum[index] += OUTWARD[part.edge] * force
        for index, target in self.degrees_of_freedom.prescribed(loads).items():
            momentum[index] = (unknowns[index] - target) * self.momentum_scale[index] / self.length_scale
        residual = [momentum, self._transport_residual(transport, interval.base, interval.duration).ravel()]
        residual.append(interval.duration * self._unclosed(transport, loads))
        return BlockState(
            unknowns, np.concatenate(residual), internal, positions, pressure, transport, mechanics, edge_stiffness,
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

    def jacobian(self, local: LocalDerivatives, loads: PartLoads) -> Array:
        """Derivative of the residual by the unknowns: entries in the order of the pattern."""
        entries = self.pattern.assemble(local)
        for index in self.degrees_of_freedom.prescribed(loads):
            row = np.flatnonzero(self.pattern.rows == index)
            entries[row] = 0.0
            entries[row[self.pattern.columns[row] == index]] = self.momentum_scale[index] / self.length_scale
        return entries

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
        balances = np.outer(self.content_scale, self.grid.volumes).ravel()
        boundary = self.content_scale[self.outside.potential] * self.outside.volume
        return np.concatenate([self.momentum_scale, balances, boundary])

    @cached_property
    def unknown_scale(self) -> Array:
        """Natural size of the changes of the unknowns."""
        scale, first = np.ones(self.pattern.size), self.degrees_of_freedom.number
        scale[:first] = self.length_scale
        scale[first : first + self.grid.cells] = self.modulus.mean()
        self.outer(scale)[self.outside.potential == 0] = self.modulus.mean()
        return scale

    @cached_property
    def entry_scale(self) -> Array:
        """What the entries of the Jacobian are multiplied by to be of relative changes."""
        return self.unknown_scale[self.pattern.columns] / self.residual_scale[self.pattern.rows]

    @cached_property
    def _baths(self) -> dict[float, Array]:
        return {}

    @cached_property
    def _by_outer(self) -> tuple[sparse.csr_array, sparse.csr_array]:
        """The maps of the outside from the unknowns of the boundary alone."""
        given = self.outside.across.shape[1] - self.outside.unknowns
        return self.outside.across[:, given:], self.outside.along[:, given:]

    @cached_property
    def _pressed_vertices(self) -> Array:
        return np.ascontiguousarray(self.grid.face_vertices[:, self.pressed_faces], dtype=np.int64)

    def _transport_residual(self, transport: Transport, base: Array, duration: float) -> Array:
        gain: Array = self.grid.volumes * (transport.contents - base)
        return gain + duration * transport.outflow

    def _unclosed(self, transport: Transport, loads: PartLoads) -> Array:
        """What the equations of the boundary lack: rates of what crosses it and should not."""
        rates: Array = self.outside.closing @ transport.fluxes.ravel()
        return rates + np.where(self.outside.shared, loads.current[self.outside.part] / FARADAY, 0.0)

    def _pressure_forces(self, positions: Array, loads: PartLoads) -> tuple[Array, Array]:
        """Forces of the pressures on the parts and of their baths, along the displacements, and minus their slopes."""
        faces = len(self.pressed_faces)
        slopes, total = np.empty((4, 4, faces)), np.empty(self.degrees_of_freedom.number)
        find_edge_forces(
            self.grid.section, self._pressed_vertices, positions,
            (loads.pressure + loads.bath_pressure)[self.part_of_face], self.of_vertex, slopes, total,
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
