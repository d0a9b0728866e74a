"""Runs that cannot go on: they say when, where and why, keep what there is, and never end silently wrong."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from columns import CASES, compression, single_phase

import fvswell
from fvswell import SolverError
from fvswell.case.case import MODELS, Case
from fvswell.fipy.body import FipyColumnBody
from fvswell.numerics.body import solve_stage
from fvswell.numerics.state import BALANCE, POINT, RESIDUAL
from fvswell.simulation.column_run import ColumnRun

Solve = Callable[..., bool]
IN_PYTHON = {"assembly": "fipy"}  # stages are solved in Python there, so that they can be replaced by wrong ones


def replace_solve(monkeypatch: pytest.MonkeyPatch, wrong: Callable[[Solve], Solve]) -> None:
    monkeypatch.setitem(solve_stage.implementations, FipyColumnBody, wrong(solve_stage.implementations[FipyColumnBody]))


@pytest.mark.parametrize("scheme", ["backward-euler", "esdirk43"])
def test_stopped_run_keeps_its_result_and_says_why(
    scheme: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From a strain of -5 % on, no stage converges; the anion's balance in cell 3 is the worst."""

    def stubborn(solve: Solve) -> Solve:
        def refuse(body: Any, unknowns: Any, contents: Any, *others: Any) -> bool:
            converged = solve(body, unknowns, contents, *others)
            if contents[0] @ body.widths < 0.95 * body.initial_height:
                others[-1][[BALANCE, POINT, RESIDUAL]] = 1, 3, 0.5
                return False
            return converged

        return refuse

    replace_solve(monkeypatch, stubborn)
    case = compression(geometry__cells=10, time__scheme=scheme, **IN_PYTHON)
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
    assert [file.name for file in tmp_path.iterdir()] == ["stopped.nc"]


def test_lost_matter_is_not_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """A solver that converges to something that does not conserve: the result is refused."""

    def leaking(solve: Solve) -> Solve:
        def leak(body: Any, unknowns: Any, contents: Any, *others: Any) -> bool:
            converged = solve(body, unknowns, contents, *others)
            contents[0] *= 1.0 - 1e-7
            return converged

        return leak

    replace_solve(monkeypatch, leaking)
    with pytest.raises(
        SolverError, match=r"a balance is off by .* of what is in the tissue and crossed its boundary"
    ) as raised:
        fvswell.run(compression(geometry__cells=10, time__steps_per_phase=5, **IN_PYTHON), "biphasic")
    assert raised.value.result.attrs["run_status"].startswith("stopped")
    assert raised.value.result["volume_balance_error"].max() > 1e-8


@pytest.mark.parametrize("model", MODELS)
def test_rounding_in_a_long_step_in_equilibrium_is_not_taken_for_a_loss(model: str) -> None:
    """The fluxes on fine cells of a permeable tissue are large differences; hardly an anion is in this one."""
    case = compression(
        geometry__cells=5, geometry__grading=50.0, tissue__youngs_modulus=1.7, tissue__hydraulic_permeability=0.055,
        bath__concentration=1.4e-6, time__steps_per_phase=1,
    )  # fmt: skip
    result = fvswell.run(single_phase(case, 2000.0, piston={"pressure": 0.0}), model)
    assert result.attrs["run_status"] == "complete"
    assert abs(float(result["global_strain"][-1])) < 1e-9


def squeezed(model: str) -> Case:
    """97 % of the water of the reference tissue pressed out in 5 s."""
    case = compression(model=model, geometry__cells=12)
    squeeze = {"ramp_to": 0.5 * (0.2 + 0.03 * 0.8) - ColumnRun(case).initial_height, "over": 5.0}
    return single_phase(case, 100.0, piston={"displacement": squeeze})


def test_piston_that_is_too_fast_for_the_water_is_reported() -> None:
    """The cells at the filter dry out: the solid alone bears any suction down to no water at all."""
    with pytest.raises(SolverError, match=r"stopped at t = 0.59.*without water at 0.0031 mm from the filter") as raised:
        fvswell.run(squeezed("biphasic"))
    result = raised.value.result
    assert 0.0 < result["fluid_fraction"].min() < 1e-3  # of 0.8 at the start
    assert result["volume_balance_error"].max() < 1e-8


def test_fixed_charge_keeps_the_last_of_the_water() -> None:
    """The same piston gets to its place where osmotic pressure grows without bound as the water leaves."""
    result = fvswell.run(squeezed("biphasic-swelling"))
    assert result.attrs["run_status"] == "complete"
    assert result["height"][-1] == pytest.approx(0.112, rel=1e-12)
    assert result["fluid_fraction"].min() > 1e-3
    assert result["volume_balance_error"].max() < 1e-10


def test_phase_that_never_relaxes_is_reported() -> None:
    """Relaxation times of a phase that begins in equilibrium and changes nothing."""
    case = fvswell.load_case(CASES / "confined_compression.toml").with_changes(
        {"phase.loading.piston.pressure": 0.0, "geometry.cells": 10}
    )
    with pytest.raises(SolverError, match="does not relax in phase loading; give its duration in s"):
        fvswell.run(case)
