"""How well the biphasic-swelling model stands in for the electrochemical one, predicted without running either.

In each phase both models are replaced by the exact linear solution of a column (``fvswell.exact.linear_swelling``)
about one state on the way from the equilibrium before the phase to the equilibrium after it; the changes themselves are
the finite ones between those equilibria. What earlier phases have left unfinished is superposed.

For small changes this is exact. For large ones the state linearised about stands for all those passed through. Water
and salt enter and leave through the tissue at the filter, which is in its new state at once, so it should lie nearer
to the end of the way: Crank (1975, The Mathematics of Diffusion) averages a diffusivity that varies with the
concentration by weights whose mean lies at 0.63 to 0.65 of the way. In a column that deforms, what predicts best was
found by a study (docs/studies.md); that is all that was ever fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from fvswell.exact.linear_swelling import LinearColumn
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import BIPHASIC_SWELLING, ELECTROCHEMICAL
from fvswell.physics.osmotic import bath_log_activity, ion_concentrations
from fvswell.physics.tissue import Array, Tissue, fixed_charge_density, fluid_fraction
from fvswell.prediction.determination import coefficient_of_determination

__all__ = [
    "LINEARISED_AT",
    "Conditions",
    "Prediction",
    "kind_of_change",
    "predict",
]

LINEARISED_AT = (0.8, 0.65, 0.85)  # share of the way between equilibria, by kind_of_change; where that is -1, the last

_RELAXED_FRACTION = 0.99
_RELAXATION_TIMES = 1.5
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


class Conditions(NamedTuple):
    """What the column is exposed to in a phase; numbers or arrays of shape ``(rows,)``."""

    piston_pressure: Array | float  # MPa
    bath_concentration: Array | float  # mmol/mm3
    pressure_ramp: Array | float = 0.0  # s, in which the pressure changes linearly to this one; 0: at once
    bath_ramp: Array | float = 0.0  # s, the same for the bath


@dataclass(frozen=True)
class Prediction:
    """Predicted histories of the two models.

    Strain is the change of height over the height at the first equilibrium. Everything is nan in rows without an
    equilibrium.
    """

    phase_duration: Array  # s, (rows, phases)
    reduced_strain: Array  # biphasic-swelling, at the end of each step, (rows, phases, steps)
    full_strain: Array  # electrochemical, the same shape
    equilibrium_strain: Array  # of either model, (rows, phases)
    diffusivities: Array  # of the full model where it is linearised, mm2/s, largest first, (rows, phases, 2)
    reduced_diffusivity: Array  # of the biphasic-swelling model, mm2/s, (rows, phases)
    flows_backward_first: Array  # whether the full model's flow first goes against the phase's change, (rows, phases)

    @property
    def r_squared(self) -> Array:
        """``coefficient_of_determination`` of the reduced model in each phase, ``(rows, phases)``."""
        return coefficient_of_determination(self.full_strain, self.reduced_strain)

    @property
    def largest_difference(self) -> Array:
        """Reduced less full strain where they are farthest apart, ``(rows, phases)``."""
        return np.take_along_axis(self._difference, self._farthest[..., None], axis=-1)[..., 0]

    @property
    def time_of_largest_difference(self) -> Array:
        """End of the step of ``largest_difference``, s from the start of its phase, ``(rows, phases)``."""
        return self.phase_duration * (self._farthest + 1) / self.full_strain.shape[-1]

    @property
    def _difference(self) -> Array:
        return self.reduced_strain - self.full_strain

    @property
    def _farthest(self) -> Array:
        return np.argmax(np.abs(self._difference), axis=-1)


_Equilibrium = tuple[Array, Array]  # J and ln a~, (rows,)


class _Step(NamedTuple):
    """A change at the filter, at once or within a time."""

    ramp: Array | float  # s, (rows,)
    contents: Array  # of volume and salt, (rows, 2)


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
) -> Prediction:
    """Predict the strain histories of the biphasic-swelling and the electrochemical model.

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
        relaxation time of the biphasic-swelling model.
    open_circuit_ratio
        k_open/k of the biphasic-swelling model where it is held constant, a number or ``(rows,)``; None evaluates it
        in the state linearised about.
    relaxation_times
        See ``phase_duration``; a number or ``(rows, phases)``.
    relaxation_fraction
        Share of its way that the biphasic-swelling model goes in a relaxation time.
    steps_per_phase
        Number of equal steps at whose ends the histories are given.
    """
    equilibria, steps = _equilibria(tissue, conditions)
    first, phases = equilibria[0][0], len(conditions) - 1
    shape = (len(first), phases)
    states = _best_states(conditions, shape[0]) if linearised_at is None else linearised_at
    share, given, times = (np.broadcast_to(a, shape) for a in (states, phase_duration, relaxation_times))
    fractions = np.arange(1, steps_per_phase + 1) / steps_per_phase
    duration = np.empty(shape)
    strain = np.empty((2, *shape, steps_per_phase))
    diffusivities: list[tuple[Array, Array]] = []
    backward = np.empty(shape, dtype=bool)
    past: list[tuple[Array, _Step]] = []  # since when, and what
    for p in range(phases):
        J, activity = (a + share[:, p] * (b - a) for a, b in zip(equilibria[p], equilibria[p + 1], strict=True))
        columns = [
            LinearColumn(model, tissue, height, J, activity, open_circuit_ratio)
            for model in (BIPHASIC_SWELLING, ELECTROCHEMICAL)
        ]
        relaxation = columns[0].relaxation_time(relaxation_fraction)
        duration[:, p] = np.where(np.isnan(given[:, p]), times[:, p] * relaxation, given[:, p])
        start = duration[:, :p].sum(axis=1)[:, None]
        past += [(start, step) for step in steps[p] if np.any(step.contents)]
        for i, column in enumerate(columns):
            change = _volume_change(column, start + duration[:, p, None] * fractions, past)
            strain[i, :, p] = change / first[:, None]
        backward[:, p] = columns[1].flows_backward_first(steps[p][0].contents + steps[p][1].contents)
        diffusivities.append((columns[0].diffusivities[:, 0], columns[1].diffusivities))
    return Prediction(
        phase_duration=duration,
        reduced_strain=strain[0],
        full_strain=strain[1],
        equilibrium_strain=np.stack([J / first - 1.0 for J, _ in equilibria[1:]], axis=1),
        diffusivities=np.stack([full for _, full in diffusivities], axis=1),
        reduced_diffusivity=np.stack([reduced for reduced, _ in diffusivities], axis=1),
        flows_backward_first=backward,
    )


def kind_of_change(before: Conditions, after: Conditions) -> Array:
    """0 where only the pressure changes and rises, 1 where it falls, 2 where only the bath changes, else -1."""
    pressure = np.sign(np.asarray(after.piston_pressure) - before.piston_pressure)
    bath = np.asarray(after.bath_concentration) != before.bath_concentration
    compression = np.where(pressure > 0.0, 0, np.where(pressure < 0.0, 1, -1))
    return np.where(bath, np.where(pressure == 0.0, 2, -1), compression)


def _best_states(conditions: Sequence[Conditions], rows: int) -> Array:
    """``LINEARISED_AT`` by the changes in the phases, ``(rows, phases)``."""
    kinds = [np.broadcast_to(kind_of_change(*pair), rows) for pair in pairwise(conditions)]
    return np.array(LINEARISED_AT)[np.stack(kinds, axis=1)]


def _equilibria(tissue: Tissue, conditions: Sequence[Conditions]) -> tuple[list[_Equilibrium], list[list[_Step]]]:
    """Equilibria under the conditions, and the steps from each to the next: by its pressure, then by its bath."""
    given = [np.asarray(value) for each in conditions for value in each]
    numbers = [*tissue.solid, *tissue.permeability, *tissue.osmotic, *tissue[3:]]
    shape = np.broadcast_shapes((1,), *map(np.shape, [*numbers, *given]))

    def at(pressure: Array | float, concentration: Array | float) -> _Equilibrium:
        J = equilibrium_volume_ratio(tissue, pressure, concentration)
        return np.broadcast_to(J, shape), np.broadcast_to(bath_log_activity(tissue.osmotic, concentration), shape)

    def contents(equilibrium: _Equilibrium) -> Array:
        J, activity = equilibrium
        _, anion = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), activity)
        return np.stack([J, J * fluid_fraction(tissue, J) * anion], axis=1)

    equilibria = [at(*each[:2]) for each in conditions]
    steps = []
    for start, end, (before, after) in zip(equilibria, equilibria[1:], pairwise(conditions), strict=False):
        pressed = contents(at(after.piston_pressure, before.bath_concentration))
        steps.append(
            [
                _Step(after.pressure_ramp, pressed - contents(start)),
                _Step(after.bath_ramp, contents(end) - pressed),
            ]
        )
    return equilibria, steps


def _volume_change(column: LinearColumn, time: Array, past: Sequence[tuple[Array, _Step]]) -> Array:
    """Mean change of J in a column by all that has happened at its filter, ``(rows, times)`` as ``time``."""
    change = np.zeros_like(time)
    for start, step in past:
        contents = step.contents[:, : column.diffusion.shape[-1]]
        change += _ramped_change(column, time - start, step.ramp, contents)
    return change


def _ramped_change(column: LinearColumn, time: Array, ramp: Array | float, contents: Array) -> Array:
    """Mean change of J when the contents at the filter change linearly within a time, or at once.

    The mean of the answer to sudden changes over those of the ramp that have happened. Gauss points lie in the root
    of time, in which the answer is smooth.
    """
    if not np.any(ramp):
        return column.mean_volume_change(time, contents)
    ramp = np.reshape(ramp, (-1, 1))
    since = np.maximum(time - ramp, 0.0)
    low, high = np.sqrt(since), np.sqrt(np.maximum(time, 0.0))
    roots = 0.5 * (low + high)[..., None] + 0.5 * (high - low)[..., None] * _NODES  # (rows, times, nodes)
    answers = column.mean_volume_change((roots**2).reshape(len(roots), -1), contents).reshape(roots.shape)
    weights = roots * _WEIGHTS
    mean = (weights * answers).sum(axis=-1) / weights.sum(axis=-1)
    return mean * np.minimum(time / np.where(ramp > 0.0, ramp, time), 1.0)
