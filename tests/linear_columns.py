"""Columns under loads so small that the linear theory holds for them."""

from __future__ import annotations

from typing import Any

import numpy as np
from sample_cases import small_compression

from fvswell.case.case import Case
from fvswell.physics.models import BIPHASIC
from fvswell.physics.permeability import hydraulic_permeability
from fvswell.physics.solids import aggregate_modulus
from fvswell.simulation.column_run import ColumnRun

CONTROLLED = {"time": {"scheme": "esdirk43", "tolerance": 1e-5}}
SMALL = 1e-5  # MPa: so small a load leaves the column linear to a few 1e-5


def linear(duration: float, **loads: Any) -> Case:
    """A biphasic column of 100 cells in one phase; loads by keys with ``__`` for the dot."""
    phase = {"name": "only", "duration": duration} | {key: value for key, value in loads.items() if "__" not in key}
    for key, value in loads.items():
        if "__" in key:
            part, kind = key.split("__")
            phase[part] = phase.get(part, {}) | {kind: value}
    return small_compression(model="biphasic", geometry__cells=100, geometry__grading=20, **CONTROLLED, phase=[phase])


def modulus_and_time(case: Case) -> tuple[float, float]:
    """Aggregate modulus, MPa, and consolidation time h^2/(k H), s."""
    tissue = ColumnRun(case, BIPHASIC).tissue
    H = float(np.squeeze(aggregate_modulus(tissue.solid, tissue.fluid_fraction)))
    k = float(np.squeeze(hydraulic_permeability(tissue, 1.0)))
    return H, case.geometry.height**2 / (k * H)
