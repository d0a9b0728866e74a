"""Data files are read with their units, or refused with what is wrong in which line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fvswell.case.case import Case, CaseError
from fvswell.fitting.data import read_data
from fvswell.fitting.data_file import split_heading
from fvswell.fitting.measured import thinned
from fvswell.fitting.stages import recognised, steps_of
from fvswell.fitting.starter import recording_of, starter_case

MACH1 = Path(__file__).with_name("relaxation.mach1.txt")


def written(folder: Path, text: str, name: str = "data.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("heading", "name", "unit"),
    [
        ("time (s)", "time", "s"), ("Force [N]", "Force", "N"), ("Time, s", "Time", "s"), ("time_s", "time", "s"),
        ("Position (z), mm", "Position (z)", "mm"), ("flux (mm^3/(mm^2 s))", "flux", "mm^3/(mm^2 s)"),
        ("global_strain", "global_strain", ""), ("strain", "strain", ""),
    ],
)  # fmt: skip
def test_headings_are_parted_from_their_units(heading: str, name: str, unit: str) -> None:
    assert split_heading(heading) == (name, unit)


@pytest.mark.parametrize(
    "text",
    [
        "time (s),force (N)\n0,1\n1,2.5\n", "# a comment\ntime (s)\tforce (N)\n0\t1\n1\t2.5\n",
        "time (s);force (N)\n0;1\n1;2,5\n", "# made by\n# time (s),force (N)\n0,1\n1,2.5\n\n",
    ],
)  # fmt: skip
def test_text_is_read_however_it_is_parted(tmp_path: Path, text: str) -> None:
    data = read_data(written(tmp_path, text))
    assert dict(data.units) == {"time (s)": "s", "force (N)": "N"}
    np.testing.assert_array_equal(data.columns["force (N)"], [1.0, 2.5])
    assert data.column("FORCE") == "force (N)"


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("", "is empty"),
        ("time (s),force (N)\n", "has headings but no rows"),
        ("0,1\n1,2\n", "must hold the headings"),
        ("time (s),force (N)\n0,1\n1,broken\n", 'line 3, force (N) = "broken": must be a number'),
        ("time (s),force (N)\n0,x\n1,nan\n", "line 2, force.*line 3, force (N) = nan: must be a finite number"),
        ("time (s),force (N)\n0,1\n1\n", "line 3: has 1 fields"),
        ("time (s),time (s)\n0,1\n", "stands above two columns"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(tmp_path: Path, text: str, reported: str) -> None:
    pattern = reported.replace("(", r"\(").replace(")", r"\)")
    with pytest.raises(CaseError, match=f"(?s){pattern}"):
        read_data(written(tmp_path, text))


def test_only_the_first_of_many_problems_are_listed(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match="and 15 more"):
        read_data(written(tmp_path, "time (s),force (N)\n" + "0,x\n" * 25))


def test_a_missing_column_names_the_nearest(tmp_path: Path) -> None:
    data = read_data(written(tmp_path, "time (s),force (N)\n0,1\n"))
    with pytest.raises(ValueError, match="did you mean"):
        data.column("forse")


def test_a_file_of_a_tester_is_read_with_its_stages() -> None:
    data = read_data(MACH1)
    assert data.about["functions"] == "Stress Relaxation"
    recording = recording_of(data, None, None, None)
    assert (recording.drive, recording.response) == ("Position (z), mm", "Fz, N")
    assert [stage.kind for stage in recording.stages] == ["ramp", "hold"] * 2
    first = recording.stages[0]
    assert first.rate == pytest.approx(2e-3, rel=0.02)
    assert first.end == pytest.approx(20.0, abs=0.5)
    assert recording.compression == 1.0
    assert recording.sign == -1.0


def test_a_starter_case_repeats_what_was_done() -> None:
    recording = recording_of(read_data(MACH1), None, None, None)
    for radius in (None, 2.0):
        case = Case.from_toml(starter_case(recording, 1.2, radius))
        part = "piston" if radius is None else "top"
        loads = [phase.loads()[f"{part}.displacement"] for phase in case.phase]
        assert [load.ramp_to for load in loads] == pytest.approx([-0.04, -0.08], abs=2e-3)
        assert [phase.duration for phase in case.phase] == pytest.approx([120.0, 120.0], abs=1.0)


def test_ramps_and_holds_are_found_in_noise() -> None:
    times = np.arange(0.0, 300.0, 0.5)
    drive = np.interp(times, [0.0, 10.0, 110.0, 160.0, 300.0], [0.0, 1.0, 1.0, 3.0, 3.0])
    noisy = drive + 1e-3 * np.random.default_rng(0).standard_normal(len(times))
    stages = recognised(times, noisy)
    assert [stage.kind for stage in stages] == ["ramp", "hold", "ramp", "hold"]
    np.testing.assert_allclose([stage.end for stage in stages], [10.0, 110.0, 160.0, 299.5], atol=1.5)
    steps = steps_of(stages)
    assert [step.over for step in steps] == pytest.approx([10.0, 50.0], abs=1.5)


def test_a_sine_is_no_row_of_stages() -> None:
    times = np.linspace(0.0, 100.0, 2000)
    assert recognised(times, np.sin(times)) == ()


def test_points_are_kept_where_the_curve_goes() -> None:
    times = np.linspace(0.0, 1000.0, 10_001)
    values = np.exp(-times / 10.0)
    kept = thinned(times, values, 100)
    assert len(kept) <= 100
    assert kept[0] == 0
    assert kept[-1] == 10_000
    assert np.sum(times[kept] < 30.0) > 40  # most of the way is gone there
    np.testing.assert_array_equal(thinned(times[:50], values[:50], 100), np.arange(50))
