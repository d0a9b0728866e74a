"""The time schemes: order conditions, stability, and the weights within a step."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fvswell.numerics.tableaux import BACKWARD_EULER, ESDIRK43, Tableau

SCHEMES = {"backward Euler": BACKWARD_EULER, "ESDIRK43": ESDIRK43}
A, C = ESDIRK43.coefficients, ESDIRK43.nodes
WEIGHTS = A[-1]
EMBEDDED = WEIGHTS - ESDIRK43.error_weights
ROUNDING = 1e-15


def conditions(weights: Any) -> list[tuple[int, float, float]]:
    """All eight conditions up to order 4: order, value and what it has to be (Hairer, Norsett & Wanner, II.2)."""
    return [
        (1, weights.sum(), 1.0),
        (2, weights @ C, 1 / 2),
        (3, weights @ C**2, 1 / 3),
        (3, weights @ A @ C, 1 / 6),
        (4, weights @ C**3, 1 / 4),
        (4, weights @ (C * (A @ C)), 1 / 8),
        (4, weights @ A @ C**2, 1 / 12),
        (4, weights @ A @ A @ C, 1 / 24),
    ]


@pytest.mark.parametrize(("weights", "order"), [(WEIGHTS, 4), (EMBEDDED, 3)], ids=["scheme", "embedded"])
def test_order_conditions(weights: Any, order: int) -> None:
    for needed, value, expected in conditions(weights):
        if needed <= order:
            assert abs(value - expected) <= ROUNDING, (needed, expected)


def test_embedded_scheme_is_of_order_three_only() -> None:
    """Otherwise the estimated error would not fall with the fourth power of the step."""
    assert max(abs(value - expected) for order, value, expected in conditions(EMBEDDED) if order == 4) > 1e-3
    assert ESDIRK43.error_order == 4


def test_every_stage_is_of_order_two() -> None:
    np.testing.assert_allclose(A.sum(axis=1), C, rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(A @ C, C**2 / 2, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("scheme", SCHEMES.values(), ids=SCHEMES.keys())
def test_stages_are_solved_one_after_the_other_with_one_coefficient(scheme: Tableau) -> None:
    a = scheme.coefficients
    assert np.all(np.triu(a, 1) == 0.0)
    implicit = np.diag(a)[1:] if len(a) > 1 else np.diag(a)
    assert np.all(implicit == implicit[0])
    if len(a) > 1:
        assert np.all(a[0] == 0.0)  # the rate at the start is that of the step before


@pytest.mark.parametrize("scheme", SCHEMES.values(), ids=SCHEMES.keys())
def test_last_stage_is_the_new_state(scheme: Tableau) -> None:
    """Stiffly accurate: its row holds the weights and its time is the end of the step."""
    assert scheme.nodes[-1] == 1.0
    assert scheme.coefficients[-1].sum() == pytest.approx(1.0, abs=ROUNDING)


def stability(weights: Any, scheme: Tableau, z: complex) -> complex:
    a = scheme.coefficients
    stages = np.linalg.solve(np.eye(len(a)) - z * a, np.ones(len(a)))
    return complex(1.0 + z * (weights @ stages))


@pytest.mark.parametrize(
    ("scheme", "weights"),
    [(BACKWARD_EULER, BACKWARD_EULER.coefficients[-1]), (ESDIRK43, WEIGHTS), (ESDIRK43, EMBEDDED)],
    ids=["backward Euler", "ESDIRK43", "embedded"],
)
def test_l_stable(scheme: Tableau, weights: Any) -> None:
    """No growth on the imaginary axis, hence none to its left, and R(-infinity) = 0."""
    for frequency in np.geomspace(1e-3, 1e4, 300):
        assert abs(stability(weights, scheme, 1j * frequency)) <= 1.0 + 1e-12
    far = [abs(stability(weights, scheme, -z)) for z in (1e4, 1e6, 1e8)]
    assert far[1] < 0.02 * far[0]
    assert far[2] < 0.02 * far[1] < 1e-5
    if len(weights) > 1:  # the limit itself, without rounding of large numbers
        inner, first = scheme.coefficients[1:, 1:], scheme.coefficients[1:, 0]
        once = np.linalg.solve(inner, first)
        assert weights[0] - weights[1:] @ once == pytest.approx(0.0, abs=1e-14)  # does not grow
        limit = 1.0 - weights[1:] @ np.linalg.solve(inner, np.ones(len(inner)) + once)
        assert limit == pytest.approx(0.0, abs=1e-13)


def test_states_within_a_step() -> None:
    """Dense output: order 3 at the part t of the step, 4 in quadrature, exact for cubics where it is stiff."""
    powers = np.arange(1, ESDIRK43.dense_weights.shape[1] + 1)
    for t in np.linspace(0.0, 1.0, 11):
        weights = ESDIRK43.dense_weights @ t**powers
        for order, value, expected in conditions(weights)[:5]:
            assert abs(value - expected * t**order) < 1e-13
        assert weights[0] == pytest.approx(weights[1], abs=1e-13)  # bounded for stiff parts, as the scheme is
        for power in (1, 2, 3):  # stiff parts follow t^power: in the stages to the limit, and so in between
            rates = np.linalg.solve(A[1:, 1:], C[1:] ** power - (A[1:, 0] if power == 1 else 0.0))
            value = weights[1:] @ rates + (weights[0] if power == 1 else 0.0)
            assert value == pytest.approx(t**power, abs=1e-12)
    np.testing.assert_allclose(ESDIRK43.dense_weights.sum(axis=1), WEIGHTS, rtol=0, atol=2e-13)
    np.testing.assert_allclose(BACKWARD_EULER.dense_weights, 1.0)


def test_weights_of_the_states_at_the_stages_say_the_same_as_those_of_their_rates() -> None:
    rates = np.random.default_rng(1).normal(size=(6, 3))
    states = A @ rates  # less that at the start, in a step of length 1
    np.testing.assert_allclose(ESDIRK43.dense_stages.T @ states, ESDIRK43.dense_weights.T @ rates, atol=1e-12)
    at_end = ESDIRK43.dense_stages.sum(axis=1)
    np.testing.assert_allclose(at_end, [0.0, 0.0, 0.0, 0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(BACKWARD_EULER.dense_stages, 1.0)


def test_guesses_of_stages_are_exact_for_quadratics() -> None:
    for stage in (3, 4, 5):
        for power in range(3):
            assert ESDIRK43.guesses[stage] @ C**power == pytest.approx(C[stage] ** power, abs=1e-12)
        assert np.all(ESDIRK43.guesses[stage, stage:] == 0.0)
