"""Speed of one column and of many: ratios measured side by side in one run.

    python benchmarks/column.py            prints a Markdown page; docs/speed.md keeps one

Peer: `lsoda_peer`, a method-of-lines script on scipy's LSODA, to the same accuracy.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import datetime
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import lsoda_peer
import numpy as np

import fvswell
from fvswell.case.case import Case
from fvswell.numerics.state import record_room, workspace
from fvswell.physics.models import MODELS
from fvswell.simulation.column_run import ColumnRun
from fvswell.simulation.march import march_all
from fvswell.simulation.relaxation import phase_durations

ROOT = Path(__file__).parent.parent
CASE = fvswell.load_case(ROOT / "cases" / "confined_compression.toml")
DURATION = 600.0
TIMES = np.array([1.0, 3.0, 10.0, 30.0, 60.0, 100.0, 150.0, 200.0, 300.0, 450.0, 600.0])
REPEATS = 15


def fastest(function: Callable[[], object], repeats: int = REPEATS) -> float:
    """Shortest of several runs, s."""
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        seconds.append(time.perf_counter() - start)
    return min(seconds)


def timed(case: Case) -> Case:
    """The case with both phases of a known length."""
    return case.with_changes({"phase.0.duration": DURATION, "phase.1.duration": DURATION})


def backward_euler(case: Case) -> Case:
    """The case with 50 equal steps a phase, of which nothing but the end is recorded."""
    return case.with_changes(
        {"time": {"scheme": "backward-euler", "steps_per_phase": 50}, "output": {"times": [2.0 * DURATION]}}
    )


def error_controlled(tolerance: float) -> Case:
    """The reference compression with steps chosen by the error, output at the times of comparison."""
    times = [*TIMES, *(DURATION + TIMES)]
    return timed(CASE).with_changes(
        {"time": {"scheme": "esdirk43", "tolerance": tolerance}, "output": {"times": times}}
    )


def march_seconds(case: Case) -> float:
    """Time of the integrator alone: no file, no fields, no preparation."""
    seconds = []
    for _ in range(REPEATS):
        run = ColumnRun(case)
        durations = [float(phase.duration) for phase in case.phase]  # type: ignore[arg-type]
        protocol, control, body, state = run.protocol(durations), run.control(), run.body, run.state
        record, work = record_room(state, 200, 2000), workspace(state, len(control.nodes))
        start = time.perf_counter()
        run.march(body, run.volumes, run.scale, protocol, control, state, record, work)
        seconds.append(time.perf_counter() - start)
    return min(seconds)


def strains(case: Case) -> np.ndarray:
    """Global strain at the times of comparison."""
    return np.asarray(fvswell.run(case)["global_strain"].values[1:])


def one_column() -> list[str]:
    """Given steps, error control, and LSODA to the same accuracy."""
    reference = strains(error_controlled(1e-8))
    largest = np.abs(reference).max()
    lines = ["| run | ms | error of the global strain, of the largest |", "|---|---|---|"]
    lines.append(f"| 100 backward Euler steps | {1e3 * march_seconds(backward_euler(timed(CASE))):.2f} | |")
    for tolerance in (1e-3, 1e-4, 1e-5):
        case = error_controlled(tolerance)
        error = np.abs(strains(case) - reference).max() / largest
        lines.append(f"| ESDIRK4(3), tolerance {tolerance:g} | {1e3 * march_seconds(case):.2f} | {error:.1e} |")
    pressures = (0.25, 0.0)
    for rtol in (1e-3, 1e-4, 3e-5, 1e-6):

        def peer(rtol: float = rtol) -> tuple[np.ndarray, int]:
            return lsoda_peer.solve(50, 20.0, pressures, DURATION, rtol, TIMES)

        error = np.abs(peer()[0] - reference).max() / largest
        lines.append(f"| LSODA script, rtol {rtol:g} | {1e3 * fastest(peer, 5):.0f} | {error:.1e} |")
    return lines


def from_python() -> list[str]:
    """`fvswell.run` in a loop, and the command as a whole process."""
    given = fastest(lambda: fvswell.run(timed(CASE)))
    found = fastest(lambda: fvswell.run(CASE))
    commands = []
    for _ in range(5):
        with tempfile.TemporaryDirectory() as directory:
            command = [sys.executable, "-m", "fvswell", "run", str(ROOT / "cases" / "confined_compression.toml")]
            start = time.perf_counter()
            subprocess.run([*command, "--output", directory], check=True, capture_output=True)
            commands.append(time.perf_counter() - start)
    return [
        "| `fvswell.run(case)` in a loop | ms |",
        "|---|---|",
        f"| durations given | {1e3 * given:.1f} |",
        f"| relaxation times to be found | {1e3 * found:.1f} |",
        "",
        f"`fvswell run cases/confined_compression.toml`, whole process, code in the cache: {min(commands):.2f} s.",
    ]


def many_columns() -> list[str]:
    """Milliseconds a run on one core when columns are run one after the other, as in a batch of a study."""
    draw = np.random.default_rng(1)
    lines = ["| columns | relaxation times | biphasic-swelling | electrochemical |", "|---|---|---|---|"]
    for rows in (1, 10, 100, 1000):
        cases = [
            CASE.with_changes(
                {
                    "tissue.youngs_modulus": draw.uniform(0.3, 0.7),
                    "tissue.cation_diffusivity": 5e-4 * 10 ** draw.uniform(-0.7, 0.7),
                    "tissue.anion_diffusivity": 8e-4 * 10 ** draw.uniform(-0.7, 0.7),
                    "tissue.hydraulic_permeability": 10 ** draw.uniform(-3.7, -2.3),
                    "phase.loading.piston.pressure": draw.uniform(0.05, 0.3),
                    "time": {"scheme": "backward-euler", "steps_per_phase": 50},
                }
            )
            for _ in range(rows)
        ]
        start = time.perf_counter()
        durations = [phase_durations(case) for case in cases]
        spent = [time.perf_counter() - start]
        for model in ("biphasic-swelling", "electrochemical"):
            start = time.perf_counter()
            for case, lengths in zip(cases, durations, strict=True):
                run = ColumnRun(case, MODELS[model])
                march_all(run, run.protocol(lengths, times=[sum(lengths)]), run.control()._replace(every=0))
            spent.append(time.perf_counter() - start)
        lines.append(f"| {rows} | " + " | ".join(f"{1e3 * s / rows:.1f} ms" for s in spent) + " |")
    return lines


def main() -> None:
    """Print the page."""
    described = Path("/proc/cpuinfo").read_text().splitlines()
    models = [line.split(":")[1].strip() for line in described if line.startswith("model name")]
    processor = models[0] if models else platform.processor()
    fvswell.run(timed(CASE))  # what is not in the cache is compiled now
    print(
        "# Speed of columns",
        "",
        f"Written by `python benchmarks/column.py`, {datetime.date.today()}, {processor}, one thread, Python "
        f"{platform.python_version()}, numpy {np.__version__}. Times are the shortest of {REPEATS} runs; quote ratios.",
        "",
        f"## One column: the reference compression, full model, 50 cells, 2 x {DURATION:g} s, integrator alone",
        "",
        *one_column(),
        "",
        "## From Python and from the command line",
        "",
        *from_python(),
        "",
        "## Many columns: 50 cells, 2 x 50 backward Euler steps, one after the other on one core, preparation included",
        "",
        *many_columns(),
        sep="\n",
    )


if __name__ == "__main__":
    main()
