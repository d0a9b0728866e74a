"""Functions that the tests and the benchmark compile."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numba.extending import register_jitable

from fvswell.compiled import dual_numba  # noqa: F401
from fvswell.compiled.dual import slope_of, value_of, variables


@register_jitable(error_model="numpy")
def density(p, t):
    """Return a liquid density."""
    return 998.0 * np.exp(4.5e-10 * (p - 1.0e5) - 2.1e-4 * (t - 293.15)) / (1.0 + 1.0e-3 * (t / 300.0) ** 2)


@register_jitable(error_model="numpy")
def viscosity(t):
    """Return a viscosity."""
    return 2.4e-5 * np.exp(570.6 / (t - 140.0))


@register_jitable(error_model="numpy")
def mobility(s):
    """Return a relative permeability."""
    e = (s - 0.1) / 0.8
    return e**0.5 * (1.0 - (1.0 - e**1.5) ** 0.7) ** 2 if e > 0.0 else 0.0 * e


@register_jitable(error_model="numpy")
def flux(p, s, t, c):
    """Return a flux of about sixty operations."""
    rho = density(p, t) * (1.0 + 0.7 * c)
    mu = viscosity(t) * (1.0 + c * (1.85 - c * 4.1) + 44.5 * c**3)
    pc = 5.0e3 / np.sqrt(abs(s) + 1.0e-2) * (1.0 - 0.002 * (t - 293.15))
    head = p - pc + 9.81 * rho * (1.5 + 0.1 * s)
    reynolds = rho * np.sqrt(head * head + 1.0) / mu * 1.0e-9
    friction = 1.0 / (1.0 + reynolds) + 0.02 * np.sqrt(1.0 + reynolds * c)
    mixing = np.exp(-c * s) - 0.5 * c * s + (s - c) / (s + c)
    storage = (p * 1.0e-6 - t * 1.0e-3) ** 2 + s * t * c / (1.0 + p * 1.0e-6)
    return (mobility(s) * rho / mu * head * 1.0e-12 + storage - mixing) * friction


class State(NamedTuple):
    """A heterogeneous tuple of dual and other numbers."""

    flux: object
    scale: float
    index: int
    square: object


@numba.njit(cache=True, error_model="numpy")
def make_state(x, y):
    """Return a tuple that holds dual numbers."""
    return State(x * y, 2.0, 3, x**2)


@numba.njit(cache=True, error_model="numpy")
def cached(a, b):
    """Return the value and the slopes of a function that passes dual numbers through functions and tuples."""
    x, y = variables(a, b)
    state = make_state(x, y)
    z = state.flux * state.scale + state.square / state.index
    return value_of(z), slope_of(z, 0), slope_of(z, 1)
