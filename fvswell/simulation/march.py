"""Running the integrator to the end, and saying why it stopped."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fvswell.numerics.loads import Protocol
from fvswell.numerics.state import (
    BALANCE,
    ELAPSED,
    FAILED,
    LOSS,
    NO_WATER,
    PHASE,
    POINT,
    REASON,
    RESIDUAL,
    RUNNING,
    STATUS,
    Control,
    Record,
    State,
    Workspace,
    record_room,
    workspace,
)
from fvswell.physics.models import MODELS

if TYPE_CHECKING:
    from fvswell.simulation.setup import Setup

__all__ = ["march_all", "problem_of"]

_STEPS = 512  # of room for the history of steps
_LARGEST_LOSS = 1e-8  # of what is in the body and has crossed its boundary: beyond it a result is refused


def march_all(setup: Setup, protocol: Protocol, control: Control) -> tuple[Record, str]:
    """Run to the end, keeping the outputs at the times of the protocol and no history of steps.

    Returns
    -------
    record, problem
        The outputs, and why the run cannot be used; "" where nothing is wrong.
    """
    state = setup.state
    record, work = record_room(state, len(protocol.output_times), _STEPS), workspace(state, len(control.nodes))
    while state.counts[STATUS] == RUNNING:
        record.filled[1] = 0
        setup.march(setup.body, setup.volumes, setup.scale, protocol, control, state, record, work)
    return record, problem_of(setup, state, work)


def problem_of(setup: Setup, state: State, work: Workspace) -> str:
    """When, where and why a run gave up or cannot be used; "" where nothing is wrong."""
    if state.counts[STATUS] != FAILED:
        if state.clock[LOSS] <= _LARGEST_LOSS:
            return ""
        return f"stopped: a balance is off by {state.clock[LOSS]:.3g} of what is in the tissue and crossed its boundary"
    report = work.report
    phase = setup.case.phase[int(state.counts[PHASE])].name
    balances = (*MODELS[setup.case.model].balances, "momentum")
    balance = balances[min(int(report[BALANCE]), len(balances) - 1)]
    place = setup.place(balance, int(report[POINT]))
    began = f"stopped at t = {state.clock[ELAPSED]:.6g} s in phase {phase}: "
    if report[REASON] == NO_WATER:
        return f"{began}the tissue would be inverted or without water at {place}, even with the smallest step"
    return (
        f"{began}the {balance} balance did not converge at {place}, even with the smallest step (residual "
        f"{report[RESIDUAL]:.3g}, relative)"
    )
