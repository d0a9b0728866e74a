"""A case of a column as a run sees it: what is integrated, what is recorded, how the result is laid out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from fvswell.case.acting_loads import acting_loads, moved_part, reference_bath
from fvswell.case.case import Case
from fvswell.case.column_checks import piston_pressure
from fvswell.case.loads import AnyLoad, in_length, shape_of
from fvswell.case.output_times import output_times
from fvswell.case.reference_state import stress_free
from fvswell.column.balances import COLUMN_LOADS
from fvswell.column.column import Column, compiled_march
from fvswell.column.electrical import electrical_loads
from fvswell.column.fields import column_fields
from fvswell.column.grid import ColumnGrid, column_grid, grid_of_widths
from fvswell.column.stage import ColumnBody
from fvswell.errors import SolverError
from fvswell.numerics import loads as numerics
from fvswell.numerics.loads import STRAIN, Load, Protocol, make_protocol
from fvswell.numerics.state import Control, Record, State
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import MODELS, Model
from fvswell.physics.permeability import hydraulic_permeability
from fvswell.physics.solids import aggregate_modulus
from fvswell.physics.tissue import Array, Tissue
from fvswell.results.fields import FIELDS
from fvswell.results.layout import Layout
from fvswell.simulation.loads import numeric_load
from fvswell.simulation.step_control import FIRST_STEP, SMALLEST_STRAIN, step_control

__all__ = ["ColumnRun"]


class ColumnRun:
    """A case of a column.

    Parameters
    ----------
    case
        What is simulated.
    model
        To use instead of the case's own.
    held
        Loads that a run before has left, nan where they were found; without it the column is in equilibrium.
    like
        A run of the same case with another model: what both have in common is not computed again.
    """

    def __init__(
        self, case: Case, model: Model | None = None, held: Array | None = None, like: ColumnRun | None = None
    ) -> None:
        geometry: Any = case.geometry
        open_circuit: Any = case.open_circuit_permeability
        self.case, self.model, self.held = case, model or MODELS[case.model], held
        sample = column_grid(geometry.height, geometry.cells, geometry.grading)
        (cells, swollen), (faces, _) = (
            stress_free(case, case.tissue_at(depth), self.model) for depth in (sample.centres, sample.nodes)
        )
        self.grid: ColumnGrid = sample if isinstance(swollen, float) else grid_of_widths(sample.widths / swollen)
        if like is not None and like.model.swelling == self.model.swelling:
            self._volume_ratios = like._volume_ratios
        parts: Any = case.parts
        self.column = Column(self.grid, self.model, cells, faces, case.bath.concentration, open_circuit, parts)
        self.state = self.start()
        self.volumes = self.grid.widths
        self.scale = self.column.scale[: len(self.state.contents)]

    def start(self) -> State:
        """State of the equilibrated column."""
        return self.column.start(self.initial_volume_ratio)

    @property
    def march(self) -> Callable[..., None]:
        """The integrator."""
        return compiled_march

    @property
    def tissue(self) -> Tissue:
        """Tissue in the cells, as the model sees it."""
        return self.column.cells

    @property
    def stress_free_height(self) -> float:
        """Height of the stress-free solid, mm."""
        return float(self.grid.widths.sum())

    @property
    def initial_stretch(self) -> float:
        """Height of the equilibrated column over that of the stress-free solid; nan where there is no equilibrium."""
        return self.initial_height / self.stress_free_height

    @property
    def drainage_length(self) -> float:
        """Height of the equilibrated column, mm: the filter is its only way out."""
        return self.initial_height

    @cached_property
    def body(self) -> ColumnBody:
        """What is integrated.

        Raises
        ------
        SolverError
            If the column has no equilibrium in its bath.
        """
        if np.isnan(self.initial_volume_ratio).any():
            raise SolverError(f"{self.case.source}: the bath draws all water out of the tissue")
        return self.column.body(self.initial_volume_ratio)

    @cached_property
    def _volume_ratios(self) -> Array:
        """J in equilibrium before the first phase, and with the loads that each phase ends with and no piston held.

        Shape (1 + phases, cells); nan where no water is left.
        """
        states = [(0.0, self.case.bath.concentration), *map(self._equilibrium_load, self._loads)]
        distinct = list(dict.fromkeys(states))  # often the last phase leads back to the beginning
        pressures, baths = np.array(distinct).T[:, :, None]
        J = equilibrium_volume_ratio(self.column.cells, pressures, baths)[[distinct.index(each) for each in states]]
        return np.broadcast_to(J, (len(states), len(self.grid.widths)))

    def _equilibrium_load(self, loads: list[numerics.AnyLoad | None]) -> tuple[float, float]:
        """Pressure that the solid and the ions carry in the end, and the concentration of the bath.

        Where two baths differ in pressure there is no equilibrium, and the pressure is what the solid carries at most.
        """
        end = {name: np.nan if load is None else load.target for name, load in zip(COLUMN_LOADS, loads, strict=True)}
        first = reference_bath(self.case.parts)
        name = "filter" if first is None else first.name
        carried = np.nan_to_num(end["pressure"])
        if self.case.parts[1].open:
            carried += end["piston_bath_pressure"]
        return float(carried - end[f"{name}_bath_pressure"]), float(end[f"{name}_bath_concentration"])

    def _is_steady_flow(self, loads: list[numerics.AnyLoad | None]) -> bool:
        """Whether baths that differ, or a current, keep something flowing in the end."""
        end = {name: np.nan if load is None else load.target for name, load in zip(COLUMN_LOADS, loads, strict=True)}
        ends = [part.name for part in self.case.parts if part.open]
        differ = [len({end[f"{name}_bath_{kind}"] for name in ends}) > 1 for kind in ("concentration", "pressure")]
        driven = [end[f"{name}_{kind}"] for name in ("filter", "piston") for kind in ("current", "potential")]
        return any(differ) or bool(np.nan_to_num(driven).any() and self.model.transports_ions)

    @cached_property
    def initial_volume_ratio(self) -> Array:
        """J of the equilibrated column, (cells,)."""
        return np.ascontiguousarray(self._volume_ratios[0])

    @cached_property
    def initial_height(self) -> float:
        """Height of the equilibrated column, mm."""
        return float(self._volume_ratios[0] @ self.grid.widths)

    @cached_property
    def _loads(self) -> list[list[numerics.AnyLoad | None]]:
        """Each load of a column in each phase."""
        phases = []
        for acting in acting_loads(self.case, self._held_loads()):
            given = {name: numeric_load(shape_of(load)) for name, load in acting.items()}
            reference = reference_bath(self.case.parts)
            bath = None if reference is None else given[f"{reference.name}.bath_concentration"]
            loads: dict[str, numerics.AnyLoad | None] = electrical_loads(self.column.parts, given)
            for end in ("filter", "piston"):
                loads[f"{end}_bath_concentration"] = given.get(f"{end}.bath_concentration", bath)
                loads[f"{end}_bath_pressure"] = given.get(f"{end}.bath_pressure", Load(0.0))
            loads["pressure"] = numeric_load(piston_pressure(self.case, acting))
            loads["height"] = self._height(acting)
            phases.append([loads[name] for name in COLUMN_LOADS])
        return phases

    @cached_property
    def _free_height(self) -> float:
        """Height of the equilibrated column, mm, found without the loads."""
        return float(self.column.initial_volume_ratio() @ self.grid.widths)

    def _height(self, acting: Mapping[str, AnyLoad]) -> numerics.AnyLoad | None:
        """Height of the column where the piston is fixed, or a displacement of it gives the height."""
        if self.case.parts[1].mechanical == "fixed":
            return Load(self._free_height)
        if "piston.displacement" not in acting:
            return None
        return numeric_load(in_length(acting["piston.displacement"], self._free_height), self._free_height)

    def _held_loads(self) -> dict[str, float] | None:
        """Loads that a run before has left, by the names of the case."""
        if self.held is None:
            return None
        held = dict(zip(COLUMN_LOADS, map(float, self.held), strict=True))
        names = {"piston.pressure": held["pressure"], "piston.displacement": held["height"] - self._free_height}
        names |= {
            f"{part.name}.{kind}": held[f"{part.name}_{kind}"]
            for part in self.case.parts
            for kind in part.loads
            if kind not in ("pressure", "force", "displacement")
        }
        return {name: value for name, value in names.items() if not np.isnan(value)}

    def equilibrium_strains(self) -> Array:
        """Global strain in equilibrium under the loads that each phase ends with, (phases,); nan if there is none."""
        free = self._volume_ratios[1:] @ self.grid.widths / self.initial_height - 1.0
        heights = np.array([np.nan if loads[1] is None else loads[1].target for loads in self._loads])
        held = (heights - self._free_height) / self.initial_height
        flowing = [self._is_steady_flow(loads) for loads in self._loads]
        strains: Array = np.where(np.isnan(held), np.where(flowing, np.nan, free), held)
        return strains

    def largest_strain(self) -> float:
        """Largest strain in equilibrium of the protocol, of the sample let free as well as held.

        A bath moves a sample inside whose piston is held.
        """
        free = self._volume_ratios[1:] @ self.grid.widths / self.initial_height - 1.0
        strains = map(abs, [*free.tolist(), *self.equilibrium_strains().tolist()])
        return max(SMALLEST_STRAIN, *(strain for strain in strains if not math.isnan(strain)))

    def protocol(
        self,
        durations: Sequence[float],
        multiples: Sequence[float] | None = None,
        times: Sequence[float] | Array | None = None,
    ) -> Protocol:
        """Protocol with phases of given durations.

        Parameters
        ----------
        durations
            Of the phases, s.
        multiples
            Relaxation times that each phase lasts, see `make_protocol`; nan where it is of a given length.
        times
            Outputs to record instead of the case's own.
        """
        slopes = [name == "height" for name in COLUMN_LOADS]
        due: Any = output_times(self.case, durations) if times is None else np.asarray(times)
        if multiples is None:
            return make_protocol(self._loads, durations, due, slope_matters=slopes)
        fraction = self.case.time.relaxation_fraction
        strains = self.equilibrium_strains().tolist()
        return make_protocol(self._loads, durations, (), multiples, strains, fraction, slope_matters=slopes)

    def measured(self) -> list[int]:
        """What the end of each phase may depend on: index of a load, or `STRAIN`."""
        moved = [moved_part(self.case, acting) for acting in acting_loads(self.case, self._held_loads())]
        return [STRAIN if part is None else COLUMN_LOADS.index("pressure") for part in moved]

    def control(self) -> Control:
        """How the steps are chosen."""
        return step_control(self.case, self.largest_strain(), self.first_step())

    def first_step(self) -> float:
        """Step to start with where loads jump, s: a part of the time in which the finest cell consolidates."""
        return FIRST_STEP * float(self.grid.widths.min()) ** 2 / float(np.max(self._mobility()))

    def consolidation_time(self) -> float:
        """h^2/(k H) of the equilibrated column, H being the aggregate modulus at J = 1, s."""
        return self.initial_height**2 / float(np.min(self._mobility()))

    def _mobility(self) -> Array:
        tissue = self.column.cells
        mobility: Array = hydraulic_permeability(tissue, 1.0) * aggregate_modulus(tissue.solid, tissue.fluid_fraction)
        return mobility

    def strain(self, state: State) -> float:
        """Global strain."""
        return float(state.contents[0] @ self.grid.widths) / self.initial_height - 1.0

    def fields(self, record: Record) -> dict[str, Array]:
        """Fields of all outputs of a record."""
        fields = column_fields(self.column, self.initial_volume_ratio, record)
        area = getattr(self.case.geometry, "area", None)
        if area is not None:
            fields |= {f"{part.name}_force": area * fields[f"{part.name}_pressure"] for part in self.case.parts}
        return fields

    def place(self, balance: str, point: int) -> str:
        """Where a point of a balance lies."""
        return f"{self.grid.centres[point]:.3g} mm from the filter"

    def layout(self, durations: Sequence[float]) -> Layout:
        """Layout of the result."""
        grid = self.grid
        phases = {"phase_end": np.cumsum(durations), "equilibrium_strain": self.equilibrium_strains()}
        return Layout(
            dimensions={"cell": len(grid.widths), "node": len(grid.nodes), "bound": 2, "phase": len(self.case.phase)},
            coordinates={
                "x": (
                    ("cell",), grid.centres,
                    {"units": "mm", "long_name": "distance from the filter in the stress-free solid", "axis": "X",
                     "bounds": "x_bounds"},
                ),
                "x_bounds": (("cell", "bound"), np.stack([grid.nodes[:-1], grid.nodes[1:]], axis=1), {}),
                "x_node": (
                    ("node",), grid.nodes,
                    {"units": "mm", "long_name": "distance of nodes from the filter in the stress-free solid"},
                ),
                **{name: (("phase",), values, FIELDS[name].attributes) for name, values in phases.items()},
            },
            location_dimensions={"cell": "cell", "node": "node"},
            case=self.case,
            comment="A column of tissue between a filter at x = 0 and a piston; x moves with the solid.",
            per_area=True,
        )  # fmt: skip
