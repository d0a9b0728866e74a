"""Where long runs end: the equilibria worked out beforehand, and the same for both swelling models."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from columns import compression, relaxed, single_phase, swelling

import fvswell
from fvswell.physics.models import MODELS

# the numbers below were worked out with R = 8.3145 N mm/(mmol K)
COMPARABLE = {"bath__temperature": 298.0 * 8.3145 / 8.314462618, "geometry__cells": 12}


@pytest.fixture(scope="module")
def equilibria() -> dict[str, xr.Dataset]:
    """Loading by 0.25 MPa to equilibrium and back, in each model."""
    case = relaxed(compression(**COMPARABLE))
    return {model: fvswell.run(case, model) for model in MODELS}


@pytest.mark.parametrize(
    ("model", "free", "loaded"),
    [("biphasic", 1.0, 0.682746), ("biphasic-swelling", 1.054503, 0.822614), ("electrochemical", 1.054503, 0.822614)],
)
def test_compression(equilibria: dict[str, xr.Dataset], model: str, free: float, loaded: float) -> None:
    J = equilibria[model]["volume_ratio"].values
    np.testing.assert_allclose(J[0], free, atol=1e-6)
    np.testing.assert_allclose(J[40], loaded, atol=1e-6)
    np.testing.assert_allclose(J[-1], free, atol=1e-6)  # nothing is left of the way there
    strain = equilibria[model]["global_strain"].values[[40, -1]]
    np.testing.assert_allclose(strain, equilibria[model]["equilibrium_strain"], atol=1e-6)


@pytest.mark.parametrize("model", ["biphasic-swelling", "electrochemical"])
@pytest.mark.parametrize(("bath", "expected"), [(1e-4, 1.127643), (5e-5, 1.236596)])
def test_free_swelling(model: str, bath: float, expected: float) -> None:
    case = relaxed(single_phase(swelling(**COMPARABLE), 1.0, piston={"pressure": 0.0}, bath_concentration=bath), 3e4)
    np.testing.assert_allclose(fvswell.run(case, model)["volume_ratio"][-1], expected, atol=1e-6)


def test_equal_osmotic_coefficients() -> None:
    case = compression(tissue__osmotic_coefficient=1.0, bath__osmotic_coefficient=1.0, **COMPARABLE)
    result = fvswell.run(relaxed(case, steps=20), "biphasic-swelling")
    np.testing.assert_allclose(result["volume_ratio"][[0, -1]], 1.166001, atol=1e-6)


def test_both_swelling_models_reach_the_same_equilibrium(equilibria: dict[str, xr.Dataset]) -> None:
    for field in ("volume_ratio", "cation_concentration", "osmotic_pressure", "fluid_pressure", "electric_potential"):
        one, other = (
            equilibria[model][field].values[[0, 40, -1]] for model in ("biphasic-swelling", "electrochemical")
        )
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-7 * np.abs(one).max(), err_msg=field)


def test_in_equilibrium_everything_is_the_baths(equilibria: dict[str, xr.Dataset]) -> None:
    """Potentials of the bath throughout, no flux, and the piston carried by the solid and the excess pressure."""
    end = equilibria["electrochemical"].isel(time=40)
    bath_pressure = 2 * 0.93 * 8.3145 * 298.0 * 1.5e-4
    np.testing.assert_allclose(end["virtual_concentration"], 1.5e-4, rtol=1e-6)
    np.testing.assert_allclose(end["water_potential"], -bath_pressure, rtol=1e-6)
    start_flux = float(np.abs(equilibria["electrochemical"]["water_flux"]).max())
    assert np.abs(end["water_flux"]).max() < 1e-5 * start_flux
    np.testing.assert_allclose(end["effective_stress"] - end["fluid_pressure"], -0.25, atol=1e-12)
