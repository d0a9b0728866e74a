"""Runs that start where another one ended, and runs that go on after they were interrupted or killed."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import xarray as xr
from sample_cases import impossible_compression, small_block, small_compression, small_swelling

from fvswell.case.case import Case
from fvswell.case.errors import CaseError
from fvswell.errors import OutputError, SolverError
from fvswell.results.file import read_result, read_state
from fvswell.simulation.run import Progress, run

TESTS = str(Path(__file__).parents[1])


def esdirk43(tolerance: float) -> dict[str, Any]:
    return {"scheme": "esdirk43", "tolerance": tolerance}


ADAPTIVE = {"time": esdirk43(1e-5), "output__per_phase": 10}


def only(case: Case, phase: str) -> Case:
    """The case with one of its phases alone."""
    (kept,) = (each for each in case.model_dump(exclude_none=True)["phase"] if each["name"] == phase)
    return case.with_changes({"phase": [kept]})


@pytest.mark.parametrize("model", ["biphasic", "biphasic-swelling", "electrochemical"])
def test_two_files_are_one_run(tmp_path: Path, model: str) -> None:
    """Loading, and unloading from there, so early that ions and water are still on their way."""
    case = small_compression(model=model, **ADAPTIVE)
    whole = run(case)["global_strain"]
    run(only(case, "loading"), path=tmp_path / "first.nc")
    second = run(only(case, "unloading"), start_from=tmp_path / "first.nc")
    after = whole.isel(time=whole["time"] >= 300.0)
    assert second["time"].values[0] == 0.0
    assert second.attrs["started_from"] == str(tmp_path / "first.nc")
    np.testing.assert_allclose(second["time"], after["time"] - 300.0, atol=1e-9)
    tolerance = 2e-5 * np.abs(whole.values).max()
    np.testing.assert_allclose(second["global_strain"].values, after.values, rtol=0.0, atol=tolerance)


def test_equal_steps_go_on_as_if_nothing_had_been(tmp_path: Path) -> None:
    case = small_compression()
    whole = run(case)
    run(only(case, "loading"), path=tmp_path / "first.nc")
    second = run(only(case, "unloading"), start_from=tmp_path / "first.nc")
    for name in ("global_strain", "anion_concentration", "volume_ratio", "water_flux"):
        values = whole[name].values[8:]
        np.testing.assert_allclose(second[name].values, values, rtol=0.0, atol=1e-10 * np.abs(values).max())


def test_a_third_run_starts_from_the_second(tmp_path: Path) -> None:
    """The bath that the first one brought stays: a phase that names none goes on with it."""
    base = small_swelling()
    diluted = base.phase[0].bath_concentration
    rest = [{"name": name, "duration": 300.0, "piston": {"pressure": load}} for name, load in (("b", 0.02), ("c", 0.0))]
    case = base.with_changes(
        {"phase": [{"name": "a", "duration": 300.0, "piston": {"pressure": 0.0}, "bath_concentration": diluted}, *rest]}
    )
    whole = run(case)
    for before, phase in ((None, "a"), ("a", "b"), ("b", "c")):
        start = None if before is None else tmp_path / f"{before}.nc"
        last = run(only(case, phase), path=tmp_path / f"{phase}.nc", start_from=start)
    assert (last["bath_concentration"] == diluted).all()
    values = whole["global_strain"].values[16:]
    np.testing.assert_allclose(last["global_strain"].values, values, rtol=0.0, atol=1e-10 * np.abs(values).max())


def test_a_block_goes_on_with_what_its_edges_were_driven_by(tmp_path: Path) -> None:
    """The plate of the second run is not named: it stays where the first one has pressed it."""
    case = small_block()
    pressed = case.phase[1].model_dump(exclude_none=True) | {"name": "pressed"}
    held = {"name": "held", "duration": 1e4}
    whole = run(case.with_changes({"phase": [pressed, held]}))
    run(case.with_changes({"phase": [pressed]}), path=tmp_path / "first.nc")
    second = run(case.with_changes({"phase": [held]}), start_from=tmp_path / "first.nc")
    for name in ("global_strain", "top_force", "volume_ratio"):
        values = whole[name].values[-6:]
        np.testing.assert_allclose(second[name].values, values, rtol=0.0, atol=1e-8 * np.abs(values).max())


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"model": "biphasic"}, 'model is "electrochemical" there and "biphasic" here'),
        ({"geometry__cells": 11}, "geometry.cells is 10 there and 11 here"),
        ({"geometry__height": "0.6 mm"}, "geometry.height is 0.5 there and 0.6 here"),
        ({"tissue__youngs_modulus": 0.6}, "tissue.youngs_modulus is 0.5 there and 0.6 here"),
        ({"bath__concentration": 2e-4}, "bath.concentration is 0.00015 there and 0.0002 here"),
        ({"tissue__osmotic_coefficient_per_charge": 400.0}, "tissue.osmotic_coefficient is 0.83 there and not given"),
    ],
)
def test_another_sample_is_refused(tmp_path: Path, changes: dict[str, Any], named: str) -> None:
    run(small_compression(), path=tmp_path / "first.nc")
    reported: list[Progress] = []
    with pytest.raises(OutputError) as refused:
        run(small_compression(**changes), start_from=tmp_path / "first.nc", report=reported.append)
    assert str(refused.value).startswith(f"{tmp_path / 'first.nc'}: cannot be started from, ")
    assert named in str(refused.value)
    assert not reported


def test_what_cannot_be_started_from_is_refused(tmp_path: Path) -> None:
    case = small_compression()
    with pytest.raises(OutputError, match=r"none.nc: no such file"):
        run(case, start_from=tmp_path / "none.nc")
    with pytest.raises(SolverError):
        run(impossible_compression(), path=tmp_path / "stopped.nc")
    with pytest.raises(OutputError, match=r"is not complete \(stopped at t = "):
        run(small_compression(model="biphasic"), start_from=tmp_path / "stopped.nc")
    run(case, path=tmp_path / "first.nc")
    relaxing = small_compression(phase__loading__duration="1 relaxation time")
    with pytest.raises(CaseError, match=r"phase\[loading\].duration = .*must be given in s"):
        run(relaxing, start_from=tmp_path / "first.nc")


def assert_identical(path: Path, other: Path) -> None:
    """All data of both files, the solver's state included, the same bit for bit, and the attributes but the time."""
    one, two = read_result(path), read_result(other)
    xr.testing.assert_equal(one, two)
    for name in one.variables:
        assert one[name].values.tobytes() == two[name].values.tobytes(), name
    assert one.attrs | {"history": ""} == two.attrs | {"history": ""}
    kept, again = read_state(path), read_state(other)
    assert kept.keys() == again.keys()
    for name, values in kept.items():
        assert values.tobytes() == again[name].tobytes(), name


