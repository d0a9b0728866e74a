"""Cyclic loading: how far the response lags behind a sinusoidal load, and the energy that each cycle dissipates."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fvswell.case.acting_loads import acting_loads
from fvswell.case.case import Case
from fvswell.case.loads import Sine, shape_of
from fvswell.physics.tissue import Array

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["Cycles", "cycles", "has_cycles"]

_DRIVES = ("pressure", "force", "displacement")
_FEWEST = 12  # outputs in a period that its harmonic can be taken from


class Cycles(NamedTuple):
    """The last whole period of a phase whose load is a sine."""

    phase: str
    part: str  # that is driven
    period: float  # s
    pressure: float  # amplitude of the part's pressure, MPa
    strain: float  # amplitude of the global strain
    lag: float  # of the strain (in compression) behind the pressure, degrees
    loss: float  # energy that a cycle dissipates per volume of the equilibrated sample, MPa = mJ/mm3

    @property
    def dynamic_modulus(self) -> float:
        """Amplitude of the pressure over that of the strain, MPa."""
        return self.pressure / self.strain


def has_cycles(case: Case) -> bool:
    """Whether any load of a case is a sine."""
    return any(isinstance(shape_of(load), Sine) for phase in case.phase for load in phase.loads().values())


def cycles(case: Case, result: xr.Dataset) -> list[Cycles]:
    """What the last whole period of each cyclic phase says; of a column, or a block driven at its top.

    Phases without a sinusoidal pressure, force or displacement, shorter than a period, or with too few outputs in one
    are left out.
    """
    found = []
    ends = result["phase_end"].values
    for index, (phase, acting) in enumerate(zip(case.phase, acting_loads(case), strict=True)):
        if index >= len(ends) or not np.isfinite(ends[index]):
            break
        for name, load in acting.items():
            part, _, kind = name.partition(".")
            sine = shape_of(load)
            if kind not in _DRIVES or not isinstance(sine, Sine) or f"{part}_pressure" not in result:
                continue
            begin = ends[index] - sine.period
            if begin < (ends[index - 1] if index else 0.0) * (1.0 - 1e-12):
                continue
            inside = (result["time"].values >= begin) & (result["time"].values <= ends[index])
            if inside.sum() >= _FEWEST:
                found.append(_of_period(phase.name, part, sine.period, result.isel(time=inside)))
    return found


def _of_period(phase: str, part: str, period: float, result: xr.Dataset) -> Cycles:
    time, pressure = result["time"].values, result[f"{part}_pressure"].values
    compression = -result["global_strain"].values
    load, response = (_harmonic(time, values, period) for values in (pressure, compression))
    closed = [np.append(values, values[0]) for values in (pressure, compression)]
    loss = float(np.trapezoid(closed[0], closed[1]))
    lag = float(np.degrees(np.angle(load / response)))
    return Cycles(phase, part, period, abs(load), abs(response), lag, loss)


def _harmonic(time: Array, values: Array, period: float) -> complex:
    """Complex amplitude of the first harmonic, by least squares beside a mean and a drift."""
    angle = 2.0 * np.pi * (time - time[0]) / period
    basis = np.stack([np.ones_like(time), (time - time[0]) / period, np.cos(angle), np.sin(angle)], axis=1)
    coefficients = np.linalg.lstsq(basis, values, rcond=None)[0]
    return complex(coefficients[2], -coefficients[3])
