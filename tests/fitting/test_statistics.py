"""Intervals, noise and residuals by what theory says of them."""

from __future__ import annotations

import numpy as np
import pytest
from curves import TIMES, TRUTH, measured, problem, relaxation, sought
from linear import DESIGN, TRUE, linear
from scipy.stats import norm, t

import fvswell
from fvswell.fitting.fit import FitResult
from fvswell.fitting.identifiability import identifiability
from fvswell.fitting.least_squares import best_fit
from fvswell.fitting.model_comparison import compare_models, criteria, same_to_the_data
from fvswell.fitting.posterior import sample_posterior
from fvswell.fitting.profiles import profiles
from fvswell.fitting.residuals import residual_tests, runs_test

NOISE = 0.05


@pytest.mark.parametrize("given", [True, False])
def test_profiles_of_a_linear_model_give_the_classical_intervals(given: bool) -> None:
    """With the noise given normal intervals, else those of Student."""
    evaluator = linear(NOISE, 1, given)
    best = best_fit(evaluator)
    exact, squares, *_ = np.linalg.lstsq(DESIGN, evaluator.problem.data, rcond=None)
    np.testing.assert_allclose(best.values, exact, rtol=1e-6)
    variance = NOISE**2 if given else squares[0] / (len(TIMES) - 3)
    half = (norm if given else t(len(TIMES) - 3)).ppf(0.95) * np.sqrt(
        variance * np.diag(np.linalg.inv(DESIGN.T @ DESIGN))
    )
    for profile, value, width in zip(profiles(evaluator, best), exact, half, strict=True):
        assert profile.low == pytest.approx(value - width, abs=0.003 * width)
        assert profile.high == pytest.approx(value + width, abs=0.003 * width)
    np.testing.assert_allclose(best.standard_errors**2, variance * np.diag(np.linalg.inv(DESIGN.T @ DESIGN)), rtol=1e-5)


def test_an_interval_that_meets_a_bound_is_open_there() -> None:
    evaluator = linear(NOISE, 1, True, low=TRUE.min() - 0.02)
    found = profiles(evaluator, best_fit(evaluator))
    assert np.isnan(found[1].low)
    assert np.isfinite(found[1].high)


def test_weights_count_points_as_often() -> None:
    """A curve that counts twice gives intervals narrower by the root of two."""
    once, twice = (linear(NOISE, 2, True) for _ in range(2))
    (measurement,) = twice.problem.measurements
    object.__setattr__(measurement, "weight", 2.0)
    first, second = (best_fit(each).standard_errors for each in (once, twice))
    np.testing.assert_allclose(first / second, np.sqrt(2.0), rtol=1e-6)


def test_what_is_foretold_at_the_start_is_what_the_covariance_says() -> None:
    evaluator = linear(NOISE, 3, True)
    before = identifiability(evaluator, np.zeros(3))
    np.testing.assert_allclose(before.together, norm.ppf(0.95) * best_fit(evaluator).standard_errors, rtol=1e-6)
    assert (before.alone < before.together).all()


def covered(seed: int) -> list[bool]:
    """Whether the intervals of a fit to one noisy set hold the truth."""
    curve = measured(relaxation(), "piston_pressure", 0.01, seed)
    result = fvswell.fit(problem([curve], sought("youngs_modulus", "hydraulic_permeability", start=1.1)))
    return [low <= TRUTH[name] <= high for name, (low, high) in result.intervals.items()]


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """90 % intervals of 100 noisy sets."""
    share = np.mean([covered(seed) for seed in range(100)], axis=0)
    assert ((share >= 0.83) & (share <= 0.96)).all()


def test_intervals_of_linear_models_hold_the_truth_as_often_as_they_say() -> None:
    """The likelihood ratio at the true value, over 400 noisy sets; the binomial standard deviation is 1.5 %."""
    held = []
    for seed in range(400):
        evaluator = linear(NOISE, seed, False)
        best = best_fit(evaluator)
        half = t(len(TIMES) - 3).ppf(0.95) * best.standard_errors
        held.append(np.abs(best.values - TRUE) <= half)
    share = np.mean(held, axis=0)
    assert ((share > 0.86) & (share < 0.94)).all()


