"""A block of tissue: momentum balance of its vertices and transport balances of its cells, with their exact Jacobian.

The pore pressure p = mu_f + pi of a cell acts on its corners by p times the derivative of the cell's volume, which is
the transpose of the way in which moving corners make room for water. Unknowns and equations are in the order of
`fvswell.block.assembly`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import sparse

from fvswell.block.assembly import JacobianPattern, LocalDerivatives
from fvswell.block.diamonds import diamonds
from fvswell.block.edges import DegreesOfFreedom, EdgeCondition, check_edges, degrees_of_freedom
from fvswell.block.geometry import (
    SECTIONS,
    edge_area_vectors,
    edge_pressure_forces,
    polygon_volume,
    polygon_volume_gradient,
)
from fvswell.block.grid import BlockGrid
from fvswell.block.mechanics import BlockSolid, block_solid
from fvswell.block.sides import EDGE_AXIS, EDGES, OUTWARD
from fvswell.block.stabilisation import alternating_storage
from fvswell.block.transport import BlockBalance, BlockInterval, BlockTransportTerm, at_points
from fvswell.numerics.sparse_lu import DirectSolver
from fvswell.physics.differentiation import local_derivative
from fvswell.physics.models import Mixture
from fvswell.physics.solid import aggregate_modulus, shear_modulus
from fvswell.physics.tissue import Array, Tissue

__all__ = ["Block", "BlockState", "EdgeLoads", "make_block"]


class EdgeLoads(NamedTuple):
    """What acts on the edges, in the order of EDGES: pressure, force, and prescribed displacement (nan: none)."""

    pressure: Array
    force: Array
    displacement: Array


class BlockState(NamedTuple):
    """A state of the block and how far it is from balance."""

    residual: Array  # (unknowns,)
    internal_forces: Array  # (displacements,): what holds the vertices where they are
    positions: Array  # (2, vertices)
    deformation_gradient: Array  # (5, 4, cells)
    volume_ratio: Array  # (1, cells)
    potentials: Array  # (balances, 1, cells)
    osmotic_pressure: Array  # (cells,)
    balance: BlockBalance
    sound: Array  # (cells,) whether a cell is neither inverted nor without water


@dataclass(frozen=True)
class Block:
    """A block of tissue with one model."""

    grid: BlockGrid
    edges: Mapping[str, EdgeCondition]
    degrees_of_freedom: DegreesOfFreedom
    solid: BlockSolid
    term: BlockTransportTerm
    stabilisation: sparse.csr_array  # volumes stored by water potentials, see `block.stabilisation`
    pattern: JacobianPattern
    edge_faces: Array  # boundary faces on free and tied edges
    edge_of_face: Array  # index among EDGES
    gather_corners: sparse.csr_array
    gather_ends: sparse.csr_array

    @property
    def balances(self) -> tuple[str, ...]:
        """Names of the transport balances."""
        return self.term.cells.model.balances

    def positions(self, unknowns: Array) -> Array:
        """Positions of the vertices, ``(2, vertices)`` mm, from unknowns ``(unknowns,)``."""
        return self.grid.vertices + self.degrees_of_freedom.displacements(unknowns[: self.degrees_of_freedom.number])

    def potentials(self, unknowns: Array) -> Array:
        """Potentials of the cells, ``(balances, 1, cells)``."""
        return unknowns[self.degrees_of_freedom.number :].reshape(len(self.balances), 1, -1)

    def volume_ratio(self, positions: Array) -> Array:
        """J of the cells, ``(1, cells)``: current over reference volume."""
        corners = positions[:, self.grid.cell_vertices]
        return (polygon_volume(self.grid.section, *corners) / self.grid.volumes)[None]

    def evaluate(self, unknowns: Array, interval: BlockInterval, loads: EdgeLoads) -> BlockState:
        """Residual of all balances at a state."""
        potentials, positions = self.potentials(unknowns), self.positions(unknowns)
        corners = positions[:, self.grid.cell_vertices]
        J = self.volume_ratio(positions)
        balance = self._storing(self.term.balance(potentials, positions, J, interval), potentials[0, 0])
        osmotic = np.broadcast_to(self.term.cells.osmotic_pressure(balance.cells), J.shape)[0]
        pressure = potentials[0, 0] + osmotic
        F = self.solid.deformation_gradient(corners)
        forces = self.solid.forces(F) - pressure * polygon_volume_gradient(self.grid.section, *corners)
        internal = self.gather_corners @ forces.ravel()
        momentum = internal - self._external_forces(unknowns, positions, loads)
        for edge, index in self.degrees_of_freedom.of_tied_edge.items():
            target = loads.displacement[EDGES.index(edge)]
            if not np.isnan(target):
                momentum[index] = (unknowns[index] - target) * self.momentum_scale[index] / self.length_scale
        return BlockState(
            np.concatenate([momentum, balance.residual.ravel()]), internal, positions, F, J, potentials, osmotic,
            balance, self._sound(F, J, balance),
        )  # fmt: skip

    def jacobian(self, state: BlockState, interval: BlockInterval, loads: EdgeLoads) -> Array:
        """Derivative of the residual by the unknowns: entries in the order of the pattern."""
        section = self.grid.section
        corners = state.positions[:, self.grid.cell_vertices].reshape(8, -1)
        gradient = polygon_volume_gradient(section, *corners.reshape(2, 4, -1)).reshape(8, -1)
        curvature = local_derivative(
            lambda c: polygon_volume_gradient(section, *c.reshape(2, 4, 8, -1)).reshape(8, 8, -1), corners
        )
        slopes = self.term.cells.osmotic_pressure_derivatives(state.balance.cells)
        osmotic_slope = [np.broadcast_to(slope, state.volume_ratio.shape)[0] for slope in slopes]
        pressure = state.potentials[0, 0] + state.osmotic_pressure
        forces = self.solid.stiffness(state.deformation_gradient) - pressure * curvature
        forces -= osmotic_slope[0] / self.grid.volumes * gradient[:, None] * gradient
        ends = state.positions[:, self.grid.face_vertices[:, self.edge_faces]].reshape(4, -1)
        edge_forces = -loads.pressure[self.edge_of_face] * local_derivative(
            lambda e: edge_pressure_forces(section, e.reshape(2, 2, 4, -1)).reshape(4, 4, -1), ends
        )
        by_transport = self.term.derivatives(state.positions, state.balance)
        data = self.pattern.assemble(
            LocalDerivatives(
                forces,
                gradient,
                osmotic_slope[-1],
                edge_forces,
                self.stabilisation.data,
                by_transport,
                interval.duration,
            )
        )
        for edge, index in self.degrees_of_freedom.of_tied_edge.items():
            if not np.isnan(loads.displacement[EDGES.index(edge)]):
                entries = np.flatnonzero(self.pattern.rows == index)
                on_diagonal = self.pattern.columns[entries] == index
                data[entries] = np.where(on_diagonal, self.momentum_scale[index] / self.length_scale, 0.0)
        return data

    def edge_areas(self, positions: Array) -> Array:
        """Current areas of the edges projected on their reference direction, in the order of EDGES."""
        vectors = edge_area_vectors(self.grid.section, positions[:, self.grid.face_vertices])
        return np.array([OUTWARD[edge] * vectors[EDGE_AXIS[edge], self.grid.edges[edge]].sum() for edge in EDGES])

    def tied_edge_reactions(self, state: BlockState, loads: EdgeLoads) -> dict[str, float]:
        """Forces that press on the tied edges, positive in compression, without the pressures on their neighbours."""
        forces = {}
        for edge, index in self.degrees_of_freedom.of_tied_edge.items():
            others = np.where(np.array(EDGES) == edge, 0.0, loads.pressure)
            forces[edge] = -OUTWARD[edge] * (
                state.internal_forces[index] - self._pressure_forces(state.positions, others)[index]
            )
        return forces

    @cached_property
    def length_scale(self) -> float:
        """Size of a cell, mm."""
        areas = polygon_volume(SECTIONS["plane-strain"], *self.grid.vertices[:, self.grid.cell_vertices])
        return float(np.sqrt(areas.mean()))

    @cached_property
    def momentum_scale(self) -> Array:
        """Size of the forces that balance at each free displacement: moduli times areas, N."""
        gradient = polygon_volume_gradient(self.grid.section, *self.grid.vertices[:, self.grid.cell_vertices])
        return self.gather_corners @ (self._modulus * np.abs(gradient)).ravel()

    @cached_property
    def unknown_scale(self) -> Array:
        """Natural size of the changes of the unknowns."""
        scale = np.ones(self.pattern.size)
        scale[: self.degrees_of_freedom.number] = self.length_scale
        scale[self.degrees_of_freedom.number : self.degrees_of_freedom.number + self.grid.cells] = self._modulus.mean()
        return scale

    @cached_property
    def places(self) -> Array:
        """Where on the grid the unknowns are, ``(2, unknowns)``; nan for tied edges, which are in no single place."""
        number, of_vertex = self.degrees_of_freedom.number, self.degrees_of_freedom.of_vertex
        places = np.empty((2, self.pattern.size))
        for unknowns in of_vertex:
            places[:, unknowns[unknowns >= 0]] = self.grid.lattice("vertices")[:, unknowns >= 0]
        places[:, list(self.degrees_of_freedom.of_tied_edge.values())] = np.nan
        places[:, number:] = np.tile(self.grid.lattice("cells"), len(self.balances))
        return places

    @cached_property
    def solver(self) -> DirectSolver:
        """Of systems with the Jacobian as their matrix."""
        return DirectSolver(self.pattern.rows, self.pattern.columns, self.places)

    def residual_scale(self, bath_concentration: float) -> Array:
        """Size of what the equations balance, to judge residuals by."""
        content = np.array([1.0, bath_concentration, bath_concentration])[: len(self.balances)]
        return np.concatenate([self.momentum_scale, np.outer(content, self.grid.volumes).ravel()])

    @property
    def _modulus(self) -> Array:
        return np.broadcast_to(aggregate_modulus(self.term.cells.tissue)[0], (self.grid.cells,))

    def _storing(self, balance: BlockBalance, water_potential: Array) -> BlockBalance:
        """The balance with what the stabilisation stores besides water."""
        stored = np.zeros_like(balance.residual)
        stored[0, 0] = self.stabilisation @ water_potential
        return balance._replace(
            residual=balance.residual + stored, contents=balance.contents + stored / self.grid.volumes
        )

    def _external_forces(self, unknowns: Array, positions: Array, loads: EdgeLoads) -> Array:
        external = self._pressure_forces(positions, loads.pressure)
        for edge, index in self.degrees_of_freedom.of_tied_edge.items():
            external[index] -= OUTWARD[edge] * loads.force[EDGES.index(edge)]
        return external

    def _pressure_forces(self, positions: Array, pressure: Array) -> Array:
        """Forces of the pressures on the edges, ``(4,)``, that act along the displacements."""
        ends = positions[:, self.grid.face_vertices[:, self.edge_faces]]
        forces = pressure[self.edge_of_face] * edge_pressure_forces(self.grid.section, ends)
        return self.gather_ends @ forces.ravel()

    def _sound(self, F: Array, J: Array, balance: BlockBalance) -> Array:
        upright = ((F[0] * F[3] > F[1] * F[2]) & (F[4] > 0.0)).all(axis=0)
        cells, faces = self.term.cells.tissue, self.term.faces.tissue
        sound = upright & (J[0] - 1.0 + cells.fluid_fraction[0] > 0.0)
        dry = balance.faces.local.J[0] - 1.0 + faces.fluid_fraction[0] <= 0.0
        sound[self.term.diamonds.cells[0, dry]] = False
        return sound


def make_block(
    grid: BlockGrid, edges: Mapping[str, EdgeCondition], cells: Mixture, faces: Mixture, solid: Tissue
) -> Block:
    """Put a block together.

    Parameters
    ----------
    grid
        Of the stress-free solid.
    edges
        A condition for each of left, right, bottom and top.
    cells, faces
        The model with the tissue at ``grid.centres`` and at ``grid.face_centres`` (all faces); one row.
    solid
        The tissue at ``mechanics.integration_points(grid)``; one row.

    Raises
    ------
    ValueError
        If the conditions on the edges contradict each other or leave the block loose; all problems in one message.
    """
    if problems := check_edges(grid.section.rings, edges):
        raise ValueError("; ".join(problems))
    crossed = diamonds(grid, [edge for edge in EDGES if edges[edge].permeable])
    unknown = degrees_of_freedom(grid, edges)
    loaded = [i for i, edge in enumerate(EDGES) if edges[edge].displacement in ("free", "tied")]
    shear = np.broadcast_to(shear_modulus(cells.tissue)[0], (grid.cells,))
    stabilisation = alternating_storage(grid, shear)
    edge_faces = np.concatenate([np.zeros(0, dtype=int), *(grid.edges[EDGES[i]] for i in loaded)])
    edge_of_face = np.repeat(loaded, [len(grid.edges[EDGES[i]]) for i in loaded]).astype(int)
    return Block(
        grid=grid,
        edges=dict(edges),
        degrees_of_freedom=unknown,
        solid=block_solid(grid, solid),
        term=BlockTransportTerm(grid, crossed, cells, at_points(faces, crossed.faces)),
        stabilisation=stabilisation,
        pattern=JacobianPattern(grid, crossed, unknown, edge_faces, stabilisation, len(cells.model.balances)),
        edge_faces=edge_faces,
        edge_of_face=edge_of_face,
        gather_corners=unknown.gather(grid.cell_vertices),
        gather_ends=unknown.gather(grid.face_vertices[:, edge_faces]),
    )
