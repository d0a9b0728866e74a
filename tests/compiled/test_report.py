"""The first compilation is reported, once, as it begins; what comes from the cache is not."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from fvswell.compiled.kernels import COMPILING

SCRIPT = """
import sys
import numpy as np
from fvswell.compiled import kernel, law_kernel
from fvswell.compiled.kernels import report_compilation
from fvswell.physics.permeability import ExponentialPermeability, permeability

def flow(J):
    return permeability(ExponentialPermeability(1e-3, 2.0), J, 0.8)

def make(law):
    def evaluate(J, k):
        k[0] = permeability(law(1e-3, 2.0), J[0], 0.8)
    return evaluate

report_compilation(print)
print("begun")
if "law" in sys.argv:
    law_kernel(make, (1, 1), ExponentialPermeability)
if "kernel" in sys.argv:
    kernel(flow)(0.9)
print("done")
"""


def lines_of(script: Path, cache: Path, *parts: str) -> list[str]:
    """What the script prints."""
    done = subprocess.run(
        [sys.executable, script, *parts], env=os.environ | {"FVSWELL_CACHE_DIR": str(cache)}, capture_output=True,
        text=True, check=True,
    )  # fmt: skip
    return done.stdout.splitlines()


def test_what_is_compiled_is_reported_and_what_is_loaded_is_not(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT, encoding="utf-8")
    reported, silent = ["begun", COMPILING, "done"], ["begun", "done"]
    assert lines_of(script, tmp_path) == silent
    assert lines_of(script, tmp_path, "law") == reported
    assert lines_of(script, tmp_path, "law") == silent
    assert lines_of(script, tmp_path, "law", "kernel") == reported
    assert lines_of(script, tmp_path, "law", "kernel") == silent
    assert lines_of(script, tmp_path / "other", "law", "kernel") == reported
