"""How well the biphasic-swelling model stands in for the electrochemical one, told without running either.

In each phase both models are replaced by the exact linear solution of a column (``fvswell.exact.linear_swelling``)
about one state on the way from the rest before the phase to the rest after it; the changes themselves are the finite
ones between those states of rest. What earlier phases have left unfinished is superposed.

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
from fvswell.physics.models import BIPHASIC_SWELLING, ELECTROCHEMICAL, Mixture
from fvswell.physics.tissue import Array, Tissue

__all__ = [
    "LINEARISED_AT",
    "NO_VARIATION",
    "Conditions",
    "Prediction",
    "coefficient_of_determination",
    "kind_of_change",
    "predict",
]

NO_VARIATION = 1e-11  # of a strain, mm or MPa: rounding
LINEARISED_AT = (0.8, 0.65, 0.85)  # share of the way from rest to rest, by kind_of_change; where that is -1, the last

_RELAXED_FRACTION = 0.99
_RELAXATION_TIMES = 1.5
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


class Conditions(NamedTuple):
    """What the column is exposed to in a phase; numbers or arrays of shape ``(rows, 1)``."""

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


_Rest = tuple[Array, Array]  # J and ln c~, (rows, 1)


class _Step(NamedTuple):
    """A change at the filter, at once or within a time."""

    ramp: Array | float  # s, (rows, 1)
    contents: Array  # of volume and salt, (rows, 2)


@np.errstate(invalid="ignore")  # rows without an equilibrium carry nan, of which complex arithmetic warns
def predict(
    tissue: Tissue,
    height: Array | float,
    bath_osmotic_coefficient: Array | float,
    conditions: Sequence[Conditions],
    linearised_at: Array | float | None = None,
    phase_duration: Array | float = np.nan,
    open_circuit_ratio: Array | None = None,
    relaxation_times: Array | float = _RELAXATION_TIMES,
    relaxation_fraction: float = _RELAXED_FRACTION,
    steps_per_phase: int = 50,
) -> Prediction:
    """Predict the strain histories of the biphasic-swelling and the electrochemical model.

    Parameters
    ----------
    tissue
        Tissue of uniform columns, one for each row, arrays of shape ``(rows, 1)``.
    height
        Height of the stress-free solid, mm, a number or ``(rows, 1)``.
    bath_osmotic_coefficient
        phi_ext, a number or ``(rows, 1)``.
    conditions
        Those that the column is equilibrated with, and then those of each phase.
    linearised_at
        State that each phase is linearised about, on the way from the rest before it (0) to the rest after it (1);
        a number or ``(rows, phases)``; None takes ``LINEARISED_AT``. J and ln c~ are interpolated.
    phase_duration
        Duration of the phases, s, a number or ``(rows, phases)``; nan takes ``relaxation_times`` times the
        relaxation time of the biphasic-swelling model.
    open_circuit_ratio
        k_open/k of the biphasic-swelling model where it is held constant, ``(rows, 1)``; None evaluates it
        in the state linearised about.
    relaxation_times
        See ``phase_duration``; a number or ``(rows, phases)``.
    relaxation_fraction
        Share of its way that the biphasic-swelling model goes in a relaxation time.
    steps_per_phase
        Number of equal steps at whose ends the histories are told.
    """
    bath = np.atleast_2d(bath_osmotic_coefficient)
    mixtures = [Mixture(model, tissue, bath, open_circuit_ratio) for model in (BIPHASIC_SWELLING, ELECTROCHEMICAL)]
    rests, steps = _states_of_rest(mixtures[1], conditions)
    first, phases = rests[0][0], len(conditions) - 1
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
        state = [a + share[:, p, None] * (b - a) for a, b in zip(rests[p], rests[p + 1], strict=True)]
        columns = [LinearColumn(mixture, height, *state) for mixture in mixtures]
        relaxation = columns[0].relaxation_time(relaxation_fraction)
        duration[:, p] = np.where(np.isnan(given[:, p]), times[:, p] * relaxation, given[:, p])
        start = duration[:, :p].sum(axis=1)[:, None]
        past += [(start, step) for step in steps[p] if np.any(step.contents)]
        for i, column in enumerate(columns):
            strain[i, :, p] = _volume_change(column, start + duration[:, p, None] * fractions, past) / first
        backward[:, p] = columns[1].flows_backward_first(steps[p][0].contents + steps[p][1].contents)
        diffusivities.append((columns[0].diffusivities[:, 0], columns[1].diffusivities))
    return Prediction(
        phase_duration=duration,
        reduced_strain=strain[0],
        full_strain=strain[1],
        equilibrium_strain=np.concatenate([J / first - 1.0 for J, _ in rests[1:]], axis=1),
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


def coefficient_of_determination(data: Array, model: Array, rounding: float = NO_VARIATION) -> Array:
    """R^2 = 1 - (sum of squared residuals)/(sum of squares of the data about their mean), over the last axis.

    1 where the curves agree, 0 where the model is no better than the mean of the data, negative where it is
    worse; nan where the data do not vary by more than ``rounding`` (there is no signal to explain).
    """
    residual = ((data - model) ** 2).sum(axis=-1)
    total = ((data - data.mean(axis=-1, keepdims=True)) ** 2).sum(axis=-1)
    varies = np.ptp(data, axis=-1) > rounding
    return np.where(varies, 1.0 - residual / np.where(varies, total, 1.0), np.nan)


def _best_states(conditions: Sequence[Conditions], rows: int) -> Array:
    """``LINEARISED_AT`` by the changes in the phases, ``(rows, phases)``."""
    kinds = [np.broadcast_to(kind_of_change(*pair), (rows, 1)) for pair in pairwise(conditions)]
    return np.array(LINEARISED_AT)[np.concatenate(kinds, axis=1)]


def _states_of_rest(mixture: Mixture, conditions: Sequence[Conditions]) -> tuple[list[_Rest], list[list[_Step]]]:
    """States of rest under the conditions, and the steps from each to the next: by its pressure, then by its bath."""
    bath = mixture.bath_osmotic_coefficient
    given = [value for each in conditions for value in each]
    shape = np.broadcast_shapes((1, 1), bath.shape, mixture.tissue.youngs_modulus.shape, *map(np.shape, given))

    def at(pressure: Array | float, concentration: Array | float) -> _Rest:
        J = equilibrium_volume_ratio(mixture.tissue, pressure, concentration, bath, swelling=True)
        return np.broadcast_to(J, shape), np.broadcast_to(np.log(concentration), shape)

    def contents(rest: _Rest) -> Array:
        return np.concatenate(list(mixture.contents(mixture.at(*rest))[:2]), axis=1)

    rests = [at(*each[:2]) for each in conditions]
    steps = []
    for rest, later, (before, after) in zip(rests, rests[1:], pairwise(conditions), strict=False):
        pressed = contents(at(after.piston_pressure, before.bath_concentration))
        steps.append(
            [
                _Step(after.pressure_ramp, pressed - contents(rest)),
                _Step(after.bath_ramp, contents(later) - pressed),
            ]
        )
    return rests, steps


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
    since = np.maximum(time - ramp, 0.0)
    low, high = np.sqrt(since), np.sqrt(np.maximum(time, 0.0))
    roots = 0.5 * (low + high)[..., None] + 0.5 * (high - low)[..., None] * _NODES  # (rows, times, nodes)
    answers = column.mean_volume_change((roots**2).reshape(len(roots), -1), contents).reshape(roots.shape)
    weights = roots * _WEIGHTS
    mean = (weights * answers).sum(axis=-1) / weights.sum(axis=-1)
    return mean * np.minimum(time / np.where(ramp > 0.0, ramp, time), 1.0)
