"""Tissues that several tests use."""

from __future__ import annotations

from typing import Any

import numpy as np

from fvswell.physics.tissue import Tissue

REFERENCE = {
    "youngs_modulus": 0.5,
    "poisson_ratio": 0.3,
    "stiffening_coefficient": 0.7,
    "hydraulic_permeability": 1e-3,
    "permeability_exponent": 0.0,
    "fluid_fraction": 0.8,
    "fixed_charge_density": 2e-4,
    "osmotic_coefficient": 0.83,
    "activity_ratio": 1.0,
    "cation_diffusivity": 5e-4,
    "anion_diffusivity": 8e-4,
    "hindrance_factor": 0.4,
    "temperature": 298.0,
}
REFERENCE_BATH = {"bath_concentration": 1.5e-4, "bath_osmotic_coefficient": 0.93}


def reference_tissue(solid: str = "neo-hookean", rows: int = 1, **changes: Any) -> Tissue:
    """Reference cartilage of Wilson et al. (2005), Table 1, with changes: numbers, or one for each row."""
    values = {name: np.asarray(changes.pop(name, value), dtype=float) for name, value in REFERENCE.items()}
    assert not changes, f"no such property: {sorted(changes)}"
    rows = max(rows, *(value.size for value in values.values()))
    return Tissue(solid, **{name: np.broadcast_to(v.reshape(-1, 1), (rows, 1)) for name, v in values.items()})


def random_tissue(rows: int, seed: int, solid: str = "neo-hookean", **changes: Any) -> Tissue:
    """Rows drawn from the ranges over which the study varies the reference tissue."""
    draw = np.random.default_rng(seed)
    values: dict[str, Any] = {
        "youngs_modulus": draw.uniform(0.1, 0.5, rows),
        "poisson_ratio": draw.uniform(0.0, 0.45, rows),
        "hydraulic_permeability": np.exp(draw.uniform(np.log(2e-4), np.log(5e-3), rows)),
        "permeability_exponent": draw.uniform(0.0, 3.0, rows),
        "fluid_fraction": draw.uniform(0.7, 0.85, rows),
        "fixed_charge_density": draw.uniform(5e-5, 4e-4, rows),
        "activity_ratio": draw.uniform(0.7, 1.3, rows),
        "cation_diffusivity": 5e-4 * np.exp(draw.uniform(-np.log(5), np.log(5), rows)),
        "anion_diffusivity": 8e-4 * np.exp(draw.uniform(-np.log(5), np.log(5), rows)),
        "hindrance_factor": draw.uniform(0.0, 1.0, rows),
    }
    return reference_tissue(solid, rows, **(values | changes))
