"""Unconfined compression of a biphasic disc between rigid, frictionless, impermeable plates, small strain.

The problem of Armstrong, Lai & Mow (1984), with a solid that is isotropic across its axis, of Cohen, Lai & Mow (1998).
Axial strain e(t) is uniform; water leaves at the rim r = a, where pressure and traction are zero. The stress of the
solid is

    s_r = C11 e_r + C12 e_h + C13 e,   s_h = C12 e_r + C11 e_h + C13 e,   s_z = C13 (e_r + e_h) + C33 e.

In w = u + e r/2, u the radial displacement, dilatation is (1/r) d(r w)/dr, and mass and momentum balance (water flux
-dw/dt through a cylinder, grad p = C11 grad dilatation) combine to

    dw/dt = k C11 d/dr[(1/r) d(r w)/dr],

with zero radial traction at the rim, C11 dw/dr + C12 w/a = g e there, g = (C11 + C12)/2 - C13, and the mean axial
stress between the plates

    s = B e - 2 g w(a)/a,   B = g + C33 - C13.

If e steps (relaxation) the condition at the rim is given; if s steps (creep), e = (s + 2 g w(a)/a)/B makes it
C11 dw/dr + (C12 - 2 g^2/B) w/a = g s/B. Both are C11 (dw/dr + w/a) - kappa C11 w/a = load with
kappa = 1 - C12/C11 for relaxation and 1 - C12/C11 + 2 g^2/(B C11) for creep, hence

    w = b [r - a sum A_n J1(x_n r/a) exp(-x_n^2 tau)],   x_n J0(x_n) = kappa J1(x_n),   tau = k C11 t/a^2,
    b = load/((2 - kappa) C11),   A_n J1(x_n) = 2 (2 - kappa)/(x_n^2 + kappa^2 - 2 kappa).

A ramp is the mean of steps over its duration. The integral of a step response begins with its closed form
at late times, the solution while b rises steadily,

    w = (db/dtau) [tau r - (r (4 - kappa)/(2 - kappa) - r^3/a^2)/8 + ...].

An isotropic solid has C11 = C33 = M = K + 4 G/3, C12 = C13 = M - 2 G, g = G and B = 3 G.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import j0, j1, jn_zeros

from fvswell.exact.roots import EARLIEST_TIME, roots_between, terms_from
from fvswell.physics.tissue import Array

__all__ = ["DiscHistory", "DiscStiffness", "TransverselyIsotropicDisc", "UnconfinedDisc"]


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


class DiscStiffness(NamedTuple):
    """Stiffness of a solid that is isotropic across its axis, MPa; see the head of this module."""

    radial: float  # C11
    hoop: float  # C12
    coupling: float  # C13
    axial: float  # C33


@dataclass(frozen=True)
class TransverselyIsotropicDisc:
    """A disc between plates; units mm, N, s."""

    radius: float  # a, mm
    stiffness: DiscStiffness
    permeability: float  # across the axis, mm4/(N s)

    @property
    def rim_load(self) -> float:
        """How an axial strain pulls at the rim: g of the head of this module, MPa."""
        C = self.stiffness
        return 0.5 * (C.radial + C.hoop) - C.coupling

    @property
    def undrained_modulus(self) -> float:
        """Axial stress over axial strain before any water has left: B of the head of this module, MPa."""
        return self.rim_load + self.stiffness.axial - self.stiffness.coupling

    @property
    def drained_modulus(self) -> float:
        """Axial stress over axial strain in equilibrium, MPa."""
        return self.undrained_modulus - 2.0 * self.rim_load**2 / (self.stiffness.radial + self.stiffness.hoop)

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
            If a time is below 1e-7 a^2/(k C11), where the series would not converge in reasonable terms.
        """
        C, g, B = self.stiffness, self.rim_load, self.undrained_modulus
        kappa = 1.0 - C.hoop / C.radial + 2.0 * g**2 / (B * C.radial)
        stress = np.full(np.shape(time), -pressure)
        tau = self._scaled(time)
        modes = self._modes(kappa, position, terms_from(tau))
        decay = np.exp(-np.outer(tau, modes.x**2)) * modes.weight
        dilation = g * stress / (B * (2.0 - kappa) * C.radial)  # b
        rim = dilation * (1.0 - decay.sum(axis=1))  # w(a)/a
        strain = (stress + 2.0 * g * rim) / B
        return self._history(strain, stress, rim, -dilation[:, None] * (decay @ modes.shape))

    def relaxation(self, position: Array, time: Array, strain: float, ramp_duration: float) -> DiscHistory:
        """Response to an axial strain that comes on evenly over ``ramp_duration`` s, then stays.

        The strain is negative in compression. Other parameters as for ``creep``; any time from 0 on.
        """
        C, g = self.stiffness, self.rim_load
        kappa = 1.0 - C.hoop / C.radial
        tau, tau_end = self._scaled(time), self._scaled(np.array(ramp_duration))
        modes = self._modes(kappa, position, terms_from(np.array(EARLIEST_TIME)))
        limits = 0.25 / (2.0 - kappa), 0.5 * (1.0 - (np.asarray(position) / self.radius) ** 2)

        def ramp_sum(limit: Array | float, amplitude: Array) -> Array:
            """Mean of a step response over the ramp."""
            upper, lower = (_integral(t, limit, modes.x, amplitude) for t in (tau, tau - tau_end))
            return (upper - lower) / tau_end

        share = np.clip(tau / tau_end, 0.0, 1.0)
        final = strain * g / ((2.0 - kappa) * C.radial)  # b
        rim = final * (share - ramp_sum(limits[0], modes.weight))
        dilatation = -final * ramp_sum(limits[1], modes.weight[:, None] * modes.shape)
        stress = self.undrained_modulus * strain * share - 2.0 * g * rim
        return self._history(strain * share, stress, rim, dilatation)

    def _scaled(self, time: Array) -> Array:
        return self.stiffness.radial * self.permeability / self.radius**2 * time

    def _modes(self, kappa: float, position: Array, count: int) -> _Modes:
        zeros = jn_zeros(0, count)
        x = roots_between(lambda x: x * j0(x) - kappa * j1(x), np.append(1e-3, zeros[:-1]), zeros)
        shape = j0(np.outer(x, np.asarray(position) / self.radius)) - j0(x)[:, None]
        weight = 2.0 * (2.0 - kappa) / (x**2 + kappa**2 - 2.0 * kappa)
        return _Modes(x, weight, shape * (x / j1(x))[:, None])

    def _history(self, strain: Array, stress: Array, rim: Array, dilatation: Array) -> DiscHistory:
        """From w(a)/a and the dilatation less that at the rim, which p/C11 equals (momentum balance)."""
        displacement = self.radius * (rim - 0.5 * strain)
        return DiscHistory(strain, stress, displacement, self.stiffness.radial * dilatation)


