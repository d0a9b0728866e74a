"""The simplest body that the integrator takes: one cell, one balance, solved exactly."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fvswell.numerics.body import (
    admissible,
    complete_loads,
    find_rate,
    find_unknowns,
    global_strain,
    solve_stage,
)
from fvswell.numerics.integrator import march
from fvswell.numerics.loads import Protocol
from fvswell.numerics.state import (
    BALANCE,
    ITERATIONS,
    NOT_CONVERGED,
    POINT,
    REASON,
    RESIDUAL,
    Control,
    Record,
    State,
    record_room,
    start_state,
    workspace,
)
from fvswell.physics.tissue import Array


@dataclass
class Reservoir:
    """dm/dt = rate (load - m). It fails for steps that are too long, or once it holds more than it can."""

    rate: float
    longest: float = np.inf
    most: float = np.inf
    attempts: list[float] = field(default_factory=list)


def _solve(
    body: Reservoir, unknowns: Array, contents: Array, base: Array, duration: float, loads: Array, tolerance: float,
    crossing: Array, clock: Array, report: Array,
) -> bool:  # fmt: skip
    body.attempts.append(duration)
    report[ITERATIONS] = 1
    contents[0, 0] = (base[0, 0] + body.rate * duration * loads[0]) / (1.0 + body.rate * duration)
    unknowns[0] = contents[0, 0]
    crossing[:] = 0.0
    crossing[0, 0] = body.rate * (loads[0] - contents[0, 0])
    if duration <= body.longest and contents[0, 0] <= body.most:
        return True
    report[REASON], report[BALANCE], report[POINT], report[RESIDUAL] = NOT_CONVERGED, 0, 0, 7.0
    return False


def _unknowns(body: Reservoir, unknowns: Array, contents: Array, *others: Any) -> bool:
    unknowns[0] = contents[0, 0]
    return True


def _rate(
    body: Reservoir, unknowns: Array, contents: Array, loads: Array, slopes: Array, rate: Array, crossing: Array,
    clock: Array, report: Array,
) -> bool:  # fmt: skip
    unknowns[0] = contents[0, 0]
    rate[0, 0] = body.rate * (loads[0] - contents[0, 0])
    crossing[:] = 0.0
    crossing[0, 0] = rate[0, 0]
    return True


# not by `register`: that would note the functions down for compiled code, whose cache depends on all that is noted
solve_stage.implementations[Reservoir] = _solve
find_rate.implementations[Reservoir] = _rate
find_unknowns.implementations[Reservoir] = _unknowns
global_strain.implementations[Reservoir] = lambda body, unknowns, contents: contents[0, 0]
admissible.implementations[Reservoir] = lambda body, guess, unknowns: True
complete_loads.implementations[Reservoir] = lambda body, unknowns, contents, loads: None


def empty_reservoir() -> State:
    """State at the start: nothing inside, the load zero."""
    return start_state(np.zeros(1), np.zeros((1, 1)), np.zeros(1), parts=1)


def fill(
    body: Reservoir, protocol: Protocol, control: Control, state: State | None = None, outputs: int = 5000,
    steps: int = 5000,
) -> tuple[State, Record]:  # fmt: skip
    """Run to the end of the protocol, or until the record is full."""
    state = state or empty_reservoir()
    record = record_room(state, outputs, steps)
    march(body, np.ones(1), np.ones(1), protocol, control, state, record, workspace(state, len(control.nodes)))
    return state, record
