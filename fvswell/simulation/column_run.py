"""A case of a column as a run sees it: what is integrated, what is recorded, how the result is laid out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from fvswell.case.acting_loads import acting_loads
from fvswell.case.case import Case
from fvswell.case.column_checks import piston_pressure
from fvswell.case.output_times import output_times
from fvswell.case.reference_state import stress_free
from fvswell.case.values import Ramp, final_value
from fvswell.column.balances import COLUMN_LOADS
from fvswell.column.column import Column, compiled_march
from fvswell.column.fields import column_fields
from fvswell.column.grid import ColumnGrid, column_grid, grid_of_widths
from fvswell.column.stage import ColumnBody
from fvswell.errors import SolverError
from fvswell.numerics.loads import Load, Protocol, make_protocol
from fvswell.numerics.state import Control, Record, State
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import MODELS, Model
from fvswell.physics.permeability import hydraulic_permeability
from fvswell.physics.solids import aggregate_modulus
from fvswell.physics.tissue import Array, Tissue
from fvswell.results.fields import FIELDS
from fvswell.results.layout import Layout
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
        self.column = Column(self.grid, self.model, cells, faces, case.bath.concentration, open_circuit)
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
        states = [(0.0, self.case.bath.concentration)]
        for loads in self._loads:
            pressure, bath = loads[0], loads[2]
            states.append((0.0 if pressure is None else pressure.target, bath.target if bath else np.nan))
        pressures, baths = np.array(states).T[:, :, None]
        J = equilibrium_volume_ratio(self.column.cells, pressures, baths)
        return np.broadcast_to(J, (len(states), len(self.grid.widths)))

    @cached_property
    def initial_volume_ratio(self) -> Array:
        """J of the equilibrated column, (cells,)."""
        return np.ascontiguousarray(self._volume_ratios[0])

    @cached_property
    def initial_height(self) -> float:
        """Height of the equilibrated column, mm."""
        return float(self._volume_ratios[0] @ self.grid.widths)

    @cached_property
    def _loads(self) -> list[list[Load | None]]:
        """Each load of a column in each phase; heights as displacements of the piston."""
        phases = []
        for acting in acting_loads(self.case, self._held_loads()):
            baths = {
                f"{end}_{kind}": _load(acting.get(f"{end}.bath_{kind}"))
                for end in ("filter", "piston")
                for kind in ("concentration", "pressure")
            }
            loads = baths | {
                "pressure": _load(piston_pressure(self.case, acting)),
                "height": _load(acting.get("piston.displacement")),
                "current": Load(0.0),
            }
            reference = baths["filter_concentration"] or baths["piston_concentration"]
            for end in ("filter", "piston"):
                loads[f"{end}_concentration"] = loads[f"{end}_concentration"] or reference
                loads[f"{end}_pressure"] = loads[f"{end}_pressure"] or Load(0.0)
            phases.append([loads[name] for name in COLUMN_LOADS])
        return phases

    def _held_loads(self) -> dict[str, float] | None:
        """Loads that a run before has left, by the names of the case."""
        if self.held is None:
            return None
        held = dict(zip(COLUMN_LOADS, map(float, self.held), strict=True))
        height = float(self.column.initial_volume_ratio() @ self.grid.widths)
        names = {
            "piston.pressure": held["pressure"],
            "piston.displacement": held["height"] - height,
            **{f"{end}.bath_{kind}": held[f"{end}_{kind}"] for end in ("filter", "piston")
               for kind in ("concentration", "pressure")},
        }  # fmt: skip
        return {name: value for name, value in names.items() if not np.isnan(value)}

    def equilibrium_strains(self) -> Array:
        """Global strain in equilibrium under the loads that each phase ends with, (phases,)."""
        free = self._volume_ratios[1:] @ self.grid.widths / self.initial_height - 1.0
        held = [np.nan if loads[1] is None else loads[1].target / self.initial_height for loads in self._loads]
        return np.where(np.isnan(held), free, held)

    def largest_strain(self) -> float:
        """Largest strain in equilibrium of the protocol, of the sample let free as well as held.

        A bath moves a sample inside whose piston is held.
        """
        free = self._volume_ratios[1:] @ self.grid.widths / self.initial_height - 1.0
        strains = np.abs(np.concatenate([free, self.equilibrium_strains()]))
        return max(float(np.nan_to_num(strains).max()), SMALLEST_STRAIN)

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
        phases: list[list[Load | None]] = [
            [loads[0], _shifted(loads[1], self.initial_height), *loads[2:]] for loads in self._loads
        ]
        due: Any = output_times(self.case, durations) if times is None else np.asarray(times)
        if multiples is None:
            return make_protocol(phases, durations, due)
        fraction = self.case.time.relaxation_fraction
        return make_protocol(phases, durations, (), multiples, self.equilibrium_strains().tolist(), fraction)

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
        return column_fields(self.column, self.initial_volume_ratio, record)

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
        )  # fmt: skip


def _load(value: float | Ramp | None) -> Load | None:
    if value is None:
        return None
    return Load(final_value(value), value.over if isinstance(value, Ramp) else 0.0)


def _shifted(load: Load | None, by: float) -> Load | None:
    return None if load is None else load._replace(target=load.target + by)
