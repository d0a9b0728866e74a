"""The numbers of a sample in its two states: as the stress-free solid, and in equilibrium with its first bath."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fvswell.physics.permeability import hydraulic_permeability
from fvswell.physics.tissue import Array
from fvswell.simulation.setup import Setup

__all__ = ["EQUILIBRATED", "STRESS_FREE", "SampleState", "sample_states", "state_attributes", "states_in"]

STRESS_FREE, EQUILIBRATED = "stress_free", "equilibrated"


class SampleState(NamedTuple):
    """Means over the sample; those of water and charge conserve both."""

    height: float  # mm
    fluid_fraction: float
    fixed_charge_density: float  # mmol per mm3 of fluid
    hydraulic_permeability: float  # mm4/(N s)


def sample_states(setup: Setup) -> dict[str, SampleState]:
    """The stress-free and the equilibrated state of a sample, by `STRESS_FREE` and `EQUILIBRATED`; nan without one."""
    tissue, volumes = setup.tissue, setup.volumes
    height = setup.stress_free_height
    charge = tissue.fixed_charge_density * tissue.fluid_fraction * volumes

    def state(height: float, J: Array) -> SampleState:
        water, total = (J - 1.0 + tissue.fluid_fraction) * volumes, J * volumes
        k = np.broadcast_to(hydraulic_permeability(tissue, J), J.shape)
        return SampleState(
            height, float(water.sum() / total.sum()), float(np.sum(charge) / water.sum()),
            float((k * total).sum() / total.sum()),
        )  # fmt: skip

    return {
        STRESS_FREE: state(height, np.ones(len(volumes))),
        EQUILIBRATED: state(height * setup.initial_stretch, setup.initial_volume_ratio),
    }


def state_attributes(states: dict[str, SampleState]) -> dict[str, float]:
    """Both states as attributes of a result, such as ``stress_free_height``."""
    return {f"{name}_{field}": value for name, state in states.items() for field, value in state._asdict().items()}


def states_in(attributes: dict[str, object]) -> dict[str, SampleState]:
    """Both states from the attributes of a result; of an older one, nothing."""
    found = {}
    for name in (STRESS_FREE, EQUILIBRATED):
        values = [attributes.get(f"{name}_{field}") for field in SampleState._fields]
        if all(isinstance(value, float) for value in values):
            found[name] = SampleState(*(float(value) for value in values))  # type: ignore[arg-type]
    return found
