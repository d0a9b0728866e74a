"""Tissues that several tests use."""

from __future__ import annotations

from typing import Any

import numpy as np

from fvswell.physics.constants import GAS_CONSTANT
from fvswell.physics.osmotic import OSMOTIC_LAWS
from fvswell.physics.permeability import PERMEABILITIES
from fvswell.physics.solids import SOLIDS
from fvswell.physics.tissue import Tissue

REFERENCE = {
    "youngs_modulus": 0.5,
    "poisson_ratio": 0.3,
    "stiffening_coefficient": 0.7,
    "shear_modulus": 0.2,
    "hydraulic_permeability": 1e-3,
    "permeability_exponent": 0.0,
    "permeability_power": 0.1,
    "permeability_coefficient": 1.6e-4,
    "fluid_fraction": 0.8,
    "fixed_charge_density": 2e-4,
    "osmotic_coefficient": 0.83,
    "osmotic_coefficient_per_charge": 500.0,
    "bath_osmotic_coefficient": 0.93,
    "activity_ratio": 1.0,
    "cation_diffusivity": 5e-4,
    "anion_diffusivity": 8e-4,
    "hindrance_factor": 0.4,
    "temperature": 298.0,
}
BATH = 1.5e-4  # mmol/mm3


def reference_tissue(
    solid: str = "neo-hookean", permeability: str = "exponential", osmotic: str = "constant", **changes: Any
) -> Tissue:
    """Reference cartilage of Wilson et al. (2005), Table 1, with changes: numbers, or arrays over points.

    Every parameter of every law has a value in `REFERENCE`, so the laws may be any of the registries.
    """
    assert set(changes) <= set(REFERENCE), f"no such property: {sorted(set(changes) - set(REFERENCE))}"
    values = REFERENCE | changes

    def law(chosen: Any) -> Any:
        return chosen(*(values[field] for field in chosen._fields))

    return Tissue(
        solid=law(SOLIDS[solid]), permeability=law(PERMEABILITIES[permeability]), osmotic=law(OSMOTIC_LAWS[osmotic]),
        thermal_energy=GAS_CONSTANT * values["temperature"], **{name: values[name] for name in Tissue._fields[3:-1]},
    )  # fmt: skip


def random_tissue(points: int, seed: int, solid: str = "neo-hookean", **changes: Any) -> Tissue:
    """Points drawn from the ranges over which the study varies the reference tissue; arrays ``(points,)``."""
    draw = np.random.default_rng(seed)
    values: dict[str, Any] = {
        "youngs_modulus": draw.uniform(0.1, 0.5, points),
        "poisson_ratio": draw.uniform(0.0, 0.45, points),
        "hydraulic_permeability": np.exp(draw.uniform(np.log(2e-4), np.log(5e-3), points)),
        "permeability_exponent": draw.uniform(0.0, 3.0, points),
        "fluid_fraction": draw.uniform(0.7, 0.85, points),
        "fixed_charge_density": draw.uniform(5e-5, 4e-4, points),
        "activity_ratio": draw.uniform(0.7, 1.3, points),
        "cation_diffusivity": 5e-4 * np.exp(draw.uniform(-np.log(5), np.log(5), points)),
        "anion_diffusivity": 8e-4 * np.exp(draw.uniform(-np.log(5), np.log(5), points)),
        "hindrance_factor": draw.uniform(0.0, 1.0, points),
    }
    return reference_tissue(solid, **(values | changes))


def point_of(tissue: Any, index: int) -> Any:
    """The tissue, or one of its laws, at one of its points: floats only."""
    return type(tissue)(
        *(
            point_of(part, index) if isinstance(part, tuple) else float(part if np.ndim(part) == 0 else part[index])
            for part in tissue
        )
    )
