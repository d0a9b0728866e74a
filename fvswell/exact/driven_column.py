"""A column under any loads, by the linear solution in the Laplace domain.

The contents of `fvswell.exact.linear_swelling` obey dm/dt = D d2m/dx2. With v the change at the filter and w the change
per height at the far end (0, or what an electrode in the wall lets through), xi = x/h0 and z = sqrt(s h0^2/D),

    m(xi) = cosh(z (1 - xi))/cosh(z) v + sinh(z xi)/(z cosh z) w,        mean = tanh(z)/z v + (1 - 1/cosh z)/z^2 w,

functions of the matrix D taken at its eigenvalues. A piston whose pressure is given changes v at once. Where its
displacement is given, the pressure P that it needs is the one that makes the mean of J what it has to be: as v contains
P linearly, P is a quotient of two such sums. Its poles have no closed form when volume and salt are coupled; transforms
are inverted numerically to rounding (`fvswell.exact.laplace`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Literal, NamedTuple

import numpy as np

from fvswell.exact.electrical import (
    ElectricalCoefficients,
    WallElectrode,
    donnan_slopes,
    electrical_coefficients,
    wall_anion_flux,
)
from fvswell.exact.histories import History
from fvswell.exact.laplace import TransferAnswers
from fvswell.exact.linear_swelling import LinearColumn
from fvswell.physics.constants import FARADAY
from fvswell.physics.tissue import Array

__all__ = ["COLUMN_LOADS", "Drive", "DrivenColumn", "Measured"]

COLUMN_LOADS = (
    "piston.pressure",  # MPa
    "piston.displacement",  # mm, from the state linearised about
    "filter.bath_concentration",  # mmol/mm3
    "filter.bath_pressure",  # MPa
    "filter.current",  # A/mm2, into the tissue through the filter and out through the electrode at the far end
)

Measured = Literal["strain", "pressure", "wall_potential", "tissue_potential", "electrode_potential"]


class Drive(NamedTuple):
    """What a unit of a load changes."""

    contents: Array  # at the filter if the pressure of the piston does not change, (rows, contents)
    wall: Array  # of their change per height at the far end, (rows, contents)
    volume: Array  # of the mean of J, if the displacement of the piston is given, (rows,)
    pressure: Array  # of the piston, if it is given, MPa, (rows,)
    current: float = 0.0  # A/mm2


@dataclass(frozen=True)
class DrivenColumn:
    """A column at rest, driven from time 0 on.

    Parameters
    ----------
    column
        The column, linearised about its equilibrium.
    held
        Whether the displacement of the piston is given (and is 0 where no load says otherwise), not its pressure.
    electrode
        Kind of the electrode in the wall at the far end that carries currents.
    """

    column: LinearColumn
    held: bool = False
    electrode: WallElectrode = "cation"

    def history(self, measured: Measured, loads: Mapping[str, History], time: Array) -> Array:
        """What is measured while loads act.

        Parameters
        ----------
        measured
            "strain": change of height over the height in the state linearised about; "pressure": change of the
            piston's pressure, MPa; "wall_potential", "tissue_potential" and "electrode_potential": change of the
            potential (mV, relative to the bath) at the far end, of the virtual bath, of the tissue (which has a Donnan
            potential on top) and of an electrode of the column's kind, relative to a like one in the bath.
        loads
            Changes of the loads by name, of `COLUMN_LOADS`.
        time
            s, shape ``(times,)`` or ``(rows, times)``.

        Returns
        -------
        array
            Shape ``(rows, times)``.

        Raises
        ------
        ValueError
            If a load is unknown or contradicts ``held``, or a model without ions is asked for potentials or currents.
        """
        time = np.broadcast_to(np.atleast_2d(time), (len(self.column.volume_ratio), np.shape(time)[-1]))
        total = np.zeros(time.shape)
        for name, history in loads.items():
            total = total + history.answer(self.answers(measured, self.drive(name)), time)
        return total

    def frequency_response(self, measured: Measured, load: str, frequency: Array) -> Array:
        """Complex amplitude of what is measured under a load of unit amplitude, steady, ``(rows, frequencies)``.

        Parameters
        ----------
        measured, load
            As for `history`.
        frequency
            Hz, shape ``(frequencies,)``.

        Raises
        ------
        ValueError
            As for `history`.
        """
        answers = self.answers(measured, self.drive(load))
        return np.stack([answers.frequency_response(2.0 * np.pi * f) for f in np.atleast_1d(frequency)], axis=-1)

    def drive(self, load: str) -> Drive:
        """What a unit of a load changes; see `history`."""
        column, rows = self.column, len(self.column.volume_ratio)
        if load not in COLUMN_LOADS:
            raise ValueError(f"no load {load!r}; there are {', '.join(COLUMN_LOADS)}")
        if load == ("piston.pressure" if self.held else "piston.displacement"):
            raise ValueError(f"{load} cannot be given: that of the piston is {'found' if self.held else 'free'}")
        none, nothing = np.zeros_like(column.boundary_change()), np.zeros(rows)
        if load == "piston.displacement":
            return Drive(none, none, nothing + 1.0 / np.asarray(column.height), nothing)
        if load == "filter.current":
            return Drive(none, self._wall, nothing, nothing, 1.0)
        pressure, bath = float(load == "piston.pressure"), float(load == "filter.bath_concentration")
        water = pressure - float(load == "filter.bath_pressure")  # of the bath, it acts as less pressure of the piston
        return Drive(column.boundary_change(water, bath), none, nothing, nothing + pressure)

    def answers(self, measured: Measured, drive: Drive) -> TransferAnswers:
        """Answers of what is measured to histories of a drive; see `history`."""
        return TransferAnswers(partial(self._transfer, measured, drive))

    def _transfer(self, measured: Measured, drive: Drive, s: Array) -> Array:
        if measured == "pressure":
            return self._pressure(drive, s)
        if measured == "strain":
            return self._mean_volume(drive, s) / self.column.volume_ratio[:, None, None]
        return self._potential(measured, drive, s)

    def _pressure(self, drive: Drive, s: Array) -> Array:
        """Change of the piston's pressure."""
        if not self.held:
            return drive.pressure[:, None, None] + 0.0 * s
        waves = self._waves(s)
        needed = drive.volume[:, None, None] - self._free_volume(drive.contents, drive.wall, waves)
        return needed / self._free_volume(self._by_pressure, np.zeros_like(drive.wall), waves)

    def _mean_volume(self, drive: Drive, s: Array) -> Array:
        """Mean change of J."""
        if self.held:
            return drive.volume[:, None, None] + 0.0 * s
        return self._free_volume(drive.contents, drive.wall, self._waves(s))

    def _waves(self, s: Array) -> list[_Wave]:
        """Of each eigenvalue."""
        root = np.sqrt(s)
        return [_Wave.of(root * np.sqrt(time)[:, None, None]) for time in self._slab_times.T]

    def _free_volume(self, contents: Array, wall: Array, waves: list[_Wave]) -> Array:
        """Mean change of J by changes at the filter and at the wall."""
        at_filter, at_wall = (self.column.response(change)[:, :, 0] for change in (contents, wall))
        total = sum(wave.mean * share[:, None, None] for wave, share in zip(waves, at_filter.T, strict=True))
        if np.any(at_wall):
            total = total + sum(
                _rise(wave.z) * share[:, None, None] for wave, share in zip(waves, at_wall.T, strict=True)
            )
        result: Array = np.asarray(total)
        return result

    def _potential(self, measured: Measured, drive: Drive, s: Array) -> Array:
        """Potential at the far end, relative to the bath, mV."""
        column, coefficients = self.column, self._coefficients
        pressure = self._pressure(drive, s) if self.held else np.zeros_like(s)
        at_wall, at_filter = self._far_contents(drive, pressure, s)
        across = np.einsum("rpc,crtn->prtn", column.stiffness, at_wall - at_filter)  # of the potentials
        slopes = coefficients.potential_per_potential.T[:, :, None, None]
        potential = (slopes * across).sum(axis=0)
        potential = potential - (drive.current * column.current_height / coefficients.conductivity)[:, None, None]
        if measured == "wall_potential":
            return potential
        if measured == "electrode_potential":
            sign = 1.0 if self.electrode == "cation" else -1.0
            thermal = np.broadcast_to(column.tissue.thermal_energy / FARADAY, column.volume_ratio.shape)
            return potential + sign * thermal[:, None, None] * across[1]
        donnan = donnan_slopes(column.tissue, column.volume_ratio, column.log_activity)
        return potential + (donnan.T[:, :, None, None] * at_wall).sum(axis=0)

    def _far_contents(self, drive: Drive, pressure: Array, s: Array) -> tuple[Array, Array]:
        """Changes of the contents at the far end and at the filter, ``(contents, rows, times, nodes)``."""
        at_filter = drive.contents.T[:, :, None, None] + self._by_pressure.T[:, :, None, None] * pressure
        at_wall = np.zeros(at_filter.shape, dtype=complex)
        shares = [self.column.response(change) for change in (drive.contents, self._by_pressure, drive.wall)]
        for i, wave in enumerate(self._waves(s)):
            given, pressed, wall = (share[:, i].T[:, :, None, None] for share in shares)
            at_wall = at_wall + _sech(wave.z) * (given + pressed * pressure) + wave.mean * wall
        return at_wall, at_filter

    @cached_property
    def _slab_times(self) -> Array:
        """h0^2/d of the eigenvalues d of D, s, ``(rows, eigenvalues)``."""
        return self.column.current_height[:, None] ** 2 / self.column.diffusivities

    @cached_property
    def _by_pressure(self) -> Array:
        """Change of the contents at the filter by the piston's pressure, ``(rows, contents)``."""
        return self.column.boundary_change(1.0)

    @cached_property
    def _coefficients(self) -> ElectricalCoefficients:
        column = self.column
        if not column.model.transports_ions:
            raise ValueError(f"the {column.model.name} model has no ions to carry a current or to make a potential")
        return electrical_coefficients(column.tissue, column.volume_ratio, column.log_activity)

    @cached_property
    def _wall(self) -> Array:
        """Change per height at the far end by a unit current: L grad y = tau i - (0, j-), ``(rows, contents)``."""
        column = self.column
        flux = self._coefficients.flux_per_charge - np.array([0.0, wall_anion_flux(self.electrode)])
        slope = np.linalg.solve(column.mobility @ column.stiffness, flux[..., None])[..., 0]
        return column.current_height[:, None] * slope


class _Wave(NamedTuple):
    """What is needed of the profile of an eigenvalue, shape of s."""

    z: Array
    mean: Array  # tanh(z)/z

    @classmethod
    def of(cls, z: Array) -> _Wave:
        return cls(z, np.tanh(z) / z)


def _sech(z: Array) -> Array:
    return 2.0 * np.exp(-z) / (1.0 + np.exp(-2.0 * z))


def _rise(z: Array) -> Array:
    """(1 - 1/cosh z)/z^2, to all digits at small z too."""
    return (np.expm1(-z) / z) ** 2 / (1.0 + np.exp(-2.0 * z))
