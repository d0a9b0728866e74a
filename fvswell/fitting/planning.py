"""Which experiment tells most: intervals that a fit would reach, before anything is measured.

The sensitivities of the curves of a protocol to the parameters, over the noise, give the covariance that a fit to such
data will have (the inverse of Fisher's information; Atkinson, Donev & Tobias 2007, Optimum Experimental Designs). Two
protocols on one sample add up. Protocols are ranked by the geometric mean of the half intervals of all parameters, in
their logarithm or over their range: that is D-optimality of the parameters taken one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from fvswell.fitting.evaluator import Evaluator, FitProgress
from fvswell.fitting.identifiability import Identifiability, identifiability, told_by
from fvswell.fitting.problem import FitProblem
from fvswell.fitting.workers import Workers
from fvswell.study.scheduling import available_cores

__all__ = ["Plan", "PlannedProtocol", "plan"]


@dataclass(frozen=True)
class PlannedProtocol:
    """A protocol, or several on one sample, and what it would tell.

    Parameters
    ----------
    names
        Of the protocols.
    duration
        Of all of them, s.
    points
        That are measured.
    tells
        The intervals.
    reason
        Why there are none; "" where nothing is wrong.
    """

    names: tuple[str, ...]
    duration: float
    points: float
    tells: Identifiability | None
    reason: str = ""

    @property
    def score(self) -> float:
        """Geometric mean of the half intervals, of logarithms or over the ranges; inf if one is not told at all."""
        if self.tells is None:
            return np.inf
        widths = self.tells.together / np.where(self.tells.is_log, 1.0, self.tells.ranges)
        return float(np.exp(np.mean(np.log(widths)))) if np.isfinite(widths).all() else np.inf


@dataclass(frozen=True)
class Plan:
    """Protocols, the best first.

    Parameters
    ----------
    protocols
        Each by itself.
    pairs
        Two of them on one sample, the best first.
    budget
        Time that there is, s; inf if it does not matter.
    """

    protocols: tuple[PlannedProtocol, ...]
    pairs: tuple[PlannedProtocol, ...]
    budget: float

    @property
    def best(self) -> PlannedProtocol | None:
        """The best protocol or pair within the budget; a pair only if no single one does as well."""
        affordable = [each for each in (*self.protocols, *self.pairs) if each.duration <= self.budget]
        best = min(affordable, key=lambda each: each.score, default=None)
        return best if best is not None and np.isfinite(best.score) else None

    @property
    def never_told(self) -> tuple[str, ...]:
        """Parameters that no protocol tells."""
        known = [each.tells for each in self.protocols if each.tells is not None]
        if not known:
            return ()
        told = np.any([each.told for each in known], axis=0)
        return tuple(name for name, one in zip(known[0].names, told, strict=True) if not one)


def plan(
    problems: Sequence[FitProblem],
    budget: float = np.inf,
    processes: int | None = None,
    report: Callable[[FitProgress], None] | None = None,
) -> Plan:
    """Rank protocols by what they would tell.

    Parameters
    ----------
    problems
        One for each protocol, with the same parameters, its measured values being of no account and its noise given.
    budget
        Time that there is, s.
    processes
        As for `fvswell.fitting.fit.fit`.
    report
        Called after every batch of runs.

    Raises
    ------
    CaseError
        If a measured quantity is none of its case.
    """
    found = [_planned(problem, processes, report) for problem in problems]
    pairs = [
        _together(problems[0], found[i], found[j])
        for i, j in combinations(range(len(found)), 2)
        if found[i].tells is not None and found[j].tells is not None
        and found[i].duration + found[j].duration <= budget
    ]  # fmt: skip
    ranked, best_pairs = (tuple(sorted(each, key=lambda one: one.score)) for each in (found, pairs))
    return Plan(ranked, best_pairs, budget)


def _planned(
    problem: FitProblem, processes: int | None, report: Callable[[FitProgress], None] | None
) -> PlannedProtocol:
    from fvswell.errors import SolverError

    duration = float(sum(sum(experiment.durations) for experiment in problem.experiments))
    points = float(problem.weights.sum())
    if processes is None:
        processes = available_cores() if any(each.is_block for each in problem.experiments) else 1
    with Workers(problem.experiments, processes) as workers:
        evaluator = Evaluator(problem, workers, report=report)
        evaluator.stage = problem.title
        try:
            problem.check()
            tells = identifiability(evaluator, problem.parameters.start)
        except SolverError as error:
            return PlannedProtocol((problem.title,), duration, points, None, str(error))
    return PlannedProtocol((problem.title,), duration, points, tells)


def _together(problem: FitProblem, one: PlannedProtocol, other: PlannedProtocol) -> PlannedProtocol:
    """What two protocols tell on one sample."""
    assert one.tells is not None
    assert other.tells is not None
    slopes = np.vstack([one.tells.sensitivities, other.tells.sensitivities])
    names, points = one.names + other.names, one.points + other.points
    return PlannedProtocol(names, one.duration + other.duration, points, told_by(problem, slopes))
