"""Fit files are read with their cases and data, or refused with all that is wrong, and nothing is written."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from curves import TIMES, creep, relaxation
from typer.testing import CliRunner

import fvswell
from fvswell.case.case import CaseError
from fvswell.cli.main import app
from fvswell.fitting.simulated import Experiment


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A case, and a curve of it with noise."""
    (tmp_path / "case.toml").write_text(creep().to_toml(), encoding="utf-8")
    strain = Experiment.of(creep(), ["global_strain"], TIMES).histories({})[0]
    noisy = strain + 2e-4 * np.random.default_rng(1).standard_normal(len(TIMES))
    rows = [f"{time / 60.0:.8g},{-100.0 * value:.8g}" for time, value in zip(TIMES, noisy, strict=True)]
    (tmp_path / "creep.csv").write_text("time (min),compression (%)\n" + "\n".join(rows), encoding="utf-8")
    return tmp_path


MEASUREMENT = {
    "name": "creep", "file": "creep.csv", "value": "compression", "factor": -1, "quantity": "global_strain",
}  # fmt: skip
PARAMETER = {"name": "modulus", "key": "tissue.youngs_modulus", "start": "0.7 MPa"}


def content(measurement: dict[str, Any] | None = None, parameter: dict[str, Any] | None = None) -> dict[str, Any]:
    """A fit file; None in a table takes its key away."""
    tables = {"measurement": [MEASUREMENT | (measurement or {})], "parameter": [PARAMETER | (parameter or {})]}
    kept = {name: [{k: v for k, v in row.items() if v is not None} for row in rows] for name, rows in tables.items()}
    return {"title": "Creep", "case": "case.toml", "starts": 1, **kept}


def fit_file(folder: Path, *args: Any) -> Path:
    path = folder / "fit.toml"
    path.write_text(tomli_w.dumps(content(*args)), encoding="utf-8")
    return path


def test_a_fit_file_is_read_in_internal_units(folder: Path) -> None:
    problem = fvswell.load_fit(fit_file(folder, {"noise": "0.02 %", "start": "10 s", "points": 20}))
    (measurement,) = problem.measurements
    assert len(measurement) <= 20
    assert measurement.times[0] >= 0.0
    assert measurement.values.max() < 0.0
    assert measurement.noise == pytest.approx(2e-4 * measurement.size)  # a part of the range
    (parameter,) = problem.parameters.every
    assert (parameter.start, parameter.low, parameter.high) == pytest.approx((0.7, 0.07, 7.0))
    assert parameter.log


@pytest.mark.parametrize(
    ("measurement", "parameter", "reported"),
    [
        ({"value": "compresion"}, {}, 'measurement[creep].value = "compresion"'),
        ({"value": "compresion"}, {}, 'did you mean "compression (%)"?'),
        ({"quantity": "global_strian"}, {}, "did you mean global_strain?"),
        ({"quantity": "piston_pressure"}, {}, "is not a unit of pressure"),
        ({"unit": "kPa"}, {}, "is of dimension pressure"),
        ({"time_unit": "mm"}, {}, "is not a unit of time"),
        ({"phases": ["olny"]}, {}, 'did you mean "only"?'),
        ({"start": "1 h"}, {}, "has 0 rows in the phases that count"),
        ({"noise": "-1 %"}, {}, "must be above 0"),
        ({"noise": "1 mm"}, {}, "measurement[creep].noise"),
        ({"file": "crep.csv"}, {}, "no such file"),
        ({}, {"key": "tissue.youngs_modulsu"}, 'did you mean "tissue.youngs_modulus"?'),
        ({}, {"start": "8 MPa", "high": "1 MPa"}, "must be within the bounds"),
        ({}, {"low": "2 MPa", "high": "1 MPa"}, "must be above low"),
        ({}, {"low": 0.0, "scale": "log"}, "above 0"),
        ({}, {"start": "1 mm"}, "parameter[modulus].start"),
        ({}, {"fixed": True}, "leaves nothing to be fitted"),
        ({}, {"measurements": ["crep"]}, 'did you mean "creep"?'),
        ({}, {"key": "phase.only.duration", "start": None}, "is not a quantity"),
        ({"weight": 0.0}, {}, "must be above 0"),
        ({"name": None}, {}, "missing"),
    ],
)
def test_what_is_wrong_is_refused(
    folder: Path, measurement: dict[str, Any], parameter: dict[str, Any], reported: str
) -> None:
    with pytest.raises(CaseError) as error:
        fvswell.load_fit(fit_file(folder, measurement, parameter))
    assert reported in str(error.value)
    assert str(folder / "fit.toml") in str(error.value)


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("", "is empty"),
        ("time (s),compression (%)\n0,1\n2,1\n1,1\n3,2\n", "in line 4 1 comes after 2"),
        ("time (s),compression (%)\n0,1\n1,nan\n2,3\n", "must be a finite number"),
        ("time (s),compression (%)\n0,one\n", "must be a number"),
        ("time,compression (%)\n0,1\n1,2\n2,3\n", "does not say the unit"),
    ],
)
def test_bad_data_end_the_command_and_nothing_is_written(folder: Path, text: str, reported: str) -> None:
    (folder / "creep.csv").write_text(text, encoding="utf-8")
    done = CliRunner().invoke(app, ["fit", str(fit_file(folder)), "-o", str(folder / "out")])
    assert done.exit_code == 2
    assert reported in done.stderr
    assert not (folder / "out").exists()


