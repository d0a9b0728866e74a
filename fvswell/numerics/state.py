"""What the time integrator keeps: state, settings, records and workspace, all of them arrays and numbers.

The arrays of a `State` are all that a run needs to go on, so a run may stop after any step and be continued later.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

__all__ = ["Control", "Record", "State", "Workspace", "record_room", "start_state", "workspace"]

# entries of State.clock
TIME, ELAPSED, SIZE, LARGEST, NEWTON, NEAR, FAR, LOSS, START_STRAIN = range(9)
# entries of State.counts
PHASE, SEGMENT, STEP, OUTPUT, ENTER, RATE_KNOWN, RESTARTED, STATUS = range(8)
# values of counts[STATUS]
RUNNING, COMPLETE, FAILED = range(3)
# entries of the report of a stage
ITERATIONS, UPDATE, RESIDUAL, BALANCE, POINT, REASON = range(6)
# why a stage failed
CONVERGED, NOT_CONVERGED, NO_WATER, SINGULAR = range(4)

SAME_TIME = 1e-12  # of the time since the run began: times that are closer are one


class Control(NamedTuple):
    """How steps are chosen."""

    coefficients: Any  # of the scheme, see `tableaux.Tableau`, whose fields come first
    nodes: Any
    error_weights: Any
    error_order: int
    dense_weights: Any
    dense_stages: Any
    guesses: Any
    tolerance: float  # of the global strain, relative to its largest value; without error control, of Newton
    expected_strain: float  # that the tolerance is relative to as long as no larger one has been seen
    max_step: float  # s
    first_step: float  # s, where loads jump
    fixed_steps: int  # equal steps in a phase; 0: chosen by the error
    every: int  # record each of so many steps; 0: at the output times of the protocol


class State(NamedTuple):
    """Where a body stands; changed in place."""

    unknowns: Any  # (unknowns,)
    contents: Any  # (balances, cells), per reference volume; the first is J
    rate: Any  # (balances, cells) at the end of the last step
    crossing: Any  # (parts, 3) rates at which water, anions and cations enter, at the end of the last step
    crossed: Any  # (parts, 3) what has entered since the run began
    traffic: Any  # (3,) the same in magnitude, over all parts
    loads: Any  # (loads,) as they are
    phase_loads: Any  # (loads,) at the start of the phase
    past: Any  # (2, unknowns) earlier unknowns, the later first
    errors: Any  # (3,) largest mismatch of volume, anions and cations since the last record, relative to the traffic
    clock: Any  # times and sizes, see the names above
    counts: Any  # whole numbers


class Record(NamedTuple):
    """What a run leaves behind, filled from the front."""

    time: Any  # (outputs,) s since the run began
    unknowns: Any  # (outputs, unknowns)
    contents: Any  # (outputs, balances, cells)
    loads: Any  # (outputs, loads)
    crossed: Any  # (outputs, parts, 3)
    errors: Any  # (outputs, 3)
    phase: Any  # (outputs,) that the output belongs to
    steps: Any  # (steps, 4): time at the end, size, Newton iterations, last update
    filled: Any  # (2,): number of outputs and of steps


class Workspace(NamedTuple):
    """Arrays that a step needs."""

    rates: Any  # (stages, balances, cells)
    crossings: Any  # (stages, parts, 3)
    stages: Any  # (stages, unknowns)
    base: Any  # (balances, cells)
    contents: Any  # (balances, cells)
    unknowns: Any  # (unknowns,)
    loads: Any  # (loads,)
    slopes: Any  # (loads,)
    extents: Any  # (loads,)
    crossing: Any  # (parts, 3)
    dense: Any  # (parts, 3)
    report: Any  # (6,)
    nodes: Any  # (stages + 2,)


def start_state(unknowns: Any, contents: Any, loads: Any, parts: int) -> State:
    """State of a body in equilibrium, before its first phase."""
    clock, counts = np.zeros(9), np.zeros(8, dtype=np.int64)
    clock[SIZE] = np.inf
    clock[NEWTON] = np.inf
    counts[ENTER] = 1
    return State(
        unknowns=unknowns.copy(), contents=contents.copy(), rate=np.zeros_like(contents),
        crossing=np.zeros((parts, 3)), crossed=np.zeros((parts, 3)), traffic=np.zeros(3), loads=loads.copy(),
        phase_loads=loads.copy(), past=np.zeros((2, len(unknowns))), errors=np.zeros(3), clock=clock, counts=counts,
    )  # fmt: skip


def record_room(state: State, outputs: int, steps: int) -> Record:
    """Room for a number of outputs and steps."""
    parts = len(state.crossed)
    return Record(
        np.zeros(outputs), np.zeros((outputs, len(state.unknowns))), np.zeros((outputs, *state.contents.shape)),
        np.zeros((outputs, len(state.loads))), np.zeros((outputs, parts, 3)), np.zeros((outputs, 3)),
        np.zeros(outputs, dtype=np.int64), np.zeros((steps, 4)), np.zeros(2, dtype=np.int64),
    )  # fmt: skip


def workspace(state: State, stages: int) -> Workspace:
    """Arrays for steps from a state."""
    contents, unknowns, loads, parts = state.contents, state.unknowns, state.loads, len(state.crossed)
    return Workspace(
        np.zeros((stages, *contents.shape)), np.zeros((stages, parts, 3)), np.zeros((stages, len(unknowns))),
        np.zeros_like(contents), np.zeros_like(contents), np.zeros_like(unknowns), np.zeros_like(loads),
        np.zeros_like(loads), np.zeros_like(loads), np.zeros((parts, 3)), np.zeros((parts, 3)), np.zeros(6),
        np.zeros(stages + 2),
    )  # fmt: skip
