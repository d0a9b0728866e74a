"""Swelling and compression of a column by small steps of load or bath: the linear solution, exact in time.

About a uniform state at rest the balances of a column are coupled diffusion of its contents, J and J n_f c-:

    dm/dt = D d2m/dx2,   D = J0 L H,

x being the current coordinate from the filter. H = dy/dm is the stiffness of the potentials y = (mu_f,
ln c~) and L the mobility in (q, j-) = -L grad y with the electric potential eliminated by i = 0. A step of
load or bath changes m at the filter at once and in the rest of the column as ``slab.profile_uptake``, once
for each eigenvalue of D. The biphasic and biphasic-swelling models are the same with one content, J.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fvswell.exact.slab import mean_uptake, profile_uptake, relaxation_time
from fvswell.physics.differentiation import COMPLEX_STEP
from fvswell.physics.electrochemistry import (
    bath_osmotic_pressure,
    fixed_charge_density,
    fluid_fraction,
    ion_concentrations,
    osmotic_pressure,
)
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import Mixture
from fvswell.physics.permeability import open_circuit_permeability
from fvswell.physics.solid import uniaxial_stress
from fvswell.physics.tissue import Array

__all__ = ["ColumnChange", "LinearColumn", "salt_outdraws_osmosis"]

_SMALLEST_GAP = 1e-5  # half the distance of the eigenvalues over their mean, see LinearColumn.diffusivities


class ColumnChange(NamedTuple):
    """Changes from the state linearised about, shape ``(rows, times, points)``."""

    volume_ratio: Array
    log_concentration: Array
    water_potential: Array  # MPa


@dataclass(frozen=True)
class LinearColumn:
    """A column linearised about a uniform state; every array has the rows of a batch as its first axis.

    Parameters
    ----------
    mixture
        Model and tissue at one point of each row.
    height
        Height of the stress-free solid, mm; shape ``(rows, 1)`` or a number.
    volume_ratio, log_concentration
        J and ln c~ (c~ in mmol/mm3) of the state, shape ``(rows, 1)``.
    """

    mixture: Mixture
    height: Array | float
    volume_ratio: Array
    log_concentration: Array

    @classmethod
    def at_equilibrium(
        cls,
        mixture: Mixture,
        height: Array | float,
        applied_pressure: Array | float,
        bath_concentration: Array | float,
    ) -> LinearColumn:
        """Linearise about the equilibrium with a bath (mmol/mm3) under a pressure of the piston (MPa)."""
        J = equilibrium_volume_ratio(
            mixture.tissue,
            applied_pressure,
            bath_concentration,
            mixture.bath_osmotic_coefficient,
            mixture.model.swelling,
        )
        return cls(mixture, height, J, np.log(bath_concentration) + np.zeros_like(J))

    @cached_property
    def current_height(self) -> Array:
        """Height in the state linearised about, mm, shape ``(rows,)``."""
        return (self.volume_ratio * self.height)[:, 0]

    @cached_property
    def stiffness(self) -> Array:
        """H, the derivative of the potentials by the contents, shape ``(rows, contents, contents)``."""
        J, step = self.volume_ratio, 1j * COMPLEX_STEP
        if not self.mixture.model.transports_ions:
            stress = uniaxial_stress(self.mixture.tissue, J + step)
            mu_f = stress - self.mixture.osmotic_pressure(self.mixture.at(J + step, self.log_concentration))
            return mu_f.imag[:, :, None] / COMPLEX_STEP
        salt = self.mixture.contents(self.mixture.at(J, self.log_concentration))[1]
        columns = (self._potentials(J + step, salt), self._potentials(J, salt + step))
        return np.stack([np.stack(column, axis=-1).imag[:, 0] for column in columns], axis=-1) / COMPLEX_STEP

    @cached_property
    def mobility(self) -> Array:
        """L, the fluxes for unit gradients of the potentials, shape ``(rows, contents, contents)``."""
        J, tissue = self.volume_ratio, self.mixture.tissue
        if not self.mixture.model.transports_ions:
            return self.mixture.permeability(self.mixture.at(J, self.log_concentration))[:, :, None]
        cation, anion = ion_concentrations(tissue, J, self.log_concentration)
        k_open = open_circuit_permeability(tissue, J, cation, anion)
        D_cation, D_anion, w = tissue.cation_diffusivity, tissue.anion_diffusivity, tissue.convection_factor
        conductance = cation * D_cation + anion * D_anion
        # salt carried by the water; the streaming potential speeds the slower ion up
        carried = w * cation * anion * (D_cation + D_anion) / conductance
        diffused = 2.0 * fluid_fraction(tissue, J) * cation * D_cation * anion * D_anion / conductance
        drawn = 2.0 * tissue.thermal_energy * carried  # reciprocal to ``carried``
        entries = np.broadcast_arrays(k_open, k_open * drawn, carried * k_open, carried * k_open * drawn + diffused)
        return np.stack(entries, axis=-1).reshape(-1, 2, 2)

    @cached_property
    def diffusion(self) -> Array:
        """D = J0 L H, mm2/s on the diagonal, shape ``(rows, contents, contents)``."""
        return self.volume_ratio[:, :, None] * (self.mobility @ self.stiffness)

    @cached_property
    def diffusivities(self) -> Array:
        """Eigenvalues of D, mm2/s, largest first, shape ``(rows, contents)``.

        They are complex where osmotic pressure and salt do not derive from one free energy (osmotic
        coefficients other than 1) and the two are close. Two eigenvalues are kept at least 2e-5 of their
        mean apart: functions of D are formed by interpolation between them, which then costs 1e-10 and not
        all digits.
        """
        D = self.diffusion
        if D.shape[-1] == 1:
            return D[:, :, 0]
        mean = 0.5 * (D[:, 0, 0] + D[:, 1, 1])
        square = 0.25 * (D[:, 0, 0] - D[:, 1, 1]) ** 2 + D[:, 0, 1] * D[:, 1, 0]
        least = (_SMALLEST_GAP * mean) ** 2
        square = np.where(np.abs(square) < least, least, square)
        half_gap = np.sqrt(square.astype(complex) if np.any(square < 0.0) else square)
        return np.stack([mean + half_gap, mean - half_gap], axis=-1)

    def boundary_change(self, delta_pressure: Array | float = 0.0, delta_concentration: Array | float = 0.0) -> Array:
        """Change of the contents at the filter at once and everywhere in the end, ``(rows, contents)``.

        Parameters
        ----------
        delta_pressure
            Step of the piston's pressure, MPa; a number or ``(rows, 1)``.
        delta_concentration
            Step of the bath's salt concentration, mmol/mm3; a number or ``(rows, 1)``.
        """
        bath, tissue = self.mixture.bath_osmotic_coefficient, self.mixture.tissue
        delta_log = delta_concentration / np.exp(self.log_concentration)
        water = -delta_pressure + np.zeros_like(self.volume_ratio)
        if self.mixture.model.swelling:
            delta_bath = np.asarray(delta_concentration)
            water = water - bath_osmotic_pressure(bath, tissue.thermal_energy, delta_bath)
        if self.mixture.model.transports_ions:
            change = np.stack(np.broadcast_arrays(water, delta_log), axis=-1)[:, 0]
        else:  # the salt in the column follows the bath at once
            change = water + self._osmotic_slope * delta_log
        return np.linalg.solve(self.stiffness, change[..., None])[..., 0]

    def response(self, boundary_change: Array) -> Array:
        """Share of each eigenvalue of D in a change at the filter, shape ``(rows, eigenvalues, contents)``.

        f(D) m_b is the sum over the eigenvalues d of f(d) times their share, for any function f.
        """
        if self.diffusion.shape[-1] == 1:
            return boundary_change[:, None, :]
        large, small = self.diffusivities.T
        mean = 0.5 * (large + small)
        deviation = (self.diffusion @ boundary_change[..., None])[..., 0] - mean[:, None] * boundary_change
        deviation = deviation / (large - small)[:, None]
        return np.stack([0.5 * boundary_change + deviation, 0.5 * boundary_change - deviation], axis=1)

    def mean_volume_change(self, time: Array, boundary_change: Array) -> Array:
        """Change of J averaged over the height, a time after a sudden change at the filter.

        Parameters
        ----------
        time
            s, shape ``(times,)`` or ``(rows, times)``; up to time 0 nothing has changed.
        boundary_change
            Change of the contents at the filter, shape ``(rows, contents)``.

        Returns
        -------
        array
            Shape ``(rows, times)``.
        """
        share = self.response(boundary_change)[:, :, 0]
        value = mean_uptake(self._slab_time(time)) * share[..., None]
        return value.sum(axis=1).real

    def relaxation_time(self, fraction: float) -> Array:
        """Time (s) in which a model without ions comes to a fraction of its final strain, ``(rows,)``.

        Raises
        ------
        ValueError
            If ions are transported: their time scale depends on what is changed.
        """
        if self.mixture.model.transports_ions:
            raise ValueError(f"the {self.mixture.model.name} model has no single relaxation time")
        return relaxation_time(fraction) * self.current_height**2 / self.diffusivities[:, 0]

    def global_strain(
        self,
        time: Array,
        delta_pressure: Array | float = 0.0,
        delta_concentration: Array | float = 0.0,
    ) -> Array:
        """Change of height over the height in the state linearised about, shape ``(rows, times)``.

        Parameters as for ``mean_volume_change`` and ``boundary_change``.
        """
        change = self.boundary_change(delta_pressure, delta_concentration)
        return self.mean_volume_change(time, change) / self.volume_ratio

    def profile(
        self,
        position: Array,
        time: Array,
        delta_pressure: Array | float = 0.0,
        delta_concentration: Array | float = 0.0,
    ) -> ColumnChange:
        """Changes along the column.

        Parameters
        ----------
        position
            Distance from the filter in the state linearised about, mm; ``(points,)`` or ``(rows, points)``.
        time, delta_pressure, delta_concentration
            As for ``global_strain``.

        Raises
        ------
        ValueError
            If a position is outside the column.
        """
        xi: Array = np.atleast_2d(position) / self.current_height[:, None]
        if np.any((xi < 0.0) | (xi > 1.0 + 1e-12)):
            raise ValueError(f"positions must lie in the column, between 0 and {self.current_height} mm")
        boundary = self.boundary_change(delta_pressure, delta_concentration)
        uptake = profile_uptake(xi[:, None, None, :], self._slab_time(time)[..., None])
        content = np.einsum("rdc,rdtx->rctx", self.response(boundary), uptake).real
        potential = np.einsum("rpc,rctx->rptx", self.stiffness, content)
        delta_log = (delta_concentration / np.exp(self.log_concentration))[:, :, None]
        load = np.broadcast_to(delta_pressure, self.volume_ratio.shape)[:, :, None]
        water = potential[:, 0] + load
        if self.mixture.model.transports_ions:
            return ColumnChange(content[:, 0], potential[:, 1], water)
        osmotic = self._osmotic_slope[:, :, None] * delta_log
        return ColumnChange(content[:, 0], delta_log + np.zeros_like(water), water - osmotic)

    def early_strain(self, boundary_change: Array) -> Array:
        """Coefficient a in strain = a sqrt(t), which holds while the far end is untouched; ``(rows,)``."""
        share = self.response(boundary_change)[:, :, 0]
        rate = 2.0 / np.sqrt(np.pi) * (np.sqrt(self.diffusivities) * share).sum(axis=1).real
        return rate / (self.current_height * self.volume_ratio[:, 0])

    def flows_backward_first(self, boundary_change: Array) -> Array:
        """Whether water first flows against the final change of volume: negative osmosis; ``(rows,)``."""
        return self.early_strain(boundary_change) * boundary_change[:, 0] < 0.0

    @property
    def _osmotic_slope(self) -> Array:
        """Slope d pi/d ln c~ at fixed J, MPa, shape ``(rows, 1)``."""
        shifted = self.log_concentration + 1j * COMPLEX_STEP
        pi = self.mixture.osmotic_pressure(self.mixture.at(self.volume_ratio, shifted))
        return np.asarray(pi).imag / COMPLEX_STEP + np.zeros_like(self.volume_ratio)

    def _slab_time(self, time: Array) -> Array:
        scaled = self.diffusivities / self.current_height[:, None] ** 2
        return scaled[:, :, None] * np.atleast_2d(time)[:, None, :]

    def _potentials(self, J: Array, salt: Array) -> tuple[Array, Array]:
        """mu_f (up to the applied pressure) and ln c~ as functions of the contents."""
        tissue = self.mixture.tissue
        anion = salt / (J * fluid_fraction(tissue, J))
        cation = anion + fixed_charge_density(tissue, J)
        log_concentration = 0.5 * np.log(cation * anion / tissue.activity_ratio)
        return uniaxial_stress(tissue, J) - osmotic_pressure(tissue, cation, anion), log_concentration


def salt_outdraws_osmosis(mixture: Mixture, J: Array, log_concentration: Array) -> Array:
    """Whether a salt gradient in a tissue of uniform J moves water toward the weaker solution.

    Water is drawn along by the salt with w R T (S - c_F a/b) grad ln c~, where a, b = c+ D+ -+ c- D-, and
    held by osmosis with phi_int R T (4 g c~^2/S) grad ln c~. Where the first is larger, a swelling sample
    can shrink first (negative osmosis). Whether a whole column does so depends also on how the volume
    diffuses in from the filter, see ``LinearColumn.flows_backward_first``. Shape of ``J``.
    """
    tissue = mixture.tissue
    cation, anion = ion_concentrations(tissue, J, log_concentration)
    from_cation, from_anion = cation * tissue.cation_diffusivity, anion * tissue.anion_diffusivity
    asymmetry = (from_cation - from_anion) / (from_cation + from_anion)
    total = cation + anion
    drag = tissue.convection_factor * (total - (cation - anion) * asymmetry)
    return drag > tissue.osmotic_coefficient * 4.0 * cation * anion / total
