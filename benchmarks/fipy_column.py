"""Time of one Newton step of a column by each of the ways that docs/fipy.md compares, and of moving its mesh.

Run it as ``python benchmarks/fipy_column.py [cells]``.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import fvswell
from fvswell.fipy.body import FluxTermEquation
from fvswell.fipy.mesh import column_mesh, column_nodes, move
from fvswell.fipy.stock_terms import StockTerms
from fvswell.numerics.state import record_room, workspace
from fvswell.simulation.setup import Setup, make_setup

CASE = Path(__file__).parent.parent / "cases" / "confined_compression.toml"


def best(task: Callable[[], Any], repeats: int) -> float:
    """Least processor time of a number of runs, ms."""
    task()
    times = []
    for _ in range(repeats):
        start = time.process_time()
        task()
        times.append(time.process_time() - start)
    return 1e3 * min(times)


def compiled(setup: Setup, repeats: int) -> float:
    """Processor time of a whole compiled run for each of its Newton steps, ms."""
    control, times = setup.control(), []
    for _ in range(repeats):
        state = make_setup(setup.case).state
        record, work = record_room(state, 200, 200), workspace(state, len(control.nodes))
        protocol, start = setup.protocol([600.0, 600.0]), time.process_time()
        setup.march(setup.body, setup.volumes, setup.scale, protocol, control, state, record, work)
        times.append((time.process_time() - start) / record.steps[:, 2].sum())
    return 1e3 * min(times)


def main() -> None:
    cells = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    changes = {"geometry.cells": cells, "geometry.grading": 1, "time.scheme": "backward-euler"}
    setup: Any = make_setup(fvswell.load_case(CASE).with_changes(changes))
    contents, column, loads = setup.state.contents.copy(), setup.column, setup.state.loads.copy()
    loads[:2] = 0.25, np.nan
    step = (contents, contents, 1.0, loads, 0.0)
    term, stock = FluxTermEquation(column, setup.body), StockTerms(column, setup.initial_volume_ratio)
    mesh, nodes = column_mesh(column.grid), column_nodes(column.grid, contents[0])[None]
    figures = {
        "compiled kernels": compiled(setup, 10),
        "one term": best(lambda: term.sweep(*step), 50),
        "stock terms, kept": best(lambda: stock.sweep(*step), 10),
        "stock terms, new": best(lambda: StockTerms(column, setup.initial_volume_ratio).sweep(*step), 5),
        "moving the mesh": best(lambda: move(mesh, nodes), 50),
        "a new mesh": best(lambda: column_mesh(column.grid), 20),
    }
    for name, figure in figures.items():
        print(f"{name:20s} {figure:10.4g} ms")


if __name__ == "__main__":
    main()
