"""Samples of the posterior: what the data leave open, without any linearisation, by an ensemble of walkers (emcee).

The prior is even within the bounds, in the coordinate that is searched in: in the logarithm of positive quantities. The
likelihood is that of Gaussian noise; levels that are not given are integrated out with Jeffreys' prior, which leaves
S^(-N/2) of each measurement's sum of squares. All walkers of a half step are one batch of runs (Goodman & Weare 2010;
Foreman-Mackey et al. 2013, doi:10.1086/670067).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fvswell.errors import OutputError
from fvswell.fitting.evaluator import Evaluator
from fvswell.fitting.least_squares import BestFit
from fvswell.fitting.problem import FitProblem
from fvswell.physics.tissue import Array

__all__ = ["Samples", "log_likelihood", "sample_posterior"]

_BURN_IN = 0.25  # of the steps, that are left away
_ENOUGH = 50.0  # autocorrelation times that a chain must have for its quantiles to be trusted


@dataclass(frozen=True)
class Samples:
    """Samples of the posterior.

    Parameters
    ----------
    values
        Of the parameters, internal units, shape (samples, parameters).
    intervals
        Of each parameter, that hold the share of the samples which the confidence is, equal tails, (parameters, 2).
    autocorrelation
        Longest autocorrelation time, in steps; nan if the chain is too short to say.
    steps
        That each walker has gone after those left away.
    accepted
        Share of proposals.
    """

    values: Array
    intervals: Array
    autocorrelation: float
    steps: int
    accepted: float

    @property
    def long_enough(self) -> bool:
        """Whether the chain is as long as its quantiles need."""
        return bool(self.steps >= _ENOUGH * self.autocorrelation)


def log_likelihood(problem: FitProblem, curves: Array) -> Array:
    """Logarithm of the likelihood of curves, ``(..., points)``, up to a constant; -inf where there are none."""
    total = np.zeros(curves.shape[:-1])
    for measurement, span in zip(problem.measurements, problem.spans, strict=True):
        own = (curves[..., span.points] - measurement.values) / (measurement.noise or measurement.size)
        squares = measurement.weight * np.sum(own**2, axis=-1)
        if measurement.noise is not None:
            total = total - 0.5 * squares
        else:
            total = total - 0.5 * measurement.weight * len(measurement) * np.log(np.maximum(squares, 1e-300))
    return np.where(np.isfinite(total), total, -np.inf)


def sample_posterior(evaluator: Evaluator, best: BestFit, steps: int, walkers: int = 64) -> Samples:
    """Sample the posterior about a fit.

    Parameters
    ----------
    evaluator
        Gives the curves.
    best
        The fit, where the walkers begin.
    steps
        Of each walker.
    walkers
        How many.

    Raises
    ------
    OutputError
        If emcee is not installed.
    """
    try:
        import emcee
    except ImportError:
        raise OutputError('samples of the posterior need the extra "fit": pip install "fvswell[fit]"') from None
    problem = best.problem
    low, high = problem.parameters.bounds
    evaluator.stage = "posterior"

    def log_probability(coordinates: Array) -> Array:
        inside = ((coordinates >= low) & (coordinates <= high)).all(axis=1)
        found = np.full(len(coordinates), -np.inf)
        if inside.any():
            found[inside] = log_likelihood(problem, evaluator.curves(coordinates[inside]))
        return found

    generator = np.random.default_rng(problem.settings.seed)
    start = _start(best, walkers, generator)
    sampler = emcee.EnsembleSampler(walkers, len(low), log_probability, vectorize=True)
    state = np.random.RandomState(problem.settings.seed).get_state()  # what emcee takes
    sampler.random_state = state
    sampler.run_mcmc(start, steps)
    burn_in = int(_BURN_IN * steps)
    chain = sampler.get_chain(discard=burn_in)
    values = problem.parameters.values(chain.reshape(-1, len(low)))
    tail = 0.5 * (1.0 - problem.settings.confidence)
    times = emcee.autocorr.integrated_time(chain, quiet=True, tol=0)
    return Samples(
        values, np.quantile(values, [tail, 1.0 - tail], axis=0).T, float(np.max(times)), len(chain),
        float(np.mean(sampler.acceptance_fraction)),
    )  # fmt: skip


def _start(best: BestFit, walkers: int, generator: np.random.Generator) -> Array:
    """Walkers about the best, as the covariance has them, within the bounds."""
    low, high = best.problem.parameters.bounds
    spread = np.where(np.isfinite(best.standard_errors), best.standard_errors, 0.1 * (high - low))
    spread = np.minimum(spread, 0.1 * (high - low))
    start = best.coordinates + spread * generator.standard_normal((walkers, len(low)))
    margin = 1e-6 * (high - low)
    beyond = (start < low + margin) | (start > high - margin)
    within = low + (high - low) * generator.uniform(0.0, 1.0, start.shape)
    near = np.clip(best.coordinates + spread * generator.uniform(-1.0, 1.0, start.shape), low + margin, high - margin)
    start = np.where(beyond, near, start)
    return np.where((start <= low + margin) | (start >= high - margin), within, start)
