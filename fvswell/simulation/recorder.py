"""The way from the start of a run to its end: chunks of steps, what is recorded of them, and files of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fvswell.compiled import Kernel
from fvswell.numerics.state import (
    ELAPSED,
    FAILED,
    PHASE,
    RUNNING,
    STATUS,
    STEP,
    Workspace,
    record_room,
    workspace,
)
from fvswell.physics.tissue import Array
from fvswell.results.layout import COMPLETE, Content
from fvswell.results.run_file import RunFile
from fvswell.simulation.continuation import Ending, Interrupted, kept_state
from fvswell.simulation.march import problem_of
from fvswell.simulation.setup import Setup

__all__ = ["Progress", "Recorder"]

_CHUNK = 256  # steps between two reports of progress, where they are compiled


@dataclass(frozen=True)
class Progress:
    """How far a run is."""

    time: float  # s, simulated
    phase_ends: tuple[float, ...]  # s
    steps: int
    strain: float


class Recorder:
    """Runs the integrator chunk by chunk, and hands on outputs, the solver's history and progress."""

    def __init__(
        self, setup: Setup, durations: list[float], file: RunFile | None, report: Callable[[Progress], None] | None
    ) -> None:
        self.setup, self.file, self.report = setup, file, report
        self.state, self.control = setup.state, setup.control()
        self.protocol = setup.protocol(durations)
        self.phase_ends = tuple(np.cumsum(durations).tolist())
        self.parts: list[Content] = []
        self.kept: tuple[int, dict[str, Array]] = 0, {}  # number of parts, and the state that goes with them
        steps = _CHUNK if isinstance(setup.march, Kernel) else 1
        outputs = len(self.protocol.output_times) if self.control.every == 0 else steps
        self.record = record_room(self.state, outputs, steps)
        self.work: Workspace = workspace(self.state, len(self.control.nodes))

    def begin(self, earlier: Ending | Interrupted | None) -> None:
        """Record the state that the run starts from, or take over what an interrupted run has left."""
        if isinstance(earlier, Interrupted):
            earlier.restore(self.state, self.protocol)
            self._take(earlier.content)
            return
        if earlier is not None:
            earlier.restore(self.state)
        self._take(self._state_output())

    def march(self) -> str:
        """Run to the end; gives the status of the result."""
        setup, state = self.setup, self.state
        while state.counts[STATUS] == RUNNING:
            self.record.filled[:] = 0
            setup.march(
                setup.body, setup.volumes, setup.scale, self.protocol, self.control, state, self.record, self.work
            )
            self._take(self._recorded())
        return problem_of(setup, state, self.work) or COMPLETE

    def finish(self, status: str) -> Content:
        """Record where a run failed, and write the file; gives what has been recorded."""
        state = self.state
        if state.counts[STATUS] == FAILED and self._last_time() != state.clock[ELAPSED]:
            self.parts.append(self._state_output())
        content = _joined(self.parts)
        if self.file is not None:
            self.file.close(content, status, kept_state(state, self.protocol, self.setup.held))
        return content

    def interrupt(self) -> None:
        """Write the file of a run that is not over, unless it has failed meanwhile.

        The interruption may have come in the midst of a step, so what there is dates from the last report.
        """
        parts, kept = self.kept
        if self.file is None or not kept:
            return
        if kept["counts"][STATUS] == FAILED:
            self.finish(problem_of(self.setup, self.state, self.work))
        else:
            status = f"interrupted after t = {kept['clock'][ELAPSED]:.6g} s"
            self.file.interrupt(_joined(self.parts[:parts]), status, kept)

    def _recorded(self) -> Content:
        """What the integrator has just recorded."""
        record = self.record
        outputs, steps = (int(count) for count in record.filled)
        fields = self.setup.fields(record) if outputs else {}
        # the record is filled anew in the next chunk, so nothing may go on looking into it
        own = {name: values if values.base is None else values.copy() for name, values in fields.items()}
        return Content(record.time[:outputs].copy(), own, _history(record.steps[:steps]))

    def _state_output(self) -> Content:
        """The state as it is, as an output."""
        state, record = self.state, record_room(self.state, 1, 0)
        for name in ("unknowns", "contents", "loads", "crossed"):
            getattr(record, name)[0] = getattr(state, name)
        record.time[0], record.phase[0], record.filled[0] = state.clock[ELAPSED], state.counts[PHASE], 1
        return Content(record.time.copy(), self.setup.fields(record), _history(record.steps))

    def _last_time(self) -> float:
        """Time of the last output, s."""
        return float(next(part.times[-1] for part in reversed(self.parts) if len(part.times)))

    def _take(self, part: Content) -> None:
        """Add what has been recorded, keep it on disk now and then, and report."""
        self.parts.append(part)
        if self.file is not None:
            self.kept = len(self.parts), kept_state(self.state, self.protocol, self.setup.held)
            if self.state.counts[STATUS] == RUNNING:
                self.file.keep(lambda: _joined(self.parts), self.kept[1])
        if self.report is not None:
            time = float(self.state.clock[ELAPSED])
            steps = int(self.state.counts[STEP])
            self.report(Progress(time, self.phase_ends, steps, self.setup.strain(self.state)))


def _joined(parts: Sequence[Content]) -> Content:
    """What has been recorded one after the other, as one."""
    times, fields, history = zip(*parts, strict=True)
    with_fields = [part for part in fields if part]
    return Content(np.concatenate(times), _joined_by_name(with_fields), _joined_by_name(history))


def _joined_by_name(parts: Sequence[dict[str, Array]]) -> dict[str, Array]:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _history(steps: Array) -> dict[str, Array]:
    """History of the solver by name, from steps as a record has them."""
    names = ("step_time", "step_size", "step_iterations", "step_update")
    return dict(zip(names, steps.T.copy(), strict=True))
