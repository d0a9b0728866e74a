"""The commands about many columns as a user meets them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import studies
from sample_cases import CASES, small_block, small_compression, small_swelling
from typer.testing import CliRunner, Result

from fvswell.cli.main import app
from fvswell.study.file import read_study


@pytest.fixture(autouse=True)
def _in_empty_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def fvswell(*arguments: str | Path) -> Result:
    """Run a command in this process; its output is no terminal."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


@pytest.fixture
def study_file() -> Path:
    path, counts = Path("small.toml"), {"stiffness": 3, "permeability": 4}
    path.write_text(studies.text(design=[{"name": "map", "kind": "grid", "counts": counts}]), encoding="utf-8")
    return path


def test_study_and_rules(study_file) -> None:
    ran = fvswell("study", study_file, "--processes", "1")
    assert ran.exit_code == 0
    assert "12 of 12 runs complete" in ran.stdout
    assert "12 of 12 runs, " in ran.stdout  # progress
    result = Path("output/small/study.nc")
    assert read_study(result).sizes["run"] == 12
    reported = fvswell("rules", result)
    assert reported.exit_code == 0
    for name in ("rules.json", "rules.csv", "rules.png", "rules.pdf"):
        assert f"wrote output/small/{name}" in reported.stdout
        assert result.with_name(name).stat().st_size > 0
    assert json.loads(result.with_name("rules.json").read_text())["source"].startswith("A small study (12 runs")
    assert "compression, loading: predictor" in reported.stdout
    assert "compression, loading: rule" in reported.stdout
    for command in (("study", study_file), ("rules", result)):  # files that are there are kept without --force
        refused = fvswell(*command)
        assert refused.exit_code == 2
        assert "--force" in refused.stderr
    assert fvswell("study", study_file, "--processes", "1", "--force", "--quiet").stdout == ""


def test_interrupted_studies_say_how_to_go_on(study_file, monkeypatch) -> None:
    def interrupt(*_args, **_options):
        raise KeyboardInterrupt

    monkeypatch.setattr("fvswell.study.run.run_study", interrupt)
    result = fvswell("study", study_file)
    assert result.exit_code == 130
    assert "the same command goes on" in result.stderr


@pytest.mark.parametrize("command", ["study", "rules", "advise", "sensitivity"])
def test_missing_files(command) -> None:
    result = fvswell(command, "nothing.toml")
    assert result.exit_code == 2
    assert "nothing.toml" in result.stderr
    assert "no such file" in result.stderr


def test_rules_of_what_is_no_study(tmp_path) -> None:
    Path("text.nc").write_text("not netCDF")
    assert fvswell("rules", "text.nc").exit_code == 2


def test_advise() -> None:
    Path("soft.toml").write_text(small_swelling().to_toml())
    result = fvswell("advise", "soft.toml", "--set", "tissue.youngs_modulus=0.4 MPa")
    assert result.exit_code == 0
    assert "youngs modulus 0.4 MPa" in result.stdout
    assert "recommended: " in result.stdout
    assert not list(Path().rglob("*.nc"))
    block = fvswell("advise", CASES / "plane_strain.toml")
    assert block.exit_code == 2
    assert "only columns" in block.stderr


def test_sensitivity() -> None:
    Path("case.toml").write_text(small_compression().to_toml())
    options = ("--samples", "8", "--model-samples", "2", "--processes", "1", "--spread", "1.2")
    result = fvswell("sensitivity", "case.toml", *options)
    assert result.exit_code == 0
    assert "20 of 20 runs of both models" in result.stdout
    assert "case, unloading: Sobol indices (predictor: 80 runs" in result.stdout
    assert Path("output/case/sensitivity.csv").exists()
    refused = fvswell("sensitivity", "case.toml", "--samples", "10", "--model-samples", "3")
    assert refused.exit_code == 2
    assert "--samples = 10: must be a power of two" in refused.stderr
    assert "--model-samples = 3: must be a power of two" in refused.stderr


def test_paper() -> None:
    protocols = [studies.protocol(), studies.protocol("swelling", "free_swelling.toml")]
    Path("sweep.toml").write_text(studies.text(protocol=protocols))
    cases = Path("cases")
    cases.mkdir()
    (cases / "compression.toml").write_text(small_compression().to_toml())
    (cases / "swelling.toml").write_text(small_swelling().to_toml())
    Path("block.toml").write_text(small_block().to_toml())
    options = ("--sweep", "sweep.toml", "--block", "block.toml", "--processes", "1", "-o", "figures")
    result = fvswell("paper", cases, *options)
    assert result.exit_code == 0
    assert "What the paper reports, and what comes out here" in result.stdout
    names = {path.name for path in Path("figures").iterdir()}
    pages = {f"figure{n}.{suffix}" for n in range(3, 10) for suffix in ("png", "pdf")}
    assert names == pages | {"paper.csv", "study.nc"}
    assert fvswell("paper", cases, *options).exit_code == 2
