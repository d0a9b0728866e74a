"""The time integrator for blocks: the same source, in Python, with its loops over arrays compiled.

A block is a Python object, so the integrator itself runs in Python. The parts of a step that only work on arrays
(`fvswell.numerics.steps`) are compiled, each alone.
"""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any

from fvswell.compiled import kernel
from fvswell.numerics import integrator, steps

__all__ = ["march_block"]


def _march() -> Callable[..., Any]:
    """`integrator.march` with the functions of `steps` replaced by kernels."""
    space: dict[str, Any] = dict(vars(integrator))
    space |= {name: kernel(getattr(steps, name)) for name in steps.__all__}
    for name, value in vars(integrator).items():
        if isinstance(value, FunctionType) and value.__module__ == integrator.__name__:
            space[name] = FunctionType(value.__code__, space, name, value.__defaults__)
    march: Callable[..., Any] = space["march"]
    return march


march_block = _march()
