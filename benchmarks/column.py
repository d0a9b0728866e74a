"""Speed of one column and of many: ratios measured side by side in one run.

    python benchmarks/column.py            prints a Markdown page; docs/speed.md keeps one

Peers: `lsoda_peer` (a method-of-lines script on scipy's LSODA, to the same accuracy) and the stock-term assembly.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import datetime
import platform
import resource
import time
from pathlib import Path

import lsoda_peer
import numpy as np

import fvswell
from fvswell.column.column import Loads
from fvswell.column.stock_terms import StockTermsTransport
from fvswell.column.transport_term import Interval
from fvswell.numerics.time_stepping import Marcher
from fvswell.physics.models import MODELS
from fvswell.simulation.column_batch import ColumnBatch
from fvswell.simulation.relaxation import phase_durations

CASE = fvswell.load_case(Path(__file__).parent.parent / "cases" / "confined_compression.toml")
DURATION = 600.0
TIMES = np.array([1.0, 3.0, 10.0, 30.0, 60.0, 100.0, 150.0, 200.0, 300.0, 450.0, 600.0])
REPEATS = 5


def fastest(function) -> float:
    """Shortest of several runs, s."""
    seconds = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        function()
        seconds.append(time.perf_counter() - start)
    return min(seconds)


def timed(case: fvswell.Case) -> fvswell.Case:
    """The case with both phases of a known length."""
    return case.with_changes({"phase.0.duration": DURATION, "phase.1.duration": DURATION})


def march(case: fvswell.Case, observers=()) -> Marcher:
    """The solver alone: no file, no fields."""
    batch = ColumnBatch.of([case])
    durations = np.array([[phase.duration for phase in case.phase]])
    marcher = Marcher(batch.system, batch.protocol(durations), batch.control(), batch.start(), observers)
    marcher.run()
    return marcher


def error_controlled(tolerance: float) -> fvswell.Case:
    """The reference compression with SDIRK2, output at the times of comparison."""
    times = [*TIMES, *(DURATION + TIMES)]
    return timed(CASE).with_changes({"time": {"scheme": "sdirk2", "tolerance": tolerance}, "output": {"times": times}})


def strains(case: fvswell.Case) -> np.ndarray:
    """Global strain at the times of comparison."""
    return fvswell.run(case)["global_strain"].values[1:]


def one_column() -> list[str]:
    """(a) fixed steps, (b) error control, LSODA to the accuracy of (b), stock terms."""
    fixed = timed(CASE)
    a = fastest(lambda: march(fixed))
    controlled = error_controlled(1e-4)
    b = fastest(lambda: march(controlled))
    reference = strains(error_controlled(1e-7))
    largest = np.abs(reference).max()
    error = np.abs(strains(controlled) - reference).max() / largest
    lines = [
        "| run | s | error of the global strain, of the largest |",
        "|---|---|---|",
        f"| (a) 100 backward Euler steps | {a:.3f} | |",
        f"| (b) SDIRK2, tolerance 1e-4 | {b:.3f} | {error:.1e} |",
    ]
    pressures = (CASE.phase[0].piston_pressure, 0.0)
    for cells, rtol in ((50, 1e-3), (50, 1e-4), (50, 1e-6), (100, 1e-8)):

        def peer(cells=cells, rtol=rtol):
            return lsoda_peer.solve(cells, 20.0, pressures, DURATION, rtol, TIMES)

        seconds = fastest(peer)
        off = np.abs(peer()[0] - reference).max() / largest if cells == 50 else np.nan
        told = f"{off:.1e}" if cells == 50 else "(another grid)"
        lines.append(f"| LSODA script, {cells} cells, rtol {rtol:g} | {seconds:.3f} | {told} |")
    return [*lines, "", *assembly()]


def assembly() -> list[str]:
    """One Newton step by the coupled term and by the stock terms."""
    batch = ColumnBatch.of([timed(CASE)])
    term, state = batch.system.term, batch.start()
    stock = StockTermsTransport(term.grid, term.laws)
    loads = Loads(np.array([[0.1]]), np.array([[1.5e-4]]))
    interval = Interval.under(term.laws, state.contents, np.array([[2.0]]), loads)
    balance = term.balance(state.unknowns, interval)
    coupled = fastest(lambda: [term.linearise(term.balance(state.unknowns, interval)) for _ in range(20)]) / 20
    slow = fastest(lambda: stock.matrix(state.unknowns, interval, balance))
    return [
        f"Assembly of matrix and residual, 50 cells, full model: coupled term {1e3 * coupled:.2f} ms, stock terms "
        f"{1e3 * slow:.0f} ms, ratio {slow / coupled:.0f}.",
    ]


def batches() -> list[str]:
    """Milliseconds a run on one core when N columns are advanced at once."""
    draw = np.random.default_rng(1)
    lines = [
        "| columns | relaxation times | biphasic-swelling | electrochemical | peak memory, MB |",
        "|---|---|---|---|---|",
    ]
    for rows in (1, 10, 100, 200, 1000):
        cases = [
            CASE.with_changes(
                {
                    "tissue.youngs_modulus": draw.uniform(0.3, 0.7),
                    "tissue.cation_diffusivity": 5e-4 * 10 ** draw.uniform(-0.7, 0.7),
                    "tissue.anion_diffusivity": 8e-4 * 10 ** draw.uniform(-0.7, 0.7),
                    "tissue.hydraulic_permeability": 10 ** draw.uniform(-3.7, -2.3),
                    "phase.loading.piston_pressure": draw.uniform(0.05, 0.3),
                }
            )
            for _ in range(rows)
        ]
        start = time.perf_counter()
        durations = phase_durations(cases)
        spent = [time.perf_counter() - start]
        for model in ("biphasic-swelling", "electrochemical"):
            start = time.perf_counter()
            batch = ColumnBatch.of(cases, MODELS[model])
            Marcher(batch.system, batch.protocol(durations), batch.control(), batch.start()).run()
            spent.append(time.perf_counter() - start)
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        lines.append(f"| {rows} | " + " | ".join(f"{1e3 * s / rows:.1f} ms" for s in spent) + f" | {memory} |")
    return lines


def main() -> None:
    """Print the page."""
    described = Path("/proc/cpuinfo").read_text().splitlines()
    models = [line.split(":")[1].strip() for line in described if line.startswith("model name")]
    processor = models[0] if models else platform.processor()
    print(
        "# Speed",
        "",
        f"Written by `python benchmarks/column.py`, {datetime.date.today()}, {processor}, one thread, Python "
        f"{platform.python_version()}, numpy {np.__version__}. Times are the shortest of {REPEATS} runs; quote ratios.",
        "",
        f"## One column: the reference compression, full model, 50 cells, two phases of {DURATION:g} s",
        "",
        *one_column(),
        "",
        "## Many columns: 50 cells, 2 x 50 backward Euler steps, time for each run on one core",
        "",
        *batches(),
        sep="\n",
    )


if __name__ == "__main__":
    main()
