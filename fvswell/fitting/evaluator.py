"""The curves of a problem for any parameters: simulated once, kept, and counted."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fvswell.fitting.kept_runs import KeptRuns
from fvswell.fitting.problem import FitProblem
from fvswell.fitting.workers import Workers
from fvswell.physics.tissue import Array

__all__ = ["Evaluator", "FitProgress"]


@dataclass(frozen=True)
class FitProgress:
    """How far a fit is."""

    stage: str  # what it does now
    runs: int  # parameter sets so far, those of earlier sessions included
    misfit: float  # smallest root mean square of the residuals so far, relative to the noise or size of the data
    elapsed: float  # s


class Evaluator:
    """Curves of a problem at coordinates of its parameters.

    Parameters
    ----------
    problem
        What is fitted.
    workers
        Who simulates.
    kept
        Where curves are kept; in memory without it.
    report
        Called after every batch of runs.
    """

    def __init__(
        self,
        problem: FitProblem,
        workers: Workers,
        kept: KeptRuns | None = None,
        report: Callable[[FitProgress], None] | None = None,
    ) -> None:
        self.problem, self.workers, self._report = problem, workers, report
        self.kept = kept or KeptRuns(problem.n_parameters(), len(problem.data))
        self.stage, self.runs, self.reasons = "", self.kept.earlier, dict[str, int]()
        self._began, self._least = time.monotonic(), np.inf
        self._sizes = problem.scales([each.noise or each.size for each in problem.measurements])
        self._lock = threading.Lock()

    @property
    def parallel(self) -> bool:
        """Whether several runs go on at a time."""
        return self.workers.parallel

    def curves(self, coordinates: Array) -> Array:
        """Curves at some coordinates, all simulated in one batch.

        Parameters
        ----------
        coordinates
            Shape ``(..., parameters)``.

        Returns
        -------
        array
            Shape ``(..., points)``; nan where there is no such case, or its run had to stop.
        """
        rows = np.atleast_2d(coordinates).reshape(-1, self.problem.n_parameters())
        values = self.problem.parameters.values(rows)
        with self._lock:
            found = [self.kept.get(row) for row in values]
        missing = [index for index, curve in enumerate(found) if curve is None]
        for index, curve in zip(missing, self._simulated(values[missing]), strict=True):
            found[index] = curve
        curves = np.stack([np.asarray(curve) for curve in found])
        with self._lock:
            for index in missing:
                self.kept.keep(values[index], curves[index])
            self._count(curves, len(missing))
        return curves.reshape(*np.shape(coordinates)[:-1], -1)

    def _simulated(self, values: Array) -> list[Array]:
        problem = self.problem
        experiments = range(len(problem.experiments))
        tasks = [(index, problem.changes(row, index)) for row in values for index in experiments]
        outcomes = self.workers.simulate(tasks)
        curves = []
        for row in range(len(values)):
            own = outcomes[row * len(experiments) : (row + 1) * len(experiments)]
            reasons = [outcome for outcome in own if isinstance(outcome, str)]
            for reason in reasons:
                self.reasons[reason] = self.reasons.get(reason, 0) + 1
            failed = np.full(len(problem.data), np.nan)
            curves.append(failed if reasons else problem.curves([each for each in own if not isinstance(each, str)]))
        return curves

    def _count(self, curves: Array, simulated: int) -> None:
        self.runs += simulated
        misfit = np.sqrt(np.mean(((curves - self.problem.data) / self._sizes) ** 2, axis=1))
        self._least = min(self._least, float(np.nanmin(misfit, initial=np.inf)))
        if self._report is not None:
            self._report(FitProgress(self.stage, self.runs, self._least, time.monotonic() - self._began))
