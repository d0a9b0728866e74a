"""A fit from its problem to all that is known afterwards."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from fvswell.case.case import Case
from fvswell.case.errors import CaseError, Problem
from fvswell.fitting.evaluator import Evaluator, FitProgress
from fvswell.fitting.identifiability import Identifiability, identifiability
from fvswell.fitting.kept_runs import KeptRuns
from fvswell.fitting.least_squares import BestFit, best_fit, refined
from fvswell.fitting.posterior import Samples, sample_posterior
from fvswell.fitting.problem import FitProblem
from fvswell.fitting.profiles import Profile, profiles
from fvswell.fitting.residuals import ResidualTest, residual_tests
from fvswell.fitting.workers import Workers
from fvswell.study.scheduling import available_cores

__all__ = ["FitResult", "fit"]

_BETTER = 0.01  # of the variance by which a profile has to find something better for the search to begin again
_AGAIN = 2  # times
_IDLE = "makes no difference to any measured curve: fix it, or leave it out"


@dataclass(frozen=True)
class FitResult:
    """What a fit has found."""

    problem: FitProblem
    before: Identifiability  # what the data can tell, at the start
    best: BestFit
    profiles: tuple[Profile, ...]  # of the free parameters; empty if they were not asked for
    samples: Samples | None  # of the posterior, if they were asked for
    runs: int  # parameter sets simulated
    failed: dict[str, int]  # why runs had to stop, and how many
    seconds: float

    @cached_property
    def residual_tests(self) -> tuple[ResidualTest, ...]:
        """Whether the misfit is noise, by measurement."""
        return residual_tests(self.best)

    @property
    def values(self) -> dict[str, float]:
        """Best values of the free parameters by name, internal units."""
        return dict(zip(self.problem.parameters.names, map(float, self.best.values), strict=True))

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """Profile likelihood intervals by name, internal units; nan where an end is open within the bounds."""
        return {profile.name: (profile.low, profile.high) for profile in self.profiles}

    @property
    def cases(self) -> dict[str, Case]:
        """The case of each measurement with the best values, by name."""
        spans = zip(self.problem.measurements, self.problem.spans, strict=True)
        return {measurement.name: self.problem.case(self.best.values, span.experiment) for measurement, span in spans}


def fit(
    problem: FitProblem,
    *,
    with_profiles: bool = True,
    samples: int = 0,
    processes: int | None = None,
    scheduler: str | None = None,
    keep: Path | None = None,
    report: Callable[[FitProgress], None] | None = None,
) -> FitResult:
    """Fit a problem.

    Parameters
    ----------
    problem
        Measured curves and parameters.
    with_profiles
        Whether to find profile likelihood intervals.
    samples
        Steps of each of the 64 walkers that sample the posterior; none with 0.
    processes
        Number of processes on this machine; without it as many as there are cores for blocks, and this process alone
        for columns, whose runs take milliseconds.
    scheduler
        Address of a Dask scheduler to work on instead.
    keep
        File in which runs are kept, so that an interrupted fit goes on where it was; it is deleted at the end.
    report
        Called after every batch of runs.

    Returns
    -------
    FitResult
        Values, intervals, and how good they are.

    Raises
    ------
    CaseError
        If a parameter changes nothing, a measured quantity is none of its case, or the start cannot be.
    SolverError
        If the case cannot be run at the start, or beside a point of the search.
    OutputError
        If runs cannot be kept.
    """
    began = time.monotonic()
    problem.check()
    if processes is None:
        blocks = any(experiment.is_block for experiment in problem.experiments)
        processes = available_cores() if blocks else 1
    with ExitStack() as stack:
        kept = stack.enter_context(KeptRuns(problem.n_parameters(), len(problem.data), keep, problem.sha256))
        workers = stack.enter_context(Workers(problem.experiments, processes, scheduler))
        evaluator = Evaluator(problem, workers, kept, report)
        evaluator.stage = "sensitivities at the start"
        before = identifiability(evaluator, problem.parameters.start)
        _refuse_idle(problem, before)
        best = best_fit(evaluator)
        found: tuple[Profile, ...] = ()
        for _ in range(_AGAIN if with_profiles else 0):
            found = profiles(evaluator, best)
            better = [(profile.ratio.min(), profile.coordinates[profile.ratio.argmin()]) for profile in found]
            least, where = min(better, key=lambda each: each[0])
            if least > -_BETTER:
                break
            best = refined(evaluator, best, where)
        drawn = sample_posterior(evaluator, best, samples) if samples else None
        kept.remove()
    seconds = time.monotonic() - began
    return FitResult(problem, before, best, found, drawn, evaluator.runs, evaluator.reasons, seconds)


def _refuse_idle(problem: FitProblem, before: Identifiability) -> None:
    """Parameters that change no measured curve."""
    idle = [
        Problem(
            f"parameter[{name}]",
            parameter.keys[0],
            _IDLE,
        )
        for name, parameter, effect in zip(before.names, problem.parameters.free, before.alone, strict=True)
        if not np.isfinite(effect)
    ]
    if idle:
        raise CaseError(idle, problem.source)
