"""The equilibria that columns pass through in a phase, and the changes of their contents on that way.

Each point of a load has an equilibrium of its own: contents at the filter go from one to the next, so that finite
changes end where they should. First the piston's load changes in the bath that was there, then the bath.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.osmotic import bath_log_activity, ion_concentrations, osmotic_pressure_difference
from fvswell.physics.solids import uniaxial_stress
from fvswell.physics.tissue import Array, Tissue, fixed_charge_density, fluid_fraction
from fvswell.prediction.conditions import Conditions, Course, course_of

__all__ = ["Change", "Columns", "Equilibrium", "Oscillation"]


class Equilibrium(NamedTuple):
    """A state of rest, arrays ``(rows,)``."""

    volume_ratio: Array
    log_activity: Array
    salt: Array  # J n_f c-, mmol/mm3 of the stress-free solid
    pressure: Array  # of the piston, MPa
    bath_concentration: Array  # mmol/mm3

    @property
    def contents(self) -> Array:
        """Contents and the pressure of the piston, ``(rows, 3)``."""
        return np.stack([self.volume_ratio, self.salt, self.pressure], axis=-1)


class Oscillation(NamedTuple):
    """A sine of contents and of the pressure that they are in equilibrium with."""

    amplitude: Array  # (rows, 3)
    period: float  # s


class Change(NamedTuple):
    """Changes since a phase began, by a load: of the contents at the filter in equilibrium, and of the pressure."""

    times: Array  # s since the phase began, (rows, points)
    values: Array  # (rows, points, 3), see `Equilibrium.contents`
    oscillation: Oscillation | None = None


@dataclass(frozen=True)
class Columns:
    """Uniform columns in equilibrium with baths; arrays ``(rows,)`` or numbers."""

    tissue: Tissue
    height: Array | float
    rows: int

    def pressed(self, pressure: Array | float, bath: Array) -> Equilibrium:
        """Equilibrium under a pressure of the piston."""
        return self._with(equilibrium_volume_ratio(self.tissue, pressure, bath), pressure, bath)

    def held(self, volume_ratio: Array, bath: Array) -> Equilibrium:
        """Equilibrium at a given height."""
        stress = uniaxial_stress(self.tissue.solid, volume_ratio, self.tissue.fluid_fraction)
        pressure = osmotic_pressure_difference(self.tissue, volume_ratio, bath) - stress
        return self._with(volume_ratio, pressure, bath)

    def phase(
        self, before: Equilibrium, first: Equilibrium, conditions: Conditions, duration: Array | float = np.nan
    ) -> tuple[list[Change], Equilibrium]:
        """Changes in a phase, and the equilibrium under the loads that it ends with.

        Parameters
        ----------
        before
            Equilibrium under the loads that the phase before ended with.
        first
            Equilibrium from which displacements count.
        conditions
            Loads of the phase.
        duration
            Of the phase, s, to know where a sine ends; a number or ``(rows,)``.
        """
        changes, state = [], before
        for axis in self._axes(first, conditions):
            start = axis.value(state)
            times, points = axis.course.points(start)
            states = [self._moved(axis, state, value) for value in points.T]
            path = np.stack([each.contents - state.contents for each in states], axis=1)
            oscillation, end = None, states[-1]
            amplitude = axis.course.amplitude
            if np.any(amplitude):
                high, low = (axis.at(state, points[:, -1] + sign * amplitude).contents for sign in (1.0, -1.0))
                oscillation = Oscillation(0.5 * (high - low), axis.course.period)
                end = axis.at(state, np.broadcast_to(axis.course.final(duration), start.shape))
            if oscillation is not None or np.any(path):
                changes.append(Change(times, path, oscillation))
            state = end
        return changes, state

    def middle(self, before: Equilibrium, first: Equilibrium, conditions: Conditions, duration: Array) -> Equilibrium:
        """Equilibrium under the means of the loads over a phase, ``(rows,)`` durations in s."""
        state = before
        for axis in self._axes(first, conditions):
            state = self._moved(axis, state, axis.course.mean(axis.value(state), duration))
        return state

    def turn(self, before: Equilibrium, first: Equilibrium, conditions: Conditions) -> bool:
        """Whether a load comes back on its way in a phase."""
        return any(axis.course.turns(axis.value(before)) for axis in self._axes(first, conditions))

    def _axes(self, first: Equilibrium, conditions: Conditions) -> list[_Axis]:
        """What the piston's load and the bath do to an equilibrium, in this order."""

        def in_bath(state: Equilibrium, bath: Array) -> Equilibrium:
            return self.held(state.volume_ratio, bath) if conditions.held else self.pressed(state.pressure, bath)

        bath = _Axis(course_of(conditions.bath_concentration), lambda state: state.bath_concentration, in_bath)
        if conditions.piston_displacement is None:
            pressure = _Axis(
                course_of(conditions.piston_pressure),
                lambda state: state.pressure,
                lambda state, value: self.pressed(value, state.bath_concentration),
            )
            return [pressure, bath]
        displacement = _Axis(
            course_of(conditions.piston_displacement),
            lambda state: (state.volume_ratio - first.volume_ratio) * self.height,
            lambda state, value: self.held(first.volume_ratio + value / self.height, state.bath_concentration),
        )
        return [displacement, bath]

    @staticmethod
    def _moved(axis: _Axis, state: Equilibrium, value: Array) -> Equilibrium:
        """Equilibrium at a value of the load; it is found anew only if the load has moved in some row."""
        return state if np.array_equal(value, axis.value(state)) else axis.at(state, value)

    def _with(self, volume_ratio: Array, pressure: Array | float, bath: Array) -> Equilibrium:
        law, shape = self.tissue.osmotic, (self.rows,)
        J = np.broadcast_to(volume_ratio, shape)
        activity = bath_log_activity(law, bath)
        _, anion = ion_concentrations(law, fixed_charge_density(self.tissue, J), activity)
        salt = J * fluid_fraction(self.tissue, J) * anion
        return Equilibrium(J, *(np.broadcast_to(value, shape) for value in (activity, salt, pressure, bath)))


class _Axis(NamedTuple):
    """A load that moves columns from one equilibrium to another."""

    course: Course
    value: Callable[[Equilibrium], Array]  # of the load in an equilibrium
    at: Callable[[Equilibrium, Array], Equilibrium]  # the equilibrium at another value, all else as it was
