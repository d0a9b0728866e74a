"""A block as a run sees it: what is marched, what is recorded, how the result is laid out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fvswell.block.block import Block, make_block
from fvswell.block.edges import EdgeCondition, drive_names
from fvswell.block.equilibrium import (
    NoEquilibrium,
    equilibrated_state,
    initial_open_circuit_ratio,
    with_open_circuit_ratio,
)
from fvswell.block.fields import block_fields
from fvswell.block.grid import BlockGrid, block_grid
from fvswell.block.mechanics import integration_points
from fvswell.block.sides import EDGE_AXIS, EDGES
from fvswell.block.system import BlockSystem
from fvswell.case.case import BlockCase
from fvswell.case.values import Ramp, final_value
from fvswell.errors import SolverError
from fvswell.numerics.conservation import ConservationBooks
from fvswell.numerics.protocol import Drive, Protocol, phase_targets
from fvswell.numerics.time_stepping import (
    BACKWARD_EULER,
    FIRST_STEP,
    SDIRK2,
    SMALLEST_STRAIN,
    State,
    StepControl,
)
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import MODELS, Mixture
from fvswell.physics.solid import aggregate_modulus
from fvswell.physics.tissue import Array, Tissue
from fvswell.results.fields import FIELDS
from fvswell.results.file import Layout

__all__ = ["BlockRun"]

_LOADS = ("pressure", "force", "displacement")


class BlockRun:
    """A case of a block.

    Raises
    ------
    SolverError
        If no state at rest is found to start from.
    """

    def __init__(self, case: BlockCase) -> None:
        self.case = case
        self.grid = _grid(case)
        coefficient = np.array([[case.bath.osmotic_coefficient]])
        model = MODELS[case.model]
        cells = Mixture(model, case.tissue_at_points(self.grid.centres), coefficient)
        faces = Mixture(model, case.tissue_at_points(self.grid.face_centres), coefficient)
        solid = case.tissue_at_points(integration_points(self.grid))
        block = make_block(self.grid, _edges(case), cells, faces, solid)
        try:
            self._initial = equilibrated_state(BlockSystem(block), case.bath.concentration)
        except NoEquilibrium as error:
            raise SolverError(f"{case.source}: {error}") from None
        if model.open_circuit and case.open_circuit_permeability != "state":
            ratio = np.ones((1, 1))
            if case.open_circuit_permeability == "initial":
                ratio = initial_open_circuit_ratio(block, self._initial.unknowns[0, 0], case.bath.concentration)
            block = with_open_circuit_ratio(block, ratio)
        self.system = BlockSystem(block)
        self._height = self._mean_height(self._initial)
        self.probe = self._probe_vertex()

    @property
    def block(self) -> Block:
        """The block that is marched."""
        return self.system.block

    @property
    def tissue(self) -> Tissue:
        """Tissue in the cells."""
        return self.block.term.cells.tissue

    @property
    def initial_volume_ratio(self) -> Array:
        """Volume ratio of the cells at rest, (1, cells)."""
        return self.block.volume_ratio(self.block.positions(self._initial.unknowns[0, 0]))

    @property
    def initial_stretch(self) -> float:
        """Mean height at rest over the height of the stress-free solid."""
        return self._height / self.case.geometry.height

    @property
    def drainage_length(self) -> float:
        """Distance in the block at rest from the bath to the vertex that is farthest from it, mm."""
        positions = self.block.positions(self._initial.unknowns[0, 0])
        open_edges = [name for name in EDGES if getattr(self.case.geometry.edges, name).permeable]
        bath = positions[:, np.concatenate([self.grid.edge_vertices(name) for name in open_edges])]
        return float(np.hypot(*(positions[:, :, None] - bath[:, None, :])).min(axis=1).max())

    def durations(self) -> Array:
        """Durations of the phases, (1, phases), s."""
        return np.array([[phase.duration for phase in self.case.phase]], dtype=float)

    def start(self) -> State:
        """State of the equilibrated block."""
        state = self._initial
        copies = {name: getattr(state, name).copy() for name in ("unknowns", "contents", "fluxes", "phase", "time")}
        loads = {name: value.copy() for name, value in state.loads.items()}
        return replace(state, **copies, loads=loads, elapsed=state.elapsed.copy())

    def books(self, state: State) -> ConservationBooks:
        """Books on the balances, from a state on."""
        cations = self._cation_contents if len(self.block.balances) > 1 else None
        return ConservationBooks(self.system.volumes, self.block.balances, state, cations)

    def _cation_contents(self, unknowns: Array) -> Array:
        """Cations per reference volume, (1, cells)."""
        positions, potentials = self.block.positions(unknowns[0, 0]), self.block.potentials(unknowns[0, 0])
        return self.block.term.cells.cation_contents(self.block.volume_ratio(positions), potentials[1])

    def drives(self) -> dict[str, Drive]:
        """Driven quantities over the phases; what a phase does not name goes on as it is."""
        names, phases = drive_names(self.block.edges), self.case.phase
        target = {name: np.full((1, len(phases)), np.nan) for name in names}
        over = {name: np.zeros((1, len(phases))) for name in names}
        held: dict[str, float] = {"bath": self.case.bath.concentration}
        held |= {name: 0.0 for name in names if name.endswith(".pressure")}
        for p, phase in enumerate(phases):
            named = {"bath": phase.bath_concentration}
            for edge in EDGES:
                load = getattr(phase, edge)
                if load is not None:
                    held = {name: value for name, value in held.items() if not name.startswith(f"{edge}.")}
                    named |= {f"{edge}.{kind}": getattr(load, kind) for kind in _LOADS}
            for name, value in named.items():
                if value is not None:
                    rest = self._initial.loads[name][0] if name.endswith(".displacement") else 0.0
                    held[name] = rest + final_value(value)
                    over[name][0, p] = value.over if isinstance(value, Ramp) else 0.0
            for name, value in held.items():
                target[name][0, p] = value
        return {name: Drive(target[name], over[name]) for name in names}

    def protocol(self, duration: Array) -> Protocol:
        """Protocol with phases of the given durations."""
        drives, case = self.drives(), self.case
        targets = phase_targets(duration, drives.values(), case.time.fixed_steps, case.output.times or ())
        return Protocol(duration, drives, targets)

    def control(self) -> StepControl:
        """How the steps are chosen."""
        time = self.case.time
        if time.fixed_steps is not None:
            return StepControl(BACKWARD_EULER)
        finest = min(np.diff(nodes).min() for nodes in self.case.grid_nodes())
        first = (
            FIRST_STEP * finest**2 / float((self.tissue.hydraulic_permeability * aggregate_modulus(self.tissue)).max())
        )
        return StepControl(SDIRK2, time.tolerance * self.largest_strain(), time.max_step or np.inf, first)

    def largest_strain(self) -> Array:
        """Largest strain at rest that the loads would bring about in a column of the mean tissue, (1,).

        It only scales the tolerance: a block's strain at rest takes a run to find.
        """
        drives, case, mixture = self.drives(), self.case, self.block.term.cells
        areas = self.block.edge_areas(self.block.positions(self._initial.unknowns[0, 0]))
        strains = []
        for p in range(len(case.phase)):
            value = {name: np.nan_to_num(drive.target[0, p]) for name, drive in drives.items()}
            pressures = [value.get(f"{edge}.pressure", 0.0) for edge in EDGES]
            pressures += [value[name] / area for edge, area in zip(EDGES, areas, strict=True)
                          if (name := f"{edge}.force") in value]  # fmt: skip
            largest = max(pressures, key=abs)
            rest = [
                equilibrium_volume_ratio(
                    mixture.tissue, pressure, bath, mixture.bath_osmotic_coefficient, mixture.model.swelling
                ).mean()
                for pressure, bath in ((0.0, case.bath.concentration), (largest, value["bath"]))
            ]
            strains.append(abs(rest[1] / rest[0] - 1.0))
            for edge, axis in EDGE_AXIS.items():
                if (name := f"{edge}.displacement") in drives:
                    moved = drives[name].target[0, p] - self._initial.loads[name][0]
                    strains.append(abs(np.nan_to_num(moved)) / (case.geometry.width, case.geometry.height)[axis])
        return np.maximum(np.nanmax(strains, keepdims=True), SMALLEST_STRAIN)

    def strain(self, state: State) -> float:
        """Change of the mean height over the height at rest."""
        return self._mean_height(state) / self._height - 1.0

    def fields(self, state: State) -> dict[str, Array]:
        """Fields to record."""
        displacement = self.block.positions(state.unknowns[0, 0]) - self.grid.vertices
        start = self.block.positions(self._initial.unknowns[0, 0]) - self.grid.vertices
        moved = (displacement - start)[:, self.probe]
        height = self._mean_height(state)
        return {
            "global_strain": np.array(height / self._height - 1.0),
            "height": np.array(height),
            "probe_displacement_x": moved[0],
            "probe_displacement_y": moved[1],
            **block_fields(self.block, state),
        }

    def place(self, balance: str, point: int) -> str:
        """Where a point of the residual of a balance lies: a vertex for momentum, else a cell."""
        x, y = (self.grid.vertices if balance == "momentum" else self.grid.centres)[:, point]
        return f"x = {x:.3g} mm, y = {y:.3g} mm"

    def layout(self, duration: Array) -> Layout:
        """Layout of the result, by the UGRID conventions."""
        grid = self.grid
        connectivity = {"_FillValue": np.int32(-1), "start_index": np.int32(0)}
        mesh = {
            "cf_role": "mesh_topology", "long_name": "grid of the block in the stress-free solid",
            "topology_dimension": np.int32(2), "node_coordinates": "node_x node_y",
            "face_node_connectivity": "face_nodes", "face_dimension": "face", "face_coordinates": "face_x face_y",
        }  # fmt: skip
        axis = "distance from the axis" if grid.section.rings else "distance from the left edge"
        coordinates: dict[str, Any] = {"mesh": ((), np.int32(0), mesh)}
        for location, points in (("node", grid.vertices), ("face", grid.centres)):
            for name, values, text in zip(("x", "y"), points, (axis, "distance from the bottom"), strict=True):
                attributes = {"units": "mm", "long_name": f"{text} in the stress-free solid",
                              "standard_name": f"projection_{name}_coordinate"}  # fmt: skip
                coordinates[f"{location}_{name}"] = ((location,), values, attributes)
        probe = grid.vertices[:, self.probe]
        return Layout(
            dimensions={"node": grid.vertices.shape[1], "face": grid.cells, "corner": 4, "phase": len(self.case.phase),
                        "axis": 2},
            coordinates={
                "face_nodes": (("face", "corner"), grid.cell_vertices.T.astype(np.int32),
                               connectivity | {"cf_role": "face_node_connectivity", "long_name": "corners"}),
                **coordinates,
                "phase_end": (("phase",), np.cumsum(duration[0]), FIELDS["phase_end"].attributes),
                "probe": (("axis",), probe, {"units": "mm", "long_name": "the probe, stress-free"}),
            },
            location_dimensions={"cell": "face", "node": "node"},
            case=self.case,
            comment="Node coordinates are of the stress-free solid; displacement_x and displacement_y move them.",
            conventions="CF-1.11 UGRID-1.0",
            mesh="mesh",
        )  # fmt: skip

    def _mean_height(self, state: State) -> float:
        positions = self.block.positions(state.unknowns[0, 0])
        top, bottom = (self.grid.edge_vertices(edge) for edge in ("top", "bottom"))
        x = self.grid.vertices[0, top]
        weight = x if self.grid.section.rings else np.ones_like(x)  # of the area of the stress-free solid
        heights = positions[1, top] - positions[1, bottom]
        return float(np.trapezoid(weight * heights, x) / np.trapezoid(weight, x))

    def _probe_vertex(self) -> int:
        geometry = self.case.geometry
        place = geometry.probe or (geometry.width, geometry.height)
        return int(np.hypot(*(self.grid.vertices - np.array(place)[:, None])).argmin())


def _grid(case: BlockCase) -> BlockGrid:
    return block_grid(case.geometry.kind, *case.grid_nodes())


def _edges(case: BlockCase) -> dict[str, EdgeCondition]:
    edges = {name: getattr(case.geometry.edges, name) for name in EDGES}
    return {name: EdgeCondition(edge.displacement, edge.permeable) for name, edge in edges.items()}
