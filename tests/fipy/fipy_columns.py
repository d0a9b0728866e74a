"""Small columns for the tests of the FiPy package."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from integrations import equal_steps, loads, make_column
from tissues import BATH, reference_tissue

from fvswell.column.balances import COLUMN_LOADS
from fvswell.column.column import FILTER_AND_PISTON, Column, compiled_march
from fvswell.fipy import direct_solver
from fvswell.numerics.loads import make_protocol
from fvswell.numerics.state import Control
from fvswell.physics.tissue import Array

VARIED = {"solid": "holmes-mow", "permeability_exponent": 2.0, "activity_ratio": 0.8}
EVERY_LOAD = {
    "pressure": 0.2, "filter_bath_concentration": 1.2e-4, "piston_bath_pressure": 0.01,
    "piston_bath_concentration": 1.6e-4, "filter_current": 1e-4,
}  # fmt: skip


class Moved(NamedTuple):
    """A column away from equilibrium, and the start of the step that led there."""

    column: Column
    J: Array  # of the equilibrated column
    contents: Array
    base: Array
    loads: Array


def moved(model: str, seed: int, open_circuit: Any = "initial", parts: Any = FILTER_AND_PISTON) -> Moved:
    """A short graded column in a random state, with every load that there is."""
    tissue = reference_tissue(**VARIED)
    column = make_column(model, tissue, 9, 8.0, open_circuit=open_circuit, parts=parts)
    J = column.initial_volume_ratio()
    base = column.contents(J, BATH)
    contents = base * np.random.default_rng(seed).uniform(0.9, 1.1, base.shape)
    return Moved(column, J, contents, base, values(**EVERY_LOAD))


def values(**given: float) -> Array:
    """Loads as an array: no pressure, no current, no given height, and the reference bath, but for what is given."""
    default = {name: BATH if "concentration" in name else 0.0 for name in COLUMN_LOADS} | {"height": np.nan}
    return np.array(list((default | given).values()))


def dense(equation: Any, duration: float) -> tuple[Array, Array]:
    """Matrix and residual that FiPy builds from an equation."""
    equation.cacheMatrix()
    residual = np.array(equation.justResidualVector(dt=duration, solver=direct_solver())).ravel()
    return np.array(equation.matrix.numpyArray), residual


def setup(column: Column, duration: float, control: Control | None = None, **given: Any) -> Any:
    """What is run: one phase of a column under constant loads."""
    J = column.initial_volume_ratio()
    start, chosen = column.start(J), control or equal_steps(8)
    return SimpleNamespace(
        case=SimpleNamespace(source="test", assembly="fipy", phase=[SimpleNamespace(duration=duration, until=None)]),
        column=column, initial_volume_ratio=J, state=start,
        body=column.body(J), tissue=column.cells, march=compiled_march, volumes=column.grid.widths,
        scale=column.scale[: len(start.contents)],
        protocol=lambda durations: make_protocol([loads(**given)], durations), control=lambda: chosen,
    )  # fmt: skip
