"""How long phases last that end on a rate: the case's own model is run, without outputs, to find out."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fvswell.case.case import Case
from fvswell.errors import SolverError
from fvswell.numerics.loads import finding
from fvswell.numerics.state import RUNNING, STATUS, State, record_room, workspace
from fvswell.simulation.setup import Setup
from fvswell.simulation.step_control import error_control

__all__ = ["ends_on_rate", "rates_of", "settled_durations"]

_TOLERANCE = 1e-6  # of the largest strain
_STEPS = 256


def ends_on_rate(case: Case) -> bool:
    """Whether a phase of a case ends on a rate."""
    return any(phase.until is not None for phase in case.phase)


def rates_of(case: Case) -> list[float]:
    """Rates that phases end on, 1/s of what is measured; nan for those that do not."""
    return [np.nan if phase.until is None else phase.until.value for phase in case.phase]


def settled_durations(
    case: Case, durations: Sequence[float], setup: Setup, begin: Callable[[State], None] | None = None
) -> list[float]:
    """Durations of the phases.

    Parameters
    ----------
    case
        With phases that end on a rate.
    durations
        Of the phases, s; of those the longest.
    setup
        What is run; its state is left as it is.
    begin
        Puts a state to where the run starts, if that is not equilibrium.

    Raises
    ------
    SolverError
        If a phase would last no time. A run that fails is not reported here: it will fail in the same way again, and
        leave its result.
    """
    protocol = finding(setup.protocol(durations), rates_of(case), setup.measured())
    state = State(*(values.copy() for values in setup.state))
    if begin is not None:
        begin(state)
    tolerance = min(_TOLERANCE, getattr(case.time, "tolerance", _TOLERANCE))
    control = error_control(tolerance, setup.largest_strain(), setup.first_step())
    record, work = record_room(state, 0, _STEPS), workspace(state, len(control.nodes))
    while state.counts[STATUS] == RUNNING:
        record.filled[:] = 0
        setup.march(setup.body, setup.volumes, setup.scale, protocol, control, state, record, work)
    for phase, duration in zip(case.phase, protocol.duration, strict=True):
        if duration == 0.0:
            raise SolverError(
                f"{case.source}: phase {phase.name} would last no time: what is measured changes more slowly than its "
                "until from the start"
            )
    return [float(duration) for duration in protocol.duration]
