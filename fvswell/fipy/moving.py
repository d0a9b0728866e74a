"""Columns and blocks under way, as FiPy sees them: a mesh that moves with the solid, and what equations on it need.

A solute that is dissolved in the water of the tissue has, in a cell of present volume V, the amount V n_f c. While the
cell moves, FiPy's terms see one volume, the present one. `MovingBody.fluid_fraction` therefore has as its old value the
water that was in the cell before the step over the volume that the cell has now, and

    TransientTerm(coeff=fluid_fraction, var=c)  =  (V n_f c - (V n_f c) before the step)/dt

exactly. The flow of water is the mean over the step, which is what changed the water in the cells, so a concentration
that is the same everywhere stays so under any deformation. (The other way, a mesh that stays that of the stress-free
solid with J n_f and the stretch in the coefficients, conserves as well, but gradients and sources on it are not those
that one would write down.)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from fipy import CellVariable, FaceVariable
from scipy.sparse.linalg import splu

from fvswell.block.block import Block
from fvswell.block.part_loads import pressing_loads
from fvswell.errors import SolverError
from fvswell.fipy.block_terms import DiamondFluxTerm
from fvswell.fipy.mesh import block_mesh, column_mesh, column_nodes, move
from fvswell.numerics.loads import Protocol, load_value
from fvswell.numerics.state import (
    ELAPSED,
    FAILED,
    PHASE,
    RUNNING,
    SEGMENT,
    STATUS,
    TIME,
    Control,
    State,
    Workspace,
    record_room,
    workspace,
)
from fvswell.physics.tissue import Array, fluid_fraction

__all__ = ["MovingBlock", "MovingBody", "MovingColumn", "Step"]


class Step(NamedTuple):
    """A step that has just been made."""

    time: float  # s since the run began, at its end
    dt: float  # s
    phase: int


class _Made(NamedTuple):
    """What a step was made of."""

    protocol: Protocol
    control: Control
    work: Workspace
    segment: int
    began: float  # s since the phase began
    dt: float
    gained: Array  # water in the cells
    entered: Array  # (parts, 3)


class MovingBody(ABC):
    """A column or block that is run step by step: iterate over it, and sweep equations of your own in every step.

    Parameters
    ----------
    setup
        What is run, as `fvswell.simulation.setup.make_setup` makes it of a case; its phases have durations in s.

    Attributes
    ----------
    mesh
        FiPy's mesh, which moves. Terms keep the geometry that they were first built with: write the equation anew in
        every step.
    volume_ratio, fluid_fraction
        J and n_f of the cells at the end of the step; see the head of this module for the old value of the latter.

    Raises
    ------
    SolverError
        While iterating, if the run cannot go on.
    """

    def __init__(self, setup: Any) -> None:
        self.setup = setup
        self.state: State = setup.state
        self.mesh = self._new_mesh()
        volumes = np.array(self.mesh.cellVolumes)
        self.volume_ratio = CellVariable(mesh=self.mesh, name="J", value=volumes / setup.volumes)
        self.fluid_fraction = CellVariable(mesh=self.mesh, name="n_f", value=self.water / volumes, hasOld=True)

    @property
    def water(self) -> Array:
        """Water in the cells, (cells,): mm of a column, mm3 of a block (of a disc whole, of a slab 1 mm thick)."""
        water: Array = self.setup.volumes * (self.state.contents[0] - 1.0 + self.setup.tissue.fluid_fraction)
        return water

    @cached_property
    def durations(self) -> list[float]:
        """Durations of the phases, s.

        Raises
        ------
        SolverError
            If a phase ends on a rate: that takes a run to find.
        """
        for phase in self.setup.case.phase:
            if phase.until is not None:
                raise SolverError(f"{self.setup.case.source}: phase {phase.name} ends on a rate: give its duration")
        return [float(phase.duration) for phase in self.setup.case.phase]

    def fields(self) -> dict[str, Array]:
        """Every output field as it is now, by name: arrays over cells, nodes or faces, and numbers."""
        record = record_room(self.state, 1, 1)
        for name in ("unknowns", "contents", "loads", "crossed"):
            getattr(record, name)[0] = getattr(self.state, name)
        record.time[0], record.phase[0], record.filled[0] = self.state.clock[ELAPSED], self.state.counts[PHASE], 1
        return {name: values[0] for name, values in self.setup.fields(record).items()}

    def __iter__(self) -> Iterator[Step]:
        """Make steps to the end of the last phase."""
        setup, state = self.setup, self.state
        protocol, control = setup.protocol(self.durations), setup.control()._replace(every=0)
        work = workspace(state, len(control.nodes))
        while state.counts[STATUS] == RUNNING:
            record = record_room(state, len(protocol.output_times) + 1, 1)
            water, crossed = self.water, state.crossed.copy()
            segment, began = int(state.counts[SEGMENT]), float(state.clock[TIME])
            setup.march(setup.body, setup.volumes, setup.scale, protocol, control, state, record, work)
            if record.filled[1] == 1:
                dt, gained, entered = float(record.steps[0, 1]), self.water - water, state.crossed - crossed
                self._follow(_Made(protocol, control, work, segment, began, dt, gained, entered))
                yield Step(float(state.clock[ELAPSED]), dt, int(protocol.phase[segment]))
        if state.counts[STATUS] == FAILED:
            raise SolverError(f"{setup.case.source}: no step could be made after t = {state.clock[ELAPSED]:.6g} s")

    def _follow(self, made: _Made) -> None:
        """Move the mesh to where a step has led."""
        move(self.mesh, self._vertices())
        volumes = np.array(self.mesh.cellVolumes)
        self.volume_ratio.setValue(volumes / self.setup.volumes)
        self.fluid_fraction.setValue((self.water - made.gained) / volumes)
        self.fluid_fraction.updateOld()
        self.fluid_fraction.setValue(self.water / volumes)
        self._set_flow(made)

    @abstractmethod
    def _new_mesh(self) -> Any:
        """FiPy's mesh of the body as it is."""

    @abstractmethod
    def _vertices(self) -> Array:
        """Vertices of the body as it is, (dimensions, vertices) mm."""

    @abstractmethod
    def _set_flow(self, made: _Made) -> None:
        """Set the mean flow of water in a step."""


