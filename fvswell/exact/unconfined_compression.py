"""Unconfined compression of a biphasic disc between rigid, frictionless, impermeable plates, small strain.

The problem of Armstrong, Lai & Mow (1984). Axial strain e(t) is uniform; water leaves at the rim r = a,
where pressure and traction are zero. In w = u + e r/2, u the radial displacement, dilatation is
(1/r) d(r w)/dr, and mass and momentum balance (water flux -dw/dt through a cylinder, grad p = M grad
dilatation) combine to

    dw/dt = k M d/dr[(1/r) d(r w)/dr],   M = K + 4G/3,

with zero radial traction at the rim, M dw/dr + lambda w/a = G e there (lambda = K - 2G/3), and the mean
axial stress between the plates

    s = 3 G e - 2 G w(a)/a.

If e steps (relaxation) the condition at the rim is given; if s steps (creep), e = s/(3 G) + (2/3) w(a)/a
makes it M dw/dr + (lambda - 2G/3) w/a = s/3. Both are M (dw/dr + w/a) - kappa M w/a = load with
kappa = 2G/M for relaxation and 8G/(3M) for creep, hence

    w = b [r - a sum A_n J1(x_n r/a) exp(-x_n^2 tau)],   x_n J0(x_n) = kappa J1(x_n),   tau = k M t/a^2,
    b = load/((2 - kappa) M),   A_n J1(x_n) = 2 (2 - kappa)/(x_n^2 + kappa^2 - 2 kappa).

A ramp is the mean of steps over its duration. The integral of a step response begins with its closed form
at late times, the solution while b rises steadily,

    w = (db/dtau) [tau r - (r (4 - kappa)/(2 - kappa) - r^3/a^2)/8 + ...].
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import j0, j1, jn_zeros

from fvswell.exact.roots import EARLIEST_TIME, roots_between, terms_from
from fvswell.physics.tissue import Array

__all__ = ["DiscHistory", "UnconfinedDisc"]


class DiscHistory(NamedTuple):
    """Response of the disc; strain and stress are negative in compression."""

    axial_strain: Array  # (times,)
    axial_stress: Array  # mean over the plate, MPa, (times,)
    rim_displacement: Array  # outward, mm, (times,)
    fluid_pressure: Array  # MPa, (times, positions)


class _Modes(NamedTuple):
    """A step response is a sum of ``weight`` (at the rim) or ``weight * shape``, times exp(-x^2 tau)."""

    x: Array  # (modes,)
    weight: Array  # A_n J1(x_n), (modes,)
    shape: Array  # x_n [J0(x_n r/a) - J0(x_n)]/J1(x_n), (modes, positions)


@dataclass(frozen=True)
class UnconfinedDisc:
    """A disc between plates; units mm, N, s."""

    radius: float  # a, mm
    youngs_modulus: float  # MPa
    poisson_ratio: float
    permeability: float  # mm4/(N s)

    @cached_property
    def shear_modulus(self) -> float:
        """G, MPa."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poisson_ratio))

    @cached_property
    def aggregate_modulus(self) -> float:
        """Aggregate modulus M = K + 4G/3, MPa."""
        return 2.0 * self.shear_modulus * (1.0 - self.poisson_ratio) / (1.0 - 2.0 * self.poisson_ratio)

    def creep(self, position: Array, time: Array, pressure: float) -> DiscHistory:
        """Response to a mean axial pressure (MPa) that comes on at time 0.

        Parameters
        ----------
        position
            Distances from the axis, mm, shape ``(positions,)``.
        time
            s, shape ``(times,)``.
        pressure
            Compression positive.

        Raises
        ------
        ValueError
            If a time is below 1e-7 a^2/(k M), where the series would not converge in reasonable terms.
        """
        G, M = self.shear_modulus, self.aggregate_modulus
        kappa = 8.0 * G / (3.0 * M)
        stress = np.full(np.shape(time), -pressure)
        tau = self._scaled(time)
        modes = self._modes(kappa, position, terms_from(tau))
        decay = np.exp(-np.outer(tau, modes.x**2)) * modes.weight
        dilation = stress / (3.0 * (2.0 - kappa) * M)  # b
        rim = dilation * (1.0 - decay.sum(axis=1))  # w(a)/a
        strain = stress / (3.0 * G) + 2.0 / 3.0 * rim
        return self._history(strain, stress, rim, -dilation[:, None] * (decay @ modes.shape))

    def relaxation(self, position: Array, time: Array, strain: float, ramp_duration: float) -> DiscHistory:
        """Response to an axial strain that comes on evenly over ``ramp_duration`` s, then stays.

        The strain is negative in compression. Other parameters as for ``creep``; any time from 0 on.
        """
        G, M = self.shear_modulus, self.aggregate_modulus
        kappa = 2.0 * G / M
        tau, tau_end = self._scaled(time), self._scaled(np.array(ramp_duration))
        modes = self._modes(kappa, position, terms_from(np.array(EARLIEST_TIME)))
        limits = 0.25 / (2.0 - kappa), 0.5 * (1.0 - (np.asarray(position) / self.radius) ** 2)

        def ramp_sum(limit: Array | float, amplitude: Array) -> Array:
            """Mean of a step response over the ramp."""
            upper, lower = (_integral(t, limit, modes.x, amplitude) for t in (tau, tau - tau_end))
            return (upper - lower) / tau_end

        share = np.clip(tau / tau_end, 0.0, 1.0)
        final = strain * G / ((2.0 - kappa) * M)  # b
        rim = final * (share - ramp_sum(limits[0], modes.weight))
        dilatation = -final * ramp_sum(limits[1], modes.weight[:, None] * modes.shape)
        stress = 3.0 * G * strain * share - 2.0 * G * rim
        return self._history(strain * share, stress, rim, dilatation)

    def _scaled(self, time: Array) -> Array:
        return self.aggregate_modulus * self.permeability / self.radius**2 * time

    def _modes(self, kappa: float, position: Array, count: int) -> _Modes:
        zeros = jn_zeros(0, count)
        x = roots_between(lambda x: x * j0(x) - kappa * j1(x), np.append(1e-3, zeros[:-1]), zeros)
        shape = j0(np.outer(x, np.asarray(position) / self.radius)) - j0(x)[:, None]
        weight = 2.0 * (2.0 - kappa) / (x**2 + kappa**2 - 2.0 * kappa)
        return _Modes(x, weight, shape * (x / j1(x))[:, None])

    def _history(self, strain: Array, stress: Array, rim: Array, dilatation: Array) -> DiscHistory:
        """From w(a)/a and the dilatation less that at the rim, which p/M equals (momentum balance)."""
        displacement = self.radius * (rim - 0.5 * strain)
        return DiscHistory(strain, stress, displacement, self.aggregate_modulus * dilatation)


def _integral(scaled_time: Array, limit: Array | float, x: Array, amplitude: Array) -> Array:
    """Integral from time 0 of sum amplitude exp(-x^2 tau), which tends to ``limit``; 0 before time 0."""
    decay = np.exp(-np.outer(np.maximum(scaled_time, 0.0), x**2))
    value = limit - (decay / x**2) @ amplitude
    return np.where((scaled_time > 0.0).reshape(-1, *[1] * (value.ndim - 1)), value, 0.0)