def interrupted_at(share: float) -> Any:
    def interrupt(progress: Progress) -> None:
        if progress.time >= share * progress.phase_ends[-1]:
            raise KeyboardInterrupt

    return interrupt


ALL_KINDS = {
    "backward Euler, every step": small_compression(time__steps_per_phase=600),
    "backward Euler, some steps": small_compression(time__steps_per_phase=600, output__every=7),
    "esdirk43, every step": small_compression(time=esdirk43(1e-8), output__every=1, geometry__cells=5),
    "esdirk43, times": small_swelling(time=esdirk43(1e-8), output__per_phase=20, geometry__cells=5),
    "held piston": small_compression(
        time__steps_per_phase=300, phase__loading__piston__displacement={"ramp_to": -0.05, "over": 200.0}
    ),
    "relaxation times": small_compression(time=esdirk43(1e-8), phase__loading__duration="2 relaxation times"),
    "block": small_block(),
    "block, esdirk43": small_block(time=esdirk43(1e-3), output__per_phase=5),
}


@pytest.mark.parametrize("kind", ALL_KINDS)
def test_interrupted_and_resumed_run_is_the_uninterrupted_one(tmp_path: Path, kind: str) -> None:
    """Interrupted by Ctrl-C twice, after every part of the run."""
    case, whole, path = ALL_KINDS[kind], tmp_path / "whole.nc", tmp_path / "resumed.nc"
    run(case, path=whole)
    resume = False
    for share in (0.0, 0.3, 0.7):
        with pytest.raises(KeyboardInterrupt):
            run(case, path=path, report=interrupted_at(share), resume=resume)
        assert (
            read_result(path if not resume else path.with_name("resumed.nc.part"))
            .attrs["run_status"]
            .startswith("interrupted after t = ")
        )
        resume = True
    run(case, path=path, resume=True)
    assert_identical(path, whole)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["resumed.nc", "whole.nc"]


def written(path: Path) -> int | None:
    """When a file was written, if it is there."""
    return path.stat().st_mtime_ns if path.exists() else None


KILLED = """
import sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from sample_cases import {case}
from fvswell.results import run_file
from fvswell.simulation.run import run
run_file._PATIENCE, run_file._SHARE = 0.0, 0.8  # so that most moments are in the midst of writing a file
path = Path({path!r})
run({case}(**{changes!r}), path=path, resume=path.with_name(path.name + ".part").exists())
"""

