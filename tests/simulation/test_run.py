"""Runs and their files: progress, what is there while a run goes on, and what is left when it ends early."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from sample_cases import impossible_compression, inverting_block, small_block, small_compression, small_swelling

from fvswell.case.case import Case
from fvswell.errors import OutputError, SolverError
from fvswell.results import run_file
from fvswell.results.file import COMPLETE, read_result, write_result
from fvswell.simulation.run import Progress, run

TESTS = str(Path(__file__).parents[1])
MANY_STEPS = {"time__steps_per_phase": 600, "output__every": 100}


def test_file_has_its_name_only_when_it_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_file, "_PATIENCE", 0.0)
    monkeypatch.setattr(run_file, "_SHARE", 1e9)
    path = tmp_path / "deep" / "result.nc"
    seen: list[set[str]] = []
    there: list[int] = []

    def look(progress: Progress) -> None:
        seen.append({file.name for file in path.parent.iterdir()})
        there.append(read_result(path.with_name("result.nc.part")).sizes["step"])

    run(small_compression(**MANY_STEPS), path=path, report=look)
    assert all(names == {"result.nc.part"} for names in seen)
    assert there[:5] == [0, 256, 512, 768, 1024]
    assert [file.name for file in path.parent.iterdir()] == ["result.nc"]


def test_short_run_writes_its_result_and_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[Path] = []

    def note(path: Path, *arguments: Any) -> None:
        written.append(path)
        write_result(path, *arguments)

    monkeypatch.setattr(run_file, "write_result", note)
    monkeypatch.setattr(run_file, "_PATIENCE", 60.0)
    run(small_compression(**MANY_STEPS), path=tmp_path / "result.nc")
    assert written == [tmp_path / "result.nc"]


def test_progress_goes_from_start_to_end() -> None:
    reported: list[Progress] = []
    result = run(small_compression(time__steps_per_phase=600), report=reported.append)
    assert reported[0] == Progress(0.0, tuple(result["phase_end"].values), 0, 0.0)
    assert reported[-1].time == pytest.approx(600.0)
    steps = [each.steps for each in reported]
    assert steps == [0, 256, 512, 768, 1024, 1200]
    np.testing.assert_allclose([each.time for each in reported], result["time"][steps], rtol=1e-14)
    np.testing.assert_allclose([each.strain for each in reported], result["global_strain"][steps], atol=1e-14)


def test_a_block_reports_every_step() -> None:
    reported: list[Progress] = []
    result = run(small_block(), report=reported.append)
    assert [each.steps for each in reported] == list(range(result.sizes["step"] + 1))


def test_existing_file_is_left_alone_and_nothing_is_computed(tmp_path: Path) -> None:
    path = tmp_path / "result.nc"
    path.write_text("precious")
    reported: list[Progress] = []
    with pytest.raises(OutputError, match=r"result\.nc: exists already; use --force"):
        run(small_compression(), path=path, report=reported.append)
    assert path.read_text() == "precious"
    assert not reported
    assert list(tmp_path.iterdir()) == [path]
    run(small_compression(), path=path, replace=True)
    assert read_result(path).attrs["run_status"] == COMPLETE


@pytest.mark.parametrize("case", [small_compression(**MANY_STEPS), small_block(output__every=2)])
def test_interrupted_run_keeps_what_there_is_and_says_so(tmp_path: Path, case: Case) -> None:
    ended: list[float] = []

    def interrupt(progress: Progress) -> None:
        if progress.time > 0.6 * progress.phase_ends[-1]:
            ended.append(progress.time)
            raise KeyboardInterrupt

    path = tmp_path / "result.nc"
    with pytest.raises(KeyboardInterrupt):
        run(case, path=path, report=interrupt)
    assert [file.name for file in tmp_path.iterdir()] == ["result.nc"]
    kept, whole = read_result(path), run(case)
    assert kept.attrs["run_status"] == f"interrupted after t = {ended[0]:.6g} s"
    outputs, steps = kept.sizes["time"], kept.sizes["step"]
    assert 1 < outputs < whole.sizes["time"]
    xr.testing.assert_equal(kept, whole.isel(time=slice(outputs), step=slice(steps)))


def test_replacing_run_that_is_interrupted_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "result.nc"
    run(small_compression(), path=path)
    before = path.read_bytes()

    def interrupt(progress: Progress) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(small_compression(), path=path, replace=True, report=interrupt)
    assert path.read_bytes() == before
    assert read_result(tmp_path / "result.nc.part").attrs["run_status"] == "interrupted after t = 0 s"


@pytest.mark.parametrize("case", [impossible_compression(), inverting_block()])
def test_stopped_run_keeps_what_there_is_and_says_so(tmp_path: Path, case: Case) -> None:
    path = tmp_path / "result.nc"
    with pytest.raises(
        SolverError, match=r"stopped at t = .* in phase \w+: the tissue would be inverted or without water at "
    ) as stop:
        run(case, path=path)
    kept = read_result(path)
    xr.testing.assert_equal(kept, stop.value.result)
    assert kept.attrs["run_status"].startswith("stopped at t = ")
    assert 0.0 < kept["time"].values[-1] < kept["phase_end"].values[-1]
    assert kept["step_time"].values[-1] == kept["time"].values[-1]
    assert [file.name for file in tmp_path.iterdir()] == ["result.nc"]


def test_phase_that_does_not_relax_is_reported_before_any_file(tmp_path: Path) -> None:
    case = small_compression(phase__loading__piston__pressure=0.0, phase__loading__duration="1 relaxation time")
    with pytest.raises(SolverError, match="does not relax in phase loading; give its duration"):
        run(case, path=tmp_path / "result.nc")
    assert not list(tmp_path.iterdir())


LONG_RUN = """
import sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from sample_cases import small_compression
from fvswell.simulation.run import run
run(small_compression(time__steps_per_phase=100000), path=Path({path!r}))
"""


def test_killed_run_leaves_no_result_and_does_not_hinder_the_next(tmp_path: Path) -> None:
    path = tmp_path / "result.nc"
    process = subprocess.Popen([sys.executable, "-c", LONG_RUN.format(tests=TESTS, path=str(path))])
    part = tmp_path / "result.nc.part"
    deadline = time.monotonic() + 60.0
    while not part.exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert part.exists()
    assert not path.exists()
    run(small_compression(), path=path)
    assert [file.name for file in tmp_path.iterdir() if file.suffix != ".new"] == ["result.nc"]


FULL_DISK = """
import resource, signal, sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from sample_cases import small_compression
from fvswell.errors import OutputError
from fvswell.results import run_file
from fvswell.simulation.run import run
run_file._PATIENCE = 0.0  # as if the run took long: what there is is kept from its beginning on
small, large = (small_compression(time__steps_per_phase=steps) for steps in (2, 200))
run(small)  # compiled code is written as well
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
try:
    run(large, path=Path({path!r}))
