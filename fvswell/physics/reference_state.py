"""The stress-free solid behind a sample that was measured in equilibrium with its bath, and back; Wilson et al. (2007).

Solid and fixed charge stay with the solid, so with J the volume ratio of the equilibrated sample

    n_f0 = n_f J - J + 1,        c_F0 = c_F n_f J/n_f0,        k0 such that k(J) is the permeability measured,

and one equation for J is left: the solid's stress balances the osmotic pressure of the charge that was measured. These
are columns, free to swell along their axis.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fvswell.physics.bracketed_root import bracketed_root
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.osmotic import ChargeDependentCoefficients, osmotic_pressure_difference
from fvswell.physics.permeability import permeability
from fvswell.physics.solids import uniaxial_stress
from fvswell.physics.tissue import Array, Tissue, fixed_charge_density, fluid_fraction

__all__ = ["equilibrated_tissue", "stress_free_at", "stress_free_tissue"]

_LEAST = 1e-6  # volume ratio that no sample comes near


def equilibrated_tissue(tissue: Tissue, bath_concentration: Array | float) -> tuple[Tissue, Array]:
    """A tissue with the numbers that are measured on it in equilibrium with a bath, and its volume ratio there.

    Parameters
    ----------
    tissue
        With the numbers of the stress-free solid.
    bath_concentration
        Of the salt, mmol/mm3.

    Returns
    -------
    tuple
        The tissue with fluid fraction, fixed charge density and, where its law has one, ``hydraulic_permeability`` of
        the swollen sample in place of the stress-free ones; and J.
    """
    J = equilibrium_volume_ratio(tissue, 0.0, bath_concentration)
    law: Any = tissue.permeability
    if "hydraulic_permeability" in law._fields:
        law = law._replace(hydraulic_permeability=permeability(law, J, tissue.fluid_fraction))
    return _with_numbers(tissue, law, fluid_fraction(tissue, J), fixed_charge_density(tissue, J)), J


def stress_free_tissue(measured: Tissue, bath_concentration: Array | float) -> tuple[Tissue, Array]:
    """The inverse of `equilibrated_tissue`: the stress-free numbers of a tissue, and its volume ratio in the bath.

    J is nan where no stress-free solid swells, or shrinks, to the sample.
    """
    bath = np.asarray(bath_concentration)

    def mismatch(J: Array) -> Array:
        tissue = stress_free_at(measured, J)
        stress = uniaxial_stress(tissue.solid, J, tissue.fluid_fraction)
        value: Array = stress - osmotic_pressure_difference(tissue, J, bath)
        return value

    most = 1.0 / (1.0 - np.asarray(measured.fluid_fraction))  # the solid alone
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        # fibres that overflow (nan) hold any swelling
        none = ~(mismatch(_LEAST * most) < 0.0) | (mismatch((1.0 - 1e-12) * most) < 0.0)
        low, high, start = (np.broadcast_to(J, none.shape) for J in (_LEAST * most, most, 1.0))
        J = bracketed_root(mismatch, start, low, high, none)
    return stress_free_at(measured, J), J


def stress_free_at(measured: Tissue, J: Array) -> Tissue:
    """The stress-free numbers of a tissue that was measured at the volume ratio J."""
    n_f0 = 1.0 - J * (1.0 - measured.fluid_fraction)
    law: Any = measured.permeability
    if "hydraulic_permeability" in law._fields:
        of_one = permeability(law._replace(hydraulic_permeability=1.0), J, n_f0)
        law = law._replace(hydraulic_permeability=law.hydraulic_permeability / of_one)
    return _with_numbers(measured, law, n_f0, measured.fixed_charge_density * measured.fluid_fraction * J / n_f0)


def _with_numbers(tissue: Tissue, permeability: Any, fluid_fraction: Array, fixed_charge_density: Array) -> Tissue:
    osmotic = tissue.osmotic
    if isinstance(osmotic, ChargeDependentCoefficients):
        osmotic = osmotic._replace(fixed_charge_density=fixed_charge_density)
    return tissue._replace(
        permeability=permeability, osmotic=osmotic, fluid_fraction=fluid_fraction,
        fixed_charge_density=fixed_charge_density,
    )  # fmt: skip
