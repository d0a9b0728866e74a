"""What data can tell before anything is fitted: which parameters, and which only in combination.

From the sensitivities of the curves at one point and the noise: how well each parameter would be known if all others
were, how well if they have to be found as well, and along which combination of parameters the data say least. The
collinearity of the sensitivities is that of Brun, Reichert & Künsch (2001, doi:10.1029/2000WR900350): above 10 or so,
a change of one parameter is undone by changes of the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fvswell.fitting.evaluator import Evaluator
from fvswell.fitting.least_squares import covariance_of
from fvswell.fitting.problem import FitProblem
from fvswell.fitting.sensitivities import central_sensitivities
from fvswell.physics.tissue import Array

__all__ = ["ASSUMED_NOISE", "COLLINEAR", "Identifiability", "identifiability", "told_by"]

ASSUMED_NOISE = 0.01  # of the size of a curve, where the noise is not given
COLLINEAR = 10.0
KNOWN = 0.5  # half the width of an interval, in the logarithm or of the range, up to which a parameter is told
_NO_EFFECT = 1e-9  # of the size of a curve
_PART = 0.2  # of a combination that a parameter must have to be named


@dataclass(frozen=True)
class Identifiability:
    """What curves with given noise can tell.

    Parameters
    ----------
    names
        Of the parameters.
    sensitivities
        Of the curves by the coordinates, over the noise, shape (points, parameters).
    alone
        Half the width of the interval of each parameter if all others are known, in its coordinate; inf without effect.
    together
        The same if all are to be found; inf where they cannot be told apart.
    collinearity
        Of all parameters; 1 if they act independently.
    weakest
        Combination of the coordinates that the data say least about, of length 1, (parameters,).
    is_log
        Which coordinates are logarithms, (parameters,).
    ranges
        Of the bounds, in coordinates, (parameters,).
    noise_is_known
        Whether the noise was given; else a hundredth of the size of each curve is assumed.
    """

    names: tuple[str, ...]
    sensitivities: Array
    alone: Array
    together: Array
    collinearity: float
    weakest: Array
    is_log: Array
    ranges: Array
    noise_is_known: bool

    @property
    def told(self) -> Array:
        """Which parameters the data tell: to better than half, or than a half of their range, (parameters,)."""
        enough = np.where(self.is_log, KNOWN, KNOWN * self.ranges)
        return np.isfinite(self.together) & (self.together < enough)

    @property
    def combined(self) -> tuple[str, ...]:
        """Parameters that trade off against each other, if the data tell them in combination only."""
        if self.collinearity < COLLINEAR:
            return ()
        return tuple(name for name, part in zip(self.names, self.weakest, strict=True) if abs(part) > _PART)


def identifiability(evaluator: Evaluator, coordinates: Array) -> Identifiability:
    """What the data of a problem can tell about its parameters near some coordinates."""
    problem = evaluator.problem
    slopes = central_sensitivities(evaluator, coordinates)
    noise = [each.noise or ASSUMED_NOISE * each.size for each in problem.measurements]
    sizes = problem.scales([each.size for each in problem.measurements])
    slopes = np.where(np.abs(slopes).max(axis=0) / sizes.max() > 0.0, slopes, 0.0)
    relative = np.abs(slopes / sizes[:, None]).max(axis=0) * problem.parameters.steps
    slopes = np.where(relative > _NO_EFFECT * problem.parameters.steps, slopes, 0.0)
    weighted = slopes * (np.sqrt(problem.weights) / problem.scales(noise))[:, None]
    return told_by(problem, weighted)


def told_by(problem: FitProblem, sensitivities: Array, chosen: Sequence[int] | None = None) -> Identifiability:
    """The same from sensitivities over the noise, ``(points, parameters)``; of all parameters, or of some of them."""
    from scipy.stats import norm

    parameters = problem.parameters
    columns = list(range(len(parameters)) if chosen is None else chosen)
    own = sensitivities[:, columns]
    factor = float(norm.ppf(0.5 + 0.5 * problem.settings.confidence))
    lengths = np.linalg.norm(own, axis=0)
    with np.errstate(divide="ignore"):
        alone = factor / lengths
    variances = np.diag(covariance_of(own))
    together = np.where(np.isfinite(variances), factor * np.sqrt(np.abs(variances)), np.inf)
    low, high = parameters.bounds
    ranges = (high - low)[columns]
    units = np.where(parameters.is_log[columns], 1.0, ranges)
    acting = lengths > 0.0
    weakest = np.zeros(len(columns))
    collinearity = np.inf
    if acting.all():
        normed = own / lengths
        collinearity = 1.0 / np.sqrt(max(float(np.linalg.eigvalsh(normed.T @ normed)[0]), 1e-30))
        weakest = np.linalg.svd(own * units, full_matrices=False)[2][-1]
        weakest = weakest * np.sign(weakest[np.abs(weakest).argmax()])
    names = tuple(parameters.names[index] for index in columns)
    return Identifiability(
        names, own, alone, together, float(collinearity), weakest, parameters.is_log[columns], ranges,
        problem.noise_is_known,
    )  # fmt: skip
