"""Roots of the equations that fix the rates of a series solution, and how many of them a time needs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import elementwise

from fvswell.physics.tissue import Array

__all__ = ["EARLIEST_TIME", "roots_between", "terms_from"]

EARLIEST_TIME = 1e-7  # scaled; before it a series needs more than ten thousand terms


def roots_between(function: Callable[[Array], Array], lower: Array, upper: Array) -> Array:
    """Root of ``function`` in each interval.

    Raises
    ------
    ValueError
        If its signs at the two ends of an interval do not differ.
    """
    found = elementwise.find_root(function, (lower, upper))
    if not np.all(found.success):
        raise ValueError(f"no change of sign from {lower[~found.success]} to {upper[~found.success]}")
    return found.x


def terms_from(scaled_time: Array) -> int:
    """Number of terms, about pi apart, after which exp(-a^2 t) is below 1e-17 at the earliest of the times.

    Raises
    ------
    ValueError
        If a time is earlier than ``EARLIEST_TIME``.
    """
    earliest = np.min(scaled_time)
    if not earliest >= EARLIEST_TIME:
        raise ValueError(f"time must be at least {EARLIEST_TIME:g} of the diffusion time, not {earliest:g}")
    return int(np.ceil(np.sqrt(40.0 / earliest) / np.pi)) + 1
