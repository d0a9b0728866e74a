"""How well the biphasic-swelling model stands in for the electrochemical one, told without running either.

Both models are replaced by the exact linear solution of a column (``fvswell.exact.linear_swelling``) about
one state between the two equilibria of a protocol; the steps themselves are the finite ones of the
equilibria. A change of load or bath at time 0 is taken back after one phase duration, the second step
superposed on the first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fvswell.equilibrium import equilibrium_volume_ratio
from fvswell.exact.linear_swelling import LinearColumn
from fvswell.models import BIPHASIC_SWELLING, ELECTROCHEMICAL, Mixture
from fvswell.tissue import Array, Tissue

__all__ = ["Conditions", "Prediction", "coefficient_of_determination", "predict"]

_RELAXED_FRACTION = 0.99
_RELAXATION_TIMES = 1.5


class Conditions(NamedTuple):
    """What the column is exposed to; numbers or arrays of shape ``(rows, 1)``."""

    piston_pressure: Array | float  # MPa
    bath_concentration: Array | float  # mmol/mm3


@dataclass(frozen=True)
class Prediction:
    """Predicted histories of the two models; the axis ``phases`` has loading and unloading.

    Strain is the change of height over the height at the first equilibrium. Everything is nan in rows
    without an equilibrium.
    """

    phase_duration: Array  # s, (rows,)
    reduced_strain: Array  # biphasic-swelling, at the end of each step, (rows, phases, steps)
    full_strain: Array  # electrochemical, the same shape
    flows_backward_first: Array  # negative osmosis of the full model at the start of loading, (rows,)

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
        return self.phase_duration[:, None] * (self._farthest + 1) / self.full_strain.shape[-1]

    @property
    def _difference(self) -> Array:
        return self.reduced_strain - self.full_strain

    @property
    def _farthest(self) -> Array:
        return np.argmax(np.abs(self._difference), axis=-1)


@np.errstate(invalid="ignore")  # rows without an equilibrium carry nan, of which complex arithmetic warns
def predict(
    tissue: Tissue,
    height: Array | float,
    bath_osmotic_coefficient: Array | float,
    initial: Conditions,
    loaded: Conditions,
    linearised_at: Array | float = 0.5,
    phase_duration: Array | float | None = None,
    open_circuit_ratio: Array | None = None,
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
    initial, loaded
        Conditions before time 0 and after the loading phase's end, and between the two.
    linearised_at
        State linearised about, on the way from the first equilibrium (0) to the loaded one (1); a number or
        ``(rows, 1)``. J and ln c~ are interpolated.
    phase_duration
        Duration of each of the two phases, s, a number or ``(rows, 1)``; None takes 1.5 times the
        relaxation time of the biphasic-swelling model, in which it comes to 99 % of its final strain.
    open_circuit_ratio
        k_open/k of the biphasic-swelling model where it is held constant, ``(rows, 1)``; None evaluates it
        in the state linearised about.
    steps_per_phase
        Number of equal steps at whose ends the histories are told.
    """
    bath = np.atleast_2d(bath_osmotic_coefficient)
    mixtures = [
        Mixture(model, tissue, bath, open_circuit_ratio) for model in (BIPHASIC_SWELLING, ELECTROCHEMICAL)
    ]
    first, last = (
        equilibrium_volume_ratio(tissue, pressure, concentration, bath, swelling=True)
        for pressure, concentration in (initial, loaded)
    )
    first, last = np.broadcast_arrays(first, last)
    logs = [np.log(c) + np.zeros_like(first) for c in (initial.bath_concentration, loaded.bath_concentration)]
    J = first + linearised_at * (last - first)
    log_concentration = logs[0] + linearised_at * (logs[1] - logs[0])
    reduced, full = (LinearColumn(mixture, height, J, log_concentration) for mixture in mixtures)
    if phase_duration is None:
        duration = _RELAXATION_TIMES * reduced.relaxation_time(_RELAXED_FRACTION)
    else:
        duration = np.broadcast_to(phase_duration, J.shape)[:, 0]
    time = duration[:, None] * np.arange(1, 2 * steps_per_phase + 1) / steps_per_phase
    salt = [mixtures[1].contents(mixtures[1].at(*state))[1] for state in ((first, logs[0]), (last, logs[1]))]
    change = np.concatenate([last - first, salt[1] - salt[0]], axis=1)

    def strain(column: LinearColumn, contents: Array) -> Array:
        loading, both = np.split(column.mean_volume_change(time, contents) / first, 2, axis=1)
        return np.stack([loading, both - loading], axis=1)

    return Prediction(
        phase_duration=duration,
        reduced_strain=strain(reduced, change[:, :1]),
        full_strain=strain(full, change),
        flows_backward_first=full.flows_backward_first(change),
    )


def coefficient_of_determination(data: Array, model: Array) -> Array:
    """R^2 = 1 - (sum of squared residuals)/(sum of squares of the data about their mean), over the last axis.

    1 where the curves agree, 0 where the model is no better than the mean of the data, negative where it is
    worse; nan where the data do not vary (there is no signal to explain).
    """
    residual = ((data - model) ** 2).sum(axis=-1)
    total = ((data - data.mean(axis=-1, keepdims=True)) ** 2).sum(axis=-1)
    return np.where(total > 0.0, 1.0 - residual / np.where(total > 0.0, total, 1.0), np.nan)
