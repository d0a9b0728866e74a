"""Butcher tableaux of the time integrator: diagonally implicit, stiffly accurate Runge-Kutta schemes.

A scheme has an explicit first stage (the rate at the start of the step, which is the last stage of the step before) or
none, and one diagonal coefficient. Its last row is its weights, so the last stage is the new state.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

__all__ = ["BACKWARD_EULER", "ESDIRK43", "Tableau"]


class Tableau(NamedTuple):
    """A scheme; arrays over its stages."""

    coefficients: Any  # (stages, stages) a_ij, lower triangular; the last row holds the weights b
    nodes: Any  # (stages,) c, times of the stages in steps
    error_weights: Any  # (stages,) b less the weights of the embedded scheme; zero where there is none
    error_order: int  # power of the step with which the estimated error of a step falls; 0 without one
    dense_weights: Any  # (stages, powers) d_ik: at a part t of a step, stage i weighs the sum over k of d_ik t^(k+1)
    dense_stages: Any  # (stages, powers) the same of the states at the stages, less that at the start of the step
    guesses: Any  # (stages, stages) weights of the states at earlier stages in the guess of a stage; 0: no such guess


def _esdirk43() -> Tableau:
    """ESDIRK4(3)6L[2]SA of Kennedy & Carpenter (2016), NASA/TM-2016-219173, table 16: order 4, embedded order 3."""
    r = np.sqrt(2.0)
    gamma = 0.25
    a = np.zeros((6, 6))
    a[range(1, 6), range(1, 6)] = gamma
    a[2, 1] = (1.0 - r) / 8.0
    a[3, 1:3] = (5.0 - 7.0 * r) / 64.0, 7.0 * (1.0 + r) / 32.0
    a[4, 1:4] = (
        (-13796.0 - 54539.0 * r) / 125000.0,
        (506605.0 + 132109.0 * r) / 437500.0,
        166.0 * (-97.0 + 376.0 * r) / 109375.0,
    )
    a[5, 1:5] = (
        (1181.0 - 987.0 * r) / 13782.0,
        47.0 * (-267.0 + 1783.0 * r) / 273343.0,
        -16.0 * (-22922.0 + 3525.0 * r) / 571953.0,
        -15625.0 * (97.0 + 376.0 * r) / 90749876.0,
    )
    a[1, 0] = gamma
    a[2:, 0] = a[2:, 1]  # the first column equals the second
    embedded = np.array(
        [
            0.0,
            -480923228411.0 / 4982971448372.0,
            6709447293961.0 / 12833189095359.0,
            3513175791894.0 / 6748737351361.0,
            -498863281070.0 / 6042575550617.0,
            2077005547802.0 / 8945017530137.0,
        ]
    )
    embedded[0] = embedded[1]
    nodes = np.array([0.0, 0.5, (2.0 - r) / 4.0, 0.625, 1.04, 1.0])
    dense = _dense_weights(a, nodes)
    return Tableau(a, nodes, a[5] - embedded, 4, dense, _dense_stages(a, dense), _guesses(nodes))


def _dense_weights(a: Any, nodes: Any) -> Any:
    """Weights of the stages within a step, which are those of the scheme at its end.

    The stages are of order 2. Four conditions are those of quadrature up to order 4. Stiff components follow what
    drives them, and there the weights are those of an interpolation of the stages: exact for a cubic, and bounded (the
    first two weights are equal). So the states within a step are of order 3, but as good as its end where the balances
    are stiff.
    """
    inner = a[1:, 1:]
    stiff = np.append(0.0, np.linalg.solve(inner, nodes[1:] ** 3))
    conditions = np.stack([nodes**0, nodes, nodes**2, nodes**3, stiff, [1.0, -1.0, 0.0, 0.0, 0.0, 0.0]])
    values = np.zeros((6, 4))
    values[range(4), range(4)] = 1.0, 1.0 / 2.0, 1.0 / 3.0, 1.0 / 4.0
    values[4, 2] = 1.0
    return np.linalg.solve(conditions, values)


def _dense_stages(a: Any, weights: Any) -> Any:
    """Weights of the states at the stages that say the same as those of their rates.

    The rate at the start of the step drops out: the first two stages weigh the same, in the states as within the step.
    """
    states = np.zeros_like(weights)
    states[1:] = np.linalg.solve(a[1:, 1:].T, weights[1:])
    return states


def _guesses(nodes: Any) -> Any:
    """Weights that interpolate earlier stages, from the fourth stage on; the others have too few before them.

    That at 26/25 is guessed without that at 0.15: a cubic through this one too errs twice as much so far outside.
    """
    weights = np.zeros((6, 6))
    for stage, known in ((3, [0, 1, 2]), (4, [0, 1, 3]), (5, [1, 2, 3, 4])):
        powers = np.arange(len(known))[:, None]
        weights[stage, known] = np.linalg.solve(nodes[known] ** powers, nodes[stage] ** powers[:, 0])
    return weights


BACKWARD_EULER = Tableau(
    np.ones((1, 1)), np.ones(1), np.zeros(1), 0, np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1))
)  # fmt: skip
ESDIRK43 = _esdirk43()