@dataclass(frozen=True)
class UnconfinedDisc:
    """A disc of an isotropic solid between plates; units mm, N, s."""

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

    @property
    def as_transversely_isotropic(self) -> TransverselyIsotropicDisc:
        """The same disc as one of a more general kind."""
        M, lame = self.aggregate_modulus, self.aggregate_modulus - 2.0 * self.shear_modulus
        return TransverselyIsotropicDisc(self.radius, DiscStiffness(M, lame, lame, M), self.permeability)

    def creep(self, position: Array, time: Array, pressure: float) -> DiscHistory:
        """Response to a mean axial pressure, see `TransverselyIsotropicDisc.creep`."""
        return self.as_transversely_isotropic.creep(position, time, pressure)

    def relaxation(self, position: Array, time: Array, strain: float, ramp_duration: float) -> DiscHistory:
        """Response to an axial strain, see `TransverselyIsotropicDisc.relaxation`."""
        return self.as_transversely_isotropic.relaxation(position, time, strain, ramp_duration)


def _integral(scaled_time: Array, limit: Array | float, x: Array, amplitude: Array) -> Array:
    """Integral from time 0 of sum amplitude exp(-x^2 tau), which tends to ``limit``; 0 before time 0."""
    decay = np.exp(-np.outer(np.maximum(scaled_time, 0.0), x**2))
    value = limit - (decay / x**2) @ amplitude
    return np.where((scaled_time > 0.0).reshape(-1, *[1] * (value.ndim - 1)), value, 0.0)
