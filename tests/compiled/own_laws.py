"""Laws of a user's own file, and a kernel that calls them; run as a program it prints what the kernel gives.

It is run in a process of its own: whatever is noted there belongs to the key of the cache.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fvswell.compiled import generic, kernel, law_at, point
from fvswell.compiled.dual import slope_of, value_of, variables
from fvswell.physics.permeability import ExponentialPermeability, permeability


class Linear(NamedTuple):
    """A law with one parameter."""

    slope: Any


class Quadratic(NamedTuple):
    """A law with two parameters."""

    slope: Any
    curvature: Any


@generic
def response(law, x):
    """What a law makes of a number."""


@response.register(Linear)
def linear(law, x):
    return law.slope * x


@response.register(Quadratic)
def quadratic(law, x):
    return twice(law.slope * x) + law.curvature * x**2


@point
def twice(x):
    return 2.0 * x


@permeability.register(Linear)
def linear_permeability(law, J, fluid_fraction):
    return law.slope * (J - 1.0 + fluid_fraction)


def run(parameters, x):
    (own,) = variables(x)
    one = response(law_at(Linear, parameters, 0, 0), own)
    other = response(law_at(Quadratic, parameters, 1, 0), own)
    usual = permeability(ExponentialPermeability(1e-3, 0.0), own, 0.8)
    added = permeability(law_at(Linear, parameters, 0, 0), own, 0.8)
    return (
        value_of(one), slope_of(one, 0), value_of(other), slope_of(other, 0), value_of(usual), value_of(added),
        slope_of(added, 0),
    )  # fmt: skip


if __name__ == "__main__":
    print(*kernel(run)(np.array([[2.0], [3.0], [0.5]]), 4.0))
