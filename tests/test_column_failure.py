"""Runs that cannot go on: they say when, where and why, keep what there is, and never end silently wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from columns import compression, march, single_phase

import fvswell
from fvswell import SolverError
from fvswell.case.case import MODELS, Case
from fvswell.column.newton import ColumnSystem
from fvswell.numerics.system import LoadValues, Solution, Stage
from fvswell.numerics.time_stepping import Marcher, State, Step
from fvswell.physics.tissue import Array
from fvswell.simulation.column_batch import ColumnBatch


@pytest.fixture
def stubborn(monkeypatch: pytest.MonkeyPatch) -> None:
    """From a strain of -5 % on, no step converges; the anion's balance in cell 3 is the worst."""
    solve = ColumnSystem.solve

    def refuse(self: ColumnSystem, guess: Array, loads: LoadValues, stage: Stage) -> Solution:
        solution = solve(self, guess, loads, stage)
        if solution.loads["height"][0] < 0.95 * 0.52725:
            solution.converged[:] = False
            solution.residual[1, :, 3] = 0.5
        return solution

    monkeypatch.setattr(ColumnSystem, "solve", refuse)


@pytest.mark.parametrize("scheme", ["backward-euler", "sdirk2"])
@pytest.mark.usefixtures("stubborn")
def test_stopped_run_keeps_its_result_and_says_why(scheme: str, tmp_path: Path) -> None:
    case = compression(geometry__cells=10, time__scheme=scheme)
    path = tmp_path / "stopped.nc"
    with pytest.raises(SolverError) as raised:
        fvswell.run(case, path=path)
    result = raised.value.result
    status = result.attrs["run_status"]
    assert status.startswith("stopped at t = ")
    assert "in phase loading" in status
    assert "the anion balance did not converge" in status
    assert "mm from the filter" in status
    assert status in str(raised.value)
    stopped_at = float(status.split("t = ")[1].split(" s")[0])
    assert result["time"][-1] == pytest.approx(stopped_at, rel=1e-5)
    assert -0.0501 < result["global_strain"][-1] < -0.03  # as far as it went
    assert result["volume_balance_error"].max() < 1e-10
    in_file = fvswell.read_result(path)
    assert in_file.attrs["run_status"] == status
    np.testing.assert_array_equal(in_file["global_strain"], result["global_strain"])
    assert not list(tmp_path.glob("*.part"))


def test_lost_matter_is_not_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """A solver that converges to something that does not conserve: the result is refused."""
    solve = ColumnSystem.solve

    def leak(self: ColumnSystem, *arguments: Any) -> Solution:
        solution = solve(self, *arguments)
        solution.contents[0] *= 1.0 - 1e-7
        return solution

    monkeypatch.setattr(ColumnSystem, "solve", leak)
    with pytest.raises(
        SolverError, match=r"a balance is off by .* of what is in the tissue and crossed its boundary"
    ) as raised:
        fvswell.run(compression(geometry__cells=10), "biphasic")
    assert raised.value.result.attrs["run_status"].startswith("stopped")
    assert raised.value.result["volume_balance_error"].max() > 1e-8


@pytest.mark.parametrize("model", MODELS)
def test_rounding_in_a_long_step_at_rest_is_not_taken_for_a_loss(model: str) -> None:
    """The fluxes on fine cells of a permeable tissue are large differences; hardly an anion is in this one."""
    case = compression(
        geometry__cells=5, geometry__grading=50.0, tissue__youngs_modulus=1.7, tissue__hydraulic_permeability=0.055,
        bath__concentration=1.4e-6, time__steps_per_phase=1,
    )  # fmt: skip
    result = fvswell.run(single_phase(case, 2000.0, piston_pressure=0.0), model)
    assert result.attrs["run_status"] == "complete"
    assert abs(float(result["global_strain"][-1])) < 1e-9


def squeezed(model: str) -> Case:
    """97 % of the water of the reference tissue pressed out in 5 s."""
    case = compression(model=model, geometry__cells=12)
    height = float(ColumnBatch.of([case]).initial_height[0])
    squeeze = {"ramp_to": 0.5 * (0.2 + 0.03 * 0.8) - height, "over": 5.0}
    return single_phase(case, 100.0, piston_displacement=squeeze)


def test_piston_that_is_too_fast_for_the_water_is_told() -> None:
    """The cells at the filter dry out: the solid alone bears any suction down to no water at all."""
    with pytest.raises(SolverError, match=r"stopped at t = 0.59.*without water at 0.0031 mm from the filter") as raised:
        fvswell.run(squeezed("biphasic"))
    result = raised.value.result
    assert 0.0 < result["fluid_fraction"].min() < 1e-6
    assert result["volume_balance_error"].max() < 1e-8


def test_fixed_charge_keeps_the_last_of_the_water() -> None:
    """The same piston gets to its place where osmotic pressure grows without bound as the water leaves."""
    result = fvswell.run(squeezed("biphasic-swelling"))
    assert result.attrs["run_status"] == "complete"
    assert result["height"][-1] == pytest.approx(0.112, rel=1e-12)
    assert result["fluid_fraction"].min() > 1e-3
    assert result["volume_balance_error"].max() < 1e-10


def test_phase_that_never_relaxes_is_told() -> None:
    """Relaxation times of a phase that begins at rest and changes nothing."""
    case = fvswell.load_case(Path(__file__).parents[1] / "cases" / "confined_compression.toml").with_changes(
        {"phase.loading.piston_pressure": 0.0, "geometry.cells": 10}
    )
    with pytest.raises(SolverError, match="does not relax in phase loading; give its duration in s"):
        fvswell.run(case)


def test_stopped_row_is_where_its_last_accepted_step_left_it() -> None:
    """An observer may end a row: the state is that of its last step."""
    marcher, _ = march(compression(geometry__cells=6))
    seen: list[float] = []

    def stop_early(state: State, step: Step) -> None:
        seen.append(float(state.elapsed[0]))
        if len(seen) == 3:
            loop.stop(0)

    start = ColumnBatch.of([compression(geometry__cells=6)]).start()
    loop = Marcher(marcher.system, marcher.protocol, marcher.control, start, [stop_early])
    loop.run()
    assert seen == [12.0, 24.0, 36.0]
    assert loop.state.elapsed[0] == 36.0
