"""Tissue that varies with depth."""

from __future__ import annotations

import numpy as np
import pytest
from columns import compression, relaxed, swelling

import fvswell
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import MODELS

LAYERS = {
    "tissue__fixed_charge_density": {"depth": [0.0, 0.3, 0.5], "value": [1e-4, 3e-4, 2e-4]},
    "tissue__youngs_modulus": {"depth": [0.0, 0.5], "value": [0.25, 0.8]},
    "tissue__hydraulic_permeability": {"depth": [0.0, 0.5], "value": [3e-3, 5e-4]},
    "tissue__fluid_fraction": {"depth": [0.0, 0.5], "value": [0.85, 0.72]},
    "tissue__cation_diffusivity": {"depth": [0.0, 0.5], "value": [6e-4, 3e-4]},
}


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("protocol", ["compression", "swelling"])
def test_every_cell_reaches_its_own_equilibrium(model: str, protocol: str) -> None:
    make, pressure, bath = (compression, 0.25, 1.5e-4) if protocol == "compression" else (swelling, 0.0, 1e-4)
    case = make(geometry__cells=15, **LAYERS)
    result = fvswell.run(relaxed(case, 1e5, steps=30), model)
    tissue = case.tissue_at(result["x"].values)
    for index, load in ((0, (0.0, 1.5e-4)), (30, (pressure, bath)), (60, (0.0, 1.5e-4))):
        J = equilibrium_volume_ratio(MODELS[model].tissue(tissue), *load)
        expected = np.broadcast_to(J, 15)
        np.testing.assert_allclose(result["volume_ratio"][index], expected, rtol=0, atol=1e-6)
    if (model, protocol) != ("biphasic", "swelling"):
        assert np.ptp(result["volume_ratio"].values[30]) > 0.02  # they do differ


@pytest.mark.parametrize("model", MODELS)
def test_layers_converge_at_second_order(model: str) -> None:
    """Global strain under way, on 10, 20, 40 and 80 even cells; profiles linear between knots at cells' faces."""
    strain = []
    for cells in (10, 20, 40, 80):
        case = compression(geometry__cells=cells, geometry__grading=1.0, time__steps_per_phase=6, **LAYERS)
        strain.append(fvswell.run(case, model)["global_strain"].values)
    change = np.abs(np.diff(strain, axis=0)).max(axis=1)
    assert np.log2(change[-2] / change[-1]) == pytest.approx(2.0, abs=0.3)


def test_uniform_profile_is_the_uniform_tissue() -> None:
    uniform = {key: {"depth": [0.0, 0.5], "value": [value, value]} for key, value in (
        ("tissue__fixed_charge_density", 2e-4), ("tissue__youngs_modulus", 0.5), ("tissue__osmotic_coefficient", 0.83),
    )}  # fmt: skip
    small = {"geometry__cells": 10, "time__steps_per_phase": 5}
    one, other = (fvswell.run(compression(**small, **changes), "electrochemical") for changes in ({}, uniform))
    np.testing.assert_allclose(one["global_strain"], other["global_strain"], rtol=1e-11, atol=1e-13)
