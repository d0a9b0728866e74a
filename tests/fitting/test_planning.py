"""What a plan foretells is what fits then reach."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from curves import TIMES, TRUTH, creep, measured, problem, relaxation, sought
from typer.testing import CliRunner

import fvswell
from fvswell.case.case import CaseError
from fvswell.cli.main import app
from fvswell.fitting.candidates import candidate_problems, read_variation, varied_cases
from fvswell.fitting.measurement import Measurement
from fvswell.fitting.planning import plan
from fvswell.fitting.schema import ParameterTable

NAMES = ("youngs_modulus", "hydraulic_permeability")
TABLES = [ParameterTable.model_validate({"name": name, "key": f"tissue.{name}"}) for name in NAMES]


@pytest.mark.parametrize("seed", range(3))
def test_predicted_intervals_are_those_of_fits_to_noisy_curves(seed: int) -> None:
    """Within 20 %, by profile likelihood with the noise given."""
    curve = measured(relaxation(), "piston_pressure", 0.005, seed)
    noise = 0.005 * measured(relaxation(), "piston_pressure").size
    known = Measurement("curve", curve.case, curve.quantity, curve.times, curve.values, noise)
    (planned,) = plan([problem([known], sought(*NAMES, start=1.0))]).protocols
    result = fvswell.fit(problem([known], sought(*NAMES)))
    assert planned.tells is not None
    for name, predicted in zip(NAMES, planned.tells.together, strict=True):
        low, high = result.intervals[name]
        assert 0.5 * np.log(high / low) == pytest.approx(predicted, rel=0.2)


def test_points_that_are_counted_by_weight_are_as_good_as_measured_ones() -> None:
    cases = {"relaxation": relaxation()}
    sparse, dense = (
        plan(candidate_problems(cases, TABLES, ["piston_pressure"], ["1 kPa"], every, 0.9)).protocols[0]
        for every in (1.0, 0.25)
    )
    assert sparse.tells is not None
    assert dense.tells is not None
    assert dense.points == 4.0 * sparse.points
    np.testing.assert_allclose(sparse.tells.together / dense.tells.together, 2.0, rtol=1e-6)


def test_two_protocols_add_up_and_the_budget_is_kept() -> None:
    cases = {"relaxation": relaxation(), "creep": creep(model="electrochemical")}
    planned = candidate_problems(cases, TABLES, ["piston_pressure"], ["1 kPa"], None, 0.9)
    found = plan(planned[:1] * 2)
    single, pair = found.protocols[0], found.pairs[0]
    assert single.tells is not None
    assert pair.tells is not None
    np.testing.assert_allclose(single.tells.together / pair.tells.together, np.sqrt(2.0), rtol=1e-9)
    assert pair.duration == 800.0
    assert found.best is pair
    limited = plan(planned[:1] * 2, budget=500.0)
    assert limited.best is limited.protocols[0]
    assert plan(planned[:1], budget=100.0).best is None


def test_protocols_that_tell_nothing_of_a_parameter_say_so() -> None:
    cases = {"creep": creep(model="biphasic")}
    tables = [*TABLES, ParameterTable.model_validate({"name": "charge", "key": "tissue.fixed_charge_density"})]
    found = plan(candidate_problems(cases, tables, ["global_strain"], ["0.1 %"], None, 0.9))
    assert found.never_told == (*NAMES, "charge")
    assert found.best is None


def test_variations_are_combined_and_named() -> None:
    varied = [read_variation("bath.concentration=0.1 M,1 M"), read_variation("phase.only.piston.pressure=0.1, 0.2")]
    cases = varied_cases({"creep": creep()}, varied)
    assert len(cases) == 4
    assert cases["bath concentration 1 M, piston pressure 0.2"].bath.concentration == 1e-3
    with pytest.raises(CaseError, match="must be KEY=VALUE"):
        read_variation("bath.concentration=0.1 M,,")
    with pytest.raises(CaseError, match="fluid_fraction"):
        varied_cases({"creep": creep()}, [("tissue.fluid_fraction", [0.5, 2.0])])


def test_plan_by_the_command_line(tmp_path: Path) -> None:
    path = tmp_path / "relaxation.toml"
    path.write_text(relaxation().to_toml(), encoding="utf-8")
    command = [
        "plan", str(path), "--parameter", "youngs_modulus", "--parameter", "fixed_charge_density",
        "--quantity", "piston_pressure", "--noise", "1 kPa", "--vary", "bath.concentration=0.15 M,1 M",
        "--budget", "1 h", "-o", str(tmp_path / "plan"),
    ]  # fmt: skip
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.stderr
    assert {each.name for each in (tmp_path / "plan").iterdir()} == {"plan.csv", "plan.png", "plan.pdf"}
    assert "best within 3600 s: bath concentration" in done.stdout
    rows = (tmp_path / "plan" / "plan.csv").read_text().splitlines()
    assert len(rows) == 4  # two protocols and their pair
    refused = CliRunner().invoke(app, ["plan", str(path), "--noise", "1 kPa", "-o", str(tmp_path / "no")])
    assert refused.exit_code == 2
    assert "--parameter: missing" in refused.stderr
    assert "--quantity: missing" in refused.stderr


def test_two_baths_tell_the_charge_better_than_twice_one() -> None:
    """The salt screens the charge: only its change tells it from the stiffness."""
    cases = {name: relaxation(bath__concentration=value) for name, value in (("low", 1.5e-4), ("high", 1e-3))}
    tables = [*TABLES, ParameterTable.model_validate({"name": "charge", "key": "tissue.fixed_charge_density"})]
    planned = candidate_problems(cases, tables, ["piston_pressure"], ["1 kPa"], None, 0.9)
    found = plan([*planned, planned[0], planned[1]])
    scores = {each.names: each.score for each in found.pairs}
    assert scores["low", "high"] < 0.5 * min(scores["low", "low"], scores["high", "high"])
    assert len(TIMES) == 50
    assert set(NAMES) < set(TRUTH)
