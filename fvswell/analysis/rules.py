"""The paper's rule for when the biphasic-swelling model will do, fitted to a study.

R^2 = 1 - a exp(-b f) of one number f of the tissue, separately for the loading and the unloading of compression and
for swelling (Wilson et al. 2005; the values of their a and b are not known to us).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from fvswell.analysis.prediction_accuracy import ErrorDistribution, prediction_errors
from fvswell.physics.tissue import Array
from fvswell.study.points import StudyPoints

__all__ = ["CurveFit", "fit_curve", "fitted_points", "paper_fits", "r_squared_by_rule", "rule_errors"]

_LARGEST_RATIO_IN_SWELLING = 100.0  # of D+ D-/(E k)^2, as in the paper
_FEWEST_POINTS = 10
_CONFIDENCE = 0.95
_RESAMPLES = 400
_SEED = 2005
_LARGEST_FALL = 20.0  # of ln(1 - R^2) over all points that is looked for
_SCAN = 21


@dataclass(frozen=True)
class CurveFit:
    """R^2 = 1 - a exp(-b f), fitted by least squares."""

    points: int
    a: float
    b: float
    a_interval: tuple[float, float]  # 95 %, from points drawn anew with replacement
    b_interval: tuple[float, float]
    scatter: float  # root of the mean squared residual
    explained: float  # share of the variance of R^2

    def __call__(self, applicability: Array) -> Array:
        """R^2 by the curve."""
        return _curve(applicability, self.a, self.b)


def fit_curve(applicability: Array, r_squared: Array, resamples: int = _RESAMPLES) -> CurveFit:
    """Fit the paper's curve to points.

    The intervals come from the bootstrap, as the residuals are far from normal: they grow toward small f.

    Parameters
    ----------
    applicability, r_squared
        f and R^2 of the points, at least ten of each.
    resamples
        How many times points are drawn anew for the intervals.

    Raises
    ------
    ValueError
        If there are fewer points.
    """
    if len(r_squared) < _FEWEST_POINTS:
        raise ValueError(f"a curve needs {_FEWEST_POINTS} points, not {len(r_squared)}")
    a, b = _least_squares(applicability, r_squared)
    draw = np.random.default_rng(_SEED)
    drawn = [draw.integers(len(r_squared), size=len(r_squared)) for _ in range(resamples)]
    sample = np.array([_least_squares(applicability[index], r_squared[index]) for index in drawn])
    low, high = np.quantile(sample, [0.5 - _CONFIDENCE / 2.0, 0.5 + _CONFIDENCE / 2.0], axis=0)
    residual = r_squared - _curve(applicability, a, b)
    return CurveFit(
        len(r_squared), a, b, (float(low[0]), float(high[0])), (float(low[1]), float(high[1])),
        scatter=float(np.sqrt(np.mean(residual**2))),
        explained=float(1.0 - np.mean(residual**2) / np.var(r_squared)),
    )  # fmt: skip


def fitted_points(points: StudyPoints, curve: str) -> Array:
    """Which points the paper's fit of a curve takes in: in swelling not those with D+ D-/(E k)^2 > 100."""
    own = points.of_curve(curve)
    return own & (points.mobility_ratio <= _LARGEST_RATIO_IN_SWELLING) if curve == "swelling" else own


def paper_fits(points: StudyPoints) -> dict[str, CurveFit]:
    """The fits of all curves that have points enough."""
    chosen = {curve: fitted_points(points, curve) for curve in points.curves}
    return {
        curve: fit_curve(points.applicability[own], points.r_squared[own])
        for curve, own in chosen.items()
        if own.sum() >= _FEWEST_POINTS
    }


def r_squared_by_rule(points: StudyPoints, fits: Mapping[str, CurveFit]) -> Array:
    """R^2 of the points by the fits of their curves, nan where there is none."""
    values = np.full(len(points.curve), np.nan)
    for curve, fit in fits.items():
        own = points.of_curve(curve)
        values[own] = fit(points.applicability[own])
    return values


def rule_errors(points: StudyPoints, curve: str, fit: CurveFit) -> ErrorDistribution:
    """How far a fit is from the points that it was made from."""
    own = fitted_points(points, curve)
    return prediction_errors(points.r_squared[own], fit(points.applicability[own]))


def _curve(applicability: Array, a: float, b: float) -> Array:
    return 1.0 - a * np.exp(-b * applicability)


def _least_squares(applicability: Array, r_squared: Array) -> tuple[float, float]:
    """Best a, and b >= 0. For each b the best a is that of a linear fit, so b alone is searched."""
    misfit = 1.0 - r_squared
    middle = applicability.mean()

    def amplitude(b: float) -> tuple[float, Array]:
        decay = np.exp(-b * (applicability - middle))
        return float(decay @ misfit / (decay @ decay)), decay

    def squares(b: float) -> float:
        a, decay = amplitude(b)
        return float(((misfit - a * decay) ** 2).sum())

    steepest = _LARGEST_FALL / (float(np.ptp(applicability)) or 1.0)  # points drawn anew may all be one
    tried = np.linspace(0.0, steepest, _SCAN)
    best = int(np.argmin([squares(b) for b in tried]))
    around = tried[max(best - 1, 0)], tried[min(best + 1, _SCAN - 1)]
    b = float(minimize_scalar(squares, bounds=around, method="bounded", options={"xatol": 1e-9 * steepest}).x)
    return amplitude(b)[0] * float(np.exp(b * middle)), b
