"""How much of a history another one explains."""

from __future__ import annotations

import numpy as np

from fvswell.physics.tissue import Array

__all__ = ["NO_VARIATION", "coefficient_of_determination"]

NO_VARIATION = 1e-11  # of a strain, mm or MPa: rounding


def coefficient_of_determination(data: Array, model: Array, rounding: float = NO_VARIATION) -> Array:
    """R^2 = 1 - (sum of squared residuals)/(sum of squares of the data about their mean), over the last axis.

    1 where the curves agree, 0 where the model is no better than the mean of the data, negative where it is
    worse; nan where the data do not vary by more than ``rounding`` (there is no signal to explain).
    """
    residual = ((data - model) ** 2).sum(axis=-1)
    total = ((data - data.mean(axis=-1, keepdims=True)) ** 2).sum(axis=-1)
    varies = np.ptp(data, axis=-1) > rounding
    return np.where(varies, 1.0 - residual / np.where(varies, total, 1.0), np.nan)
