"""What columns are exposed to in the phases of a prediction, as plain numbers and arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from fvswell.physics.tissue import Array

__all__ = ["Conditions", "Course", "CourseLike", "course_of", "kind_of_change", "ramp_to"]


@dataclass(frozen=True)
class Course:
    """A load through a phase: linear between points, then constant, and on top of that a sine or none.

    Parameters
    ----------
    times
        s since the phase began, increasing, shape ``(points,)`` or ``(rows, points)``. Two at the same time make a
        jump; so does a first one at 0 with another value than the load had.
    values
        The same shape; nan where the load still is as the phase found it.
    amplitude, period
        Of the sine, which begins with the phase; the amplitude a number or ``(rows,)``, the period in s.
    """

    times: Array
    values: Array
    amplitude: Array | float = 0.0
    period: float = np.inf

    def points(self, before: Array) -> tuple[Array, Array]:
        """Times and values, ``(rows, points)``, of rows in which the load was ``before``, ``(rows,)``."""
        times, values, start = np.broadcast_arrays(self.times, self.values, before[:, None])
        return times, np.where(np.isnan(values), start, values)

    def mean(self, before: Array, duration: Array) -> Array:
        """Mean over a phase without the sine, ``(rows,)``."""
        times, values = self.points(before)
        spans = np.diff(times, append=duration[:, None])
        ends = np.concatenate([values[:, 1:], values[:, -1:]], axis=1)
        lead = times[:, 0] * 0.5 * (before + values[:, 0])  # until the first point
        mean: Array = (lead + (0.5 * spans * (values + ends)).sum(axis=1)) / duration
        return mean

    def turns(self, before: Array) -> bool:
        """Whether the load, which was ``before``, comes back on its way in any row."""
        _, values = self.points(before)
        rises = np.diff(values, axis=1, prepend=np.broadcast_to(before[:, None], (len(values), 1)))
        back = rises.max(axis=1) * rises.min(axis=1) < 0.0
        return bool(np.any(self.amplitude) or np.any(back))

    @property
    def acts(self) -> bool:
        """Whether the load is anything but 0."""
        return bool(np.any(self.amplitude) or np.any(self.values))

    def final(self, duration: Array | float = np.nan) -> Array:
        """Value that the phase ends with, ``(rows,)``; the mean of the sine where the duration is not known."""
        values: Array = np.atleast_2d(self.values)[:, -1]
        turn = np.where(np.isnan(duration), 0.0, duration) / self.period
        return values + self.amplitude * np.sin(2.0 * np.pi * turn)


CourseLike: TypeAlias = "Array | float | Course"  # a number or (rows,): a step at the start of the phase


def course_of(load: CourseLike) -> Course:
    """The load as a course."""
    return load if isinstance(load, Course) else Course(np.zeros(1), np.asarray(load, dtype=float)[..., None])


def ramp_to(value: Array | float, over: Array | float) -> Course:
    """From where the load is to a value within a time (s), at once where that is 0; numbers or ``(rows,)``."""
    value, over = np.broadcast_arrays(np.asarray(value, dtype=float), over)
    return Course(np.stack([0.0 * over, over], axis=-1), np.stack([np.full_like(value, np.nan), value], axis=-1))


class Conditions(NamedTuple):
    """Loads of a phase."""

    piston_pressure: CourseLike  # MPa; of no meaning where the piston is held
    bath_concentration: CourseLike  # mmol/mm3
    piston_displacement: CourseLike | None = None  # mm, from the first equilibrium, of a piston that is held
    current: CourseLike = 0.0  # A/mm2, into the tissue through the filter and out through an electrode in the wall

    @property
    def ends(self) -> tuple[Array, Array]:
        """Pressure of the piston and concentration of the bath that the phase ends with, ``(rows,)``."""
        return course_of(self.piston_pressure).final(), course_of(self.bath_concentration).final()

    def turns(self, before: Conditions) -> bool:
        """Whether a load comes back on its way after other conditions."""
        baths = course_of(self.bath_concentration).turns(before.ends[1])
        if self.piston_displacement is None:
            return baths or course_of(self.piston_pressure).turns(before.ends[0])
        start = 0.0 if before.piston_displacement is None else before.piston_displacement
        return baths or course_of(self.piston_displacement).turns(course_of(start).final())

    @property
    def held(self) -> bool:
        """Whether the displacement of the piston is given, and its pressure found."""
        return self.piston_displacement is not None


def kind_of_change(before: Conditions, after: Conditions) -> Array:
    """0 where only the pressure changes and rises, 1 where it falls, 2 where only the bath changes, else -1.

    Of steps and ramps: a load that turns on its way, a current and a piston that is held are of no kind.
    """
    (earlier, bath), (later, new_bath) = before.ends, after.ends
    pressure = np.sign(later - earlier)
    compression = np.where(pressure > 0.0, 0, np.where(pressure < 0.0, 1, -1))
    kind = np.where(new_bath != bath, np.where(pressure == 0.0, 2, -1), compression)
    other = before.held or after.held or after.turns(before) or course_of(after.current).acts
    return np.full_like(kind, -1) if other else kind
