"""The cases that come with fvswell: valid, without warnings, found by the name of their experiment."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from fvswell.case.case import Case, CaseError
from fvswell.case.shipped import shipped_cases, shipped_text
from fvswell.cli.main import app

EXPERIMENTS = (
    "confined-compression", "cyclic", "depth-dependent", "dose-response", "electro-osmosis", "free-swelling",
    "indentation", "isometric-bath-step", "permeation", "plane-strain", "stress-relaxation", "unconfined-disc",
)  # fmt: skip


def test_every_experiment_is_there() -> None:
    assert set(EXPERIMENTS) <= shipped_cases().keys()


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_cases_are_valid_and_explained(name: str) -> None:
    text = shipped_text(name)
    assert Case.from_toml(text, name).title
    assert text.startswith("# ")


def test_underscores_will_do_and_misspelt_names_are_helped() -> None:
    assert shipped_text("stress_relaxation") == shipped_text("stress-relaxation")
    with pytest.raises(CaseError, match="did you mean indentation"):
        shipped_text("indention")


def test_new_writes_the_case_of_an_experiment(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    done = CliRunner().invoke(app, ["new", str(path), "--like", "indentation"])
    assert done.exit_code == 0
    assert path.read_text(encoding="utf-8") == shipped_text("indentation")
    both = CliRunner().invoke(app, ["new", str(path), "--like", "cyclic", "--tissue", "annulus-fibrosus"])
    assert both.exit_code == 2
    assert "cannot stand beside --tissue" in both.stderr
