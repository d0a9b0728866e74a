"""Swelling and compression of a column by small steps of load or bath: the linear solution, exact in time.

About a uniform state in equilibrium the balances of a column are coupled diffusion of its contents, J and J n_f c-:

    dm/dt = D d2m/dx2,   D = J0 L H,

x being the current coordinate from the filter. H = dy/dm is the stiffness of the potentials y = (mu_f,
ln a~) and L the mobility in (q, j-) = -L grad y with the electric potential eliminated by i = 0. A step of
load or bath changes m at the filter at once and in the rest of the column as ``slab.profile_uptake``, once
for each eigenvalue of D. The biphasic and biphasic-swelling models are the same with one content, J.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from fvswell.compiled.dual import Dual, variables
from fvswell.exact.slab import mean_uptake, profile_uptake, ramp_uptake, relaxation_time
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.fluxes import mixture_fluxes, potential_gradient_of_current
from fvswell.physics.models import Model
from fvswell.physics.osmotic import (
    bath_log_activity,
    bath_osmotic_pressure,
    ion_concentrations,
    log_activity,
    osmotic_pressure,
    virtual_concentration,
)
from fvswell.physics.permeability import hydraulic_permeability, open_circuit_ratio
from fvswell.physics.solids import uniaxial_stress
from fvswell.physics.tissue import Array, Tissue, convection_factor, fixed_charge_density, fluid_fraction

__all__ = ["ColumnChange", "LinearColumn", "salt_outdraws_osmosis"]

_SMALLEST_GAP = 1e-5  # half the distance of the eigenvalues over their mean, see LinearColumn.diffusivities


class ColumnChange(NamedTuple):
    """Changes from the state linearised about, shape ``(rows, times, points)``."""

    volume_ratio: Array
    log_activity: Array
    water_potential: Array  # MPa


@dataclass(frozen=True)
class LinearColumn:
    """Columns linearised about uniform states; what is an array has one entry for each column, its first axis.

    Parameters
    ----------
    model
        What is transported.
    tissue
        The tissue, numbers or arrays ``(rows,)``.
    height
        Height of the stress-free solid, mm; a number or ``(rows,)``.
    volume_ratio, log_activity
        J and ln a~ of the states, ``(rows,)``.
    kept_open_circuit_ratio
        k_open/k of the biphasic-swelling model where it is held constant, a number or ``(rows,)``; None evaluates it in
        the state.
    """

    model: Model
    tissue: Tissue
    height: Array | float
    volume_ratio: Array
    log_activity: Array
    kept_open_circuit_ratio: Array | float | None = None

    @classmethod
    def at_equilibrium(
        cls,
        model: Model,
        tissue: Tissue,
        height: Array | float,
        applied_pressure: Array | float,
        bath_concentration: Array | float,
        kept_open_circuit_ratio: Array | float | None = None,
    ) -> LinearColumn:
        """Linearise about the equilibrium with a bath (mmol/mm3) under a pressure of the piston (MPa)."""
        J = np.atleast_1d(equilibrium_volume_ratio(model.tissue(tissue), applied_pressure, bath_concentration))
        activity = bath_log_activity(tissue.osmotic, bath_concentration)
        return cls(model, tissue, height, J, activity + np.zeros_like(J), kept_open_circuit_ratio)

    @cached_property
    def current_height(self) -> Array:
        """Height in the state linearised about, mm, shape ``(rows,)``."""
        return self.volume_ratio * self.height

    @cached_property
    def stiffness(self) -> Array:
        """H, the derivative of the potentials by the contents, shape ``(rows, contents, contents)``."""
        if not self.model.transports_ions:
            return np.asarray(self._water_potential.slopes[0])[:, None, None]
        J, tissue = self.volume_ratio, self.tissue
        _, anion = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), self.log_activity)
        potentials = _potentials(tissue, *variables(J, J * fluid_fraction(tissue, J) * anion))
        return np.stack([np.stack(potential.slopes, axis=-1) for potential in potentials], axis=1)

    @cached_property
    def mobility(self) -> Array:
        """L, the fluxes for unit gradients of the potentials, shape ``(rows, contents, contents)``."""
        J, tissue = self.volume_ratio, self.tissue
        cation, anion = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), self.log_activity)
        if not self.model.transports_ions:
            k = hydraulic_permeability(tissue, J)
            if self.model.open_circuit:
                kept = self.kept_open_circuit_ratio
                k = k * (open_circuit_ratio(tissue, J, cation, anion) if kept is None else kept)
            return np.broadcast_to(k, J.shape)[:, None, None]
        columns = []
        for gradients in ((1.0, 0.0), (0.0, 1.0)):
            water, activity = (gradient + np.zeros_like(J) for gradient in gradients)
            potential = potential_gradient_of_current(tissue, J, cation, anion, water, activity, 0.0)
            fluxes = mixture_fluxes(tissue, J, cation, anion, water, activity, potential)
            columns.append(np.stack([-fluxes.water, -fluxes.anion], axis=-1))
        return np.stack(columns, axis=-1)

    @cached_property
    def diffusion(self) -> Array:
        """Coupled diffusivity D = J0 L H, mm2/s on the diagonal, shape ``(rows, contents, contents)``."""
        return self.volume_ratio[:, None, None] * (self.mobility @ self.stiffness)

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
            Step of the piston's pressure, MPa; a number or ``(rows,)``.
        delta_concentration
            Step of the bath's salt concentration, mmol/mm3; a number or ``(rows,)``.
        """
        water = -delta_pressure + np.zeros_like(self.volume_ratio)
        if self.model.swelling:
            water = water - self._bath.pressure * delta_concentration
        activity = self._activity_change(delta_concentration)
        if self.model.transports_ions:
            change = np.stack([water, activity], axis=-1)
        else:  # the salt in the column follows the bath at once
            change = (water - self._water_potential.slopes[1] * activity)[:, None]
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

    def ramped_volume_change(self, time: Array, boundary_rate: Array) -> Array:
        """The same as `mean_volume_change` where the contents at the filter change at a steady rate, 1/s each."""
        share = self.response(boundary_rate)[:, :, 0] * (self.current_height[:, None] ** 2 / self.diffusivities)
        value = ramp_uptake(self._slab_time(time)) * share[..., None]
        return value.sum(axis=1).real

    def relaxation_time(self, fraction: float) -> Array:
        """Time (s) in which a model without ions comes to a fraction of its final strain, ``(rows,)``.

        Raises
        ------
        ValueError
            If ions are transported: their time scale depends on what is changed.
        """
        if self.model.transports_ions:
            raise ValueError(f"the {self.model.name} model has no single relaxation time")
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
        return self.mean_volume_change(time, change) / self.volume_ratio[:, None]

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
        activity = self._activity_change(delta_concentration)[:, None, None]
        water = potential[:, 0] + np.broadcast_to(delta_pressure, self.volume_ratio.shape)[:, None, None]
        if self.model.transports_ions:
            return ColumnChange(content[:, 0], potential[:, 1], water)
        by_activity = np.asarray(self._water_potential.slopes[1])[:, None, None]
        return ColumnChange(content[:, 0], activity + np.zeros_like(water), water + by_activity * activity)

    def early_strain(self, boundary_change: Array) -> Array:
        """Coefficient a in strain = a sqrt(t), which holds while the far end is untouched; ``(rows,)``."""
        share = self.response(boundary_change)[:, :, 0]
        rate = 2.0 / np.sqrt(np.pi) * (np.sqrt(self.diffusivities) * share).sum(axis=1).real
        return rate / (self.current_height * self.volume_ratio)

    def flows_backward_first(self, boundary_change: Array) -> Array:
        """Whether water first flows against the final change of volume: negative osmosis; ``(rows,)``."""
        return self.early_strain(boundary_change) * boundary_change[:, 0] < 0.0

    @cached_property
    def _water_potential(self) -> Dual:
        """mu_f (up to the applied pressure) with its derivatives by J and ln a~, each ``(rows,)``."""
        tissue = self.model.tissue(self.tissue)
        J, activity = variables(self.volume_ratio, self.log_activity)
        fixed_charge = fixed_charge_density(tissue, J)
        ions = ion_concentrations(tissue.osmotic, fixed_charge, activity)
        pressure = osmotic_pressure(tissue.osmotic, tissue.thermal_energy, fixed_charge, *ions)
        potential: Dual = uniaxial_stress(tissue.solid, J, tissue.fluid_fraction) - pressure + 0.0 * activity
        return potential

    @cached_property
    def _bath(self) -> _BathSlopes:
        law = self.tissue.osmotic
        (concentration,) = variables(virtual_concentration(law, self.log_activity))
        pressure = bath_osmotic_pressure(law, self.tissue.thermal_energy, concentration)
        return _BathSlopes(pressure.slopes[0], bath_log_activity(law, concentration).slopes[0])

    def _activity_change(self, delta_concentration: Array | float) -> Array:
        change: Array = self._bath.log_activity * delta_concentration + np.zeros_like(self.volume_ratio)
        return change

    def _slab_time(self, time: Array) -> Array:
        scaled = self.diffusivities / self.current_height[:, None] ** 2
        return scaled[:, :, None] * np.atleast_2d(time)[:, None, :]


