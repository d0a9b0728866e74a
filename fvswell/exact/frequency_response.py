"""The dynamic modulus of a column: amplitude and phase of stress and strain under sine loads.

Under a pressure P exp(i omega t) of the piston the steady strain is -P/E* exp(i omega t) with the complex modulus

    1/E* = -[(tanh(z)/z) m_P]_1/J0,        z = sqrt(i omega h0^2/D),

m_P being the change of the contents by a unit of pressure (`fvswell.exact.driven_column`). A given displacement meets
the same modulus. It rises from the drained one to (1 + i) sqrt(omega/2) h0 M, without bound: incompressible tissue
yields through the water alone that leaves at the filter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fvswell.exact.driven_column import DrivenColumn
from fvswell.exact.linear_swelling import LinearColumn
from fvswell.physics.tissue import Array

__all__ = ["DynamicModulus", "dynamic_modulus"]


class DynamicModulus(NamedTuple):
    """Complex modulus E* = E' + i E'' by frequency, MPa, ``(rows, frequencies)``."""

    storage: Array  # E'
    loss: Array  # E''

    @property
    def magnitude(self) -> Array:
        """Amplitude of the stress over that of the strain, MPa."""
        return np.hypot(self.storage, self.loss)

    @property
    def phase_lag(self) -> Array:
        """Angle by which the strain lags behind the stress, rad."""
        return np.arctan2(self.loss, self.storage)

    def energy_loss(self, strain_amplitude: Array | float) -> Array:
        """Work lost in a cycle per volume of the tissue, mJ/mm3: pi E'' times the square of the strain's amplitude."""
        return np.pi * self.loss * np.square(strain_amplitude)


def dynamic_modulus(column: LinearColumn, frequency: Array) -> DynamicModulus:
    """Modulus of a column at frequencies in Hz, ``(frequencies,)``; strain over the height linearised about."""
    modulus = -1.0 / DrivenColumn(column).frequency_response("strain", "piston.pressure", frequency)
    return DynamicModulus(modulus.real, modulus.imag)
