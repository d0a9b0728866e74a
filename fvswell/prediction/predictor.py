"""How well the biphasic-swelling model stands in for the electrochemical one, predicted without running either.

In each phase both models are replaced by the exact linear solution of a column (``fvswell.exact``) about one state on
the way from the equilibrium before the phase to the equilibrium after it; the changes themselves are the finite ones
between those equilibria. What earlier phases have left unfinished is superposed, as long as the piston stays free or
stays held; from where that changes the column is taken to be in equilibrium. Where the piston is free its strain is
predicted, where it is held the pressure that it needs.

For small changes this is exact. For large ones the state linearised about stands for all those passed through. Water
and salt enter and leave through the tissue at the filter, which is in its new state at once, so it should lie nearer
to the end of the way: Crank (1975, The Mathematics of Diffusion) averages a diffusivity that varies with the
concentration by weights whose mean lies at 0.63 to 0.65 of the way. In a column that deforms, what predicts best was
found by a study (docs/studies.md); that is all that was ever fitted. Where a load turns on its way, the state is that
under its mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from fvswell.exact.driven_column import DrivenColumn
from fvswell.exact.electrical import WallElectrode
from fvswell.exact.linear_swelling import LinearColumn
from fvswell.physics.models import BIPHASIC_SWELLING, ELECTROCHEMICAL
from fvswell.physics.tissue import Array, Tissue
from fvswell.prediction.changes import Change, Columns, Equilibrium, Oscillation
from fvswell.prediction.conditions import Conditions, Course, course_of, kind_of_change
from fvswell.prediction.determination import coefficient_of_determination
from fvswell.prediction.responses import Past, current_response, load_response

__all__ = ["LINEARISED_AT", "Prediction", "predict"]

LINEARISED_AT = (0.8, 0.65, 0.85)  # share of the way between equilibria, by kind_of_change; where that is -1, the last
_HELD_IN_OTHER_BATH = 0.6  # the same where the bath of a column that is held changes, from a few simulations

_RELAXED_FRACTION = 0.99
_RELAXATION_TIMES = 1.5


@dataclass(frozen=True)
class Prediction:
    """Predicted histories of the two models.

    What is measured in a phase is the strain (change of height over the height at the first equilibrium), or the
    pressure of a piston that is held, MPa. Everything is nan in rows without an equilibrium.
    """

    measured: tuple[str, ...]  # "strain" or "pressure" in each phase
    phase_duration: Array  # s, (rows, phases)
    reduced: Array  # biphasic-swelling, at the end of each step, (rows, phases, steps)
    full: Array  # electrochemical, the same shape
    equilibrium_strain: Array  # of either model, but for currents, under the last loads of the phase, (rows, phases)
    equilibrium_pressure: Array  # the same of the piston's pressure, MPa
    diffusivities: Array  # of the full model where it is linearised, mm2/s, largest first, (rows, phases, 2)
    reduced_diffusivity: Array  # of the biphasic-swelling model, mm2/s, (rows, phases)
    flows_backward_first: Array  # whether the full model's flow first goes against the phase's change, (rows, phases)

    @property
    def r_squared(self) -> Array:
        """``coefficient_of_determination`` of the reduced model in each phase, ``(rows, phases)``."""
        return coefficient_of_determination(self.full, self.reduced)

    @property
    def largest_difference(self) -> Array:
        """Reduced less full model where they are farthest apart, ``(rows, phases)``."""
        return np.take_along_axis(self._difference, self._farthest[..., None], axis=-1)[..., 0]

    @property
    def time_of_largest_difference(self) -> Array:
        """End of the step of ``largest_difference``, s from the start of its phase, ``(rows, phases)``."""
        return self.phase_duration * (self._farthest + 1) / self.full.shape[-1]

    @property
    def _difference(self) -> Array:
        return self.reduced - self.full

    @property
    def _farthest(self) -> Array:
        return np.argmax(np.abs(self._difference), axis=-1)


class _Run(NamedTuple):
    """Phases since the piston was set free or held: what they began from, and what has happened since."""

    held: bool
    start: Equilibrium
    loads: list[Past]
    currents: list[Past]


@np.errstate(invalid="ignore")  # rows without an equilibrium carry nan, of which complex arithmetic warns
def predict(
    tissue: Tissue,
    height: Array | float,
    conditions: Sequence[Conditions],
    linearised_at: Array | float | None = None,
    phase_duration: Array | float = np.nan,
    open_circuit_ratio: Array | float | None = None,
    relaxation_times: Array | float = _RELAXATION_TIMES,
    relaxation_fraction: float = _RELAXED_FRACTION,
    steps_per_phase: int = 50,
    electrode: WallElectrode = "cation",
) -> Prediction:
    """Predict histories of the biphasic-swelling and the electrochemical model.

    Parameters
    ----------
    tissue
        Tissue of uniform columns, one for each row, numbers or arrays of shape ``(rows,)``.
    height
        Height of the stress-free solid, mm, a number or ``(rows,)``.
    conditions
        Those that the column is equilibrated with, and then those of each phase.
    linearised_at
        State that each phase is linearised about, on the way from the equilibrium before it (0) to that after it (1);
        a number or ``(rows, phases)``; None takes ``LINEARISED_AT``. J and ln a~ are interpolated.
    phase_duration
        Duration of the phases, s, a number or ``(rows, phases)``; nan takes ``relaxation_times`` times the
        relaxation time of the biphasic-swelling model. Phases in which a load turns need one.
    open_circuit_ratio
        k_open/k of the biphasic-swelling model where it is held constant, a number or ``(rows,)``; None evaluates it
        in the state linearised about.
    relaxation_times
        See ``phase_duration``; a number or ``(rows, phases)``.
    relaxation_fraction
        Share of its way that the biphasic-swelling model goes in a relaxation time.
    steps_per_phase
        Number of equal steps at whose ends the histories are given.
    electrode
        In the wall at the far end, of currents.

    Raises
    ------
    ValueError
        If a phase in which a load turns on its way has no duration.
    """
    rows = _rows(tissue, conditions)
    columns = Columns(tissue, height, rows)
    shape = (rows, len(conditions) - 1)
    states = _best_states(conditions, rows) if linearised_at is None else linearised_at
    share, given, times = (np.broadcast_to(a, shape) for a in (states, phase_duration, relaxation_times))
    fractions = np.arange(1, steps_per_phase + 1) / steps_per_phase
    duration, backward = np.empty(shape), np.zeros(shape, dtype=bool)
    histories, strain, pressure = np.empty((2, *shape, steps_per_phase)), np.empty(shape), np.empty(shape)
    diffusivities: list[tuple[Array, Array]] = []
    first = before = columns.pressed(*conditions[0].ends)
    run = _Run(False, first, [], [])
    current = np.zeros(rows)
    for p, each in enumerate(conditions[1:]):
        if each.held != run.held:
            run = _Run(each.held, before, [], [])
        changes, after = columns.phase(before, first, each, given[:, p])
        J, activity = _state(columns, before, after, first, each, share[:, p], given[:, p])
        pair = [
            LinearColumn(model, tissue, height, J, activity, open_circuit_ratio)
            for model in (BIPHASIC_SWELLING, ELECTROCHEMICAL)
        ]
        relaxation = pair[0].relaxation_time(relaxation_fraction)
        duration[:, p] = np.where(np.isnan(given[:, p]), times[:, p] * relaxation, given[:, p])
        start = duration[:, :p].sum(axis=1)[:, None]
        end = start + duration[:, p, None]
        run.loads.extend(Past(start, end, change) for change in changes)
        course = course_of(each.current)
        run.currents.extend(Past(start, end, change) for change in _current_changes(course, current))
        current = np.broadcast_to(course.final(duration[:, p]), (rows,))
        time = start + duration[:, p, None] * fractions
        for i, column in enumerate(pair):
            driven = DrivenColumn(column, each.held, electrode)
            change = load_response(driven, time, run.loads)
            if run.currents and column.model.transports_ions:
                change += current_response(driven, time, run.currents)
            histories[i, :, p] = _measured(run, change, first)
        strain[:, p], pressure[:, p] = after.volume_ratio / first.volume_ratio - 1.0, after.pressure
        if not each.held:
            backward[:, p] = pair[1].flows_backward_first((after.contents - before.contents)[:, :2])
        diffusivities.append((pair[0].diffusivities[:, 0], pair[1].diffusivities))
        before = after
    return Prediction(
        measured=tuple("pressure" if each.held else "strain" for each in conditions[1:]),
        phase_duration=duration,
        reduced=histories[0],
        full=histories[1],
        equilibrium_strain=strain,
        equilibrium_pressure=pressure,
        diffusivities=np.stack([full for _, full in diffusivities], axis=1),
        reduced_diffusivity=np.stack([reduced for reduced, _ in diffusivities], axis=1),
        flows_backward_first=backward,
    )


def _measured(run: _Run, change: Array, first: Equilibrium) -> Array:
    """Pressure, or strain from the first equilibrium, ``(rows, times)``, by what has changed since the run began."""
    if run.held:
        return run.start.pressure[:, None] + change
    return (run.start.volume_ratio[:, None] + change) / first.volume_ratio[:, None] - 1.0


def _state(
    columns: Columns,
    before: Equilibrium,
    after: Equilibrium,
    first: Equilibrium,
    conditions: Conditions,
    share: Array,
    duration: Array,
) -> tuple[Array, Array]:
    """J and ln a~ to linearise about."""
    if columns.turn(before, first, conditions):
        if np.isnan(duration).any():
            raise ValueError("a phase in which a load turns on its way needs a duration in s")
        middle = columns.middle(before, first, conditions, duration)
        return middle.volume_ratio, middle.log_activity
    return tuple(a + share * (b - a) for a, b in zip(before[:2], after[:2], strict=True))


def _current_changes(course: Course, before: Array) -> list[Change]:
    """Changes of the current in a phase, A/mm2."""
    times, values = course.points(before)
    path = (values - before[:, None])[..., None]
    amplitude = np.broadcast_to(course.amplitude, before.shape)[:, None]
    oscillation = Oscillation(amplitude, course.period) if np.any(amplitude) else None
    return [Change(times, path, oscillation)] if np.any(path) or oscillation is not None else []


def _rows(tissue: Tissue, conditions: Sequence[Conditions]) -> int:
    """Number of columns."""
    courses = [course_of(load) for each in conditions for load in each if load is not None]
    numbers = [*tissue.solid, *tissue.permeability, *tissue.osmotic, *tissue[3:]]
    shapes = [np.shape(number) for number in numbers] + [np.shape(course.values)[:-1] for course in courses]
    return int(np.broadcast_shapes((1,), *shapes)[0])


def _best_states(conditions: Sequence[Conditions], rows: int) -> Array:
    """``LINEARISED_AT`` by the changes in the phases, ``(rows, phases)``."""
    states = []
    for before, after in pairwise(conditions):
        state = np.array(LINEARISED_AT)[kind_of_change(before, after)]
        other_bath = after.held & (before.ends[1] != after.ends[1])
        states.append(np.broadcast_to(np.where(other_bath, _HELD_IN_OTHER_BATH, state), rows))
    return np.stack(states, axis=1)
