"""What is reported of cases of blocks that cannot be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from sample_cases import CASES, small_block
from typer.testing import CliRunner

from fvswell.case.case import Case, CaseError
from fvswell.cli.main import app

TEXT = (CASES / "plane_strain.toml").read_text(encoding="utf-8")


def problems(**changes: Any) -> str:
    with pytest.raises(CaseError) as error:
        small_block(**changes)
    return str(error.value)


@pytest.mark.parametrize(
    ("changes", "reported"),
    [
        ({"geometry__edges__right__permeable": False}, "no part is open to a bath: at least one has to be"),
        (
            {"geometry__edges__left__displacement": "fixed"},
            "the part top is straight, but ends at the part left, which is fixed",
        ),
        (
            {"geometry__edges__bottom__displacement": "free", "geometry__edges__left__displacement": "free"},
            "nothing keeps the block from moving along x or moving along y",
        ),
        ({"geometry__edges__bottom__displacement": "free"}, "nothing keeps the block from moving along y"),
        ({"geometry__probe": ["11 mm", "5 mm"]}, "lies outside the block, which is 10 mm x 5 mm"),
        ({"geometry__cells": [0, 4]}, "geometry.cells"),
        ({"geometry__height": 0.0}, "geometry.height"),
        ({"geometry__width": "-1 mm"}, "geometry.width"),
        ({"geometry__grading": 0.5}, "geometry.grading"),
        ({"geometry__finest_at": ["rihgt"]}, "right"),
        ({"geometry__edges__top__displacement": "glued"}, "geometry.edges.top.displacement"),
        ({"phase__compression__bottom": {"pressure": 0.1}}, "the edge is fixed: it can be given for free or tied"),
        ({"phase__compression__right": {"force": 0.1}}, "the edge is free: it can be given for tied"),
        ({"phase__compression__top": {"displacement": -0.1}}, "jumps, which needs infinite pressure"),
        ({"geometry__height": 1e9}, "times as long as wide, more than 100000: change the lengths"),
        ({"geometry__grading": 1e7}, "must be at least 1 and at most 1e+06"),
        ({"geometry__cells": [20, 10**9]}, "must be a whole number from 1 to 1000"),
        ({"phase__swelling__duration": "1 relaxation times"}, "relaxation times are of columns"),
        (
            {"tissue__youngs_modulus": {"depth": [0.0, 1.0], "value": [0.5, 1.0]}},
            "varies along another axis: in a block give {x = [...], y = [...], value = [[...]]}",
        ),
    ],
)
def test_block_that_cannot_be_is_refused(changes: dict[str, Any], reported: str) -> None:
    assert reported in problems(**changes)


def test_axis_of_a_disc_is_a_closed_roller() -> None:
    reported = problems(
        geometry__kind="axisymmetric", geometry__radius=10.0, geometry__edges__left__permeable=True,
        geometry__width=None,
    )  # fmt: skip
    assert "the part left lies on the axis of the disc: it has to be a roller, closed and insulating" in reported


def test_all_problems_are_reported_at_once() -> None:
    reported = problems(geometry__probe=[11.0, 5.0], geometry__edges__right__permeable=False).splitlines()
    assert len(reported) == 2
    assert all("plane_strain.toml" in line for line in reported)


def test_command_line_refuses_with_code_2(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(TEXT.replace('probe = ["10 mm", "5 mm"]', 'probe = ["10 mm", "6 mm"]'), encoding="utf-8")
    done = CliRunner().invoke(app, ["check", str(path)])
    assert done.exit_code == 2
    assert f"error: {path}: geometry.probe = [10 mm, 6 mm]: lies outside the block" in done.stderr.replace('"', "")


def test_case_of_a_block_survives_writing() -> None:
    case = Case.from_toml(TEXT)
    assert Case.from_toml(case.to_toml()) == case


def test_ramps_of_edges_that_outlast_their_phase_are_refused() -> None:
    reported = problems(phase__compression__top={"pressure": {"ramp_to": 0.1, "over": 3e4}})
    assert "phase[compression].top.pressure" in reported
    assert "over: 30000 s is longer than the phase, 20000 s" in reported


def test_edges_that_would_be_moved_through_the_block_are_refused() -> None:
    reported = problems(phase__compression__top={"displacement": {"ramp_to": -9.0, "over": 100.0}})
    assert "phase[compression].top.displacement" in reported
    assert "moves the edge through the block, which is less than" in reported


def test_charge_that_peaks_between_even_points_is_seen() -> None:
    """All knots of a profile are looked at: the osmotic coefficient must stay above 0 at each."""
    peak = {"x": [0.0, 4.99, 4.991, 4.992, 10.0], "y": [0.0], "value": [[2e-4, 2e-4, 1e-2, 2e-4, 2e-4]]}
    reported = problems(tissue__fixed_charge_density=peak, tissue__osmotic_coefficient=None,
                    tissue__osmotic_coefficient_per_charge=500.0)  # fmt: skip
    assert "osmotic_coefficient_per_charge" in reported


@pytest.mark.parametrize(
    ("changes", "reported"),
    [
        ({"geometry__edges__left": "fixed"}, "must be a table with the heading [geometry.edges.left]"),
        ({"edges": 3}, "belongs under [geometry]"),
        (
            {"phase__compression__displacement": -1},
            "belongs under [phase.left] or [phase.right] or [phase.bottom] or [phase.top]",
        ),
    ],
)
def test_misplaced_keys_are_sent_to_their_headings(changes: dict[str, Any], reported: str) -> None:
    assert reported in problems(**changes)
