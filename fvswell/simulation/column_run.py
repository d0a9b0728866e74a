"""A single column as a run sees it: what is marched, what is recorded, how the result is laid out."""

from __future__ import annotations

import numpy as np

from fvswell.case.case import Case
from fvswell.case.errors import CaseError
from fvswell.column.fields import column_fields
from fvswell.column.newton import ColumnSystem
from fvswell.errors import SolverError
from fvswell.numerics.conservation import ConservationBooks
from fvswell.numerics.protocol import Protocol
from fvswell.numerics.time_stepping import State, StepControl
from fvswell.physics.tissue import Array
from fvswell.results.fields import FIELDS
from fvswell.results.file import Layout
from fvswell.simulation.column_batch import ColumnBatch
from fvswell.simulation.relaxation import overlong_ramps, phase_durations, unrelaxed_phase

__all__ = ["ColumnRun"]


class ColumnRun:
    """A case of a column."""

    def __init__(self, case: Case) -> None:
        self.case, self.batch = case, ColumnBatch.of([case])

    @property
    def system(self) -> ColumnSystem:
        """What is marched."""
        return self.batch.system

    def durations(self) -> Array:
        """Durations of the phases, (1, phases), s.

        Raises
        ------
        CaseError
            If a ramp is longer than its phase turns out to be.
        SolverError
            If the biphasic-swelling model does not relax.
        """
        duration = phase_durations([self.case])
        if told := unrelaxed_phase(self.case, duration[0]):
            raise SolverError(f"{self.case.source}: {told}")
        if problems := overlong_ramps(self.case, duration[0]):
            raise CaseError(problems, self.case.source)
        return duration

    def start(self) -> State:
        """State of the equilibrated column."""
        return self.batch.start()

    def books(self, state: State) -> ConservationBooks:
        """Books on the balances, from a state on."""
        return self.batch.books(state)

    def protocol(self, duration: Array) -> Protocol:
        """Protocol with phases of the given durations."""
        return self.batch.protocol(duration)

    def control(self) -> StepControl:
        """How the steps are chosen."""
        return self.batch.control()

    def strain(self, state: State) -> float:
        """Global strain."""
        return float(state.loads["height"][0] / self.batch.initial_height[0] - 1.0)

    def fields(self, state: State) -> dict[str, Array]:
        """Fields to record."""
        batch = self.batch
        return column_fields(batch.grid, batch.system.term.laws, state, float(batch.initial_height[0]))

    def place(self, balance: str, point: int) -> str:
        """Where a point of the residual of a balance lies."""
        return f"{self.batch.grid.centres[point]:.3g} mm from the filter"

    def layout(self, duration: Array) -> Layout:
        """Layout of the result."""
        grid = self.batch.grid
        phases = {
            "phase_end": np.cumsum(duration[0]),
            "equilibrium_strain": self.batch.equilibrium_heights()[0] / self.batch.initial_height[0] - 1.0,
        }
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
