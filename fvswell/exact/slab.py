"""Diffusion in a slab of unit thickness and unit diffusivity: the kernels of the one-dimensional solutions.

The slab is empty at first; its face at 0 is brought to 1 at time 0 and kept there. Each kernel is written
twice, as a series of exponentials that converges fast at late times and as a series of images
(complementary error functions) that converges fast at early times; with the change-over below, the terms
left out are smaller than 1e-18 of the result. Times may be complex (with a positive real part): the
relaxation rates of two coupled diffusions can be.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from scipy.special import erfc

from fvswell.physics.tissue import Array

__all__ = ["mean_uptake", "profile_uptake", "ramp_influx", "ramp_uptake", "relaxation_time"]

_CHANGE_OVER = 0.15
_EXPONENTIALS = 5
_IMAGES = 2
_SMALLEST_TIME = 1e-30  # stands for 0, where 1/time is wanted


def mean_uptake(time: Array) -> Array:
    """Mean over the slab when the face at 1 is closed: 1 - sum 2/lambda_n^2 exp(-lambda_n^2 t).

    lambda_n = (n + 1/2) pi. Shape of ``time``; zero up to time 0.
    """
    return _early_or_late(time, _mean_early, _mean_late)


def ramp_uptake(time: Array) -> Array:
    """Mean over the slab when the face at 0 rises as t and the face at 1 is closed: the integral of ``mean_uptake``.

    t - 1/3 + sum 2/lambda_n^4 exp(-lambda_n^2 t), lambda_n = (n + 1/2) pi. Shape of ``time``; zero up to time 0.
    """
    return _early_or_late(time, _ramp_mean_early, _ramp_mean_late)


def profile_uptake(position: Array, time: Array) -> Array:
    """Value at ``position`` (0 to 1) when the face at 1 is closed.

    1 - sum 2/lambda_n sin(lambda_n x) exp(-lambda_n^2 t), lambda_n = (n + 1/2) pi.
    ``position`` and ``time`` broadcast. At time 0 the value is 1 on the face at 0 and 0 inside.
    """
    position, time = np.broadcast_arrays(position, time)
    return _early_or_late(time, _profile_early, _profile_late, position)


def ramp_influx(time: Array) -> Array:
    """Flux into the face at 0 when it rises as t and the face at 1 is kept at 0.

    t + 1/3 - sum 2/(n pi)^2 exp(-(n pi)^2 t), n >= 1. Shape of ``time``; zero up to time 0.
    """
    return _early_or_late(time, _ramp_early, _ramp_late)


@lru_cache
def relaxation_time(fraction: float) -> float:
    """Time at which ``mean_uptake`` reaches ``fraction`` of its final value, a number between 0 and 1."""
    if not 0.0 < fraction < 1.0:
        raise ValueError(f"the fraction of the final value must be between 0 and 1, not {fraction}")
    from scipy.optimize import brentq  # a tenth of a second to import

    # of the series the first exponential is the largest, and all of them add up to at most exp(-lambda_0^2 t)
    latest = -4.0 / np.pi**2 * np.log(1.0 - fraction)

    def excess(time: float) -> float:
        return float(mean_uptake(np.array(time))) - fraction

    return float(brentq(excess, 0.0, latest, xtol=1e-15, rtol=1e-14))


def _early_or_late(
    time: Array, early_form: Callable[..., Array], late_form: Callable[..., Array], *others: Array
) -> Array:
    time = np.asarray(time)
    value = np.zeros(time.shape, dtype=np.result_type(time, float))
    late = time.real >= _CHANGE_OVER
    early = ~late & (time.real >= 0.0)
    value[late] = late_form(time[late], *(other[late] for other in others))
    value[early] = early_form(time[early], *(other[early] for other in others))
    return value


def _positive(time: Array) -> Array:
    return np.where(time.real > _SMALLEST_TIME, time, _SMALLEST_TIME)


def _integral_of_erfc(z: Array) -> Array:
    return np.exp(-z * z) / np.sqrt(np.pi) - z * erfc(z)


def _third_integral_of_erfc(z: Array) -> Array:
    return ((1.0 + z * z) * np.exp(-z * z) / np.sqrt(np.pi) - z * (1.5 + z * z) * erfc(z)) / 6.0


def _mean_early(time: Array) -> Array:
    root = np.sqrt(_positive(time))
    images = sum((-1) ** n * _integral_of_erfc(n / root) for n in range(1, _IMAGES + 1))
    return 2.0 * np.sqrt(time) * (1.0 / np.sqrt(np.pi) + 2.0 * images)


def _mean_late(time: Array) -> Array:
    # the exponents are odd squares, (2n + 1)^2, which differ by multiples of 8: powers of one exponential
    decay = np.exp(-0.25 * np.pi**2 * time)
    eighth = np.square(np.square(np.square(decay)))
    total, ratio = decay.copy(), eighth.copy()
    for n in range(1, _EXPONENTIALS):
        decay *= ratio
        total += decay * (1.0 / (2 * n + 1) ** 2)
        ratio *= eighth
    return 1.0 - 8.0 / np.pi**2 * total


def _ramp_mean_early(time: Array) -> Array:
    root = np.sqrt(_positive(time))
    images = sum((-1) ** n * _third_integral_of_erfc(n / root) for n in range(1, _IMAGES + 1))
    return 8.0 * time * np.sqrt(time) * (1.0 / (6.0 * np.sqrt(np.pi)) + 2.0 * images)


def _ramp_mean_late(time: Array) -> Array:
    wave_numbers = (np.arange(_EXPONENTIALS) + 0.5) * np.pi
    return time - 1.0 / 3.0 + sum(2.0 / k**4 * np.exp(-k * k * time) for k in wave_numbers)


def _profile_early(time: Array, position: Array) -> Array:
    double_root = 2.0 * np.sqrt(_positive(time))
    value = np.zeros_like(double_root)
    for n in range(_IMAGES + 1):
        near, far = (2 * n + position) / double_root, (2 * n + 2 - position) / double_root
        value = value + (-1) ** n * (erfc(near) + erfc(far))
    return value


def _profile_late(time: Array, position: Array) -> Array:
    wave_numbers = (np.arange(_EXPONENTIALS) + 0.5) * np.pi
    return 1.0 - sum(2.0 / k * np.sin(k * position) * np.exp(-k * k * time) for k in wave_numbers)


def _ramp_early(time: Array) -> Array:
    root = np.sqrt(_positive(time))
    images = sum(_integral_of_erfc(n / root) for n in range(1, _IMAGES + 1))
    return 2.0 * np.sqrt(time) * (1.0 / np.sqrt(np.pi) + 2.0 * images)


def _ramp_late(time: Array) -> Array:
    wave_numbers = np.arange(1, _EXPONENTIALS + 1) * np.pi
    return time + 1.0 / 3.0 - sum(2.0 / k**2 * np.exp(-k * k * time) for k in wave_numbers)
