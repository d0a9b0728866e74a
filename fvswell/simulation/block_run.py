"""A case of a block as a run sees it: what is integrated, what is recorded, how the result is laid out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from fvswell.block.block import Block
from fvswell.block.body import BlockBody
from fvswell.block.equilibrium import NoEquilibrium, equilibrated_body, initial_open_circuit_ratio, start_of
from fvswell.block.fields import block_fields
from fvswell.block.grid import BlockGrid, block_grid
from fvswell.block.histories import part_histories
from fvswell.block.make_block import make_block
from fvswell.block.march import march_block
from fvswell.block.reactions import part_areas
from fvswell.boundary.sides import EDGE_AXIS
from fvswell.case.acting_loads import acting_loads, moved_part
from fvswell.case.case import Case
from fvswell.case.loads import AnyLoad, in_length, shape_of
from fvswell.case.output_times import output_times
from fvswell.errors import SolverError
from fvswell.numerics.loads import AnyLoad as NumericLoad
from fvswell.numerics.loads import Protocol, make_protocol
from fvswell.numerics.state import Control, Record, State
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import MODELS, Model
from fvswell.physics.permeability import hydraulic_permeability
from fvswell.physics.solids import aggregate_modulus
from fvswell.physics.tissue import Array, Tissue
from fvswell.results.fields import FIELDS
from fvswell.results.layout import Layout
from fvswell.simulation.block_reference import BlockTissues, stress_free_block, tissues_at
from fvswell.simulation.loads import measured_load, numeric_load
from fvswell.simulation.step_control import FIRST_STEP, SMALLEST_STRAIN, step_control

__all__ = ["BlockRun"]


class BlockRun:
    """A case of a block.

    Parameters
    ----------
    case
        What is simulated.
    model
        To use instead of the case's own.
    held
        Loads that a run before has left, nan where they were found; without it the block is in equilibrium.

    Raises
    ------
    SolverError
        If no equilibrium is found to start from.
    """

    def __init__(self, case: Case, model: Model | None = None, held: Array | None = None) -> None:
        geometry: Any = case.geometry
        self.case, self.model, self.held = case, model or MODELS[case.model], held
        self._sample = block_grid(geometry.kind, *geometry.grid_nodes(case.parts))
        try:
            self.body, self.state = _equilibrated(case, self.model, self._sample)
        except NoEquilibrium as error:
            raise SolverError(f"{case.source}: {error}") from None
        self.grid = self.block.grid
        self.volumes, self.scale = self.grid.volumes, self.block.content_scale
        self._initial = self.block.positions(self.state.unknowns)
        self._rest = dict(zip(self.body.load_names, self.state.loads.copy(), strict=True))
        self.probe = self._probe_vertex()

    @property
    def block(self) -> Block:
        """The block."""
        return self.body.block

    @property
    def tissue(self) -> Tissue:
        """Tissue in the cells, as the model sees it."""
        return self.block.cells

    @property
    def march(self) -> Callable[..., None]:
        """The integrator."""
        return march_block

    @property
    def initial_volume_ratio(self) -> Array:
        """J of the cells in equilibrium before the first phase, (cells,)."""
        ratio: Array = self.block.transport_at(self.state.unknowns, self.block.unloaded).volume_ratio
        return ratio

    @property
    def stress_free_height(self) -> float:
        """Mean height of the stress-free solid, mm."""
        return float(self.body.mean_height(self.grid.vertices))

    @property
    def initial_stretch(self) -> float:
        """Mean height in equilibrium over that of the stress-free solid."""
        return float(self.body.initial_height / self.stress_free_height)

    @property
    def drainage_length(self) -> float:
        """Distance in the equilibrated block from the bath to the vertex that is farthest from it, mm."""
        block = self.block
        faces = [faces for part, faces in zip(block.parts, block.part_faces, strict=True) if part.open]
        bath = self._initial[:, self.grid.face_vertices[:, np.concatenate(faces)].ravel()]
        return float(np.hypot(*(self._initial[:, :, None] - bath[:, None, :])).min(axis=1).max())

    def equilibrium_strains(self) -> Array:
        """Nothing: the strain of a block in equilibrium takes a run to find."""
        return np.zeros(0)

    def loads(self) -> list[list[NumericLoad | None]]:
        """Each load of the block in each phase."""
        phases = []
        for acting in acting_loads(self.case, self._held_loads()):
            loads = {name: self._load(name, load) for name, load in acting.items()}
            phases.append([loads.get(name) for name in self.body.load_names])
        return phases

    def _held_loads(self) -> dict[str, float] | None:
        """Loads that a run before has left, by the names of the case."""
        if self.held is None:
            return None
        held = zip(self.body.load_names, map(float, self.held), strict=True)
        return {name: value - self._rest_of(name) for name, value in held if not np.isnan(value)}

    def _load(self, name: str, load: AnyLoad) -> NumericLoad | None:
        """A load as the integrator takes it."""
        if not name.endswith("displacement"):
            return numeric_load(shape_of(load))
        edges = {part.name: part.edge for part in self.case.parts}
        axis = EDGE_AXIS[edges[name.partition(".")[0]]]
        if name.endswith(".tangential_displacement"):
            axis = 1 - axis
        return numeric_load(in_length(load, self._free_extent(axis)), self._rest_of(name))

    def _free_extent(self, axis: int) -> float:
        """Of the equilibrated block along x (0) or y (1), mm: its mean height, or its width at the bottom."""
        if axis == 1:
            return float(self.body.initial_height)
        bottom = self._initial[0, self.grid.edge_vertices("bottom")]
        return float(np.ptp(bottom))

    def _rest_of(self, name: str) -> float:
        """Value in the equilibrated block of what a case gives relative to it: a displacement."""
        return float(self._rest[name]) if name.endswith("displacement") else 0.0

    def protocol(self, durations: Sequence[float], times: Sequence[float] | Array | None = None) -> Protocol:
        """Protocol with phases of given durations; ``times`` are outputs to record instead of the case's own."""
        due: Any = output_times(self.case, durations) if times is None else np.asarray(times)
        slopes = [name.endswith("displacement") for name in self.body.load_names]
        return make_protocol(self.loads(), durations, due, slope_matters=slopes)

    def measured(self) -> list[int]:
        """What the end of each phase may depend on: index of a load, or `STRAIN`."""
        acting = acting_loads(self.case, self._held_loads())
        return [measured_load(self.body.load_names, moved_part(self.case, each)) for each in acting]

    def control(self) -> Control:
        """How the steps are chosen."""
        return step_control(self.case, self.largest_strain(), self.first_step())

    def first_step(self) -> float:
        """Step to start with where loads jump, s: a part of the time in which the finest cell consolidates."""
        geometry: Any = self.case.geometry
        finest = min(np.diff(nodes).min() for nodes in geometry.grid_nodes(self.case.parts))
        return FIRST_STEP * float(finest) ** 2 / float(np.max(self._mobility()))

    def consolidation_time(self) -> float:
        """Square of the drainage length over k H, H being the aggregate modulus at J = 1, s."""
        return self.drainage_length**2 / float(np.min(self._mobility()))

    def largest_strain(self) -> float:
        """Largest strain in equilibrium that the loads would bring about in a column of the mean tissue.

        It only scales the tolerance: the strain of a block in equilibrium takes a run to find.
        """
        tissue, strains = self.block.cells, []
        areas = part_areas(self.block, self._initial)
        bath = f"{self.block.parts[self.block.outside.reference].name}.bath_concentration"
        start = equilibrium_volume_ratio(tissue, 0.0, self.case.bath.concentration).mean()
        for loads in self.loads():
            value = {n: load.target for n, load in zip(self.body.load_names, loads, strict=True) if load is not None}
            names = [part.name for part in self.block.parts]
            pressures = [value.get(f"{name}.pressure", 0.0) for name in names]
            forces = ((f"{name}.force", area) for name, area in zip(names, areas, strict=True))
            pressures += [value[name] / area for name, area in forces if name in value]
            end = equilibrium_volume_ratio(tissue, max(pressures, key=abs), value[bath]).mean()
            strains.append(abs(end / start - 1.0))
            for edge, axis in EDGE_AXIS.items():
                if (name := f"{edge}.displacement") in value:
                    moved = abs(value[name] - self._rest[name])
                    strains.append(moved / self._extent[axis])
        return max(float(np.nanmax(strains)), SMALLEST_STRAIN)

    def strain(self, state: State) -> float:
        """Change of the mean height over that in equilibrium."""
        height = self.body.mean_height(self.block.positions(state.unknowns))
        return float(height / self.body.initial_height - 1.0)

    def fields(self, record: Record) -> dict[str, Array]:
        """Fields of all outputs of a record."""
        outputs = int(record.filled[0])
        positions = np.stack([self.block.positions(unknowns) for unknowns in record.unknowns[:outputs]])
        moved = positions[:, :, self.probe] - self._initial[:, self.probe]
        height = self.body.mean_height(positions)
        return {
            "global_strain": height / self.body.initial_height - 1.0,
            "height": height,
            "probe_displacement_x": moved[:, 0],
            "probe_displacement_y": moved[:, 1],
            **block_fields(self.body, record),
            **part_histories(self.body, record, self._initial),
        }

    def place(self, balance: str, point: int) -> str:
        """Where a point of a balance lies: a vertex for momentum, else a cell."""
        x, y = (self.grid.vertices if balance == "momentum" else self.grid.centres)[:, point]
        return f"x = {x:.3g} mm, y = {y:.3g} mm"

    def layout(self, durations: Sequence[float]) -> Layout:
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
                "phase_end": (("phase",), np.cumsum(durations), FIELDS["phase_end"].attributes),
                "probe": (("axis",), probe, {"units": "mm", "long_name": "the probe, stress-free"}),
            },
            location_dimensions={"cell": "face", "node": "node"},
            case=self.case,
            comment="Node coordinates are of the stress-free solid; displacement_x and displacement_y move them.",
            conventions="CF-1.11 UGRID-1.0",
            mesh="mesh",
        )  # fmt: skip

    @property
    def _extent(self) -> Array:
        """Of the stress-free solid along x and y, mm."""
        extent: Array = np.ptp(self.grid.vertices, axis=1)
        return extent

    def _mobility(self) -> Array:
        tissue = self.block.cells
        mobility: Array = hydraulic_permeability(tissue, 1.0) * aggregate_modulus(tissue.solid, tissue.fluid_fraction)
        return mobility

    def _probe_vertex(self) -> int:
        geometry: Any = self.case.geometry
        vertices = self._sample.vertices
        place = np.ptp(vertices, axis=1) if geometry.probe is None else np.array(geometry.probe)
        return int(np.hypot(*(vertices - place[:, None])).argmin())


def _equilibrated(case: Case, model: Model, sample: BlockGrid) -> tuple[BlockBody, State]:
    """The block in equilibrium with its bath, its permeability as the case has it, from the grid that it gives."""

    def make(grid: BlockGrid, tissues: BlockTissues) -> Block:
        return make_block(grid, case.parts, model, *tissues, case.bath.concentration, sample=sample)

    if case.tissue.reference_state == "equilibrated" and model.swelling:
        body, state = stress_free_block(case, model, sample, make)
    else:
        body, state = equilibrated_body(make(sample, tissues_at(case, model, sample)))
    block = body.block
    if not model.open_circuit or case.open_circuit_permeability == "state":
        return body, state
    ratio: Array | float = 1.0
    if case.open_circuit_permeability == "initial":
        ratio = initial_open_circuit_ratio(block, state.unknowns)
    return start_of(block.with_open_circuit_ratio(ratio), state.unknowns)
