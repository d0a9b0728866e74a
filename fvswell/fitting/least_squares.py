"""Bounded nonlinear least squares from several starts; noise is estimated unless it is given.

Each search is `scipy.optimize.least_squares` (trust region reflective: Branch, Coleman & Li 1999) with finite
differences of one batch as its Jacobian. Where several measurements have noise of unknown levels, the levels follow
from the residuals of each and the search is repeated with them until they stay (feasible generalised least squares).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import qmc

from fvswell.errors import SolverError
from fvswell.fitting.evaluator import Evaluator
from fvswell.fitting.problem import FitProblem
from fvswell.fitting.sensitivities import central_sensitivities, sensitivities
from fvswell.physics.tissue import Array

__all__ = ["BestFit", "Search", "best_fit", "residuals_of"]

SMALLEST_NOISE = 1e-6  # of the size of a curve: below it a misfit is rounding and the tolerance of the runs
_SCREENED = 8  # points spread over the bounds for each further start
_MOST_EVALUATIONS = 100  # of one search
_ROUGH_EVALUATIONS = 25  # of one that is compared first
_CLOSE = 1e-9  # relative change of the squares that ends a search
_ROUGH = 1e-3  # the same of searches that are compared first
_SAME_COORDINATES = 1e-10
_ROUNDS = 10  # of noise levels
_SAME_NOISE = 1e-3
_SAME_END = 0.01  # of the range of every coordinate: searches that end so near each other have found the same
_AT_BOUND = 1e-3  # of the range


@dataclass(frozen=True)
class Search:
    """One search: where from, where to."""

    start: Array  # coordinates
    end: Array
    squares: float  # weighted sum of squares there, relative to the noise or size of the data
    evaluations: int
    converged: bool


@dataclass(frozen=True)
class BestFit:
    """The best parameters, and how the data lie about the curves there."""

    problem: FitProblem
    coordinates: Array  # (parameters,)
    curves: Array  # (points,)
    sensitivities: Array  # of the curves by the coordinates, (points, parameters)
    scales: Array  # that residuals are relative to, (points,)
    searches: tuple[Search, ...]

    @property
    def values(self) -> Array:
        """Of the free parameters, internal units."""
        return self.problem.parameters.values(self.coordinates)

    @property
    def residuals(self) -> Array:
        """Data less curves over their scales, (points,)."""
        return (self.problem.data - self.curves) / self.scales

    @property
    def squares(self) -> float:
        """Weighted sum of squares of the residuals."""
        return float(self.problem.weights @ self.residuals**2)

    @property
    def variance(self) -> float:
        """Of the residuals: 1 where all noise is given, else estimated from them."""
        if self.problem.noise_is_known:
            return 1.0
        return max(self.squares / self.problem.degrees_of_freedom, self._least_variance)

    @property
    def noise(self) -> tuple[float, ...]:
        """Standard deviation of each measurement, as it is given or as the residuals have it."""
        shares = self.problem.degrees_of_freedom / self.problem.weights.sum()
        found = []
        for measurement, span in zip(self.problem.measurements, self.problem.spans, strict=True):
            own = (self.residuals * self.scales)[span.points]
            estimated = max(float(np.sqrt(np.mean(own**2) / shares)), SMALLEST_NOISE * measurement.size)
            found.append(estimated if measurement.noise is None else measurement.noise)
        return tuple(found)

    @property
    def jacobian(self) -> Array:
        """Of the weighted curves over their scales, (points, parameters)."""
        return self.sensitivities * (np.sqrt(self.problem.weights) / self.scales)[:, None]

    @property
    def covariance(self) -> Array:
        """Of the coordinates, from the linearised curves, (parameters, parameters); nan where it is not determined."""
        return covariance_of(self.jacobian) * self.variance

    @property
    def standard_errors(self) -> Array:
        """Of the coordinates, (parameters,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlations(self) -> Array:
        """Of the estimates, (parameters, parameters)."""
        errors = self.standard_errors
        return self.covariance / np.outer(errors, errors)

    @property
    def at_bound(self) -> tuple[str, ...]:
        """For each parameter "low" or "high" if it lies at that bound, else ""."""
        low, high = self.problem.parameters.bounds
        share = (self.coordinates - low) / (high - low)
        return tuple("low" if at < _AT_BOUND else "high" if at > 1.0 - _AT_BOUND else "" for at in share)

    @property
    def agreeing(self) -> int:
        """How many of the searches have found it."""
        low, high = self.problem.parameters.bounds
        away = [np.abs(search.end - self.coordinates) / (high - low) for search in self.searches]
        return sum(bool((each < _SAME_END).all()) for each in away)

    @property
    def _least_variance(self) -> float:
        sizes = self.problem.scales([measurement.size for measurement in self.problem.measurements])
        return float(np.mean((SMALLEST_NOISE * sizes / self.scales) ** 2))


def covariance_of(jacobian: Array) -> Array:
    """Inverse of J'J, (parameters, parameters); nan where it is singular."""
    lengths = np.linalg.norm(jacobian, axis=0)
    if not lengths.all():
        return np.full((jacobian.shape[1], jacobian.shape[1]), np.nan)
    triangle: Array = np.asarray(np.linalg.qr(jacobian / lengths, mode="r"))
    if np.linalg.cond(triangle) > 1e12:
        return np.full(triangle.shape, np.nan)
    inverse = np.linalg.inv(triangle)
    covariance: Array = inverse @ inverse.T / np.outer(lengths, lengths)
    return covariance


def best_fit(evaluator: Evaluator) -> BestFit:
    """Search from all starts, and settle the noise.

    Raises
    ------
    SolverError
        If the case cannot be run at the start.
    """
    problem = evaluator.problem
    noise = [measurement.noise or measurement.size for measurement in problem.measurements]
    scales = problem.scales(noise)
    starts = _starts(evaluator, scales)
    close = _CLOSE if len(starts) == 1 else _ROUGH
    searches = [_search(evaluator, scales, start, "search", close) for start in starts]
    best = _best(evaluator, scales, searches)
    if close != _CLOSE:
        best = _best(evaluator, scales, [_search(evaluator, scales, best.coordinates, "search", _CLOSE)], searches)
    unknown = [measurement.noise is None for measurement in problem.measurements]
    if len(unknown) == 1 or not any(unknown):
        return best
    for _ in range(_ROUNDS):
        before = np.array(noise)
        noise = list(best.noise)
        scales = problem.scales(noise)
        best = _best(
            evaluator, scales, [_search(evaluator, scales, best.coordinates, "noise levels", _CLOSE)], searches
        )
        if np.allclose(noise, before, rtol=_SAME_NOISE, atol=0.0):
            break
    return best


def refined(evaluator: Evaluator, best: BestFit, start: Array) -> BestFit:
    """The fit that a search from another point finds with the same scales."""
    again = _search(evaluator, best.scales, start, "search", _CLOSE)
    return _best(evaluator, best.scales, [again], [*best.searches, again])


def residuals_of(problem: FitProblem, curves: Array, scales: Array) -> Array:
    """Curves less data, over the scales and weighted, ``(..., points)``."""
    return (curves - problem.data) * (np.sqrt(problem.weights) / scales)


def _search(evaluator: Evaluator, scales: Array, start: Array, stage: str, close: float) -> Search:
    from scipy.optimize import least_squares  # a tenth of a second to import

    evaluator.stage = stage
    problem = evaluator.problem
    factor = np.sqrt(problem.weights) / scales

    def residuals(at: Array) -> Array:
        return residuals_of(problem, evaluator.curves(at), scales)

    def jacobian(at: Array) -> Array:
        return sensitivities(evaluator, at, evaluator.curves(at)) * factor[:, None]

    found: Any = least_squares(
        residuals, problem.parameters.within(start), jacobian, problem.parameters.bounds, x_scale="jac",
        ftol=close, xtol=_SAME_COORDINATES, gtol=None,
        max_nfev=_ROUGH_EVALUATIONS if close == _ROUGH else _MOST_EVALUATIONS,
    )  # fmt: skip
    return Search(start, found.x, 2.0 * float(found.cost), int(found.nfev), found.status > 0)


def _best(
    evaluator: Evaluator, scales: Array, searches: Sequence[Search], all_searches: Sequence[Search] | None = None
) -> BestFit:
    best = min(searches, key=lambda search: search.squares)
    curves = evaluator.curves(best.end)
    slopes = central_sensitivities(evaluator, best.end)
    return BestFit(evaluator.problem, best.end, curves, slopes, scales, tuple(all_searches or searches))


def _starts(evaluator: Evaluator, scales: Array) -> list[Array]:
    """The given start, and the best of points spread over the bounds."""
    problem = evaluator.problem
    start, further = problem.parameters.start, problem.settings.starts - 1
    evaluator.stage = "start"
    if not np.isfinite(evaluator.curves(start)).all():
        raise SolverError(f"{problem.source}: at the start of the fit: {next(iter(evaluator.reasons))}")
    if further == 0:
        return [start]
    evaluator.stage = "further starts"
    low, high = problem.parameters.bounds
    count = 1 << (_SCREENED * further - 1).bit_length()  # sobol points are balanced in powers of two
    unit = qmc.Sobol(len(start), rng=problem.settings.seed).random(count)
    points = low + unit * (high - low)
    squares = np.sum(residuals_of(problem, evaluator.curves(points), scales) ** 2, axis=1)
    order = [index for index in np.argsort(squares) if np.isfinite(squares[index])]
    return [start, *_apart(points[order], unit[order], further)]


def _apart(points: Array, unit: Array, count: int) -> list[Array]:
    """The first of some points, leaving out those that lie near one before them."""
    distance = 0.5 * len(points) ** (-1.0 / unit.shape[1]) if len(points) else 0.0
    chosen: list[int] = []
    for index in range(len(points)):
        if all(np.abs(unit[index] - unit[other]).max() > distance for other in chosen):
            chosen.append(index)
        if len(chosen) == count:
            break
    return [points[index] for index in chosen]
