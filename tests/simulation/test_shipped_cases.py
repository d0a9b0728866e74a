"""Every case that comes with fvswell runs, at a small size, and does what its experiment is about."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

import fvswell
from fvswell.analysis.cycles import cycles
from fvswell.case.shipped import shipped_cases
from fvswell.results.file import COMPLETE

COLUMN: dict[str, Any] = {"geometry.cells": 12, "geometry.grading": 5, "time.tolerance": 1e-3}
BLOCK: dict[str, Any] = {"geometry.cells": [10, 5], "time.tolerance": 1e-2, "output.per_phase": 10}


def result_of(name: str, **changes: Any) -> xr.Dataset:
    """The full model of a case, whole and with closed balances."""
    size = BLOCK if name == "indentation" else COLUMN
    case = fvswell.load_case(shipped_cases()[name]).with_changes(size | changes)
    result = fvswell.run(case, "electrochemical")
    assert result.attrs["run_status"] == COMPLETE
    for balance in ("volume", "anion", "cation"):
        assert float(result[f"{balance}_balance_error"].max()) < 1e-10
    return result


def at_end(result: xr.Dataset, name: str, phase: int) -> float:
    return float(np.interp(result["phase_end"][phase], result["time"], result[name]))


def test_stress_relaxation_peaks_at_the_end_of_the_ramp_and_falls() -> None:
    result = result_of("stress-relaxation")
    peak = float(result["time"][int(result["piston_pressure"].values.argmax())])
    assert peak == pytest.approx(400.0, rel=0.01)
    assert at_end(result, "piston_pressure", 1) < 0.6 * float(result["piston_pressure"].max())
    np.testing.assert_allclose(result["piston_force"], 28.3 * result["piston_pressure"], rtol=1e-12)


def test_isometric_stress_overshoots_ends_where_the_salt_does_and_comes_back() -> None:
    result = result_of("isometric-bath-step")
    np.testing.assert_allclose(result["global_strain"], 0.0, atol=1e-9)
    assert float(result["piston_pressure"].max()) > 1.2 * at_end(result, "piston_pressure", 0) > 0.0
    assert abs(at_end(result, "piston_pressure", 1)) < 1e-3 * at_end(result, "piston_pressure", 0)


def test_permeation_lets_through_less_than_in_proportion_to_the_pressure() -> None:
    """Ten times the pressure: compacted tissue lets less than ten times as much through."""
    result = result_of("permeation", **{"geometry.grading": 1})
    flow = [
        -np.interp([end - 300.0, end], result["time"], result["filter_water_volume"]) @ [-1.0, 1.0] / 300.0
        for end in result["phase_end"].values
    ]
    assert 0.0 < flow[1] < 9.0 * flow[0]
    assert flow[0] == pytest.approx(1e-3 * 0.02 / 0.5, rel=0.3)
    assert at_end(result, "piston_potential", 1) < at_end(result, "piston_potential", 0) < 0.0
    np.testing.assert_array_equal(result["piston_current"], 0.0)


def test_a_load_gives_a_streaming_potential_and_a_current_moves_water() -> None:
    result = result_of("electro-osmosis")
    assert float(np.abs(result["piston_potential"].where(result["time"] < 2000.0)).max()) > 0.1
    before, after = (at_end(result, "global_strain", phase) for phase in (0, 1))
    assert after > before + 1e-3  # water comes along with the current from the bath
    assert at_end(result, "piston_current", 1) == pytest.approx(-1e-6, rel=1e-12)


def test_cycles_lag_and_lose_energy() -> None:
    case = fvswell.load_case(shipped_cases()["cyclic"]).with_changes(COLUMN)
    (found,) = cycles(case, result_of("cyclic"))
    assert found.pressure == pytest.approx(0.05, rel=1e-3)
    assert 10.0 < found.lag < 50.0
    assert found.loss > 0.0


def test_the_soft_surface_takes_up_most_of_the_strain() -> None:
    result = result_of("depth-dependent")
    J = result["volume_ratio"]
    loaded = J.isel(time=int(result["global_strain"].values.argmin())) / J.isel(time=0) - 1.0
    assert float(loaded[0]) < 1.5 * float(loaded[-1]) < 0.0


def test_weak_baths_swell_cartilage() -> None:
    assert at_end(result_of("dose-response"), "global_strain", 0) > 0.1


def test_indenter_relaxes_under_displacement_and_creeps_under_force() -> None:
    result = result_of("indentation")
    first = result["time"] <= float(result["phase_end"][0])
    assert float(result["indenter_force"].where(first).max()) > 1.3 * at_end(result, "indenter_force", 0)
    assert at_end(result, "indenter_force", 1) == pytest.approx(0.15, rel=1e-9)
    assert at_end(result, "indenter_displacement", 1) < -0.06
    np.testing.assert_allclose(result["bottom_force"], result["indenter_force"], atol=2e-3)
    assert at_end(result, "surface_water_volume", 1) + at_end(result, "right_water_volume", 1) < 0.0
