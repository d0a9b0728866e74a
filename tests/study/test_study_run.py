"""Studies from file to file: what is in the result, and that interruptions change nothing in it."""

from __future__ import annotations

import errno
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import studies
import xarray as xr

from fvswell.case.case import Case
from fvswell.errors import OutputError
from fvswell.study import parts
from fvswell.study.batches import plan
from fvswell.study.file import read_study
from fvswell.study.run import run_study
from fvswell.study.scheduling import SchedulerError
from fvswell.study.study import Study

SCRIPT = """
import sys
import time
from pathlib import Path
from fvswell.study import batches
from fvswell.study.study import load_study
from fvswell.study.run import run_study
if __name__ == "__main__":
    def report(progress):
        time.sleep(0.2 if progress.done else 0.0)  # so that there is something left to do when it is killed

    batches.LARGEST_BATCH = 2
    run_study(load_study(sys.argv[1]), Path(sys.argv[2]), processes=2, report=report)
"""


@pytest.fixture(scope="module", autouse=True)
def _small_batches() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fvswell.study.batches.LARGEST_BATCH", 2)
        yield


@pytest.fixture(scope="module")
def study() -> Study:
    return studies.study(**studies.many_batches())


@pytest.fixture(scope="module")
def result(study, tmp_path_factory) -> xr.Dataset:
    """The result of an uninterrupted run in this process."""
    path = tmp_path_factory.mktemp("study") / "whole.nc"
    outcome = run_study(study, path, processes=1)
    assert (outcome.runs, outcome.complete, outcome.resumed) == (12, 12, 0)
    assert sorted(file.name for file in path.parent.iterdir()) == ["whole.nc"]
    return read_study(path)


def test_the_result_holds_every_run(study, result):
    assert dict(result.sizes) == {"run": 12, "phase": 2, "model": 2, "sample": 8}
    assert list(result["phase"].values) == ["loading", "unloading"]
    assert list(result["model"].values) == ["biphasic-swelling", "electrochemical"]
    assert set(result["run_status"].values) == {"complete"}
    for name in ("protocol", "design", "run_status", "stiffness", "height"):
        assert result.coords[name].dims == ("run",)
    np.testing.assert_array_equal(result["stiffness"], study.runs.values[:, 0])
    np.testing.assert_array_equal(result["height"], study.runs.values[:, 1])
    assert result["height"].units == "mm"
    assert result["stiffness"].units == "N mm-2"
    np.testing.assert_array_equal(result["strain"].values[..., -1], result["final_strain"].values)


def test_every_variable_has_its_metadata(result):
    for name, variable in result.variables.items():
        assert {"units", "long_name", "location", "cell_methods"} <= set(variable.attrs), name
        assert {variable.attrs["location"], variable.attrs["cell_methods"].split(":")[0]} <= set(variable.dims), name
    for name in ("Conventions", "title", "institution", "source", "history", "references", "comment",
                 "package_versions", "study_sha256"):  # fmt: skip
        assert result.attrs[name]


def test_a_result_can_be_run_again_from_itself(study, result):
    again = Study.from_toml(result.attrs["study_toml"])
    assert again.sha256 == result.attrs["study_sha256"] == study.sha256
    assert isinstance(again.case(3), Case)
    assert again.case(3) == study.case(3)


def test_processes_give_the_same_file(study, result, tmp_path):
    seen = []
    run_study(study, tmp_path / "cores.nc", processes=2, report=seen.append)
    studies.assert_identical(read_study(tmp_path / "cores.nc"), result)
    assert [p.done for p in seen] == [0, 2, 4, 6, 8, 10, 12]
    assert {p.total for p in seen} == {12}
    assert seen[0].remaining is None
    assert seen[-1].remaining == 0.0
    assert all(p.remaining > 0.0 for p in seen[1:-1])


def test_a_study_that_was_killed_goes_on_and_ends_alike(study, result, tmp_path):
    file, script = tmp_path / "study.toml", tmp_path / "script.py"
    file.write_text(study.to_toml())
    script.write_text(SCRIPT)
    path = tmp_path / "out" / "study.nc"
    process = subprocess.Popen([sys.executable, script, file, path], stderr=subprocess.PIPE)
    parts = path.with_name("study.nc.parts")
    workers: list[int] = []
    try:
        deadline = time.monotonic() + 60.0
        while not list(parts.glob("*.npz")):
            assert process.poll() is None, process.stderr.read()
            assert time.monotonic() < deadline
            time.sleep(0.005)
        workers = children(process.pid)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
        process.stderr.close()
    kept = len(list(parts.glob("*.npz")))
    assert 1 <= kept < 6
    assert not path.exists()
    gone_by = time.monotonic() + 20.0
    while any(is_running(worker) for worker in workers):
        assert time.monotonic() < gone_by, "workers outlive the study"
        time.sleep(0.05)
    outcome = run_study(study, path, processes=1)
    assert outcome.resumed == 2 * kept
    studies.assert_identical(read_study(path), result)
    assert not parts.exists()


