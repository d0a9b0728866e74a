"""Mandel's problem: a saturated block squeezed between rigid, frictionless, impermeable plates.

Mandel (1953); Cheng & Detournay (1988), here for incompressible constituents (undrained Poisson's ratio
1/2). Plane strain, half width a, drained and free of traction at x = +-a; the plates, apart by the height
of the block, press with the force F per half width and per depth from time 0 on.

With the axial strain e(t) uniform and sigma_xx = 0, dp/dt + 2 G de/dt = c d2p/dx2, c = k (K + 4G/3), and
the plates' force fixes e. The series runs over tan(a_n) = a_n (1 - nu)/(1/2 - nu). The pressure in the
middle first rises: the drained sides give way and hand their load on.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fvswell.exact.roots import roots_between, terms_from
from fvswell.physics.tissue import Array

__all__ = ["MandelBlock"]


@dataclass(frozen=True)
class MandelBlock:
    """Mandel's block; units mm, N, s. Times are arrays of one axis, at least 1e-7 a^2/c.

    Every method raises ValueError at an earlier time, where the series would not converge in reasonable
    terms.
    """

    half_width: float  # a, mm
    youngs_modulus: float  # MPa
    poisson_ratio: float
    permeability: float  # mm4/(N s)
    force: float  # F, N/mm

    @cached_property
    def shear_modulus(self) -> float:
        """G, MPa."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poisson_ratio))

    @cached_property
    def diffusivity(self) -> float:
        """Consolidation coefficient c = k (K + 4G/3), mm2/s."""
        nu = self.poisson_ratio
        return self.permeability * 2.0 * self.shear_modulus * (1.0 - nu) / (1.0 - 2.0 * nu)

    def roots(self, count: int) -> Array:
        """The first roots a_n of tan(a_n) = a_n (1 - nu)/(1/2 - nu)."""
        slope = (1.0 - self.poisson_ratio) / (0.5 - self.poisson_ratio)
        turns = np.arange(count) * np.pi
        # sin(a) = slope a cos(a), solved in each half turn; its solution 0 is not one of them
        return roots_between(lambda a: np.sin(a) - slope * a * np.cos(a), np.maximum(turns, 1e-2), turns + 0.5 * np.pi)

    def fluid_pressure(self, position: Array, time: Array) -> Array:
        """Pressure p (MPa) at distances from the middle (mm), shape ``(times, positions)``."""
        a, decay = self._modes(time)
        shape = np.cos(np.outer(a, np.asarray(position) / self.half_width)) - np.cos(a)[:, None]
        share = np.sin(a) / (a - np.sin(a) * np.cos(a))
        return self.force / self.half_width * (decay * share) @ shape

    def edge_displacement(self, time: Array) -> Array:
        """Outward displacement of the sides (mm), shape ``(times,)``; it falls back as the water leaves."""
        a, decay = self._modes(time)
        share = np.cos(a) * np.sin(a) / (a - np.sin(a) * np.cos(a))
        return self.force / self.shear_modulus * (0.5 * self.poisson_ratio + 0.5 * decay @ share)

    def axial_strain(self, time: Array) -> Array:
        """Strain between the plates (negative), shape ``(times,)``."""
        a, decay = self._modes(time)
        share = np.cos(a) * np.sin(a) / (a - np.sin(a) * np.cos(a))
        scale = self.force / (self.shear_modulus * self.half_width)
        return scale * (-0.5 * (1.0 - self.poisson_ratio) + 0.5 * decay @ share)

    def _modes(self, time: Array) -> tuple[Array, Array]:
        scaled = self.diffusivity / self.half_width**2 * np.atleast_1d(time)
        a = self.roots(terms_from(scaled))
        return a, np.exp(-np.outer(scaled, a**2))
