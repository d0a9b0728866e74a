"""Histories of a load, and the answer of a linear system to them by superposition.

A history is a change from what the system was in equilibrium with: zero before it begins.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from fvswell.physics.tissue import Array

__all__ = ["Answers", "History", "Kink", "PiecewiseLinear", "Sine", "kinks", "ramp", "step"]


class Answers(Protocol):
    """Answers of a system to histories that begin at time 0; times and answers have shape ``(rows, times)``."""

    def step(self, time: Array) -> Array:
        """Answer to a unit step."""
        ...

    def ramp(self, time: Array) -> Array:
        """Answer to a ramp of unit slope."""
        ...

    def sine(self, time: Array, angular_frequency: float, phase: Array | float) -> Array:
        """Answer to sin(omega t + phase); a phase or ``(rows, 1)``."""
        ...


class History(Protocol):
    """A load over time."""

    def value(self, time: Array) -> Array:
        """The load, shape of ``time``."""
        ...

    def answer(self, answers: Answers, time: Array) -> Array:
        """What the system answers, ``(rows, times)`` as ``time``."""
        ...


class Kink(NamedTuple):
    """What happens to a piecewise linear history at a time."""

    time: Array  # s, (rows, 1)
    jump: Array  # (rows, quantities)
    change_of_slope: Array  # per s, (rows, quantities)


def kinks(times: Array, values: Array) -> Iterator[Kink]:
    """Jumps and changes of slope of quantities that are linear between points, 0 before and constant after them.

    Parameters
    ----------
    times
        s, not falling, shape ``(rows, points)``; rows may be 1. Two at the same time make a jump.
    values
        Shape ``(rows, points, quantities)``.
    """
    spans, rises = np.diff(times)[..., None], np.diff(values, axis=1)
    slopes = np.divide(rises, spans, out=np.zeros(rises.shape), where=spans > 0.0)
    jumps = np.concatenate([values[:, :1], np.where(spans > 0.0, 0.0, rises)], axis=1)
    none = np.zeros_like(values[:, :1])
    changes = np.diff(np.concatenate([none, slopes, none], axis=1), axis=1)
    for i in range(times.shape[1]):
        yield Kink(times[:, i, None], jumps[:, i], changes[:, i])


@dataclass(frozen=True)
class PiecewiseLinear:
    """Linear between points, constant after the last one.

    Parameters
    ----------
    times
        s, not falling, shape ``(points,)`` or ``(rows, points)``. Two at the same time make a jump.
    values
        Of the load, the same shape; a first one that is not 0 is a jump.
    """

    times: Array
    values: Array

    def value(self, time: Array) -> Array:
        """The load, shape of ``time``, ``(rows, times)``; at a jump the value after it."""
        total = np.zeros_like(time)
        for kink in self._kinks():
            since = time - kink.time
            total = total + np.where(since >= 0.0, kink.jump + kink.change_of_slope * since, 0.0)
        return total

    def answer(self, answers: Answers, time: Array) -> Array:
        """What the system answers, ``(rows, times)`` as ``time``."""
        total = np.zeros_like(time)
        for kink in self._kinks():
            since = time - kink.time
            if np.any(kink.jump):
                total = total + kink.jump * answers.step(since)
            if np.any(kink.change_of_slope):
                total = total + kink.change_of_slope * answers.ramp(since)
        return total

    def _kinks(self) -> Iterator[Kink]:
        return kinks(np.atleast_2d(self.times), np.atleast_2d(self.values)[..., None])


def step(value: Array | float, time: Array | float = 0.0) -> PiecewiseLinear:
    """A sudden change at a time (s); numbers or arrays ``(rows,)``."""
    value, time = np.broadcast_arrays(value, time)
    return PiecewiseLinear(time[..., None], value[..., None])


def ramp(value: Array | float, over: Array | float, start: Array | float = 0.0) -> PiecewiseLinear:
    """A change at one speed within a time (s), 0 for at once; numbers or arrays ``(rows,)``."""
    value, over, start = np.broadcast_arrays(value, over, start)
    return PiecewiseLinear(np.stack([start, start + over], axis=-1), np.stack([0.0 * value, value], axis=-1))


@dataclass(frozen=True)
class Sine:
    """A sine that begins from 0 and keeps the value that it ends with; times are numbers or ``(rows, 1)``."""

    amplitude: float
    period: float  # s
    start: Array | float = 0.0  # s
    end: Array | float = np.inf  # s

    def value(self, time: Array) -> Array:
        """The load, shape of ``time``."""
        since = np.clip(time, self.start, self.end) - self.start
        return self.amplitude * np.sin(self.angular_frequency * since)

    def answer(self, answers: Answers, time: Array) -> Array:
        """What the system answers, ``(rows, times)`` as ``time``."""
        total = self.amplitude * answers.sine(time - self.start, self.angular_frequency, 0.0)
        if np.all(np.isfinite(self.end)):  # take off what would follow, and keep the value
            phase = self.angular_frequency * (self.end - self.start)
            since = time - self.end
            going_on = answers.sine(since, self.angular_frequency, phase) - np.sin(phase) * answers.step(since)
            total = total - self.amplitude * going_on
        return total

    @property
    def angular_frequency(self) -> float:
        """2 pi over the period, 1/s."""
        return 2.0 * np.pi / self.period
