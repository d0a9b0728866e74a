"""Exact derivatives of local functions by complex step."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fvswell.physics.tissue import Array

__all__ = ["COMPLEX_STEP", "local_derivative"]

COMPLEX_STEP = 1e-40  # far below rounding of anything it is added to: the imaginary part is the derivative exactly


def local_derivative(function: Callable[[Array], Array], arguments: Array) -> Array:
    """Derivative of a function of several arguments at every point, all points at once.

    Parameters
    ----------
    function
        Takes arguments ``(arguments, directions, ...)``, complex, and returns ``(values, directions, ...)``; the value
        at a point depends on the arguments at that point alone.
    arguments
        Where to differentiate, real, ``(arguments, ...)``.

    Returns
    -------
    array
        ``(values, arguments, ...)``.
    """
    count = len(arguments)
    perturbed = np.repeat(arguments[:, None].astype(complex), count, axis=1)
    perturbed[range(count), range(count)] += 1j * COMPLEX_STEP
    return function(perturbed).imag / COMPLEX_STEP