def test_samples_of_a_linear_model_have_its_covariance() -> None:
    pytest.importorskip("emcee")
    evaluator = linear(NOISE, 4, True)
    best = best_fit(evaluator)
    samples = sample_posterior(evaluator, best, 3000, 32)
    assert samples.long_enough
    np.testing.assert_allclose(np.std(samples.values, axis=0), best.standard_errors, rtol=0.1)
    half = norm.ppf(0.95) * best.standard_errors
    np.testing.assert_allclose(samples.intervals[:, 1] - best.values, half, rtol=0.15)


def test_runs_test_by_hand() -> None:
    """Signs + + - - + +: 3 runs of 4 and 2, where 2 4 2/6 + 1 are expected."""
    runs, expected, probability = runs_test(np.array([1.0, 2.0, -1.0, -2.0, 1.0, 1.0]))
    variance = (expected - 1.0) * (expected - 2.0) / 5.0
    assert (runs, expected) == (3, pytest.approx(11.0 / 3.0))
    assert probability == pytest.approx(norm.cdf((3.5 - 11.0 / 3.0) / np.sqrt(variance)))
    assert runs_test(np.ones(20))[2] < 1e-5


def test_runs_tests_of_noise_are_even() -> None:
    generator = np.random.default_rng(0)
    found = [runs_test(generator.standard_normal(200))[2] for _ in range(500)]
    assert np.mean(np.array(found) < 0.1) == pytest.approx(0.1, abs=0.04)


def test_a_misfit_that_is_not_noise_is_said_to_be_one() -> None:
    """The biphasic model fitted to a swelling tissue in relaxation."""
    of = relaxation(model="biphasic")
    data = measured(relaxation(), "piston_pressure", 1e-4)
    wrong = type(data)("curve", of, data.quantity, data.times, data.values)
    result = fvswell.fit(problem([wrong], sought("youngs_modulus", "hydraulic_permeability")), with_profiles=False)
    (test,) = result.residual_tests
    assert test.structured
    assert abs(test.relative) > 1e-3
    right = fvswell.fit(problem([data], sought("youngs_modulus", "hydraulic_permeability")), with_profiles=False)
    assert not right.residual_tests[0].structured


def test_criteria_by_hand() -> None:
    result = _linear_result(False)
    count, squares = len(TIMES), result.best.squares
    aicc, bic = criteria(result)
    size = result.problem.measurements[0].size
    deviance = count * np.log(float(np.sum((result.best.residuals * result.best.scales / size) ** 2)) / count)
    assert squares > 0.0
    assert aicc == pytest.approx(deviance + 8.0 + 40.0 / (count - 5.0))
    assert bic == pytest.approx(deviance + 4.0 * np.log(count))
    known = _linear_result(True)
    assert criteria(known)[1] == pytest.approx(known.best.squares + 3.0 * np.log(count))


def _linear_result(given: bool) -> FitResult:
    evaluator = linear(NOISE, 5, given)
    best = best_fit(evaluator)
    before = identifiability(evaluator, best.coordinates)
    return FitResult(evaluator.problem, before, best, (), None, 0, {}, 0.0)


def test_models_are_told_apart_where_the_data_can() -> None:
    fine = problem([measured(relaxation(), "piston_pressure", 1e-3)], sought(*list(TRUTH)[:2], "fixed_charge_density"))
    found = {each.model: each for each in compare_models(fine, ("biphasic", "electrochemical"))}
    assert found["biphasic"].idle == ("fixed_charge_density",)
    assert found["electrochemical"].aicc < found["biphasic"].aicc - 10.0
    assert same_to_the_data(tuple(found.values())) == ("electrochemical",)


def test_tests_are_of_each_measurement() -> None:
    best = best_fit(linear(NOISE, 6, False))
    (test,) = residual_tests(best)
    assert test.measurement == "line"
    assert not test.structured
