"""Running a study: batches spread out, kept on disk as they are finished, and put together in the end.

Memory does not grow with the study: besides the parameter sets themselves, this process holds the results of the
batches that have just come in, and each worker the columns of one batch. An interrupted study goes on where it was
when it is run again with the same output, and ends with the same file.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from fvswell.results.file import refuse_existing
from fvswell.study.batches import Batch, plan
from fvswell.study.file import write_study
from fvswell.study.parts import StudyParts
from fvswell.study.scheduling import Finished, available_cores, in_this_process, on_cores, on_dask
from fvswell.study.study import Study
from fvswell.version import __version__

__all__ = ["StudyOutcome", "StudyProgress", "run_study"]


@dataclass(frozen=True)
class StudyProgress:
    """How far a study is."""

    done: int  # runs, those of earlier sessions included
    total: int
    elapsed: float  # s, in this session
    remaining: float | None  # s, at the speed of this session; None before anything is finished


@dataclass(frozen=True)
class StudyOutcome:
    """What came out."""

    path: Path
    runs: int
    complete: int  # the others say why not in run_status
    resumed: int  # runs that an earlier session had finished
    elapsed: float  # s


def run_study(
    study: Study,
    path: Path,
    *,
    scheduler: str | None = None,
    processes: int | None = None,
    replace: bool = False,
    report: Callable[[StudyProgress], None] | None = None,
) -> StudyOutcome:
    """Run a study, or go on with it, and write its result.

    Parameters
    ----------
    study
        What to run.
    path
        The netCDF file to write. Until it is whole, finished batches are kept in ``PATH.parts`` beside it.
    scheduler
        Address of a Dask scheduler to run on; without it, the cores of this machine.
    processes
        Number of processes on this machine; as many as there are cores without it. With 1, this process does the work.
    replace
        Whether a result of that name may be replaced.
    report
        Called at the start and after every batch.

    Raises
    ------
    OutputError
        If the result exists already, belongs to another study, or cannot be written.
    SchedulerError
        If the batches cannot be computed where they should be. The finished ones are kept.
    """
    refuse_existing([path], replace)
    start = time.monotonic()
    parts = StudyParts(path, hashlib.sha256(f"{study.sha256} {__version__}".encode()).hexdigest())
    batches = plan(study)
    finished = parts.finished()
    todo = [batch for batch in batches if batch.index not in finished]
    total = sum(len(batch.runs) for batch in batches)
    done = resumed = total - sum(len(batch.runs) for batch in todo)
    if report is not None:
        report(StudyProgress(done, total, 0.0, None))
    if todo:
        with closing(_computed(todo, scheduler, processes)) as results:
            for index, result in results:
                parts.store(index, result)
                done += len(batches[index].runs)
                if report is not None:
                    elapsed = time.monotonic() - start
                    report(StudyProgress(done, total, elapsed, elapsed * (total - done) / (done - resumed)))
    complete, runs = write_study(path, study, batches, parts.results())
    parts.remove()
    return StudyOutcome(path, runs, complete, resumed, time.monotonic() - start)


def _computed(batches: Sequence[Batch], scheduler: str | None, processes: int | None) -> Finished:
    if scheduler is not None:
        return on_dask(batches, scheduler)
    processes = processes or available_cores()
    return in_this_process(batches) if processes == 1 else on_cores(batches, processes)
