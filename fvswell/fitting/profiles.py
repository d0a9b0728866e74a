"""Profile likelihood intervals: how far a parameter can go while all others follow it.

The likelihood ratio of Gaussian residuals is a difference of sums of squares S. With noise that is given, the
interval of a parameter holds the values whose least S over the other parameters is within a quantile of chi-squared
with 1 degree of freedom of the least of all. With noise that is estimated, S is over its estimated variance and the
quantile is that of F with 1 and N - p degrees of freedom, which for a linear model gives Student's interval exactly
(Bates & Watts 1988, Nonlinear Regression Analysis, section 6.1).
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from fvswell.fitting.evaluator import Evaluator
from fvswell.fitting.least_squares import BestFit, residuals_of
from fvswell.physics.tissue import Array

__all__ = ["Profile", "profile_quantile", "profiles"]

_NEAR = 0.03  # of the root of the quantile: the end of an interval is interpolated from points as near as that
_MOST_POINTS = 12  # on each side
_FARTHEST = 2.5  # times as far as the last point goes the next one
_SHARE = 0.005  # of the quantile that a minimum over the other parameters is found to
_FEW = 30  # evaluations of one minimum


@dataclass(frozen=True)
class Profile:
    """How the best misfit grows as one parameter leaves its best value.

    Parameters
    ----------
    name
        Of the parameter.
    coordinates
        Of all parameters at the points of the profile, the parameter's own increasing, shape (points, parameters).
    own
        Coordinate of the parameter, shape (points,).
    ratio
        Growth of the sum of squares over the variance, shape (points,).
    low, high
        Ends of the interval, as values in internal units; nan where it is open within the bounds.
    quantile
        Of the ratio, at which the interval ends.
    """

    name: str
    coordinates: Array
    own: Array
    ratio: Array
    low: float
    high: float
    quantile: float


def profile_quantile(best: BestFit) -> float:
    """Growth of the sum of squares over the variance at the ends of an interval."""
    from scipy.stats import chi2, f

    problem = best.problem
    confidence = problem.settings.confidence
    if problem.noise_is_known:
        return float(chi2.ppf(confidence, 1))
    return float(f.ppf(confidence, 1, problem.degrees_of_freedom))


def profiles(evaluator: Evaluator, best: BestFit) -> tuple[Profile, ...]:
    """Profiles of all free parameters, about a fit."""
    evaluator.stage = "profiles"
    chains = [(index, sign) for index in range(len(best.coordinates)) for sign in (-1.0, 1.0)]
    walk = _Walk(evaluator, best)
    if evaluator.parallel:
        with ThreadPoolExecutor(len(chains)) as threads:
            sides = list(threads.map(lambda chain: walk.side(*chain), chains))
    else:
        sides = [walk.side(*chain) for chain in chains]
    return tuple(walk.joined(index, *sides[2 * index : 2 * index + 2]) for index in range(len(best.coordinates)))


_Point = tuple[Array, float]  # coordinates of all parameters, and the ratio there


class _Walk:
    """Steps along profiles of one fit."""

    def __init__(self, evaluator: Evaluator, best: BestFit) -> None:
        self.evaluator, self.best = evaluator, best
        self.quantile = profile_quantile(best)
        self.covariance, self.errors = best.covariance, best.standard_errors

    def side(self, index: int, sign: float) -> list[_Point]:
        """Points of a profile on one side, the nearest first, until the quantile is passed or a bound is reached."""
        centre, target = self.best.coordinates, np.sqrt(self.quantile)
        bounds = self.best.problem.parameters.bounds
        bound = bounds[1 if sign > 0.0 else 0][index]
        room = abs(bound - centre[index])
        if room <= 1e-12 * (bounds[1] - bounds[0])[index]:
            return []
        error = self.errors[index]
        distance = min(target * error, room) if np.isfinite(error) else 0.1 * room
        points: list[_Point] = []
        while len(points) < _MOST_POINTS:
            at = bound if distance >= room else centre[index] + sign * distance
            points.append(self.point(index, at, points))
            points.sort(key=lambda point: abs(point[0][index] - centre[index]))
            away = np.array([abs(point[0][index] - centre[index]) for point in points])
            roots = np.sqrt([max(point[1], 0.0) for point in points])
            beyond = np.flatnonzero(roots >= target)
            if not len(beyond):
                if away[-1] >= room * (1.0 - 1e-12):
                    break
                distance = away[-1] * float(np.clip(1.02 * target / max(roots[-1], 1e-12), 1.2, _FARTHEST))
                continue
            if np.abs(roots - target).min() <= _NEAR * target:
                break
            first = beyond[0]
            inner, root = (away[first - 1], roots[first - 1]) if first else (0.0, 0.0)
            share = (target - root) / (roots[first] - root)
            distance = inner + float(np.clip(share, 0.1, 0.9)) * (away[first] - inner)
        # so that a figure shows the shape; a profile that bends is no parabola
        half = 0.5 * abs(points[-1][0][index] - centre[index])
        if min(abs(point[0][index] - centre[index]) for point in points) > 1.2 * half:
            points.append(self.point(index, centre[index] + sign * half, points))
        return sorted(points, key=lambda point: abs(point[0][index] - centre[index]))

    def point(self, index: int, at: float, before: list[_Point]) -> _Point:
        """The least misfit with one coordinate held."""
        best, others = self.best, np.arange(len(self.best.coordinates)) != index
        start = self.best.problem.parameters.within(self._guess(index, at, before))
        start[index] = at
        if not others.any():
            return start, self._ratio(self._residuals(start))
        low, high = (bound[others] for bound in best.problem.parameters.bounds)
        return self._least(start, others, low, high)

    def joined(self, index: int, below: list[_Point], above: list[_Point]) -> Profile:
        """The profile of a parameter from its two sides."""
        best, names = self.best, self.best.problem.parameters.names
        points = [*below[::-1], (best.coordinates, 0.0), *above]
        coordinates = np.stack([point[0] for point in points])
        ends = [self._end(index, side) for side in (below, above)]
        values = [
            np.nan if end is None else best.problem.parameters.values(_replaced(best.coordinates, index, end))[index]
            for end in ends
        ]
        ratio = np.array([point[1] for point in points])
        return Profile(
            names[index], coordinates, coordinates[:, index], ratio, float(values[0]), float(values[1]), self.quantile
        )

    def _guess(self, index: int, at: float, before: list[_Point]) -> Array:
        """Where the others will be: on the line of the covariance, bent as the nearest point before is off it."""
        centre = self.best.coordinates
        away = at - centre[index]
        slope = self.covariance[:, index] / self.covariance[index, index]
        slope = np.where(np.isfinite(slope), slope, 0.0)
        guess: Array = centre + slope * away
        if before:
            nearest = min(before, key=lambda point: abs(point[0][index] - at))[0]
            way = nearest[index] - centre[index]
            guess = guess + (nearest - centre - slope * way) * (away / way) ** 2
        return guess

    def _least(self, start: Array, others: Array, low: Array, high: Array) -> _Point:
        from scipy.optimize import least_squares

        best, whole = self.best, start.copy()
        broyden = _Broyden(self, start, others)
        if not np.isfinite(self._residuals(start)).all():
            return start, np.inf
        expected = best.squares + self.quantile * best.variance
        found: Any = least_squares(
            lambda part: self._residuals(_replaced(start, others, part)), start[others], broyden, (low, high),
            x_scale="jac", ftol=_SHARE * self.quantile * best.variance / expected, xtol=1e-9, gtol=None, max_nfev=_FEW,
        )  # fmt: skip
        whole[others] = found.x
        return whole, self._ratio(found.fun)

    def _residuals(self, at: Array) -> Array:
        return residuals_of(self.best.problem, self.evaluator.curves(at), self.best.scales)

    def _ratio(self, residuals: Array) -> float:
        return float((residuals @ residuals - self.best.squares) / self.best.variance)

    def _end(self, index: int, side: list[_Point]) -> float | None:
        """Coordinate at which the quantile is reached, None if it is not."""
        from scipy.interpolate import PchipInterpolator

        away = np.array([0.0, *(point[0][index] - self.best.coordinates[index] for point in side)])
        roots = np.sqrt(np.maximum([0.0, *(point[1] for point in side)], 0.0))
        target = np.sqrt(self.quantile)
        beyond = np.flatnonzero(roots >= target)
        if not len(beyond):
            return None
        last = beyond[0]
        known = np.concatenate([[True], np.diff(np.maximum.accumulate(roots[: last + 1])) > 0.0])
        own, at = roots[: last + 1][known], away[: last + 1][known]
        if not np.isfinite(own[-1]):  # there is no case at the last point: the end lies before it
            return float(self.best.coordinates[index] + at[-1])
        return float(self.best.coordinates[index] + PchipInterpolator(own, at)(target))


class _Broyden:
    """Jacobian by the other coordinates: finite differences where it begins, then updated from the steps taken."""

    def __init__(self, walk: _Walk, start: Array, others: Array) -> None:
        self.walk, self.start, self.others = walk, start, others
        self.last: tuple[Array, Array, Array] | None = None  # coordinates, residuals, Jacobian

    def __call__(self, part: Array) -> Array:
        at = _replaced(self.start, self.others, part)
        residuals = self.walk._residuals(at)
        if self.last is None:
            jacobian = self._differences(at, residuals)
        else:
            before, old, jacobian = self.last
            step = part - before
            jacobian = jacobian + np.outer(residuals - old - jacobian @ step, step) / (step @ step)
        self.last = part.copy(), residuals, jacobian
        return jacobian

    def _differences(self, at: Array, residuals: Array) -> Array:
        parameters = self.walk.best.problem.parameters
        steps = np.where(at + parameters.steps <= parameters.bounds[1], 1.0, -1.0) * parameters.steps
        beside = (at + np.diag(steps))[self.others]
        curves = self.walk.evaluator.curves(beside)
        found = residuals_of(self.walk.best.problem, curves, self.walk.best.scales) - residuals
        found = np.where(np.isfinite(found), found, 0.0)  # beside it there is no case: that way is not gone
        jacobian: Array = (found / steps[self.others][:, None]).T
        return jacobian


def _replaced(coordinates: Array, where: int | Array, by: float | Array) -> Array:
    changed = coordinates.copy()
    changed[where] = by
    return changed
