"""What fibres cost: the integrator with and without them, measured in turns in one run.

python benchmarks/fibres.py        prints a Markdown page; docs/speed.md keeps its table
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import time
from pathlib import Path
from typing import Any

import fvswell
from fvswell.case.case import Case
from fvswell.numerics.state import record_room, workspace
from fvswell.simulation.run import make_setup

CASES = Path(__file__).parent.parent / "cases"
FAMILIES: dict[str, list[dict[str, Any]]] = {
    "none": [],
    "isotropic, power 2": [{"directions": "isotropic", "modulus": 1.0}],
    "isotropic, exponential": [{"directions": "isotropic", "modulus": 1.0, "exponent": 5.0}],
    "isotropic, exponential, power 2.5": [{"directions": "isotropic", "modulus": 1.0, "exponent": 5.0, "power": 2.5}],
    "isotropic, logarithmic": [{"directions": "isotropic", "law": "logarithmic", "modulus": 1.0, "exponent": 8.0}],
    "planar, power 2": [{"directions": "planar", "modulus": 1.0}],
    "along the axis, power 2": [{"directions": "along", "angle": 90.0, "modulus": 1.0}],
}
EQUAL = {"time.scheme": "backward-euler"}
COLUMN = EQUAL | {
    "phase.loading.duration": 600.0, "phase.unloading.duration": 600.0, "time.steps_per_phase": 50,
    "output.times": [1200.0],
}  # fmt: skip
DISC = EQUAL | {"time.steps_per_phase": 500, "output.times": [3000.0]}
KINDS = {
    "column of 50 cells, 2 x 50 steps": ("confined_compression", COLUMN, 15),
    "disc of 24 x 2 cells, 500 steps": ("unconfined_disc", DISC, 3),
}


def march_seconds(case: Case) -> tuple[float, int]:
    """Seconds of the processor for the integrator alone, and its Newton iterations."""
    setup: Any = make_setup(case)
    protocol = setup.protocol([float(phase.duration) for phase in case.phase])  # type: ignore[arg-type]
    control, body, state = setup.control(), setup.body, setup.state
    record, work = record_room(state, 200, 2000), workspace(state, len(control.nodes))
    start = time.process_time()
    setup.march(body, setup.volumes, setup.scale, protocol, control, state, record, work)
    return time.process_time() - start, int(record.steps[: record.filled[1], 2].sum())


def table(name: str, changes: dict[str, Any], repeats: int) -> list[str]:
    """Times and ratios of a case with every family, the shortest of runs in turns."""
    base = fvswell.load_case(CASES / f"{name}.toml").with_changes(changes)
    cases = {kind: base.with_changes({"tissue.fibres": given}) if given else base for kind, given in FAMILIES.items()}
    best = {kind: march_seconds(case) for kind, case in cases.items()}  # compiles
    for _ in range(repeats):
        best = {kind: min(best[kind], march_seconds(case)) for kind, case in cases.items()}
    seconds, iterations = best["none"]
    return [
        f"| {kind} | {1e3 * s:.2f} | {s / seconds:.2f} | {n} | {s / n / (seconds / iterations):.2f} |"
        for kind, (s, n) in best.items()
    ]


def main() -> None:
    """Print the page."""
    for title, (name, changes, repeats) in KINDS.items():
        print(f"\n{title[0].upper()}{title[1:]}, backward Euler, electrochemical:\n")
        print("| fibres | ms | over those without | Newton iterations | ratio of an iteration |\n|---|---|---|---|---|")
        print("\n".join(table(name, changes, repeats)))


if __name__ == "__main__":
    main()
