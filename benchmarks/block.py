"""Speed of blocks: whole runs, the parts of a Newton iteration, growth with the grid, orderings, memory.

    python benchmarks/block.py [MOST_CELLS]    prints a Markdown page; docs/speed-blocks.md keeps one

Solvers are compared on one Jacobian; kvxopt, pypardiso and python-mumps take part where they are installed.
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
from scipy import sparse
from scipy.sparse.linalg import splu

import fvswell
from fvswell.block.block import Block, Interval
from fvswell.block.linearisation import Linearisation
from fvswell.block.make_block import unknown_places
from fvswell.numerics.sparse_lu import DirectSolver
from fvswell.numerics.state import record_room, workspace
from fvswell.simulation.block_run import BlockRun

CASE = Path(__file__).parent.parent / "cases" / "plane_strain.toml"
SIDES = (20, 40, 80, 160)
WHOLE = (20, 40)  # sides of the grids that the case is run on
DURATION = 100.0  # s, of the step whose iteration is timed
SYMMETRIC: dict[str, Any] = {"diag_pivot_thresh": 0.01, "options": {"SymmetricMode": True}}
ORDERINGS: dict[str, tuple[int, dict[str, Any]]] = {  # of SuperLU, and the most cells that they take seconds for
    "SuperLU, minimum degree of A + A^T, symmetric mode": (25600, {"permc_spec": "MMD_AT_PLUS_A", **SYMMETRIC}),
    "SuperLU, minimum degree of A + A^T": (1600, {"permc_spec": "MMD_AT_PLUS_A"}),
    "SuperLU, COLAMD": (1600, {"permc_spec": "COLAMD"}),
}


def fastest(function: Callable[[], object], repeats: int) -> float:
    """Shortest of several runs, s of the processor, which other work on the machine hardly changes."""
    durations = []
    for _ in range(repeats):
        began = time.process_time()
        function()
        durations.append(time.process_time() - began)
    return min(durations)


def whole(side: int) -> list[float]:
    """Seconds of the processor for set-up, integration and fields of a run; its steps, iterations and outputs."""
    case = fvswell.load_case(CASE).with_changes({"geometry.cells": [side, side]})
    best: list[list[float]] = []
    for _ in range(3):
        times = [time.process_time()]
        setup = BlockRun(case)
        times.append(time.process_time())
        state, control, protocol = setup.state, setup.control(), setup.protocol(setup.durations())
        record, work = record_room(state, 1000, 1000), workspace(state, len(control.nodes))
        setup.march(setup.body, setup.volumes, setup.scale, protocol, control, state, record, work)
        times.append(time.process_time())
        setup.fields(record)
        times.append(time.process_time())
        best.append(np.diff(times).tolist())
    outputs, steps = record.filled
    counts = [float(steps), float(record.steps[:steps, 2].sum()), float(outputs)]
    return [min(part) for part in zip(*best, strict=True)] + counts


def timings(side: int) -> dict[str, float]:
    """Seconds of the parts of an iteration on a square grid of cells, and the peak of memory in MB."""
    setup = BlockRun(fvswell.load_case(CASE).with_changes({"geometry.cells": [side, side]}))
    block, state = setup.block, setup.state
    loads = block.unloaded._replace(bath_concentration=np.full(len(block.parts), 5e-5))
    interval, unknowns, pattern = Interval(state.contents, DURATION, loads), state.unknowns, block.pattern
    evaluated = block.evaluate(unknowns, interval)

    def jacobian() -> np.ndarray:
        return block.jacobian(block.local_derivatives(evaluated, DURATION), loads) * block.entry_scale

    values, right = jacobian(), evaluated.residual / block.residual_scale
    repeats = 9 if side <= 40 else 3
    found = {"unknowns": float(pattern.size), "nonzeros": float(len(values))}
    found["residual"] = fastest(lambda: block.evaluate(unknowns, interval), repeats)
    found["Jacobian"] = fastest(jacobian, repeats)
    linearisation = Linearisation(block, evaluated, interval)
    found["step with kept factors"] = fastest(lambda: linearisation.step(evaluated, interval), repeats)
    found |= direct("fronts", block, values, right, repeats)
    found["peak memory, MB"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    found |= direct("superlu", block, values, right, repeats)
    matrix = sparse.csc_array((values, (pattern.rows, pattern.columns)), shape=(pattern.size, pattern.size))
    for name, (most, options) in ORDERINGS.items():
        if side**2 <= most:
            found[name] = fastest(lambda options=options: splu(matrix, **options).solve(right), 3 if side <= 40 else 1)
    for peer in (umfpack, pardiso, mumps):
        try:
            name, solve = peer(matrix, right)
        except ImportError:
            continue
        assert np.abs(matrix @ solve() - right).max() < 1e-9 * np.abs(right).max()
        found[name] = fastest(solve, repeats)
    return found


def direct(method: str, block: Block, values: np.ndarray, right: np.ndarray, repeats: int) -> dict[str, float]:
    """Seconds of our own solver by one of its methods."""
    os.environ["FVSWELL_SPARSE_SOLVER"] = method
    pattern = block.pattern
    places = unknown_places(block.grid, block.degrees_of_freedom, block.outside, len(block.balances))
    found = {"analysis": fastest(lambda: DirectSolver(pattern.rows, pattern.columns, places), 1)}
    solver = DirectSolver(pattern.rows, pattern.columns, places)
    found["factors"] = fastest(lambda: solver.factorise(values), repeats)
    factors = solver.factorise(values)
    found["solution"] = fastest(lambda: factors.solve(right), repeats)
    found["entries of the factors"] = float(factors.entries or 0)
    return {f"{method}: {name}": value for name, value in found.items()}


Peer = tuple[str, Callable[[], np.ndarray]]  # name, and what factorises and solves, the ordering known


def umfpack(matrix: sparse.csc_array, right: np.ndarray) -> Peer:
    import kvxopt
    from kvxopt import umfpack as library

    entries = matrix.tocoo()
    rows, columns = (kvxopt.matrix(index.astype(np.int64)) for index in entries.coords)
    own = kvxopt.spmatrix(kvxopt.matrix(entries.data), rows, columns, matrix.shape)
    analysis = library.symbolic(own)

    def solve() -> np.ndarray:
        solution = kvxopt.matrix(right.copy())
        library.solve(own, library.numeric(own, analysis), solution)
        return np.array(solution).ravel()

    return "UMFPACK (kvxopt)", solve


def pardiso(matrix: sparse.csc_array, right: np.ndarray) -> Peer:
    import pypardiso

    own, solver = matrix.tocsr(), pypardiso.PyPardisoSolver()
    solver.factorize(own)

    def solve() -> np.ndarray:
        solver.set_phase(22)  # numbers only, the ordering is kept
        solver._call_pardiso(own, right[:, None])
        return solver.solve(own, right)

    return "MKL PARDISO (pypardiso)", solve


def mumps(matrix: sparse.csc_array, right: np.ndarray) -> Peer:
    import mumps as library

    own, context = matrix.tocoo(), library.Context()
    context.set_matrix(own)
    context.analyze(ordering="amd")

    def solve() -> np.ndarray:
        context.set_matrix(own)
        context.factor(reuse_analysis=True)
        return context.solve(right.copy())

    return "MUMPS (python-mumps)", solve


def own_process(side: int) -> dict[str, float]:
    """Timings in a process of their own, so that memory is that of the one grid."""
    command = [sys.executable, __file__, "--side", str(side)]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return {name: float(value) for name, value in (line.rsplit("\t", 1) for line in output.splitlines())}


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
    # first, as the peak of memory of a process is counted from that of the one that starts it
    cells = [side**2 for side in SIDES if side**2 <= most]
    found = {count: own_process(int(count**0.5)) for count in cells}
    print("`cases/plane_strain.toml` from Python, the code compiled before:\n")
    print("| cells | set-up | integration | fields of the outputs | steps | Newton iterations | outputs |")
    print("|---|---|---|---|---|---|---|")
    for side in WHOLE:
        print(f"| {side**2} | " + " | ".join(f"{number:.4g}" for number in whole(side)) + " |")
    print()
    names = list(found[cells[0]])
    print(
        "Seconds of the parts of one Newton iteration, and of factors with solution by other orderings and solvers.\n"
    )
    print("| | " + " | ".join(f"{count} cells" for count in cells) + " | growth exponent |")
    print("|---|" + "---|" * (len(cells) + 1))
    for name in names:
        have = [count for count in cells if name in found[count]]
        values = [found[count][name] for count in have]
        shown = [f"{found[count][name]:.4g}" if count in have else "-" for count in cells]
        print(f"| {name} | {' | '.join(shown)} | {growth(have, values) if len(have) > 1 else float('nan'):.2f} |")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--side"]:
        for name, value in timings(int(sys.argv[2])).items():
            print(f"{name}\t{value!r}")
    else:
        page(int(sys.argv[1]) if len(sys.argv) > 1 else 6400)
