"""The figure of a case before it is run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sample_cases import CASES
from typer.testing import CliRunner

from fvswell.case.case import load_case
from fvswell.cli.main import app
from fvswell.reporting.case_figure import case_figure, load_curves
from fvswell.reporting.part_marks import block_outline


def test_load_curves_are_what_acts() -> None:
    case = load_case(CASES / "cyclic.toml")
    curves = load_curves(case, [1500.0, 1000.0])
    times, pressure = curves["piston.pressure"]
    assert np.interp(5.0, times[:400], pressure[:400]) == pytest.approx(0.05, rel=0.02)  # half of the ramp
    second = pressure[402:-1]
    assert (second.max(), second.min()) == (pytest.approx(0.15, rel=1e-3), pytest.approx(0.05, rel=1e-3))
    assert curves["piston.pressure"].changes
    assert not curves["filter.bath_concentration"].changes
    relaxing = load_curves(load_case(CASES / "stress_relaxation.toml"), [400.0, 7200.0])["piston.displacement"]
    np.testing.assert_allclose(relaxing.values[403:-1], -0.1, rtol=1e-12)  # goes on without being named


def test_parts_of_an_edge_share_its_nodes() -> None:
    case = load_case(CASES / "indentation.toml")
    x, y = np.array([0.0, 0.25, 0.5, 0.75, 1.5, 3.0]), np.array([0.0, 0.5, 1.0])
    nodes = np.stack([part.ravel() for part in np.meshgrid(x, y)])
    parts = {part.name: part for part in case.parts}
    on_indenter, beside = (nodes[:, block_outline(parts[name], (x, y))] for name in ("indenter", "surface"))
    np.testing.assert_array_equal(on_indenter[0], [0.0, 0.25, 0.5, 0.75])
    np.testing.assert_array_equal(beside[0], [0.75, 1.5, 3.0])
    assert set(on_indenter[1]) == set(beside[1]) == {1.0}


def test_figure_names_every_part_and_every_load_that_changes() -> None:
    figure = case_figure(load_case(CASES / "electro_osmosis.toml"), [2000.0, 2000.0])
    texts = " ".join(text.get_text() for text in figure.findobj(lambda artist: hasattr(artist, "get_text")))
    for word in ("filter", "piston", "anion electrode", "open to a bath", "compression", "current density", "pressure"):
        assert word in texts


def test_check_draws_the_case(tmp_path: Path) -> None:
    path = tmp_path / "case.pdf"
    done = CliRunner().invoke(app, ["check", str(CASES / "permeation.toml"), "--figure", str(path)])
    assert done.exit_code == 0, done.stderr
    assert path.read_bytes().startswith(b"%PDF")
    assert f"wrote {path}" in done.stdout.replace("\n", "")
