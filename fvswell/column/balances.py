"""Fluxes through the faces of a column and their exact derivatives, for one combination of laws.

A column is uniaxial strain between two ends, x = 0 and x = h. The momentum balance is closed per cell,
p = sigma_s(J) + P with P the applied pressure, so the potentials of a cell follow from its contents

    J              volume, per reference volume
    s = J n_f c-   anions, per reference volume, where ions are transported

P is the pressure on the tissue: that of the piston, and, where the piston is open to a bath, the bath's on top.

Fluxes are two-point: they depend on the state at a face (its stretch, and the mean of ln a~ of the cells beside it) and
on the differences of the potentials across it. The electric potential is eliminated face by face: nothing stores
charge, so one current flows through all faces. It is given, or, where the potentials of both ends are, found as an
unknown of the column, to which the rises of the potential across the faces add up. At an open end the bath stands for
the missing cell, and the laws take the stretch of the cell inside. Nothing passes a closed end but the current through
an electrode in it, carried by the ions that the electrode exchanges.

The functions here are compiled once for each combination of laws (`law_kernel`). Their arguments:

    cells, faces    (parameters, cells) and (parameters, cells + 1): the tissue, row by row as `tissue_parameters` has
                    it; the last row of ``faces`` is k_open/k of models that hold it constant
    metric          (5, cells + 1): distance across a face, weights of the cells below and above in its stretch, and in
                    its ln a~
    contents        (balances, cells)
    loads           values of `COLUMN_LOADS`
    ends            (2, 2): for both ends, 1 where it is open to its bath, and the sign of the ion that an electrode in
                    a closed one exchanges, 0 without an electrode
    fluxes          (4, cells + 1): water, anions, charge (j+ - j-), and, where the current is found, the rise of the
                    potential, mV; set here like all that follow
    by_lower, by_upper
                    (rows, balances, cells + 1): fluxes by the contents of the cells below and above the face; where the
                    current is found the third row is that of the rise of the potential
    by_pressure     (rows, 2): the same at the ends by the pressure
    by_current      (rows, cells + 1): the same by the current, mm2/A, where it is found
    potentials      (6, cells): mu_f and ln a~, each with its derivatives by J and s
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from fvswell.compiled import point
from fvswell.compiled.dual import slope_of, value_of, variables
from fvswell.physics.constants import FARADAY
from fvswell.physics.fluxes import fluxes_of_unit_current, mixture_fluxes, potential_gradient_of_current
from fvswell.physics.osmotic import (
    bath_log_activity,
    bath_osmotic_pressure,
    ion_concentrations,
    log_activity,
    osmotic_pressure,
)
from fvswell.physics.permeability import hydraulic_permeability, open_circuit_ratio
from fvswell.physics.solids import uniaxial_stress
from fvswell.physics.tissue import first_rows, fixed_charge_density, fluid_fraction, tissue_at

__all__ = ["COLUMN_LOADS", "DIMENSIONS", "current_along", "full_balances", "reduced_balances"]

COLUMN_LOADS = (
    "pressure",  # of the piston, without that of its bath, MPa
    "height",  # of the column, mm; where it is given, the pressure is found
    "filter_bath_concentration",  # of the bath at x = 0, mmol/mm3
    "filter_bath_pressure",  # hydrostatic, MPa
    "piston_bath_concentration",
    "piston_bath_pressure",
    "filter_current",  # into the tissue through the filter, A/mm2
    "piston_current",  # one of the two is given, the other is found
    "filter_potential",  # mV; where both are given, the currents are found
    "piston_potential",
)
PRESSURE, HEIGHT, CONCENTRATION, BATH_PRESSURE, CURRENT, POTENTIAL = 0, 1, 2, 3, 6, 8
OPEN, ELECTRODE = 0, 1  # rows of ends
RISE = 3  # row of fluxes
DIMENSIONS = (2, 2, 2, 2, 1, 2, 2, 3, 3, 2, 2, 2)  # of the arguments


@point
def current_along(loads: Any) -> Any:
    """Current along x, A/mm2, from that through one of the parts; nan where it has to be found."""
    filter_current = loads[CURRENT]
    return -loads[CURRENT + 1] if np.isnan(filter_current) else filter_current


@point
def pressure_on_tissue(loads: Any, ends: Any) -> Any:
    """Pressure of the piston, and of its bath if it is open."""
    pressure = loads[PRESSURE]
    if ends[OPEN, 1] != 0.0:
        pressure = pressure + loads[BATH_PRESSURE + 2]
    return pressure


@point
def reference_concentration(loads: Any, ends: Any) -> Any:
    """Salt concentration of the bath of the first open end, to which potentials are relative."""
    return loads[CONCENTRATION + 2] if ends[OPEN, 0] == 0.0 and ends[OPEN, 1] != 0.0 else loads[CONCENTRATION]


@point
def electrode_rise(
    tissue: Any, sign: Any, end: Any, J: Any, log_activity: Any, reference: Any, distance: Any, current: Any
) -> Any:
    """Rise of F psi~/(R T) along x between an electrode in the wall and the centre of the cell there.

    The electrode is at the electrochemical potential of its ion at the wall, relative to that in the reference bath.
    Where water and the other ion stand still, the ion of the given sign is driven by its own potential alone, the
    gradient of which is  sign (grad ln a~) + grad psi~ = - current/(n_f D c).  It is the same for both signs.

    Parameters
    ----------
    tissue
        At the wall.
    sign
        Of the ion that the electrode exchanges.
    end
        0 at the filter, 1 at the piston.
    J, log_activity
        Of the cell.
    reference
        ln a~ of the reference bath.
    distance
        From the wall to the centre of the cell, in the stress-free solid, mm.
    current
        j+ - j- along x, mmol/(mm2 s).

    Returns
    -------
    tuple
        The rise, and its derivative by the current.
    """
    cation, anion = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), log_activity)
    conductance = tissue.cation_diffusivity * cation if sign > 0.0 else tissue.anion_diffusivity * anion
    resistance = distance * J / (fluid_fraction(tissue, J) * conductance)
    along = sign if end == 1 else -sign
    return along * (log_activity - reference) - current * resistance, -value_of(resistance)


def full_balances(solid: type, permeability: type, osmotic: type, current_is_found: bool) -> Callable[..., None]:
    """Balances of the model that transports ions, for given laws.

    ``current_is_found`` says that the rise of the potential is wanted, and derivatives by the current.
    """
    first = first_rows(solid, permeability, osmotic)
    rows = 3 if current_is_found else 2

    def evaluate(
        cells: Any, faces: Any, metric: Any, contents: Any, loads: Any, ends: Any, fluxes: Any, by_lower: Any,
        by_upper: Any, by_pressure: Any, by_current: Any, potentials: Any,
    ) -> None:  # fmt: skip
        n = contents.shape[1]
        pressure, current = pressure_on_tissue(loads, ends), current_along(loads) / FARADAY
        for i in range(n):
            tissue = tissue_at(solid, permeability, osmotic, first, cells, i)
            J, s = variables(contents[0, i], contents[1, i])
            anion = s / (J - 1.0 + tissue.fluid_fraction)
            charge = fixed_charge_density(tissue, J)
            cation = charge + anion
            pi = osmotic_pressure(tissue.osmotic, tissue.thermal_energy, charge, cation, anion)
            mu = uniaxial_stress(tissue.solid, J, tissue.fluid_fraction) + pressure - pi
            activity = log_activity(tissue.osmotic, charge, cation, anion)
            potentials[0, i] = value_of(mu)
            potentials[1, i] = slope_of(mu, 0)
            potentials[2, i] = slope_of(mu, 1)
            potentials[3, i] = value_of(activity)
            potentials[4, i] = slope_of(activity, 0)
            potentials[5, i] = slope_of(activity, 1)
        for i in range(n + 1):
            fluxes[0, i] = 0.0
            fluxes[1, i] = 0.0
            fluxes[2, i] = current
            for row in range(rows):
                for unknown in range(2):
                    by_lower[row, unknown, i] = 0.0
                    by_upper[row, unknown, i] = 0.0
            end = 0 if i == 0 else 1
            outside = i == 0 or i == n
            lower, upper = max(i - 1, 0), min(i, n - 1)
            if outside:
                for row in range(rows):
                    by_pressure[row, end] = 0.0
                if ends[OPEN, end] == 0.0:
                    sign = ends[ELECTRODE, end]
                    if sign < 0.0:
                        fluxes[1, i] = -current
                    if current_is_found:
                        tissue = tissue_at(solid, permeability, osmotic, first, faces, i)
                        RT = tissue.thermal_energy
                        reference = bath_log_activity(tissue.osmotic, reference_concentration(loads, ends))
                        J, activity = variables(contents[0, lower], potentials[3, lower])
                        rise, by_unit = electrode_rise(tissue, sign, end, J, activity, reference, metric[0, i], current)
                        fluxes[RISE, i] = RT / FARADAY * value_of(rise)
                        by_current[0, i] = 0.0
                        by_current[1, i] = -1.0 / FARADAY if sign < 0.0 else 0.0
                        by_current[2, i] = RT / (FARADAY * FARADAY) * by_unit
                        by_cell = by_upper if i == 0 else by_lower
                        by_J, by_activity = RT / FARADAY * slope_of(rise, 0), RT / FARADAY * slope_of(rise, 1)
                        by_cell[2, 0, i] = by_J + by_activity * potentials[4, lower]
                        by_cell[2, 1, i] = by_activity * potentials[5, lower]
                    continue
            tissue = tissue_at(solid, permeability, osmotic, first, faces, i)
            mu_lower, mu_upper = potentials[0, lower], potentials[0, upper]
            activity_lower, activity_upper = potentials[3, lower], potentials[3, upper]
            if outside:
                concentration = loads[CONCENTRATION + 2 * end]
                RT = tissue.thermal_energy
                mu = loads[BATH_PRESSURE + 2 * end] - bath_osmotic_pressure(tissue.osmotic, RT, concentration)
                activity = bath_log_activity(tissue.osmotic, concentration)
                if i == 0:
                    mu_lower, activity_lower = mu, activity
                else:
                    mu_upper, activity_upper = mu, activity
            distance = metric[0, i]
            per_distance = 1.0 / distance  # a division takes as long as five products
            at_face = metric[3, i] * activity_lower + metric[4, i] * activity_upper
            if outside:
                at_face = activity_lower if i == 0 else activity_upper
            J, activity, mu_slope, activity_slope = variables(
                metric[1, i] * contents[0, lower] + metric[2, i] * contents[0, upper],
                at_face,
                (mu_upper - mu_lower) * per_distance,
                (activity_upper - activity_lower) * per_distance,
            )
            cation, anion = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), activity)
            per_stretch = 1.0 / J
            mu_gradient, activity_gradient = mu_slope * per_stretch, activity_slope * per_stretch
            potential_gradient = potential_gradient_of_current(
                tissue, J, cation, anion, mu_gradient, activity_gradient, current
            )
            flux = mixture_fluxes(tissue, J, cation, anion, mu_gradient, activity_gradient, potential_gradient)
            fluxes[2, i] = value_of(flux.cation) - value_of(flux.anion)
            rise = flux.anion  # stands for it where it is not wanted
            if current_is_found:
                millivolt = tissue.thermal_energy / FARADAY
                rise = millivolt * distance * (potential_gradient * J)
                fluxes[RISE, i] = value_of(rise)
                by_unit, resistance = fluxes_of_unit_current(tissue, value_of(J), value_of(cation), value_of(anion))
                by_current[0, i] = by_unit.water / FARADAY
                by_current[1, i] = by_unit.anion / FARADAY
                by_current[2, i] = -millivolt * distance * value_of(J) * resistance / FARADAY
            fluxes[0, i], fluxes[1, i] = value_of(flux.water), value_of(flux.anion)
            for row in range(rows):
                through = flux.water if row == 0 else (flux.anion if row == 1 else rise)
                by_J, by_activity = slope_of(through, 0), slope_of(through, 1)
                by_mu, by_salt = slope_of(through, 2) * per_distance, slope_of(through, 3) * per_distance
                if outside:
                    by_pressure[row, end] = by_mu if i == 0 else -by_mu
                for unknown in range(2):
                    if i > 0:
                        by_lower[row, unknown, i] = (metric[3, i] * by_activity - by_salt) * potentials[
                            4 + unknown, lower
                        ] - by_mu * potentials[1 + unknown, lower]
                    if i < n:
                        by_upper[row, unknown, i] = (metric[4, i] * by_activity + by_salt) * potentials[
                            4 + unknown, upper
                        ] + by_mu * potentials[1 + unknown, upper]
                if i > 0:
                    by_lower[row, 0, i] += metric[1, i] * by_J
                if i < n:
                    by_upper[row, 0, i] += metric[2, i] * by_J

    return evaluate


def reduced_balances(
    solid: type, permeability: type, osmotic: type, open_circuit_of_state: bool
) -> Callable[..., None]:
    """Balances of the models in which the ions are in equilibrium with the bath, or do not matter, for given laws.

    ``open_circuit_of_state`` says that k_open/k follows the state, rather than the last row of ``faces``.
    """
    first = first_rows(solid, permeability, osmotic)

    def evaluate(
        cells: Any, faces: Any, metric: Any, contents: Any, loads: Any, ends: Any, fluxes: Any, by_lower: Any,
        by_upper: Any, by_pressure: Any, by_current: Any, potentials: Any,
    ) -> None:  # fmt: skip
        n = contents.shape[1]
        pressure, reference = pressure_on_tissue(loads, ends), reference_concentration(loads, ends)
        for i in range(n):
            tissue = tissue_at(solid, permeability, osmotic, first, cells, i)
            J, _ = variables(contents[0, i], 0.0)
            activity = bath_log_activity(tissue.osmotic, reference)
            charge = fixed_charge_density(tissue, J)
            cation, anion = ion_concentrations(tissue.osmotic, charge, activity)
            pi = osmotic_pressure(tissue.osmotic, tissue.thermal_energy, charge, cation, anion)
            mu = uniaxial_stress(tissue.solid, J, tissue.fluid_fraction) + pressure - pi
            potentials[0, i] = value_of(mu)
            potentials[1, i] = slope_of(mu, 0)
            potentials[3, i] = activity
        for i in range(n + 1):
            fluxes[0, i] = 0.0
            fluxes[1, i] = 0.0
            fluxes[2, i] = 0.0
            by_lower[0, 0, i] = 0.0
            by_upper[0, 0, i] = 0.0
            end = 0 if i == 0 else 1
            outside = i == 0 or i == n
            if outside:
                by_pressure[0, end] = 0.0
                if ends[OPEN, end] == 0.0:
                    continue
            tissue = tissue_at(solid, permeability, osmotic, first, faces, i)
            lower, upper = max(i - 1, 0), min(i, n - 1)
            mu_lower, mu_upper = potentials[0, lower], potentials[0, upper]
            if outside:
                concentration = loads[CONCENTRATION + 2 * end]
                RT = tissue.thermal_energy
                mu = loads[BATH_PRESSURE + 2 * end] - bath_osmotic_pressure(tissue.osmotic, RT, concentration)
                if i == 0:
                    mu_lower = mu
                else:
                    mu_upper = mu
            distance = metric[0, i]
            J, mu_slope = variables(
                metric[1, i] * contents[0, lower] + metric[2, i] * contents[0, upper], (mu_upper - mu_lower) / distance
            )
            k = hydraulic_permeability(tissue, J)
            if open_circuit_of_state:
                charge = fixed_charge_density(tissue, J)
                activity = bath_log_activity(tissue.osmotic, reference)
                cation, anion = ion_concentrations(tissue.osmotic, charge, activity)
                k = k * open_circuit_ratio(tissue, J, cation, anion)
            else:
                k = k * faces[faces.shape[0] - 1, i]
            flux = -k * (mu_slope / J)
            fluxes[0, i] = value_of(flux)
            by_J, by_mu = slope_of(flux, 0), slope_of(flux, 1) / distance
            if outside:
                by_pressure[0, end] = by_mu if i == 0 else -by_mu
            if i > 0:
                by_lower[0, 0, i] = metric[1, i] * by_J - by_mu * potentials[1, lower]
            if i < n:
                by_upper[0, 0, i] = metric[2, i] * by_J + by_mu * potentials[1, upper]

    return evaluate
