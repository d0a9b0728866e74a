"""The solver against exact solutions for small steps, and its observed order in space."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import xarray as xr
from columns import compression, single_phase, strain_at

import fvswell
from fvswell.exact.confined_compression import creep_fluid_pressure, creep_strain, relaxation_pressure
from fvswell.exact.linear_swelling import LinearColumn
from fvswell.physics.models import MODELS
from fvswell.physics.tissue import Array
from fvswell.simulation.column_run import ColumnRun

TIMES = np.array([5.0, 20.0, 100.0, 400.0])
# amplitudes of the steps, of which the second is half the first
STEPS = {"load": (0.0, 2e-3), "bath": (1.5e-4, -1e-6)}
H = 0.5 / 1.2 + 4 / 3 * 0.5 / 2.6  # aggregate modulus of the reference tissue


@cache
def linear_part(model: str, step: str, cells: int, grading: float, tolerance: float) -> xr.Dataset:
    """Response to a step over its amplitude, freed of its second-order part by two amplitudes."""
    rest, amplitude = STEPS[step]
    results = []
    for share in (1.0, 0.5):
        value = rest + share * amplitude
        loads: dict[str, Any] = {"piston": {"pressure": value}} if step == "load" else {"bath_concentration": value}
        case = single_phase(compression(geometry__cells=cells, geometry__grading=grading), 400.0, **loads)
        case = case.with_changes(
            {"time.scheme": "esdirk43", "time.tolerance": tolerance, "output.times": TIMES.tolist()}
        )
        results.append(fvswell.run(case, model))
    names = ["global_strain", "volume_ratio", "water_potential"]
    names += ["virtual_concentration"] if model != "biphasic" else []
    whole, half = (result[names] - result[names].isel(time=0) for result in results)
    return (2.0 * half / 0.5 - whole) / amplitude


def exact(model: str) -> LinearColumn:
    run = ColumnRun(compression(), MODELS[model])
    return LinearColumn.at_equilibrium(run.model, run.tissue, 0.5, 0.0, 1.5e-4)


def unit_step(step: str) -> dict[str, float]:
    return {"delta_pressure": 1.0} if step == "load" else {"delta_concentration": 1.0}


def strain_error(model: str, step: str, cells: int, grading: float, tolerance: float) -> Array:
    """Of the global strain at each time, over the largest."""
    expected = exact(model).global_strain(TIMES, **unit_step(step))[0]
    return (strain_at(linear_part(model, step, cells, grading, tolerance), TIMES) - expected) / np.abs(expected).max()


CASES = [("biphasic", "load"), ("biphasic-swelling", "load"), ("biphasic-swelling", "bath"),
         ("electrochemical", "load"), ("electrochemical", "bath")]  # fmt: skip


@pytest.mark.parametrize(("model", "step"), CASES)
def test_strain_follows_the_exact_solution(model: str, step: str) -> None:
    assert np.abs(strain_error(model, step, 50, 20.0, 1e-5)).max() < 1e-3


@pytest.mark.parametrize(("model", "step"), CASES)
def test_profiles_follow_the_exact_solution(model: str, step: str) -> None:
    """J, mu_f and ln c~ along the column, from 5 s on, over the change at the filter."""
    result = linear_part(model, step, 50, 20.0, 1e-5).sel(time=TIMES, method="nearest")
    column = exact(model)
    centres = ColumnRun(compression(), MODELS[model]).grid.centres
    profile = column.profile(centres * column.volume_ratio.item(), TIMES, **unit_step(step))
    pairs = [(result["volume_ratio"], profile.volume_ratio[0]), (result["water_potential"], profile.water_potential[0])]
    if model == "electrochemical":
        pairs.append((result["virtual_concentration"] / 1.5e-4, profile.log_activity[0]))
    for values, expected in pairs:
        scale = np.abs(expected).max()
        assert scale > 0.0
        assert np.abs(values - expected).max() < 4e-3 * scale


def test_swelling_overshoots_as_the_exact_solution_says() -> None:
    """A weaker bath: the strain at 400 s is above the final one, for the salt has yet to diffuse out."""
    strain = strain_at(linear_part("electrochemical", "bath", 50, 20.0, 1e-5), TIMES) * -1e-6
    final = exact("electrochemical").global_strain(np.array([1e7]), delta_concentration=-1e-6)[0, 0]
    assert strain[-1] > 1.02 * final


@pytest.mark.parametrize("grading", [1.0, 20.0], ids=["uniform", "graded"])
@pytest.mark.parametrize(
    ("model", "step"), [("biphasic", "load"), ("electrochemical", "load"), ("electrochemical", "bath")]
)
def test_second_order_in_space(model: str, step: str, grading: float) -> None:
    """Error of the global strain, from 20 s on, on 6, 12 and 24 cells, the error in time being far less."""
    errors = [np.abs(strain_error(model, step, cells, grading, 5e-6))[1:].max() for cells in (6, 12, 24)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 1.75)
    assert orders[-1] < 2.3


@pytest.mark.parametrize("model", MODELS)
def test_second_order_in_space_at_large_strain(model: str) -> None:
    """The reference compression, backward Euler: differences between 10, 20, 40 and 80 cells, all fields of J."""
    means = []
    for cells in (10, 20, 40, 80):
        case = single_phase(compression(geometry__cells=cells, geometry__grading=4.0), 200.0, piston={"pressure": 0.25})
        result = fvswell.run(case.with_changes({"time.steps_per_phase": 12}), model).isel(time=[3, 6, 12])
        means.append(result["global_strain"].values)
    change = np.abs(np.diff(means, axis=0)).max(axis=1)
    orders = np.log2(change[:-1] / change[1:])
    assert orders[-1] == pytest.approx(2.0, abs=0.2)


# ---- the biphasic classics -------------------------------------------------------------------------------


def biphasic(**loads: object) -> xr.Dataset:
    case = single_phase(compression(geometry__cells=50), 1000.0, **loads)
    changes = {"time.scheme": "esdirk43", "time.tolerance": 1e-5, "output.times": [2.0, 10.0, 50.0, 200.0, 700.0]}
    return fvswell.run(case.with_changes(changes), "biphasic").isel(time=slice(1, None))


def test_creep_of_terzaghi_and_mow() -> None:
    """A load of 1e-5 of the modulus: strain and pore pressure."""
    pressure = 1e-5 * H
    result = biphasic(piston={"pressure": pressure})
    time = result["time"].values
    expected = creep_strain(H, 1e-3, 0.5, pressure, time)
    np.testing.assert_allclose(result["global_strain"], expected, rtol=0, atol=3e-4 * np.abs(expected).max())
    expected = creep_fluid_pressure(H, 1e-3, 0.5, pressure, result["x"].values, time[:, None])
    np.testing.assert_allclose(result["fluid_pressure"], expected, rtol=0, atol=3e-3 * pressure)


def test_stress_relaxation_of_mow() -> None:
    """A piston that moves in by 1e-5 of the height in 50 s and stands still: its pressure is found."""
    result = biphasic(piston={"displacement": {"ramp_to": -5e-6, "over": 50.0}})
    expected = relaxation_pressure(H, 1e-3, 0.5, 5e-6, 50.0, result["time"].values)
    np.testing.assert_allclose(result["piston_pressure"], expected, rtol=0, atol=1e-3 * expected.max())
    assert expected.max() > 2.0 * expected[-1]  # there was something to relax
    np.testing.assert_allclose(result["height"][2:], 0.5 - 5e-6, rtol=1e-14)


def test_negative_osmosis_that_the_grid_makes_vanishes_with_it() -> None:
    """Without hindrance a small step to a weaker bath draws water out of cells too large for the first layer.

    In them the first flow is that of the jumps of the potentials, L dy, of which the salt's draws water out and wins.
    Where the layer is resolved, water and salt share it, and the strain is the exact a sqrt(t), with a > 0.
    """
    time = 1.0
    case = single_phase(
        compression(tissue__hindrance_factor=0.0), time, piston={"pressure": 0.0}, bath_concentration=1.49e-4
    )
    case = case.with_changes({"time": {"scheme": "esdirk43", "tolerance": 1e-5}, "output.times": [time]})
    run = ColumnRun(case)
    column = LinearColumn.at_equilibrium(run.model, run.tissue, 0.5, 0.0, 1.5e-4)
    expected = column.early_strain(column.boundary_change(0.0, -1e-6)).item()
    assert expected > 0.0
    found = [
        float(fvswell.run(case.with_changes(grid))["global_strain"][-1])
        for grid in (
            {"geometry.cells": 5, "geometry.grading": 1},
            {"geometry.cells": 50, "geometry.grading": 20},
            {"geometry.cells": 200, "geometry.grading": 200},
        )
    ]
    assert found[0] < 0.0
    np.testing.assert_allclose(found[1:], expected, rtol=0.01)