KILLED_CASES = {
    "backward Euler": (small_compression, {"time__steps_per_phase": 4000, "output__every": 50}),
    "esdirk43": (small_swelling, {"time": esdirk43(1e-12), "output__per_phase": 100, "geometry__cells": 6}),
}


@pytest.mark.parametrize("kind", KILLED_CASES)
def test_run_that_is_killed_at_any_moment_can_be_resumed(tmp_path: Path, kind: str) -> None:
    """Killed (SIGKILL) again and again at random moments, each time resumed in a process of its own."""
    whole, path = tmp_path / "whole.nc", tmp_path / "killed" / "result.nc"
    make, changes = KILLED_CASES[kind]
    case = make(**changes)
    run(case, path=whole)
    script = KILLED.format(tests=TESTS, path=str(path), case=make.__name__, changes=changes)
    draw, part = np.random.default_rng(1), path.with_name("result.nc.part")
    steps = []
    for _ in range(4):
        process = subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.PIPE)
        deadline = time.monotonic() + 300.0
        versions = {written(part)}
        while len(versions) < 3 and process.poll() is None:  # what it found, the same again, and with more steps
            assert time.monotonic() < deadline
            time.sleep(0.001)
            versions.add(written(part))
        time.sleep(draw.uniform(0.0, 0.1))
        process.send_signal(signal.SIGKILL)
        errors = process.communicate()[1]
        assert not errors or path.exists(), errors.decode()
        if path.exists():
            break
        steps.append(read_result(part).sizes["step"])
    assert len(steps) >= 3
    assert steps == sorted(steps)
    assert 0 < steps[-1] < read_result(whole).sizes["step"]
    if not path.exists():
        run(case, path=path, resume=True)
    assert_identical(path, whole)


def test_what_cannot_be_resumed_is_refused(tmp_path: Path) -> None:
    case, path = small_compression(**ADAPTIVE), tmp_path / "result.nc"
    with pytest.raises(OutputError, match=r"nothing to resume: neither this file nor result.nc.part exists"):
        run(case, path=path, resume=True)
    with pytest.raises(OutputError, match="needs the name of that"):
        run(case, resume=True)
    run(case, path=path)
    with pytest.raises(OutputError, match=r"result.nc: is complete, there is nothing to resume"):
        run(case, path=path, resume=True)
    with pytest.raises(KeyboardInterrupt):
        run(case, path=tmp_path / "other.nc", report=interrupted_at(0.0))
    with pytest.raises(OutputError, match=r"other.nc: cannot be resumed: it is of another case"):
        run(small_compression(), path=tmp_path / "other.nc", resume=True)
    with pytest.raises(OutputError, match="no other start"):
        run(case, path=tmp_path / "other.nc", resume=True, start_from=path)
    with pytest.raises(SolverError):
        run(impossible_compression(), path=tmp_path / "stopped.nc")
    with pytest.raises(OutputError, match=r"stopped.nc: cannot be resumed: the run has stopped at t = "):
        run(impossible_compression(), path=tmp_path / "stopped.nc", resume=True)
    (tmp_path / "result.nc.part").write_bytes(path.read_bytes()[:5000])
    with pytest.raises(OutputError, match=r"result.nc.part: is damaged"):
        run(case, path=path, resume=True)
    (tmp_path / "stateless.nc").write_bytes((tmp_path / "other.nc").read_bytes())
    with netCDF4.Dataset(tmp_path / "stateless.nc", "a") as file:
        file.renameGroup("state", "other")
    with pytest.raises(OutputError, match=r"stateless.nc: holds no state to continue from"):
        run(case, path=tmp_path / "stateless.nc", resume=True)


def test_a_run_that_started_from_another_is_resumed_as_such(tmp_path: Path) -> None:
    """Without the file that it started from, and with the bath that was left there."""
    case = small_swelling(**ADAPTIVE)
    run(only(case, "loading"), path=tmp_path / "first.nc")
    held = case.with_changes({"phase": [{"name": "held", "duration": 600.0, "piston": {"pressure": 0.05}}]})
    run(held, path=tmp_path / "whole.nc", start_from=tmp_path / "first.nc")
    path = tmp_path / "resumed.nc"
    with pytest.raises(KeyboardInterrupt):
        run(held, path=path, start_from=tmp_path / "first.nc", report=interrupted_at(0.0))
    (tmp_path / "first.nc").rename(tmp_path / "moved.nc")
    run(held, path=path, resume=True)
    assert_identical(path, tmp_path / "whole.nc")
