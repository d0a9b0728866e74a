"""What is fitted: numbers of cases, each within bounds, searched for as they are or in their logarithm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fvswell.case.values import Quantity
from fvswell.physics.tissue import Array
from fvswell.study.schema import varied_quantity

__all__ = ["Parameter", "Parameters", "default_bounds", "searched_in_log"]

_FACTOR = 10.0  # of the start, down and up: where to look by default for what has no bounds of its own
_MARGIN = 1e-3  # of the allowed range, that the default bounds keep from ends that are not allowed
_STEP = 1e-3  # of finite differences, in the logarithm, or of the range


@dataclass(frozen=True)
class Parameter:
    """A number of one or more cases that is sought, or that stays fixed.

    Parameters
    ----------
    name
        In tables, files and figures.
    keys
        Dotted keys of the case that all take the value.
    start
        Where the search begins, or the value if it is fixed; internal unit.
    low, high
        Bounds, internal unit.
    log
        Whether it is searched for in its logarithm.
    measurements
        Names of the measurements that it is a property of; None for all of them.
    fixed
        Whether it stays at ``start``.
    """

    name: str
    keys: tuple[str, ...]
    start: float
    low: float
    high: float
    log: bool
    measurements: tuple[str, ...] | None = None
    fixed: bool = False

    @property
    def unit(self) -> str:
        """Internal unit."""
        return varied_quantity(self.keys[0]).unit

    @property
    def step(self) -> float:
        """Of finite differences, in the coordinate of the search."""
        return _STEP if self.log else _STEP * (self.high - self.low)

    def belongs_to(self, measurement: str) -> bool:
        """Whether the case of a measurement has it."""
        return self.measurements is None or measurement in self.measurements


class Parameters:
    """Parameters as vectors: of values, and of coordinates of the search, which are logarithms or values.

    Parameters
    ----------
    every
        All parameters; vectors hold the free ones in this order.
    """

    def __init__(self, every: Sequence[Parameter]) -> None:
        self.every = tuple(every)
        self.free = tuple(parameter for parameter in every if not parameter.fixed)

    def __len__(self) -> int:
        return len(self.free)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the free ones."""
        return tuple(parameter.name for parameter in self.free)

    @cached_property
    def is_log(self) -> Array:
        """Which are searched for in their logarithm, (parameters,)."""
        return np.array([parameter.log for parameter in self.free], dtype=bool)

    @cached_property
    def steps(self) -> Array:
        """Of finite differences, in coordinates, (parameters,)."""
        return np.array([parameter.step for parameter in self.free])

    @cached_property
    def start(self) -> Array:
        """Coordinates at which the search begins."""
        return self.coordinates(np.array([parameter.start for parameter in self.free]))

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Coordinates of the bounds."""
        low, high = ([getattr(parameter, name) for parameter in self.free] for name in ("low", "high"))
        return self.coordinates(np.array(low)), self.coordinates(np.array(high))

    def coordinates(self, values: Array) -> Array:
        """Coordinates of the search, ``(..., parameters)``."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(self.is_log, np.log(values), values)

    def values(self, coordinates: Array) -> Array:
        """Values in internal units, ``(..., parameters)``."""
        return np.where(self.is_log, np.exp(np.where(self.is_log, coordinates, 0.0)), coordinates)

    def within(self, coordinates: Array) -> Array:
        """Coordinates moved into the bounds."""
        return np.clip(coordinates, *self.bounds)

    def changes(self, values: Array, measurement: str) -> dict[str, float]:
        """What a vector of values changes in the case of a measurement, by dotted key."""
        given = dict(zip(self.names, map(float, values), strict=True))
        return {
            key: given.get(parameter.name, parameter.start)
            for parameter in self.every
            if parameter.belongs_to(measurement)
            for key in parameter.keys
        }


def searched_in_log(quantity: Quantity, start: float) -> bool:
    """Whether a quantity is searched for in its logarithm unless told otherwise: positive, and without an upper end."""
    lowest = max((bound for bound in (quantity.above, quantity.at_least) if bound is not None), default=-math.inf)
    return lowest >= 0.0 and quantity.below is None and quantity.at_most is None and start > 0.0


def default_bounds(quantity: Quantity, start: float, log: bool) -> tuple[float | None, float | None]:
    """Bounds of the search where none are given; None where there is no telling.

    A tenth of the start and ten times it in the logarithm, else the ends of what is allowed; ends that are not allowed
    themselves are kept clear of.
    """
    lowest = quantity.above if quantity.above is not None else quantity.at_least
    highest = quantity.below if quantity.below is not None else quantity.at_most
    span = math.inf if lowest is None or highest is None else highest - lowest
    margin = _MARGIN * span if math.isfinite(span) else 0.0
    low = None if lowest is None else lowest + (margin if quantity.above is not None else 0.0)
    high = None if highest is None else highest - (margin if quantity.below is not None else 0.0)
    if not log:
        return (low, high) if math.isfinite(span) else (None, None)
    bottom, top = start / _FACTOR, start * _FACTOR
    return max(bottom, low or 0.0), top if high is None else min(top, high)
