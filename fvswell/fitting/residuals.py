"""Whether what is left between data and curve is noise, or a misfit that the model cannot help."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fvswell.fitting.least_squares import BestFit
from fvswell.physics.tissue import Array

__all__ = ["ResidualTest", "residual_tests", "runs_test"]

_LEVEL = 1e-3  # probability below which residuals are not taken for noise
_FEWEST = 10  # points below which nothing is said
_SMOOTH = 20  # parts of a curve over whose length residuals are averaged to see what is systematic
_NOTICED = 1e-4  # of the size of a curve: a smaller systematic misfit is the accuracy of the runs


@dataclass(frozen=True)
class ResidualTest:
    """What the residuals of a measurement look like.

    Parameters
    ----------
    measurement
        Its name.
    runs
        Stretches of residuals of one sign.
    expected_runs
        How many independent residuals would have.
    probability
        That independent residuals have so few (Wald & Wolfowitz 1940).
    autocorrelation
        Of neighbouring residuals.
    systematic
        Largest systematic misfit, data less curve, in the unit of the history.
    time
        Of it, s since the run began.
    relative
        It over the size of the curve.
    structured
        Whether the misfit is not noise.
    """

    measurement: str
    runs: int
    expected_runs: float
    probability: float
    autocorrelation: float
    systematic: float
    time: float
    relative: float
    structured: bool


def residual_tests(best: BestFit) -> tuple[ResidualTest, ...]:
    """One for each measurement."""
    tests = []
    for measurement, span in zip(best.problem.measurements, best.problem.spans, strict=True):
        own = measurement.values - best.curves[span.points]
        runs, expected, probability = runs_test(own)
        centred = own - own.mean()
        power = float(centred @ centred)
        smooth = _smoothed(own)
        worst = int(np.abs(smooth).argmax())
        relative = float(smooth[worst] / measurement.size)
        tests.append(
            ResidualTest(
                measurement=measurement.name,
                runs=runs,
                expected_runs=expected,
                probability=probability,
                autocorrelation=float(centred[1:] @ centred[:-1]) / power if power else 0.0,
                systematic=float(smooth[worst]),
                time=float(measurement.times[worst]),
                relative=relative,
                structured=probability < _LEVEL and len(own) >= _FEWEST and abs(relative) > _NOTICED,
            )
        )
    return tuple(tests)


def runs_test(residuals: Array) -> tuple[int, float, float]:
    """Runs of one sign, how many are expected of independent residuals, and the probability of so few.

    The number of runs is taken as normal, given the numbers of positive and negative residuals.
    """
    from scipy.stats import norm

    signs = residuals[residuals != 0.0] > 0.0
    above, total = int(signs.sum()), len(signs)
    below = total - above
    runs = 1 + int(np.count_nonzero(signs[1:] != signs[:-1])) if total else 0
    if not above or not below:
        # all on one side: that all of them are is as likely as so many coins falling alike
        return runs, float(runs), 2.0 * 0.5**total if total else 1.0
    expected = 2.0 * above * below / total + 1.0
    variance = (expected - 1.0) * (expected - 2.0) / (total - 1.0)
    if variance <= 0.0:
        return runs, expected, 1.0
    return runs, expected, float(norm.cdf((runs + 0.5 - expected) / np.sqrt(variance)))


def _smoothed(values: Array) -> Array:
    """Averages over stretches of a twentieth of the points, at least 3."""
    width = min(max(len(values) // _SMOOTH, 3), len(values)) | 1
    kernel = np.ones(width)
    averaged: Array = np.convolve(values, kernel, "same") / np.convolve(np.ones(len(values)), kernel, "same")
    return averaged if len(values) >= width else np.full(len(values), values.mean())
