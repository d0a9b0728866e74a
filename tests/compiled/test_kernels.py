"""The cache of compiled code: never an old answer, never a needless compilation, never a need for a disk."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

import fvswell
from fvswell.compiled import kernel
from fvswell.compiled.kernels import cache_directory

SCRIPT = """
import numpy as np
from fvswell.compiled import kernel, law_kernel
from fvswell.physics.permeability import ExponentialPermeability, permeability

def flow(J):
    return permeability(ExponentialPermeability(1e-3, 2.0), J, 0.8)

def make(law):
    def evaluate(J, k):
        k[0] = permeability(law(1e-3, 2.0), J[0], 0.8)
    return evaluate

def through(evaluate, J, k):
    evaluate(J, k)

compiled = kernel(flow)
k = np.zeros(1)
kernel(through)(law_kernel(make, (1, 1), ExponentialPermeability), np.array([0.9]), k)
value = compiled(0.9)
assert value == k[0]
print(repr(float(value)), sum(compiled._compiled.stats.cache_hits.values()))
"""


class Copy:
    """A copy of the package that runs the script in processes of its own."""

    def __init__(self, folder: Path) -> None:
        self.package, self.cache = folder / "source" / "fvswell", folder / "cache"
        shutil.copytree(Path(fvswell.__file__).parent, self.package, ignore=shutil.ignore_patterns("__pycache__"))
        self.script = folder / "script.py"
        self.script.write_text(SCRIPT, encoding="utf-8")

    def run(self, **environment: str) -> tuple[float, int]:
        """The answer, and how many functions came from the cache."""
        return self.run_at_once(1, **environment)[0]

    def run_at_once(self, processes: int, **environment: str) -> list[tuple[float, int]]:
        """The same of several processes that run at the same time."""
        own = {"PYTHONPATH": str(self.package.parent), "FVSWELL_CACHE_DIR": str(self.cache), "NUMBA_DISABLE_JIT": "0"}
        command = [sys.executable, self.script]
        started = [
            subprocess.Popen(command, env=os.environ | own | environment, stdout=subprocess.PIPE, text=True)
            for _ in range(processes)
        ]
        printed = [each.communicate()[0].split() for each in started]
        assert not any(each.returncode for each in started)
        return [(float(value), int(hits)) for value, hits in printed]

    def edit(self, file: str, old: str, new: str) -> None:
        path = self.package / file
        text = path.read_text(encoding="utf-8")
        assert text.count(old) == 1
        path.write_text(text.replace(old, new), encoding="utf-8")

    def files(self) -> dict[str, int]:
        return {str(path): path.stat().st_mtime_ns for path in self.cache.rglob("*") if path.is_file()}


def test_cache_is_used_and_follows_the_sources(tmp_path: Path) -> None:
    """A second process compiles nothing; an edited law, in a file that numba does not look at, changes the answer."""
    copy = Copy(tmp_path)
    expected = 1e-3 * np.exp(-0.2)
    assert copy.run() == (pytest.approx(expected, rel=1e-14), 0)
    files = copy.files()
    assert files
    assert copy.run() == (pytest.approx(expected, rel=1e-14), 1)
    assert copy.files() == files
    copy.edit("physics/permeability.py", "permeability_exponent * (J - 1.0)", "permeability_exponent * (J - 0.5)")
    assert copy.run() == (pytest.approx(1e-3 * np.exp(0.8), rel=1e-14), 0)
    assert set(copy.files()) > set(files)


def test_processes_that_need_the_same_compile_it_once(tmp_path: Path) -> None:
    found = Copy(tmp_path).run_at_once(3)
    assert {value for value, _ in found} == {found[0][0]}
    assert sorted(hits for _, hits in found) == [0, 1, 1]


WITHOUT_BLAS = """
import sys
import numba, numpy as np
from fvswell.compiled import kernel
def twice(x):
    return 2.0 * x
assert kernel(twice)(1.5) == 3.0
assert "scipy.linalg" not in sys.modules
product = numba.njit(lambda a: a @ a)
np.testing.assert_allclose(product(np.array([[1.0, 2.0], [3.0, 4.0]])), [[7.0, 10.0], [15.0, 22.0]])
assert "scipy.linalg" in sys.modules
"""


def test_kernels_do_not_take_scipy_along_and_leave_matrix_products_to_whoever_wants_them(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(WITHOUT_BLAS, encoding="utf-8")
    own = {"FVSWELL_CACHE_DIR": str(tmp_path), "NUMBA_DISABLE_JIT": "0"}
    subprocess.run([sys.executable, script], env=os.environ | own, check=True)


def test_works_in_memory_where_nothing_can_be_written(tmp_path: Path) -> None:
    copy = Copy(tmp_path)
    blocked = tmp_path / "file"
    blocked.write_text("")
    value, hits = copy.run(FVSWELL_CACHE_DIR=str(blocked), HOME=str(blocked), XDG_CACHE_HOME=str(blocked))
    assert (value, hits) == (pytest.approx(1e-3 * np.exp(-0.2), rel=1e-14), 0)
    assert not copy.files()
    assert not list(tmp_path.rglob("*.nbi"))


def test_folder_is_that_of_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FVSWELL_CACHE_DIR", str(tmp_path / "own"))
    own = cache_directory()
    assert own is not None
    assert own.is_relative_to(tmp_path / "own")
    monkeypatch.delenv("FVSWELL_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_directory() == tmp_path / "xdg" / "fvswell" / own.name
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_directory() == tmp_path / ".cache" / "fvswell" / own.name


def test_old_folders_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FVSWELL_CACHE_DIR", str(tmp_path))
    for age in range(6):
        folder = tmp_path / "fvswell" / f"of version {age}"
        folder.mkdir(parents=True)
        (folder / "code").write_text("")
        os.utime(folder, (1e9 - age, 1e9 - age))
    own = cache_directory()
    left = {path.name for path in (tmp_path / "fvswell").iterdir()}
    assert own is not None
    assert left == {own.name, "of version 0", "of version 1", "of version 2"}
    assert cache_directory() == own  # nothing more is removed once it is there
    assert {path.name for path in (tmp_path / "fvswell").iterdir()} == left


def test_threads_may_compile_and_call_at_once() -> None:
    def total(values: np.ndarray) -> float:
        result = 0.0
        for value in values:
            result += value
        return result

    compiled, start = kernel(total), threading.Barrier(4)
    found: list[float] = []

    def call() -> None:
        start.wait()
        found.append(compiled(np.arange(10.0)))

    threads = [threading.Thread(target=call) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [45.0] * 4
