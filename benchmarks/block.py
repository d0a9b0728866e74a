"""Speed of blocks: assembly and solution of a Newton iteration, growth with the grid, orderings, memory.

    python benchmarks/block.py [MOST_CELLS]    prints a Markdown page; docs/speed-blocks.md keeps one

Solvers are compared on one Jacobian each; pypardiso takes part where it is installed.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import datetime
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse.linalg import splu

import fvswell
from fvswell.block_run import BlockRun
from fvswell.block_system import edge_loads
from fvswell.block_transport import BlockInterval

CASE = Path(__file__).parent.parent / "cases" / "plane_strain.toml"
SIDES = (20, 40, 80, 160)
DURATION = 100.0  # s, of the step whose iteration is timed
ORDERINGS: dict[str, dict[str, Any]] = {
    "MMD_AT_PLUS_A, symmetric mode": {
        "permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.01, "options": {"SymmetricMode": True},
    },
    "MMD_AT_PLUS_A": {"permc_spec": "MMD_AT_PLUS_A"},
    "COLAMD": {"permc_spec": "COLAMD"},
}  # fmt: skip


def fastest(function: Callable[[], object], repeats: int) -> float:
    """Shortest of several runs, s."""
    durations = []
    for _ in range(repeats):
        began = time.perf_counter()
        function()
        durations.append(time.perf_counter() - began)
    return min(durations)


def timings(side: int) -> dict[str, float]:
    """Seconds of the parts of an iteration on a square grid of cells, and the peak of memory in MB."""
    body = BlockRun(fvswell.load_case(CASE).with_changes({"geometry.cells": [side, side]}))
    block, state = body.block, body.start()
    bath = 5e-5
    interval, loads = BlockInterval(state.contents, DURATION, bath), edge_loads({"bath": np.array([bath])})
    unknowns = state.unknowns[0, 0]
    scale = block.residual_scale(bath)
    entry_scale = block.unknown_scale[block.pattern.columns] / scale[block.pattern.indices]
    evaluated = block.evaluate(unknowns, interval, loads)
    matrix = block.pattern.matrix(block.jacobian(evaluated, interval, loads) * entry_scale)
    right = evaluated.residual / scale
    repeats = 5 if side <= 40 else 2
    found = {"unknowns": float(len(unknowns)), "nonzeros": float(matrix.nnz)}
    found["residual"] = fastest(lambda: block.evaluate(unknowns, interval, loads), repeats)
    found["Jacobian"] = fastest(lambda: block.jacobian(evaluated, interval, loads), repeats)
    for name, options in ORDERINGS.items():
        if side > 40 and name != next(iter(ORDERINGS)):
            continue  # minutes
        found[name] = fastest(lambda options=options: splu(matrix, **options).solve(right), 1 if side > 40 else 3)
        if name == next(iter(ORDERINGS)):
            found["memory"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    try:
        import pypardiso
    except ImportError:
        return found

    def solve_with_pardiso() -> None:
        solver = pypardiso.PyPardisoSolver()
        pypardiso.spsolve(matrix.tocsr(), right, solver=solver)
        solver.free_memory(everything=True)

    found["pypardiso"] = fastest(solve_with_pardiso, 3)
    return found


def own_process(side: int) -> dict[str, float]:
    """Timings in a process of their own, so that memory is that of the one grid."""
    command = [sys.executable, __file__, "--side", str(side)]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return {name: float(value) for name, value in (line.rsplit("\t", 1) for line in told.splitlines())}


def growth(cells: list[int], seconds: list[float]) -> float:
    """Exponent of the growth with the number of cells, by least squares over the logarithms."""
    return float(np.polyfit(np.log(cells), np.log(seconds), 1)[0])


def page(most: int) -> None:
    print("# Speed of blocks\n")
    print(f"Measured {datetime.date.today().isoformat()} by `python benchmarks/block.py` ({platform.machine()},")
    print(
        f"{os.cpu_count()} cores shared with other work, one thread, Python {platform.python_version()}). The model is"
    )
    print("the electrochemical one.\n")
    began = time.perf_counter()
    result = fvswell.run(fvswell.load_case(CASE))
    print(
        f"The whole of `cases/plane_strain.toml` (400 cells): {time.perf_counter() - began:.1f} s, "
        f"{result.sizes['step']} steps, {int(result['step_iterations'].sum())} Newton iterations.\n"
    )
    cells = [side**2 for side in SIDES if side**2 <= most]
    found = {count: own_process(int(count**0.5)) for count in cells}
    names = list(found[cells[0]])
    print("Seconds of one Newton iteration: residual, Jacobian, and factors with solution by ordering; memory in MB.\n")
    print("| | " + " | ".join(f"{count} cells" for count in cells) + " | growth exponent |")
    print("|---|" + "---|" * (len(cells) + 1))
    for name in names:
        have = [count for count in cells if name in found[count]]
        values = [found[count][name] for count in have]
        told = [f"{found[count][name]:.4g}" if count in have else "-" for count in cells]
        print(f"| {name} | {' | '.join(told)} | {growth(have, values) if len(have) > 1 else float('nan'):.2f} |")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--side"]:
        for name, value in timings(int(sys.argv[2])).items():
            print(f"{name}\t{value!r}")
    else:
        page(int(sys.argv[1]) if len(sys.argv) > 1 else 6400)
