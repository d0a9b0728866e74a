"""Fluxes through the faces of a column and their exact derivatives, for one combination of laws.

A column is uniaxial strain between two ends, x = 0 and x = h. The momentum balance is closed per cell,
p = sigma_s(J) + P with P the applied pressure, so the potentials of a cell follow from its contents

    J              volume, per reference volume
    s = J n_f c-   anions, per reference volume, where ions are transported

Fluxes are two-point: they depend on the state at a face (its stretch, and the mean of ln a~ of the cells beside it) and
on the differences of the potentials across it. The electric potential is eliminated face by face: nothing stores
charge, so the current through every face is the one that is given. At an open end the bath stands for the missing cell,
and the laws take the stretch of the cell inside.

The functions here are compiled once for each combination of laws (`law_kernel`). Their arguments:

    cells, faces    (parameters, cells) and (parameters, cells + 1): the tissue, row by row as `tissue_parameters` has
                    it; the last row of ``faces`` is k_open/k of models that hold it constant
    metric          (5, cells + 1): distance across a face, weights of the cells below and above in its stretch, and in
                    its ln a~
    contents        (balances, cells)
    loads           values of `COLUMN_LOADS`
    open_ends       (2,) 1 where an end is open to its bath
    fluxes          (3, cells + 1): water, anions, charge (j+ - j-); set here like all that follow
    by_lower, by_upper
                    (balances, balances, cells + 1): fluxes by the contents of the cells below and above the face
    by_pressure     (balances, 2): fluxes at the ends by the applied pressure
    potentials      (6, cells): mu_f and ln a~, each with its derivatives by J and s
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from fvswell.compiled.dual import slope_of, value_of, variables
from fvswell.physics.fluxes import mixture_fluxes, potential_gradient_of_current
from fvswell.physics.osmotic import (
    bath_log_activity,
    bath_osmotic_pressure,
    ion_concentrations,
    log_activity,
    osmotic_pressure,
)
from fvswell.physics.permeability import hydraulic_permeability, open_circuit_ratio
from fvswell.physics.solids import uniaxial_stress
from fvswell.physics.tissue import first_rows, fixed_charge_density, tissue_at

__all__ = ["COLUMN_LOADS", "DIMENSIONS", "full_balances", "reduced_balances"]

COLUMN_LOADS = (
    "pressure",  # applied, MPa
    "height",  # of the column, mm; where it is given, the pressure is found
    "filter_concentration",  # of the bath at x = 0, mmol/mm3
    "filter_pressure",  # hydrostatic, MPa
    "piston_concentration",
    "piston_pressure",
    "current",  # along x, over Faraday's constant, mmol/(mm2 s)
)
PRESSURE, HEIGHT, CONCENTRATION, BATH_PRESSURE, CURRENT = 0, 1, 2, 3, 6
DIMENSIONS = (2, 2, 2, 2, 1, 1, 2, 3, 3, 2, 2)  # of the arguments


def full_balances(solid: type, permeability: type, osmotic: type) -> Callable[..., None]:
    """Balances of the model that transports ions, for given laws."""
    first = first_rows(solid, permeability, osmotic)

    def evaluate(
        cells: Any, faces: Any, metric: Any, contents: Any, loads: Any, open_ends: Any, fluxes: Any, by_lower: Any,
        by_upper: Any, by_pressure: Any, potentials: Any,
    ) -> None:  # fmt: skip
        n = contents.shape[1]
        pressure, current = loads[PRESSURE], loads[CURRENT]
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
            for balance in range(2):
                fluxes[balance, i] = 0.0
                for unknown in range(2):
                    by_lower[balance, unknown, i] = 0.0
                    by_upper[balance, unknown, i] = 0.0
            fluxes[2, i] = current
            end = 0 if i == 0 else 1
            outside = i == 0 or i == n
            if outside:
                by_pressure[0, end] = 0.0
                by_pressure[1, end] = 0.0
                if open_ends[end] == 0.0:
                    continue
            tissue = tissue_at(solid, permeability, osmotic, first, faces, i)
            lower, upper = max(i - 1, 0), min(i, n - 1)
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
            for balance in range(2):
                through = flux.water if balance == 0 else flux.anion
                fluxes[balance, i] = value_of(through)
                by_J, by_activity = slope_of(through, 0), slope_of(through, 1)
                by_mu, by_salt = slope_of(through, 2) * per_distance, slope_of(through, 3) * per_distance
                if outside:
                    by_pressure[balance, end] = by_mu if i == 0 else -by_mu
                for unknown in range(2):
                    if i > 0:
                        by_lower[balance, unknown, i] = (metric[3, i] * by_activity - by_salt) * potentials[
                            4 + unknown, lower
                        ] - by_mu * potentials[1 + unknown, lower]
                    if i < n:
                        by_upper[balance, unknown, i] = (metric[4, i] * by_activity + by_salt) * potentials[
                            4 + unknown, upper
                        ] + by_mu * potentials[1 + unknown, upper]
                if i > 0:
                    by_lower[balance, 0, i] += metric[1, i] * by_J
                if i < n:
                    by_upper[balance, 0, i] += metric[2, i] * by_J

    return evaluate


def reduced_balances(
    solid: type, permeability: type, osmotic: type, open_circuit_of_state: bool
) -> Callable[..., None]:
    """Balances of the models in which the ions are in equilibrium with the bath, or do not matter, for given laws.

    ``open_circuit_of_state`` says that k_open/k follows the state, rather than the last row of ``faces``.
    """
    first = first_rows(solid, permeability, osmotic)

    def evaluate(
        cells: Any, faces: Any, metric: Any, contents: Any, loads: Any, open_ends: Any, fluxes: Any, by_lower: Any,
        by_upper: Any, by_pressure: Any, potentials: Any,
    ) -> None:  # fmt: skip
        n = contents.shape[1]
        pressure = loads[PRESSURE]
        for i in range(n):
            tissue = tissue_at(solid, permeability, osmotic, first, cells, i)
            J, _ = variables(contents[0, i], 0.0)
            activity = bath_log_activity(tissue.osmotic, loads[CONCENTRATION])
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
                if open_ends[end] == 0.0:
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
                activity = bath_log_activity(tissue.osmotic, loads[CONCENTRATION])
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
