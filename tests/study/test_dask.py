"""A study on a Dask cluster of two workers, one of which is killed on the way."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
import studies

from fvswell.study.file import read_study
from fvswell.study.run import run_study

pytest.importorskip("distributed")

# sockets and event loops of distributed that the garbage collector finds after the client has closed
pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning:distributed"),
]


@contextmanager
def running(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-m", "distributed.cli." + arguments[0], *arguments[1:]]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_for_port(port: int) -> None:
    deadline = time.monotonic() + 30.0
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
            return
        except OSError:
            assert time.monotonic() < deadline, "the scheduler does not answer"
            time.sleep(0.1)


def test_a_killed_worker_loses_nothing_and_repeats_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("fvswell.study.batches.LARGEST_BATCH", 2)
    study = studies.study(**studies.many_batches())
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    with ExitStack() as stack:
        local = ("--host", "127.0.0.1", "--no-dashboard")
        stack.enter_context(running("dask_scheduler", "--port", str(port), *local))
        wait_for_port(port)
        alone = ("--no-nanny", "--nthreads", "1", "--local-directory", str(tmp_path), *local)
        workers = [stack.enter_context(running("dask_worker", address, *alone)) for _ in range(2)]
        wait_for_workers(address, 2)
        seen = []

        def kill_one(progress):
            seen.append(progress.done)
            if progress.done and workers[0].poll() is None:
                workers[0].kill()

        outcome = run_study(study, tmp_path / "dask.nc", scheduler=address, report=kill_one)
        assert workers[0].wait(timeout=10.0) != 0
    assert seen == [0, 2, 4, 6, 8, 10, 12]
    assert (outcome.runs, outcome.complete) == (12, 12)
    run_study(study, tmp_path / "here.nc", processes=1)
    studies.assert_identical(read_study(tmp_path / "dask.nc"), read_study(tmp_path / "here.nc"))


def wait_for_workers(address: str, count: int) -> None:
    from distributed import Client

    with Client(address, timeout=30.0, set_as_default=False) as client:
        client.wait_for_workers(count, timeout=30.0)
