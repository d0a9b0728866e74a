"""Numbers that say what to expect of a case before it is run: equilibria, times and permeabilities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fvswell.case.case import Case
from fvswell.physics.models import ELECTROCHEMICAL, MODELS
from fvswell.physics.osmotic import bath_log_activity, ion_concentrations
from fvswell.physics.permeability import hydraulic_permeability, open_circuit_ratio
from fvswell.physics.solids import aggregate_modulus
from fvswell.physics.tissue import Array, Tissue, fixed_charge_density
from fvswell.simulation.run import Setup, make_setup
from fvswell.simulation.sample_states import SampleState, sample_states

__all__ = ["Characteristics", "Equilibria", "characteristics", "salt_diffusivity"]


@dataclass(frozen=True)
class Equilibria:
    """Where a model is in equilibrium; nan where it has no water left."""

    initial_stretch: float  # height of the equilibrated sample over that of the stress-free solid
    initial_volume_ratio: float  # volume of the equilibrated sample over that of the stress-free solid
    strain: tuple[float, ...]  # of columns, under the loads that each phase ends with


@dataclass(frozen=True)
class Characteristics:
    """Derived numbers of a case."""

    equilibria: dict[str, Equilibria]  # by model
    states: dict[str, SampleState]  # the stress-free and the equilibrated sample, of the case's own model
    open_circuit_ratio: tuple[float, float]  # k_open/k of the equilibrated sample, least and largest
    drainage_length: float  # farthest way to the bath, mm: of columns the height of the equilibrated sample
    consolidation_time: float  # drainage length squared/(k H), s
    diffusion_time: float  # drainage length squared over the least salt diffusivity in the equilibrated sample, s


def characteristics(case: Case) -> Characteristics:
    """Derived numbers of a case.

    Raises
    ------
    SolverError
        If no equilibrium is found for a block.
    """
    setups = {name: make_setup(case, model) for name, model in MODELS.items()}
    full = setups[ELECTROCHEMICAL.name]
    tissue, J = full.tissue, full.initial_volume_ratio
    activity = bath_log_activity(tissue.osmotic, case.bath.concentration)
    ions = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), activity)
    ratio = np.atleast_1d(open_circuit_ratio(tissue, J, *ions))
    consolidation = hydraulic_permeability(tissue, 1.0) * aggregate_modulus(tissue.solid, tissue.fluid_fraction)
    length = full.drainage_length
    return Characteristics(
        equilibria={name: _equilibria(setup) for name, setup in setups.items()},
        states=sample_states(setups[case.model]),
        open_circuit_ratio=(float(ratio.min()), float(ratio.max())),
        drainage_length=length,
        consolidation_time=float(length**2 / np.min(consolidation)),
        diffusion_time=float(length**2 / np.min(salt_diffusivity(tissue, *ions))),
    )


def salt_diffusivity(tissue: Tissue, cation: Array, anion: Array) -> Array:
    """Diffusivity of salt in charged tissue where no current flows and the solid is held, mm2/s.

    D = (c+ + c-) D+ D-/(c+ D+ + c- D-): the slower ion is pulled along by the faster one, and the co-ion,
    being the scarce one, counts most.
    """
    D_cation, D_anion = tissue.cation_diffusivity, tissue.anion_diffusivity
    return (cation + anion) * D_cation * D_anion / (cation * D_cation + anion * D_anion)


def _equilibria(setup: Setup) -> Equilibria:
    volume_ratio = float(setup.initial_volume_ratio @ setup.volumes / setup.volumes.sum())
    return Equilibria(setup.initial_stretch, volume_ratio, tuple(setup.equilibrium_strains().tolist()))
