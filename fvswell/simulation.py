"""A run: one case, one model, from the equilibrated sample to a result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from fvswell.case import Case
from fvswell.column_batch import ColumnBatch
from fvswell.column_fields import column_fields
from fvswell.errors import SolverError
from fvswell.fields import FIELDS
from fvswell.relaxation import phase_durations
from fvswell.results import COMPLETE, Layout, ResultFile, in_memory, refuse_existing
from fvswell.time_stepping import Marcher, State, Step
from fvswell.tissue import Array

__all__ = ["Progress", "run"]

_LARGEST_IMBALANCE = 1e-8  # of what crossed the boundary: beyond it the result is refused

Record = dict[str, Array]


@dataclass(frozen=True)
class Progress:
    """How far a run is."""

    time: float  # s, simulated
    phase_ends: tuple[float, ...]  # s
    steps: int
    strain: float


def run(
    case: Case,
    model: str | None = None,
    *,
    path: Path | None = None,
    replace: bool = False,
    durations: Sequence[float] | None = None,
    report: Callable[[Progress], None] | None = None,
) -> xr.Dataset:
    """Simulate a case.

    Parameters
    ----------
    case
        What to simulate.
    model
        Name of a model to use instead of the case's own.
    path
        File to write as the run goes on; without it the result is in memory only.
    replace
        Whether a file of that name may be replaced.
    durations
        Durations of the phases, s, where `fvswell.relaxation.phase_durations` has found them before.
    report
        Called at the start and after every step.

    Returns
    -------
    xarray.Dataset
        The result, as `fvswell.results.read_result` gives it.

    Raises
    ------
    CaseError
        If the case cannot be run with that model.
    OutputError
        If the file is there already or cannot be written.
    SolverError
        If the run had to stop; its ``result`` holds what there is, marked incomplete.
    """
    if model is not None and model != case.model:
        case = case.with_changes({"model": model})
    if path is not None:
        refuse_existing([path], replace)
    batch = ColumnBatch.of([case])
    duration = _found_durations(case) if durations is None else np.array([durations], dtype=float)
    layout = _layout(batch, case, duration)
    file = ResultFile(path, layout, replace) if path is not None else None
    try:
        recorder = _Recorder(batch, duration, file, report)
        marcher = Marcher(
            batch.system, batch.protocol(duration), batch.control(), recorder.state, [recorder]
        )
        marcher.run()
        status = recorder.status(marcher)
        recorder.finish()
        if file is not None:
            file.close(status)
    except BaseException:
        if file is not None:
            file.discard()
        raise
    result = in_memory(layout, recorder.times, recorder.records, recorder.history, status)
    if status != COMPLETE:
        raise SolverError(f"{case.source}: {status}", result)
    return result


def _found_durations(case: Case) -> Array:
    duration = phase_durations([case])
    for phase, seconds in zip(case.phase, duration[0], strict=True):
        if not np.isfinite(seconds):
            raise SolverError(
                f"{case.source}: the biphasic-swelling model does not relax in phase {phase.name}; "
                "give its duration in s"
            )
    return duration


def _layout(batch: ColumnBatch, case: Case, duration: Array) -> Layout:
    grid = batch.grid
    bounds = np.stack([grid.nodes[:-1], grid.nodes[1:]], axis=1)
    phases = {
        "phase_end": np.cumsum(duration[0]),
        "equilibrium_strain": batch.equilibrium_heights()[0] / batch.initial_height[0] - 1.0,
    }
    return Layout(
        dimensions={"cell": len(grid.widths), "node": len(grid.nodes), "bound": 2, "phase": len(case.phase)},
        coordinates={
            "x": (
                ("cell",), grid.centres,
                {"units": "mm", "long_name": "distance from the filter in the stress-free solid", "axis": "X",
                 "bounds": "x_bounds"},
            ),
            "x_bounds": (("cell", "bound"), bounds, {}),
            "x_node": (
                ("node",), grid.nodes,
                {"units": "mm", "long_name": "distance of nodes from the filter in the stress-free solid"},
            ),
            **{name: (("phase",), values, FIELDS[name].attributes) for name, values in phases.items()},
        },
        location_dimensions={"cell": "cell", "node": "node"},
        case=case,
        comment="A column of tissue between a filter at x = 0 and a piston; x moves with the solid.",
    )  # fmt: skip


class _Recorder:
    """Observer that keeps the books, records and the solver's history, and tells of progress."""

    def __init__(
        self,
        batch: ColumnBatch,
        duration: Array,
        file: ResultFile | None,
        report: Callable[[Progress], None] | None,
    ) -> None:
        self.batch, self.file, self.report = batch, file, report
        self.state = batch.start()
        self.books = batch.books(self.state)
        self.every = batch.cases[0].output.every
        self.output_times = [batch.output_times(duration, p)[0] for p in range(duration.shape[1])]
        self.phase_ends = tuple(np.cumsum(duration[0]).tolist())
        self.steps = 0
        self.times: list[float] = []
        self.records: list[Record] = []
        self.history: dict[str, list[float]] = {
            name: [] for name in ("step_time", "step_size", "step_iterations", "step_residual")
        }
        self._record(self.state)
        self._tell(self.state)

    def __call__(self, state: State, step: Step) -> None:
        self.books(state, step)
        self.steps += 1
        values = (state.elapsed[0], step.size[0], step.iterations[0], step.residual[0])
        for name, value in zip(self.history, values, strict=True):
            self.history[name].append(float(value))
        due = state.time[0] in self.output_times[state.phase[0]]
        if self.every is not None:
            due = self.steps % self.every == 0 or bool(step.ends_phase[0])
        if due:
            self._record(state)
        self._tell(state)

    def status(self, marcher: Marcher) -> str:
        """What the result's run_status is to say."""
        if marcher.failures:
            failure = marcher.failures[0]
            phase = self.batch.cases[0].phase[failure.phase].name
            return f"stopped at t = {failure.elapsed:.6g} s in phase {phase}: {failure.reason}"
        if self.books.largest[0] > _LARGEST_IMBALANCE:
            return f"stopped: a balance is off by {self.books.largest[0]:.3g} of what crossed the boundary"
        return COMPLETE

    def finish(self) -> None:
        """Record where a run stopped, and hand the solver's history to the file."""
        if self.times[-1] != self.state.elapsed[0] and self.every is not None:
            self._record(self.state)
        if self.file is not None:
            self.file.append_steps(self.history)

    def _tell(self, state: State) -> None:
        if self.report is not None:
            strain = float(state.loads["height"][0] / self.batch.initial_height[0] - 1.0)
            self.report(Progress(float(state.elapsed[0]), self.phase_ends, self.steps, strain))

    def _record(self, state: State) -> None:
        batch = self.batch
        fields = column_fields(batch.grid, batch.system.term.laws, state, float(batch.initial_height[0]))
        record = {name: np.array(value) for name, value in fields.items()}  # the state moves on beneath them
        errors = dict(zip(self.books.balances, self.books.take_error()[:, 0], strict=True))
        record |= {f"{balance}_balance_error": np.array(error) for balance, error in errors.items()}
        self.times.append(float(state.elapsed[0]))
        self.records.append(record)
        if self.file is not None:
            self.file.append(self.times[-1], record)
