"""A problem whose curves are linear in its parameters, with everything known about its statistics."""

from __future__ import annotations

import numpy as np
from curves import TIMES, creep

from fvswell.fitting.evaluator import Evaluator
from fvswell.fitting.measurement import Measurement
from fvswell.fitting.parameters import Parameter, Parameters
from fvswell.fitting.problem import FitProblem, Settings
from fvswell.fitting.workers import Workers
from fvswell.physics.tissue import Array

DESIGN = np.stack([np.ones_like(TIMES), TIMES / 400.0, np.exp(-TIMES / 50.0)], axis=1)
TRUE = np.array([1.0, -0.5, 0.3])


class LinearCurves(Evaluator):
    """Curves that are DESIGN times the coordinates, in place of runs."""

    def curves(self, coordinates: Array) -> Array:
        return np.asarray(coordinates) @ DESIGN.T


def linear(noise: float, seed: int, given: bool, confidence: float = 0.9, low: float = -10.0) -> LinearCurves:
    """A line with a decay, measured with noise whose level is given or not."""
    values = DESIGN @ TRUE + noise * np.random.default_rng(seed).standard_normal(len(TIMES))
    measurement = Measurement("line", creep(), "global_strain", TIMES, values, noise if given else None)
    names = ("level", "slope", "decay")
    parameters = Parameters([Parameter(n, (f"tissue.{n}",), 0.5, low, 10.0, False) for n in names])
    problem = FitProblem([measurement], parameters, Settings(starts=1, confidence=confidence))
    return LinearCurves(problem, Workers(problem.experiments))
