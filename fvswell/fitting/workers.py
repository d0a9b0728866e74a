"""Who simulates the experiments of a fit: this process, processes of this machine, or a Dask cluster."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Any, Self

from fvswell.case.errors import CaseError
from fvswell.errors import SolverError
from fvswell.fitting.simulated import Experiment
from fvswell.physics.tissue import Array
from fvswell.study.scheduling import connected, one_thread_each, start_worker

__all__ = ["Outcome", "Workers"]

Outcome = Array | str  # histories of an experiment, (quantities, times), or why there are none

_experiments: tuple[Experiment, ...] = ()  # of the fit that this process works for


class Workers(AbstractContextManager["Workers"]):
    """Simulate experiments; a context.

    Parameters
    ----------
    experiments
        That there are.
    processes
        Number of processes on this machine; with 1, this process does the work.
    scheduler
        Address of a Dask scheduler to work on instead.

    Raises
    ------
    SchedulerError
        If no Dask cluster answers at that address.
    """

    def __init__(self, experiments: Sequence[Experiment], processes: int = 1, scheduler: str | None = None) -> None:
        self.experiments = tuple(experiments)
        self._close: Callable[[], None] = lambda: None
        self._submit: Callable[[int, Mapping[str, float]], Any] = self._at_once
        if scheduler is not None:
            self._use_dask(scheduler)
        elif processes > 1:
            self._use_processes(processes)
        self.parallel = scheduler is not None or processes > 1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()

    def simulate(self, tasks: Sequence[tuple[int, Mapping[str, float]]]) -> list[Outcome]:
        """Histories for each task: the index of an experiment, and what to change in its case."""
        pending = [self._submit(index, changes) for index, changes in tasks]
        return [each.result() for each in pending]

    def _at_once(self, index: int, changes: Mapping[str, float]) -> Future[Outcome]:
        done: Future[Outcome] = Future()
        done.set_result(simulated(self.experiments[index], changes))
        return done

    def _use_processes(self, processes: int) -> None:
        context = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(processes, context, initializer=_start, initargs=(self.experiments,))
        with one_thread_each():
            pool.submit(_begin)  # spawned processes all start with the first task
        self._submit = lambda index, changes: pool.submit(_simulated_here, index, dict(changes))
        self._close = lambda: pool.shutdown(wait=True, cancel_futures=True)

    def _use_dask(self, address: str) -> None:
        client = connected(address)
        sent = [client.scatter(experiment, broadcast=True) for experiment in self.experiments]
        self._submit = lambda index, changes: client.submit(simulated, sent[index], dict(changes), pure=False)
        self._close = client.close


def simulated(experiment: Experiment, changes: Mapping[str, float]) -> Outcome:
    """Histories of an experiment, or why there are none."""
    try:
        return experiment.histories(changes)
    except CaseError as error:
        return "; ".join(map(str, error.problems))
    except SolverError as error:
        return str(error).removeprefix(f"{experiment.case.source}: ")


def _start(experiments: tuple[Experiment, ...]) -> None:
    global _experiments
    _experiments = experiments
    start_worker()


def _begin() -> None:
    """Nothing: a first task."""


def _simulated_here(index: int, changes: Mapping[str, float]) -> Outcome:
    return simulated(_experiments[index], changes)
