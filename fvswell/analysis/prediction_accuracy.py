"""How far the predictor is from the simulations of a study, and what users may expect of it.

The state linearised about is all that is fitted in the predictor. It is chosen on one half of the runs of a study, and
judged on the other.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import resources
from itertools import pairwise
from typing import Any

import numpy as np

from fvswell.physics.tissue import Array
from fvswell.prediction.predictor import LINEARISED_AT
from fvswell.study.points import CURVES, StudyPoints

__all__ = [
    "Accuracy",
    "Assessment",
    "Choice",
    "ErrorDistribution",
    "StrainClass",
    "assess",
    "known_accuracy",
    "prediction_errors",
]

_STRAIN_BOUNDS = (0.05, 0.1, 0.2, 0.3)
_CANDIDATES = np.linspace(0.0, 1.0, 21)
_SEED = 2005
_FEWEST_POINTS = 10  # that a distribution is given of


@dataclass(frozen=True)
class ErrorDistribution:
    """How far predicted R^2 are from simulated ones; the misfit is 1 - R^2."""

    points: int
    median: float  # of |predicted - simulated R^2|
    ninth_decile: float
    median_factor: float  # by which the misfit is off, up or down
    ninth_decile_factor: float
    bias_factor: float  # median of predicted over simulated misfit
    within_hundredth: float  # share of the points with |predicted - simulated R^2| <= 0.01


@dataclass(frozen=True)
class StrainClass:
    """Errors where the strain between equilibria is within bounds."""

    curve: str
    low: float
    high: float
    errors: ErrorDistribution


@dataclass(frozen=True)
class Choice:
    """A state linearised about, chosen on one half of the runs for some curves, and its errors on the other half."""

    curve: str
    linearised_at: float
    chosen_from: str  # "this curve", "all curves" or "the program"
    errors: ErrorDistribution


@dataclass(frozen=True)
class Assessment:
    """The predictor against a study."""

    predicted: Array  # R^2 of the points by the predictor as it is
    errors: dict[str, ErrorDistribution]  # by curve
    by_strain: tuple[StrainClass, ...]
    choices: tuple[Choice, ...]


def assess(points: StudyPoints) -> Assessment:
    """Hold the predictor against the points of a study."""
    predicted = points.predicted()
    own = {curve: points.of_curve(curve) for curve in points.curves}
    return Assessment(
        predicted,
        errors={curve: prediction_errors(points.r_squared[part], predicted[part]) for curve, part in own.items()},
        by_strain=tuple(_by_strain(points, predicted)),
        choices=tuple(_choices(points, predicted)),
    )


def prediction_errors(simulated: Array, predicted: Array) -> ErrorDistribution:
    """Distribution of the errors of predicted R^2, arrays of one shape."""
    error = np.abs(predicted - simulated)
    decades = _decades(simulated, predicted)
    return ErrorDistribution(
        points=len(error),
        median=float(np.median(error)),
        ninth_decile=float(np.quantile(error, 0.9)),
        median_factor=float(10.0 ** np.median(np.abs(decades))),
        ninth_decile_factor=float(10.0 ** np.quantile(np.abs(decades), 0.9)),
        bias_factor=float(10.0 ** np.median(decades)),
        within_hundredth=float(np.mean(error <= 0.01)),
    )


@dataclass(frozen=True)
class Accuracy:
    """What a study, run beforehand, says of the predictor."""

    source: str
    by_strain: tuple[StrainClass, ...]

    def expected(self, curve: str | None, strain: float) -> ErrorDistribution:
        """Errors to expect of a phase; without a curve the largest ones of any at that strain."""
        fitting = [
            each.errors
            for each in self.by_strain
            if curve in (each.curve, None) and each.low <= abs(strain) < each.high
        ]
        return max(fitting, key=lambda errors: errors.ninth_decile_factor)


def known_accuracy() -> Accuracy:
    """The predictor's accuracy in the study that comes with the program (see docs/studies.md for how it was made)."""
    text = resources.files(__package__).joinpath("prediction_accuracy.json").read_text(encoding="utf-8")
    content = json.loads(text)
    return Accuracy(content["source"], tuple(_strain_class(each) for each in content["by_strain"]))


def _strain_class(content: dict[str, Any]) -> StrainClass:
    high = np.inf if content["high"] is None else content["high"]
    return StrainClass(content["curve"], content["low"], high, ErrorDistribution(**content["errors"]))


def _by_strain(points: StudyPoints, predicted: Array) -> Iterator[StrainClass]:
    """Classes that cover all strains, joined where there are too few points."""
    for curve in points.curves:
        part = points.of_curve(curve)
        strain = np.abs(points.strain[part])
        for low, high in pairwise(_filled_bounds(strain)):
            own = (strain >= low) & (strain < high)
            yield StrainClass(curve, low, high, prediction_errors(points.r_squared[part][own], predicted[part][own]))


def _filled_bounds(strain: Array) -> list[float]:
    """Bounds between which there are points enough, from 0 to infinity."""
    bounds = [0.0]
    for bound in _STRAIN_BOUNDS:
        above = np.sum(strain >= bound)
        if np.sum((strain >= bounds[-1]) & (strain < bound)) >= _FEWEST_POINTS and above >= _FEWEST_POINTS:
            bounds.append(bound)
    return [*bounds, np.inf]


def _choices(points: StudyPoints, predicted: Array) -> Iterator[Choice]:
    """States linearised about, chosen on the runs of one half and judged on those of the other."""
    runs = np.unique(points.run)
    if len(runs) < 2 * _FEWEST_POINTS:
        return
    chosen_from = np.random.default_rng(_SEED).permutation(runs)[: len(runs) // 2]
    training = np.isin(points.run, chosen_from)
    scan = np.stack([points.predicted(share) for share in _CANDIDATES])
    off = np.abs(_decades(points.r_squared, scan))
    own = {curve: points.of_curve(curve) for curve in points.curves}
    losses = {curve: off[:, part & training].mean(axis=1) for curve, part in own.items()}
    common = int(np.argmin(sum(losses.values())))
    for curve, part in own.items():
        judged = part & ~training
        best = int(np.argmin(losses[curve]))
        candidates = (
            ("this curve", _CANDIDATES[best], scan[best]),
            ("all curves", _CANDIDATES[common], scan[common]),
            ("the program", LINEARISED_AT[CURVES.index(curve)], predicted),
        )
        for label, share, values in candidates:
            errors = prediction_errors(points.r_squared[judged], values[judged])
            yield Choice(curve, float(share), label, errors)


def _decades(simulated: Array, predicted: Array) -> Array:
    """Logarithm of predicted over simulated misfit 1 - R^2."""
    least = np.finfo(float).eps  # R^2 is not known better
    return np.log10(np.maximum(1.0 - predicted, least)) - np.log10(np.maximum(1.0 - simulated, least))
