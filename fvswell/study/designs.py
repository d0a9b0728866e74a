"""Designs: sets of points in the unit cube, one axis for each parameter. Points outside no axis are between 0 and 1."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import qmc

from fvswell.physics.tissue import Array

__all__ = ["combinations", "full_grid", "on_range", "one_at_a_time"]

_ENGINES = {"sobol": qmc.Sobol, "latin-hypercube": qmc.LatinHypercube, "halton": qmc.Halton}


def one_at_a_time(dimensions: int, count: int) -> Array:
    """Evenly spaced values of one coordinate after the other, nan elsewhere: ``(dimensions * count, dimensions)``."""
    points = np.full((dimensions, count, dimensions), np.nan)
    for axis in range(dimensions):
        points[axis, :, axis] = np.linspace(0.0, 1.0, count)
    return points.reshape(-1, dimensions)


def full_grid(counts: Sequence[int]) -> Array:
    """All combinations of evenly spaced values, the last coordinate varying fastest: ``(points, dimensions)``."""
    axes = [np.linspace(0.0, 1.0, count) for count in counts]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def combinations(dimensions: int, count: int, sampling: str, seed: int) -> Array:
    """Points spread over the cube, ``(count, dimensions)``; "random", or scrambled points of scipy.stats.qmc."""
    if sampling == "random":
        return np.random.default_rng(seed).random((count, dimensions))
    return np.asarray(_ENGINES[sampling](dimensions, rng=seed).random(count))


def on_range(unit: Array, low: float, high: float, spacing: str) -> Array:
    """Values at fractions of a range; both ends are met exactly."""
    values = low * (high / low) ** unit if spacing == "log" else low + (high - low) * unit
    return np.where(unit == 1.0, high, np.clip(values, low, high))
