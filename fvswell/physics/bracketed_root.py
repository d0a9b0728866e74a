"""Roots of equations by Newton's method kept in a bracket, of many at once or of one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from fvswell.physics.differentiation import COMPLEX_STEP
from fvswell.physics.tissue import Array

__all__ = ["bracketed_root", "bracketed_root_at"]

_CONVERGED_STEP = 1e-9  # Newton is quadratic, so the step taken last leaves 1e-18
_LONGEST_STEP = 1.0
_MAX_ITERATIONS = 200
_SLOW = 30  # iterations after which every second one halves the bracket: Newton's come down exponentials slowly


def bracketed_root(residual: Callable[[Array], Array], start: Array, low: Array, high: Array, none: Array) -> Array:
    """Where residuals that rise through zero once are zero.

    A point that has converged is left as it is, so that it does not depend on the others.

    Parameters
    ----------
    residual
        Of an argument of about 1 in size, for complex numbers as well. Where it is not a number, because a law
        overflows, the root lies toward the start.
    start, low, high
        First guess and bracket, all of one shape.
    none
        Points that have no root.

    Returns
    -------
    array
        The roots; nan where there is none.
    """
    low, high, done = low.copy(), high.copy(), none.copy()
    x = start
    for iteration in range(_MAX_ITERATIONS):
        f = residual(x + 1j * COMPLEX_STEP)
        beyond = np.isnan(f.real)
        low = np.where((f.real < 0.0) | (beyond & (x < start)), x, low)
        high = np.where((f.real > 0.0) | (beyond & (x > start)), x, high)
        step = np.clip(-f.real * COMPLEX_STEP / f.imag, -_LONGEST_STEP, _LONGEST_STEP)
        halve = iteration > _SLOW and iteration % 2 == 1
        target = np.where(np.isfinite(f) & (not halve), x + step, np.nan)
        bracketed = (target >= low) & (target <= high)  # false for nan as well
        x, previous = np.where(done, x, np.where(bracketed, target, 0.5 * (low + high))), x
        done |= bracketed & (np.abs(x - previous) <= _CONVERGED_STEP)
        if np.all(done):
            break
    return np.where(none | ~done, np.nan, x)


def bracketed_root_at(residual: Callable[[complex], Any], start: float, low: float, high: float) -> float:
    """As `bracketed_root`, of one equation that has a root: arrays of a few numbers take five times longer."""
    x = start
    for iteration in range(_MAX_ITERATIONS):
        f = residual(x + 1j * COMPLEX_STEP)
        if f.real < 0.0 or (np.isnan(f.real) and x < start):
            low = x
        elif f.real > 0.0 or (np.isnan(f.real) and x > start):
            high = x
        target = np.nan
        if np.isfinite(f) and not (iteration > _SLOW and iteration % 2 == 1):
            target = x + min(max(-f.real * COMPLEX_STEP / f.imag, -_LONGEST_STEP), _LONGEST_STEP)
        bracketed = low <= target <= high
        x, previous = target if bracketed else 0.5 * (low + high), x
        if bracketed and abs(x - previous) <= _CONVERGED_STEP:
            return float(x)
    return np.nan
