"""A run: one case, one model, from the equilibrated sample to a result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fvswell.case.case import Case
from fvswell.errors import OutputError, SolverError
from fvswell.physics.tissue import Array
from fvswell.results.file import in_memory, refuse_existing
from fvswell.results.layout import COMPLETE, Content, Layout
from fvswell.results.run_file import RunFile
from fvswell.simulation.continuation import Ending, Interrupted
from fvswell.simulation.recorder import Progress, Recorder
from fvswell.simulation.relaxation import phase_durations
from fvswell.simulation.sample_states import sample_states, state_attributes
from fvswell.simulation.setup import Setup, make_setup

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["Outcome", "Progress", "Setup", "make_setup", "run", "simulate"]


@dataclass(frozen=True)
class Outcome:
    """What comes of a run, as plain arrays: making a dataset of them takes as long as a run of a column."""

    layout: Layout
    content: Content
    status: str  # "complete", or why the run had to stop

    @property
    def values(self) -> dict[str, Array]:
        """Coordinates, fields and history of the solver, by name."""
        coordinates = {name: values for name, (_, values, _) in self.layout.coordinates.items()}
        return coordinates | {"time": self.content.times} | self.content.fields | self.content.history

    def dataset(self) -> xr.Dataset:
        """The result as `fvswell.results.file.read_result` gives it."""
        return in_memory(self.layout, self.content, self.status)


def run(
    case: Case,
    model: str | None = None,
    *,
    path: Path | None = None,
    replace: bool = False,
    durations: Sequence[float] | None = None,
    start_from: Path | None = None,
    resume: bool = False,
    report: Callable[[Progress], None] | None = None,
) -> xr.Dataset:
    """Simulate a case.

    While the run goes on, ``NAME.part`` beside its file holds what there is, now and then.

    Parameters
    ----------
    case
        What to simulate.
    model
        Name of a model to use instead of the case's own.
    path
        File to write; without it the result is in memory only.
    replace
        Whether a file of that name may be replaced.
    durations
        Durations of the phases, s, where `fvswell.simulation.relaxation.phase_durations` has found them before.
    start_from
        A result of the same tissue, grid and model, whose last state the run starts from instead of equilibrium. What
        the first phases do not name goes on as it was there.
    resume
        Whether to go on with a run that was interrupted while it wrote to ``path``.
    report
        Called at the start and while the run goes on.

    Returns
    -------
    xarray.Dataset
        The result, as `fvswell.results.file.read_result` gives it.

    Raises
    ------
    CaseError
        If the case cannot be run with that model, or from there.
    OutputError
        If the file exists already or cannot be written, or there is nothing to start from or to resume.
    SolverError
        If the run had to stop; its ``result`` holds what there is, marked incomplete.
    KeyboardInterrupt
        From Ctrl-C; what there is has been written, so that the run can be resumed.
    """
    outcome = simulate(
        case, model, path=path, replace=replace, durations=durations, start_from=start_from, resume=resume,
        report=report,
    )  # fmt: skip
    result = outcome.dataset()
    if outcome.status != COMPLETE:
        raise SolverError(f"{case.source}: {outcome.status}", result)
    return result


def simulate(
    case: Case,
    model: str | None = None,
    *,
    path: Path | None = None,
    replace: bool = False,
    durations: Sequence[float] | None = None,
    start_from: Path | None = None,
    resume: bool = False,
    report: Callable[[Progress], None] | None = None,
) -> Outcome:
    """Simulate a case, as `run` does, and give what came of it even if the run had to stop."""
    if model is not None and model != case.model:
        case = case.with_changes({"model": model})
    earlier: Interrupted | Ending | None = None
    if resume:
        if path is None or start_from is not None:
            raise OutputError("a run is resumed from its own file: it needs the name of that, and no other start")
        earlier = Interrupted.of(path, case)
        durations = earlier.durations
    elif start_from is not None:
        earlier = Ending.of(start_from, case)
    if path is not None and not resume:
        refuse_existing([path], replace)
    setup = make_setup(case, held=None if earlier is None else earlier.held)
    if durations is None:
        durations = phase_durations(case, setup, earlier.restore if isinstance(earlier, Ending) else None)
    layout = setup.layout(durations)
    layout.attributes |= state_attributes(sample_states(setup))
    if earlier is not None and earlier.started_from is not None:
        layout.attributes["started_from"] = earlier.started_from
    file = None if path is None else RunFile(path, layout, replace or resume)
    recorder = Recorder(setup, list(durations), file, report)
    try:
        recorder.begin(earlier)
        status = recorder.march()
    except KeyboardInterrupt:
        recorder.interrupt()
        raise
    return Outcome(layout, recorder.finish(status), status)
