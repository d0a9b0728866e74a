"""How the curves change with the parameters: finite differences, all runs of them in one batch.

The steps of a run follow smoothly from its parameters, so differences over a thousandth are good to some 1e-5 even
though the run itself is as accurate as its tolerance only.
"""

from __future__ import annotations

import numpy as np

from fvswell.errors import SolverError
from fvswell.fitting.evaluator import Evaluator
from fvswell.physics.tissue import Array

__all__ = ["central_sensitivities", "sensitivities"]


def sensitivities(evaluator: Evaluator, coordinates: Array, curves: Array | None = None) -> Array:
    """Derivatives of the curves by the coordinates, by one-sided differences into the bounds.

    Parameters
    ----------
    evaluator
        Gives the curves.
    coordinates
        Where, shape (parameters,).
    curves
        There, if they are known.

    Returns
    -------
    array
        Shape ``(points, parameters)``.

    Raises
    ------
    SolverError
        If a run beside it has to stop.
    """
    parameters = evaluator.problem.parameters
    steps = np.where(coordinates + parameters.steps <= parameters.bounds[1], 1.0, -1.0) * parameters.steps
    beside = coordinates + np.diag(steps)
    if curves is None:
        curves, beside_curves = np.split(evaluator.curves(np.vstack([coordinates, beside])), [1])
        curves = curves[0]
    else:
        beside_curves = evaluator.curves(beside)
    return _checked(((beside_curves - curves) / steps[:, None]).T, evaluator)


def central_sensitivities(evaluator: Evaluator, coordinates: Array) -> Array:
    """The same by differences to both sides; one-sided ones at a bound."""
    parameters = evaluator.problem.parameters
    steps = np.diag(parameters.steps)
    above, below = (parameters.within(coordinates + sign * steps) for sign in (1.0, -1.0))
    upper, lower = np.split(evaluator.curves(np.vstack([above, below])), 2)
    return _checked(((upper - lower) / np.diag(above - below)[:, None]).T, evaluator)


def _checked(found: Array, evaluator: Evaluator) -> Array:
    if np.isfinite(found).all():
        return found
    reason = next(iter(evaluator.reasons), "the run stopped")
    raise SolverError(f"{evaluator.problem.source}: beside a point of the search, {reason}")