def children(pid: int) -> list[int]:
    listed = Path(f"/proc/{pid}/task/{pid}/children")
    return [int(child) for child in listed.read_text().split()] if listed.exists() else []


def is_running(pid: int) -> bool:
    stat = Path(f"/proc/{pid}/stat")
    try:
        return stat.read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_a_full_disk_keeps_what_is_finished(study, result, tmp_path, monkeypatch):
    path = tmp_path / "study.nc"
    savez, calls = np.savez, []

    def full_after_two(file, **arrays):
        calls.append(file)
        if len(calls) > 2:
            file.write(b"half a ba")
            raise OSError(errno.ENOSPC, "No space left on device")
        savez(file, **arrays)

    with monkeypatch.context() as patched:
        patched.setattr(parts.np, "savez", full_after_two)
        with pytest.raises(OutputError, match="No space left on device"):
            run_study(study, path, processes=1)
    assert not path.exists()
    outcome = run_study(study, path, processes=1)
    assert outcome.resumed == 4
    studies.assert_identical(read_study(path), result)


def test_ctrl_c_keeps_what_is_finished(study, result, tmp_path):
    path = tmp_path / "study.nc"

    def interrupt(progress):
        if progress.done >= 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_study(study, path, processes=1, report=interrupt)
    assert run_study(study, path, processes=1).resumed == 4
    studies.assert_identical(read_study(path), result)


def test_parts_of_another_study_are_refused(study, tmp_path):
    path = tmp_path / "study.nc"

    def interrupt(progress):
        if progress.done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_study(study, path, processes=1, report=interrupt)
    with pytest.raises(OutputError, match="another study"):
        run_study(studies.study(), path, processes=1)
    assert list(path.with_name("study.nc.parts").glob("*.npz"))


def test_a_study_that_was_stopped_before_its_first_batch_may_change(study, tmp_path):
    path = tmp_path / "study.nc"

    def interrupt(progress):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_study(studies.study(), path, processes=1, report=interrupt)
    assert run_study(study, path, processes=1).resumed == 0


def test_a_result_is_not_replaced_unless_asked(study, tmp_path):
    path = tmp_path / "study.nc"
    path.write_text("precious")
    with pytest.raises(OutputError, match="exists already"):
        run_study(study, path, processes=1)
    assert path.read_text() == "precious"


def test_impossible_runs_are_named_in_the_result(tmp_path):
    loads = studies.parameter("load", "phase.loading.piston.pressure", "0.1 MPa", "2 MPa")
    design = [{"name": "loads", "kind": "one-at-a-time", "count": 3}]
    study = studies.study(model="biphasic", parameter=[loads], design=design, impossible="skip")
    assert [batch.runs for batch in plan(study)] == [(0, 1)]
    path = tmp_path / "study.nc"
    outcome = run_study(study, path, processes=1)
    assert (outcome.runs, outcome.complete) == (3, 2)
    result = read_study(path)
    assert list(result["run_status"].values[:2]) == ["complete", "complete"]
    assert result["run_status"].values[2].startswith("not run: phase[loading].piston.pressure = 2: leaves no")
    assert np.isnan(result["r_squared"].values[2]).all()
    assert np.isfinite(result["r_squared"].values[:2]).all()
    np.testing.assert_allclose(result["load"], [0.1, 1.05, 2.0])
    assert "strain" not in result


def test_only_results_of_studies_are_read(tmp_path):
    with pytest.raises(OutputError, match="no such file"):
        read_study(tmp_path / "study.nc")
    (tmp_path / "text.nc").write_text("text")
    with pytest.raises(OutputError, match="not a netCDF file"):
        read_study(tmp_path / "text.nc")
    xr.Dataset({"a": 1}).to_netcdf(tmp_path / "other.nc")
    with pytest.raises(OutputError, match="not the result of a study"):
        read_study(tmp_path / "other.nc")


def test_a_scheduler_that_is_not_there_is_reported(study, tmp_path, monkeypatch):
    from fvswell.study import scheduling

    monkeypatch.setattr(scheduling, "_PATIENCE", 0.5)
    with pytest.raises(SchedulerError, match="no Dask scheduler answers"):
        run_study(study, tmp_path / "study.nc", scheduler="tcp://127.0.0.1:9")
