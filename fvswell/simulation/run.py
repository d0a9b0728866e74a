"""A run: one case, one model, from the equilibrated sample to a result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import xarray as xr

from fvswell.case.case import BlockCase, Case
from fvswell.errors import SolverError
from fvswell.numerics.conservation import ConservationBooks
from fvswell.numerics.protocol import SAME_TIME, output_times
from fvswell.numerics.protocol import Protocol as Phases
from fvswell.numerics.system import System
from fvswell.numerics.time_stepping import Marcher, State, Step, StepControl
from fvswell.physics.tissue import Array
from fvswell.results.file import COMPLETE, Layout, ResultFile, in_memory, refuse_existing
from fvswell.simulation.column_run import ColumnRun

__all__ = ["Progress", "run"]

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
        Durations of the phases, s, where `fvswell.simulation.relaxation.phase_durations` has found them before.
    report
        Called at the start and after every step.

    Returns
    -------
    xarray.Dataset
        The result, as `fvswell.results.file.read_result` gives it.

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
    body = _body(case)
    duration = body.durations() if durations is None else np.array([durations], dtype=float)
    layout = body.layout(duration)
    with nullcontext() if path is None else ResultFile(path, layout, replace) as file:
        recorder = _Recorder(body, duration, file, report)
        marcher = Marcher(body.system, body.protocol(duration), body.control(), recorder.state, [recorder])
        marcher.run()
        status = recorder.status(marcher)
        recorder.finish()
        if file is not None:
            file.close(status)
    result = in_memory(layout, recorder.times, recorder.records, recorder.history, status)
    if status != COMPLETE:
        raise SolverError(f"{case.source}: {status}", result)
    return result


class Body(Protocol):
    """What a run needs of a column or a block."""

    @property
    def case(self) -> Case:
        """What is simulated."""

    @property
    def system(self) -> System:
        """What is marched."""

    def durations(self) -> Array:
        """Durations of the phases, (1, phases), s."""

    def start(self) -> State:
        """State of the equilibrated sample."""

    def books(self, state: State) -> ConservationBooks:
        """Books on the balances, from a state on."""

    def protocol(self, duration: Array) -> Phases:
        """Protocol with phases of the given durations."""

    def control(self) -> StepControl:
        """How the steps are chosen."""

    def strain(self, state: State) -> float:
        """Global strain."""

    def fields(self, state: State) -> Record:
        """Fields to record."""

    def place(self, balance: str, point: int) -> str:
        """Where a point of the residual of a balance lies."""

    def layout(self, duration: Array) -> Layout:
        """Layout of the result."""


def _body(case: Case) -> Body:
    if isinstance(case, BlockCase):
        from fvswell.simulation.block_run import BlockRun

        return BlockRun(case)
    return ColumnRun(case)


class _Recorder:
    """Observer that keeps the books, records and the solver's history, and tells of progress."""

    def __init__(
        self,
        body: Body,
        duration: Array,
        file: ResultFile | None,
        report: Callable[[Progress], None] | None,
    ) -> None:
        self.body, self.file, self.report = body, file, report
        self.state = body.start()
        self.books = body.books(self.state)
        output = body.case.output
        self.every = output.every
        self.output_times = [output_times(output.times or (), duration, p)[0] for p in range(duration.shape[1])]
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
        gaps = np.abs(self.output_times[state.phase[0]] - state.time[0])
        due = bool((gaps <= SAME_TIME * self.phase_ends[state.phase[0]]).any())
        if self.every is not None:
            due = self.steps % self.every == 0 or bool(step.ends_phase[0])
        if due:
            self._record(state)
        self._tell(state)

    def status(self, marcher: Marcher) -> str:
        """What the result's run_status is to say."""
        if marcher.failures:
            failure = marcher.failures[0]
            phase, place = self.body.case.phase[failure.phase].name, self.body.place(failure.balance, failure.point)
            return f"stopped at t = {failure.elapsed:.6g} s in phase {phase}: {failure.reason(place)}"
        refusal = self.books.refusal(0)
        return COMPLETE if refusal is None else f"stopped: {refusal}"

    def finish(self) -> None:
        """Record where a run stopped, and hand the solver's history to the file."""
        if self.times[-1] != self.state.elapsed[0] and self.every is not None:
            self._record(self.state)
        if self.file is not None:
            self.file.append_steps(self.history)

    def _tell(self, state: State) -> None:
        if self.report is not None:
            self.report(Progress(float(state.elapsed[0]), self.phase_ends, self.steps, self.body.strain(state)))

    def _record(self, state: State) -> None:
        record = {
            name: np.array(value) for name, value in self.body.fields(state).items()
        }  # the state moves on beneath them
        errors = dict(zip(self.books.balances, self.books.take_error()[:, 0], strict=True))
        record |= {f"{balance}_balance_error": np.array(error) for balance, error in errors.items()}
        self.times.append(float(state.elapsed[0]))
        self.records.append(record)
        if self.file is not None:
            self.file.append(self.times[-1], record)
