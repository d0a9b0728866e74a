"""Balances drawn up from the result alone, beside what the result says of them."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from columns import compression, swelling

import fvswell
from fvswell.physics.models import MODELS
from fvswell.physics.tissue import Array

CASES = {
    "compression": compression(geometry__cells=30),
    "swelling": swelling(geometry__cells=30),
    "layered": compression(
        geometry__cells=30, tissue__fixed_charge_density={"depth": [0.0, 0.5], "value": [1e-4, 3e-4]},
        tissue__fluid_fraction={"depth": [0.0, 0.5], "value": [0.85, 0.75]},
    ),
}  # fmt: skip


def contents(result: xr.Dataset) -> dict[str, Array]:
    """Water, anions and cations per area of the filter, from the fields of the cells."""
    volume = result["volume_ratio"].values * np.diff(result["x_bounds"])[:, 0]
    amounts = {"volume": volume.sum(axis=1)}
    fluid = volume * result["fluid_fraction"].values
    if "anion_flux" in result:
        amounts |= {ion: (fluid * result[f"{ion}_concentration"].values).sum(axis=1) for ion in ("anion", "cation")}
    return amounts


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("model", MODELS)
def test_every_step_closes_by_the_fields_alone(model: str, name: str) -> None:
    """Backward Euler: what a step adds is its length times the flux through the filter at its end.

    Each mismatch relative to all that has crossed until then, in every one of the 100 steps.
    """
    result = fvswell.run(CASES[name], model)
    steps = result["step_size"].values
    assert len(steps) == result.sizes["time"] - 1  # every step is in the file
    flux_of = {"volume": "water_flux", "anion": "anion_flux", "cation": "cation_flux"}
    for balance, amount in contents(result).items():
        entered = steps * result[flux_of[balance]].values[1:, 0]
        assert result[f"{balance}_balance_error"].max() < 1e-10
        if name == "swelling" and model == "biphasic":
            assert np.abs(entered).sum() < 1e-12  # nothing happens
            continue
        mismatch = np.abs(np.diff(amount) - entered) / np.cumsum(np.abs(entered))
        assert mismatch.max() < 1e-10, balance
        assert np.abs(entered).sum() > 1e-3 * amount[0]
    if model == "electrochemical":
        charge = steps * (result["cation_flux"] - result["anion_flux"]).values[1:, 0]
        anions = np.cumsum(np.abs(steps * result["anion_flux"].values[1:, 0]))
        assert (np.abs(charge) / anions).max() < 1e-10
        assert result["charge_balance_error"].max() < 1e-10


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("name", ["compression", "swelling", "layered"])
def test_error_controlled_scheme_conserves(model: str, name: str) -> None:
    changes = {"time.scheme": "esdirk43", "time.tolerance": 1e-3}
    result = fvswell.run(CASES[name].with_changes(changes), model)
    balances = ("volume", "anion", "cation", "charge") if model == "electrochemical" else ("volume",)
    for balance in balances:
        assert result[f"{balance}_balance_error"].max() < 1e-10, balance


def test_balances_close_under_a_prescribed_piston() -> None:
    """No water can leave that the piston does not displace."""
    case = compression(phase__loading={"name": "loading", "duration": 100.0,
                                       "piston": {"displacement": {"ramp_to": -0.05, "over": 50.0}}})  # fmt: skip
    result = fvswell.run(case, "electrochemical").isel(time=slice(0, 51))
    flux = result["water_flux"].values[1:, 0]
    speed = np.where(result["time"].values[1:] <= 50.0 + 1e-9, -0.05 / 50.0, 0.0)
    np.testing.assert_allclose(flux, speed, rtol=1e-9, atol=1e-12)
    assert result["volume_balance_error"].max() < 1e-10