def test_a_parameter_without_effect_ends_the_command(folder: Path) -> None:
    (folder / "case.toml").write_text(creep(model="biphasic").to_toml(), encoding="utf-8")
    path = fit_file(folder, {}, {"key": "tissue.fixed_charge_density", "start": None})
    done = CliRunner().invoke(app, ["fit", str(path), "-o", str(folder / "out")])
    assert done.exit_code == 2
    assert "makes no difference to any measured curve" in done.stderr
    assert not (folder / "out" / "fit.json").exists()


def test_the_command_writes_what_it_has_found(folder: Path) -> None:
    out = folder / "out"
    command = ["fit", str(fit_file(folder)), "-o", str(out), "--models", "biphasic-swelling,electrochemical"]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.stderr
    names = {"fit.nc", "fit.json", "parameters.csv", "curves.csv", "profiles.csv", "best.toml",
             "fit_curves.png", "fit_curves.pdf", "fit_profiles.png", "fit_profiles.pdf"}  # fmt: skip
    assert {path.name for path in out.iterdir()} == names
    summary = json.loads((out / "fit.json").read_text())
    (row,) = summary["parameters"]
    assert row["low"] < 0.5 < row["high"]
    assert row["value"] == pytest.approx(0.5, rel=0.05)
    assert [model["model"] for model in summary["models"]] == ["biphasic-swelling", "electrochemical"]
    assert fvswell.load_case(out / "best.toml").tissue.youngs_modulus == row["value"]
    curves = (out / "curves.csv").read_text().splitlines()
    assert len(curves) == 1 + len(TIMES)
    assert "90 % intervals by profile likelihood" in done.stdout
    assert "What the data can tell at the start" in done.stdout
    again = CliRunner().invoke(app, command)
    assert again.exit_code == 2
    assert "exists already; use --force" in again.stderr


def test_a_case_and_a_curve_will_do_without_a_fit_file(folder: Path) -> None:
    command = [
        "fit", str(folder / "case.toml"), "--data", str(folder / "creep.csv"), "--value", "compression",
        "--parameter", "youngs_modulus=0.1 MPa..2 MPa", "--no-profiles", "-q", "-o", str(folder / "out"),
    ]  # fmt: skip
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.stderr  # strain of the wrong sign: the fit goes to a bound, and says so
    assert done.stdout == ""
    row = json.loads((folder / "out" / "fit.json").read_text())["parameters"][0]
    assert row["at_bound"] in ("low", "high")


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        ([], "--data: missing"),
        (["--data", "creep.csv"], "--parameter: missing"),
        (["--data", "creep.csv", "--parameter", "youngs_modulus=1"], "must be KEY=LOW..HIGH"),
        (["--against", "electrochemical", "--parameter", "a", "--parameter", "b"], "must be one with --against"),
    ],
)
def test_options_that_do_not_go_together_are_refused(folder: Path, arguments: list[str], reported: str) -> None:
    given = [str(folder / each) if each.endswith(".csv") else each for each in arguments]
    done = CliRunner().invoke(app, ["fit", str(folder / "case.toml"), *given, "-o", str(folder / "out")])
    assert done.exit_code == 2
    assert reported in done.stderr


def test_histories_of_a_result_can_be_fitted(folder: Path) -> None:
    fvswell.run(creep(), path=folder / "result.nc")
    path = fit_file(folder, {"file": "result.nc", "value": "global_strain", "factor": None})
    result = fvswell.fit(fvswell.load_fit(path), with_profiles=False)
    assert result.values["modulus"] == pytest.approx(0.5, rel=1e-6)


def test_data_begins_a_case_and_a_fit_that_can_be_read(folder: Path) -> None:
    recording = Path(__file__).with_name("relaxation.mach1.txt")
    out = folder / "begun"
    done = CliRunner().invoke(
        app, ["data", str(recording), "--height", "1.2 mm", "--radius", "2 mm", "-o", str(out)]
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    assert {path.name for path in out.iterdir()} == {"case.toml", "fit.toml", "data.png", "data.pdf"}
    assert "1 ramp" in done.stdout
    problem = fvswell.load_fit(out / "fit.toml")
    (measurement,) = problem.measurements
    assert measurement.quantity == "top_force"
    assert measurement.values.max() > 0.5
    assert problem.parameters.names == ("youngs_modulus", "permeability", "fibre_stiffness")
    refused = CliRunner().invoke(app, ["data", str(recording), "--height", "1 N", "-o", str(folder / "other")])
    assert refused.exit_code == 2
    assert "--height = 1 N" in refused.stderr
    assert not (folder / "other").exists()


def test_a_measured_drive_can_be_the_load(folder: Path) -> None:
    times = np.linspace(0.0, 400.0, 81)
    moved = -0.05 * np.minimum(times / 40.0, 1.0)
    rows = "\n".join(f"{time:.8g},{value:.8g}" for time, value in zip(times, moved, strict=True))
    (folder / "drive.csv").write_text("time [s],position [mm]\n" + rows, encoding="utf-8")
    load = {"file": "drive.csv", "time": "time [s]", "value": "position [mm]"}
    case = tomli_w.dumps({**_plain(relaxation().to_toml()), "phase": [
        {"name": "only", "duration": 400.0, "piston": {"displacement": load}}
    ]})  # fmt: skip
    (folder / "driven.toml").write_text(case, encoding="utf-8")
    driven = fvswell.load_case(folder / "driven.toml")
    ours = Experiment.of(driven, ["piston_pressure"], TIMES).histories({})
    np.testing.assert_allclose(ours, Experiment.of(relaxation(), ["piston_pressure"], TIMES).histories({}), rtol=5e-3)


def _plain(text: str) -> dict[str, Any]:
    import tomllib

    return tomllib.loads(text)
