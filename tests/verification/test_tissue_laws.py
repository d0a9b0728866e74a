"""Osmotic laws, fibres and the reference state in whole runs of columns and blocks."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import xarray as xr
from columns import compression, relaxed, single_phase, strain_at, swelling
from sample_cases import CASES

import fvswell
from fvswell.case.case import Case
from fvswell.column.grid import column_grid
from fvswell.exact.linear_swelling import LinearColumn
from fvswell.physics.equilibrium import equilibrium_volume_ratio, isotropic_equilibrium_volume_ratio
from fvswell.physics.models import MODELS
from fvswell.physics.tissue import Array
from fvswell.simulation.block_run import BlockRun
from fvswell.simulation.column_run import ColumnRun
from fvswell.simulation.sample_states import EQUILIBRATED, STRESS_FREE, sample_states, states_in

ACTIVITY = {"tissue__osmotic": "activity"}
ISOTROPIC = {"directions": "isotropic", "modulus": 1.0, "exponent": 2.0, "power": 2.5}
ARCADE = {
    "directions": "along", "angle": {"depth": [0.0, 0.5], "value": [90.0, 0.0]}, "law": "logarithmic",
    "modulus": {"depth": [0.0, 0.5], "value": [0.5, 1.0]}, "exponent": 8.0,
}  # fmt: skip
SWELLING = ("biphasic-swelling", "electrochemical")


def disc(changes: dict[str, Any], cells: tuple[int, int] = (10, 2)) -> Case:
    """The shipped disc on few cells, in equal steps."""
    equal = {"time": {"scheme": "backward-euler", "steps_per_phase": 40}, "geometry.cells": list(cells)}
    return fvswell.load_case(CASES / "unconfined_disc.toml").with_changes(equal | changes)


# The activity law


@pytest.mark.parametrize(
    ("bath", "J"), [(0.05, 1.221992), (0.1, 1.162412), (0.15, 1.131315), (0.5, 1.061868), (1.0, 1.034894)]
)
def test_equilibria_of_the_activity_law(bath: float, J: float) -> None:
    case = compression(**ACTIVITY).with_changes({"bath.concentration": bath * 1e-3})
    for model in SWELLING:
        assert ColumnRun(case, MODELS[model]).initial_stretch == pytest.approx(J, abs=1e-6)


def test_swelling_models_come_to_the_same_states_by_the_activity_law() -> None:
    """Under 0.25 MPa in 0.15 M, J = .858429; and in 0.1 M, 1.162412."""
    for case, J in ((compression(**ACTIVITY), 0.858429), (swelling(**ACTIVITY), 1.162412)):
        ends = {}
        for model in SWELLING:
            result = fvswell.run(relaxed(case), model)
            ends[model] = result.sel(time=result["phase_end"][0].item(), method="nearest")
            np.testing.assert_allclose(ends[model]["volume_ratio"], J, atol=1e-6)
        for name in ("fixed_charge_density", "osmotic_pressure", "fluid_pressure"):
            np.testing.assert_allclose(ends[SWELLING[0]][name], ends[SWELLING[1]][name], rtol=1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_balances_close_with_the_new_laws(model: str) -> None:
    """Columns with the activity law, fibres that vary, in an equilibrated reference state; every step."""
    changes = {"tissue__reference_state": "equilibrated", "tissue__fibres": [ISOTROPIC, ARCADE]} | ACTIVITY
    for case in (compression(geometry__cells=20, **changes), swelling(geometry__cells=20, **changes)):
        result = fvswell.run(case, model)
        for name in (name for name in result if str(name).endswith("balance_error")):
            assert result[name].max() < 1e-10, name


TIMES = np.array([5.0, 20.0, 100.0, 400.0])
STEPS = {"load": (0.0, 2e-3), "bath": (1.5e-4, -1e-6)}
REINFORCED = ACTIVITY | {"tissue__fibres": [{"directions": "isotropic", "modulus": 0.3}]}


@cache
def linear_part(step: str, cells: int) -> Array:
    """Strain after a step over its amplitude, freed of its second-order part by two amplitudes."""
    before, amplitude = STEPS[step]
    strains = []
    for share in (1.0, 0.5):
        value = before + share * amplitude
        loads: dict[str, Any] = {"piston": {"pressure": value}} if step == "load" else {"bath_concentration": value}
        case = single_phase(compression(geometry__cells=cells, **REINFORCED), 400.0, **loads)
        case = case.with_changes({"time": {"scheme": "esdirk43", "tolerance": 5e-6}, "output": {"times": TIMES}})
        strains.append(strain_at(fvswell.run(case, "electrochemical"), TIMES))
    return (4.0 * strains[1] - strains[0]) / amplitude


@pytest.mark.parametrize("step", STEPS)
def test_small_steps_follow_the_exact_solution_in_second_order(step: str) -> None:
    """The activity law and isotropic fibres, which are all in tension: the linear column has both."""
    run = ColumnRun(compression(**REINFORCED), MODELS["electrochemical"])
    assert run.initial_stretch > 1.02
    column = LinearColumn.at_equilibrium(run.model, run.tissue, 0.5, 0.0, 1.5e-4)
    unit = {"delta_pressure": 1.0} if step == "load" else {"delta_concentration": 1.0}
    exact = column.global_strain(TIMES, **unit)[0]
    errors = [np.abs(linear_part(step, cells) - exact)[1:].max() / np.abs(exact).max() for cells in (12, 24, 50)]
    assert errors[-1] < 1e-3
    assert np.log2(errors[0] / errors[1]) > 1.75


# Fibres


def test_column_with_fibres_swells_to_its_equilibrium() -> None:
    case = compression(tissue__fibres=[ISOTROPIC, ARCADE])
    result = fvswell.run(relaxed(case), "electrochemical")
    run = ColumnRun(case, MODELS["electrochemical"])
    end = result.sel(time=result["phase_end"][1].item(), method="nearest")
    np.testing.assert_allclose(end["volume_ratio"], run.initial_volume_ratio, rtol=1e-6)
    plain = ColumnRun(compression(), MODELS["electrochemical"]).initial_volume_ratio
    assert np.all(run.initial_volume_ratio < plain)
    assert np.ptp(run.initial_volume_ratio) > 1e-3  # the fibres vary


def test_free_swelling_of_a_disc_with_fibres() -> None:
    """Isotropic fibres: the closed form in all directions. Planar ones hold the radius, and leave the height."""
    isotropic = BlockRun(disc({"tissue.fibres": [ISOTROPIC]}), MODELS["electrochemical"])
    J = isotropic_equilibrium_volume_ratio(isotropic.tissue, 1.5e-4)
    np.testing.assert_allclose(isotropic.initial_volume_ratio, J, rtol=1e-6)
    assert isotropic.initial_stretch == pytest.approx(float(J) ** (1 / 3), rel=1e-6)
    planar = BlockRun(disc({"tissue.fibres": [{"directions": "planar", "modulus": 200.0}]}), MODELS["electrochemical"])
    column = equilibrium_volume_ratio(planar.tissue, 0.0, 1.5e-4)  # fibres that stiff allow no widening
    np.testing.assert_allclose(planar.initial_volume_ratio, column, rtol=1e-3)
    assert planar.initial_stretch > 1.04 > isotropic.initial_stretch


@cache
def relaxation(fibres: float, poisson_ratio: float = 0.0) -> xr.Dataset:
    """Force of a biphasic disc of planar fibres, compressed by 1 % much faster than the water leaves."""
    family = [{"directions": "planar", "modulus": fibres}] if fibres else []
    return fvswell.run(
        disc(
            {
                "tissue.fibres": family, "tissue.poisson_ratio": poisson_ratio, "model": "biphasic",
                "phase": [
                    {"name": "ramp", "duration": 0.5, "top": {"displacement": {"ramp_to": -0.005, "over": 0.5}}},
                    {"name": "hold", "duration": 2e4},
                ],
                "time": {"scheme": "esdirk43", "tolerance": 1e-3}, "output": {"per_phase": 20},
            },
            (40, 2),
        )
    )  # fmt: skip


@pytest.mark.parametrize("poisson_ratio", [0.1, 0.3])
def test_disc_without_fibres_relaxes_by_no_more_than_a_third(poisson_ratio: float) -> None:
    force = relaxation(0.0, poisson_ratio)["top_force"].values
    assert force.max() / force[-1] == pytest.approx(1.5 / (1.0 + poisson_ratio), rel=0.01)
    assert force.max() / force[-1] <= 1.5


def test_disc_with_fibres_relaxes_as_measured_cartilage_does() -> None:
    """Planar fibres of 4 xi = 24 times E: 6.5 to 8.5 times the force in equilibrium, which they do not change."""
    force = relaxation(3.0)["top_force"].values
    assert 6.5 < force.max() / force[-1] < 8.5
    assert force[-1] == pytest.approx(relaxation(0.0)["top_force"].values[-1], rel=0.02)


@pytest.mark.parametrize("kind", ["plane-strain", "axisymmetric"])
@pytest.mark.parametrize("model", MODELS)
def test_blocks_of_every_model_conserve_with_fibres_that_vary(kind: str, model: str) -> None:
    """Fibres along, across and around, whose amount varies in space, and the activity law."""
    families = [
        {"directions": "along", "angle": 30.0, "tilt": 20.0, "modulus": {"x": [0.0, 1.5], "value": [0.0, 2.0]}},
        {"directions": "planar", "normal": "x", "modulus": 0.5},
        {"directions": "isotropic", "law": "logarithmic", "modulus": 0.2, "exponent": 10.0},
    ]
    changes: dict[str, Any] = {"tissue.fibres": families, "tissue.osmotic": "activity", "time.steps_per_phase": 8}
    case = disc({}, (6, 2))
    if kind == "plane-strain":
        changes |= {"geometry.kind": "plane-strain", "geometry.width": 1.5}
    result = fvswell.run(case.with_changes(changes), model)
    for name in (name for name in result if str(name).endswith("balance_error")):
        assert result[name].max() < 1e-10, name
    assert result["top_force"].values[-1] > 0.0


# The reference state


@pytest.mark.parametrize("model", MODELS)
def test_sample_is_the_one_that_was_measured(model: str) -> None:
    """Height, water, charge and permeability at the start are those of the case, in every model, varying ones too."""
    profile = {"depth": [0.0, 0.5], "value": [1e-4, 3e-4]}
    for changes in ({}, {"tissue__fixed_charge_density": profile, "tissue__fibres": [ARCADE]}):
        case = compression(
            tissue__reference_state="equilibrated", tissue__permeability_exponent=2.0, geometry__cells=12,
            **ACTIVITY, **changes,
        )  # fmt: skip
        run = ColumnRun(case, MODELS[model])
        start = fvswell.run(case, model).isel(time=0)
        assert start["height"] == pytest.approx(0.5, rel=1e-12)
        np.testing.assert_allclose(start["fluid_fraction"], 0.8, rtol=1e-12)
        if model != "biphasic":  # which has no ions
            sample = column_grid(0.5, 12, 20.0)
            measured = np.interp(sample.centres, *profile.values()) if changes else 2e-4
            np.testing.assert_allclose(start["fixed_charge_density"], measured, rtol=1e-12)
        states = sample_states(run)
        assert states[EQUILIBRATED].hydraulic_permeability == pytest.approx(1e-3, rel=1e-12)
        if model == "biphasic":
            assert states[STRESS_FREE] == pytest.approx(states[EQUILIBRATED], rel=1e-12)
        else:
            assert states[STRESS_FREE].height < 0.49


def test_both_states_are_in_the_result_and_conserve_water_and_charge() -> None:
    result = fvswell.run(compression(geometry__cells=10), "electrochemical")
    states = states_in(result.attrs)
    assert states[STRESS_FREE] == pytest.approx((0.5, 0.8, 2e-4, 1e-3), rel=1e-12)
    swollen = states[EQUILIBRATED]
    assert swollen.height == pytest.approx(0.5 * 1.054503, abs=1e-6)
    assert swollen.height * (1.0 - swollen.fluid_fraction) == pytest.approx(0.5 * 0.2, rel=1e-12)
    charge = swollen.height * swollen.fluid_fraction * swollen.fixed_charge_density
    assert charge == pytest.approx(0.5 * 0.8 * 2e-4, rel=1e-12)


@pytest.mark.parametrize("bottom", ["roller", "fixed"])
def test_block_comes_to_the_sample_that_was_measured(bottom: str) -> None:
    """A disc that is free, and one that is glued and whose stress-free shape is not a cylinder."""
    changes = {
        "tissue.reference_state": "equilibrated", "tissue.osmotic": "activity",
        "tissue.fixed_charge_density": {"x": [0.0, 1.5], "value": [2e-4, 2.5e-4]}, "tissue.fibres": [ISOTROPIC],
    }  # fmt: skip
    case = disc(changes | {"boundary.bottom.mechanical": bottom}, (6, 4))
    run = BlockRun(case, MODELS["electrochemical"])
    sample = BlockRun(disc({}, (6, 4)), MODELS["biphasic"]).grid
    positions = run.block.positions(run.state.unknowns)
    np.testing.assert_allclose(positions, sample.vertices, atol=1e-10)
    J = run.initial_volume_ratio
    np.testing.assert_allclose(1.0 - (1.0 - run.tissue.fluid_fraction) / J, 0.8, rtol=1e-9)
    charge = run.tissue.fixed_charge_density * run.tissue.fluid_fraction / (J - 1.0 + run.tissue.fluid_fraction)
    np.testing.assert_allclose(charge, np.interp(sample.centres[0], [0.0, 1.5], [2e-4, 2.5e-4]), rtol=1e-9)
    assert np.ptp(J) > 1e-3