class _BathSlopes(NamedTuple):
    """Derivatives by the concentration of the bath that is in equilibrium with the state, ``(rows,)``."""

    pressure: Any
    log_activity: Any


def _potentials(tissue: Tissue, J: Dual, salt: Dual) -> tuple[Dual, Dual]:
    """mu_f (up to the applied pressure) and ln a~ as functions of the contents J and J n_f c-."""
    fixed_charge = fixed_charge_density(tissue, J)
    anion = salt / (J * fluid_fraction(tissue, J))
    ions = (anion + fixed_charge, anion)
    pressure = osmotic_pressure(tissue.osmotic, tissue.thermal_energy, fixed_charge, *ions)
    stress = uniaxial_stress(tissue.solid, J, tissue.fluid_fraction)
    return stress - pressure, log_activity(tissue.osmotic, fixed_charge, *ions)


def salt_outdraws_osmosis(tissue: Tissue, J: Array, log_activity: Array) -> Array:
    """Whether a salt gradient in a tissue of uniform J moves water toward the weaker solution.

    Water is drawn along by the salt with w R T (S - c_F a/b) grad ln a~, where S = c+ + c- and a, b = c+ D+ -+ c- D-,
    and held by osmosis with (d pi/d ln a~) grad ln a~. Where the first is larger, a swelling sample can shrink first
    (negative osmosis). Whether a whole column does so depends also on how the volume diffuses in from the filter, see
    ``LinearColumn.flows_backward_first``. Shape of ``J``.
    """
    law, fixed_charge = tissue.osmotic, fixed_charge_density(tissue, J)
    cation, anion = ion_concentrations(law, fixed_charge, log_activity)
    from_cation, from_anion = cation * tissue.cation_diffusivity, anion * tissue.anion_diffusivity
    asymmetry = (from_cation - from_anion) / (from_cation + from_anion)
    drag = convection_factor(tissue) * tissue.thermal_energy * (cation + anion - (cation - anion) * asymmetry)
    ions = ion_concentrations(law, fixed_charge, *variables(log_activity))
    pressure = osmotic_pressure(law, tissue.thermal_energy, fixed_charge, *ions)
    outdraws: Array = drag > pressure.slopes[0]
    return outdraws