class MovingColumn(MovingBody):
    """A column under way.

    Attributes
    ----------
    water_flux
        Mean flux of water through the faces in the step, relative to the solid, along x, mm/s: a vector variable.
    """

    def __init__(self, setup: Any) -> None:
        super().__init__(setup)
        self.water_flux = FaceVariable(mesh=self.mesh, name="q", rank=1)

    def _new_mesh(self) -> Any:
        return column_mesh(self.setup.column.grid, self.state.contents[0])

    def _vertices(self) -> Array:
        return column_nodes(self.setup.column.grid, self.state.contents[0])[None]

    def _set_flow(self, made: _Made) -> None:
        if self.setup.column.parts[1].open:
            through = made.entered[0, 0] - np.concatenate([[0.0], np.cumsum(made.gained)])
        else:
            through = np.append(np.cumsum(made.gained[::-1])[::-1], 0.0)
        self.water_flux.setValue(through[None] / made.dt)


class MovingBlock(MovingBody):
    """A block under way.

    Attributes
    ----------
    water_flow
        Mean flow of water in the step through the crossed faces (those of ``block.diamonds.faces``), in total per face,
        out of its first cell, (crossed,) mm3/s.
    """

    def __init__(self, setup: Any) -> None:
        super().__init__(setup)
        outflow = self.block.diamonds.outflow
        self.water_flow = np.zeros(outflow.shape[1])
        self._divergence = outflow
        self._balance = splu((outflow @ outflow.T).tocsc())

    @property
    def block(self) -> Block:
        """The block."""
        block: Block = self.setup.block
        return block

    def solute_flux(self, c: Any, diffusivity: float, drag: float, outside: float) -> DiamondFluxTerm:
        """Outflow of a solute in the water: it diffuses, and is dragged with a share of the water's velocity.

        Parameters
        ----------
        c
            Its concentration, per volume of water.
        diffusivity
            In the water of the tissue, mm2/s.
        drag
            Share of the water's velocity.
        outside
            Concentration in the baths.
        """
        now, through = self._transport(self.state.unknowns, self.state.loads), np.ones(len(self.water_flow))
        for part, faces in zip(self.block.crossed_parts, self.block.crossed_faces, strict=True):
            through[faces] = float(self.block.parts[part].open)  # nothing but ions passes an electrode
        water = through * fluid_fraction(self.block.faces, now.face_ratio)
        return DiamondFluxTerm(
            self.block.diamonds, c, now.metric, diffusivity * water, drag * self.water_flow, outside
        )  # fmt: skip

    def _new_mesh(self) -> Any:
        return block_mesh(self.block.grid, self._vertices())

    def _vertices(self) -> Array:
        positions: Array = self.block.positions(self.state.unknowns)
        return positions

    def _transport(self, unknowns: Array, loads: Array) -> Any:
        known = dict(zip(self.setup.body.load_names, loads, strict=True))
        return self.block.transport_at(unknowns, pressing_loads(self.block.parts, known, self.block.concentration))

    def _set_flow(self, made: _Made) -> None:
        """Flow of the stages, and what their last iterations have left out: the least flow that closes the balances."""
        weights, nodes = made.control.coefficients[-1], made.control.nodes
        flow = np.zeros_like(self.water_flow)
        for weight, node, unknowns in zip(weights, nodes, made.work.stages, strict=True):
            time = made.began + node * made.dt
            loads = np.array(
                [
                    load_value(made.protocol.table, made.segment, load, time, self.state.phase_loads)
                    for load in range(len(self.state.loads))
                ]
            )
            flow += weight * self._transport(unknowns, loads).fluxes[0]
        left = made.gained / made.dt + self._divergence @ flow
        self.water_flow = flow - self._divergence.T @ self._balance.solve(left)