except OutputError as error:
    print("reported:", error)
"""


@pytest.mark.parametrize(("limit", "left"), [(30_000, []), (500_000, ["result.nc.part"])])
def test_full_disk_is_reported_and_leaves_nothing_half_written(tmp_path: Path, limit: int, left: list[str]) -> None:
    script = FULL_DISK.format(tests=TESTS, path=str(tmp_path / "result.nc"), limit=limit)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "cannot be written" in done.stdout
    assert [file.name for file in tmp_path.iterdir()] == left
    if left:
        assert read_result(tmp_path / "result.nc.part").attrs["run_status"] == "running"


def test_threads_run_cases_at_once_as_one_after_the_other(tmp_path: Path) -> None:
    """Two threads, each running several cases of all kinds and writing files: the same bit for bit."""
    adaptive = {"time": {"scheme": "esdirk43"}, "output__per_phase": 20}
    cases = [
        small_compression(), small_swelling(model="biphasic-swelling"), small_compression(**adaptive), small_block(),
        small_compression(phase__loading__duration="1 relaxation time", **adaptive), small_swelling(),
    ]  # fmt: skip
    together = threading.Barrier(2)
    found: dict[tuple[int, int], xr.Dataset] = {}

    def work(thread: int) -> None:
        together.wait()
        order = cases if thread == 0 else cases[::-1]
        for each in order:
            index = cases.index(each)
            path = tmp_path / f"{thread}-{index}.nc"
            run(each, path=path)
            found[thread, index] = read_result(path)

    threads = [threading.Thread(target=work, args=(thread,)) for thread in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 2 * len(cases)
    for index, case in enumerate(cases):
        alone = run(case)
        for thread in range(2):
            xr.testing.assert_equal(found[thread, index], alone)
