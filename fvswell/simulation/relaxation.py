"""How long phases last whose durations are given in relaxation times.

The relaxation time of a phase is the time in which the biphasic-swelling model, run through the protocol, covers a
given fraction (99 % unless the case says otherwise) of the way from the strain at the start of the phase to the strain
in equilibrium under the phase's loads (Wilson et al. 2005 relate their durations to it, without a criterion).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fvswell.case.case import Case
from fvswell.case.errors import CaseError, Problem, shown
from fvswell.case.values import Ramp, RelaxationTimes
from fvswell.errors import SolverError
from fvswell.numerics.state import RUNNING, STATUS, record_room, workspace
from fvswell.physics.models import BIPHASIC_SWELLING
from fvswell.simulation.column_run import ColumnRun
from fvswell.simulation.step_control import error_control

__all__ = ["phase_durations"]

_TOLERANCE = 3e-5  # of the largest strain: durations are right to some 1e-4
_PATIENCE = 100.0  # consolidation times after which a sample that has not relaxed never will
_STEPS = 1000


def phase_durations(case: Case, run: object = None) -> list[float]:
    """Durations of the phases of a case, s.

    Parameters
    ----------
    case
        Of a column where any duration is given in relaxation times.
    run
        What is run of that case with any model, if there is that already.

    Raises
    ------
    CaseError
        If a ramp is longer than its phase turns out to be.
    SolverError
        If the biphasic-swelling model fails, or does not relax.
    """
    given = [phase.duration for phase in case.phase]
    if not any(isinstance(duration, RelaxationTimes) for duration in given):
        return [duration for duration in given if isinstance(duration, float)]
    durations = _found(case, given, run if isinstance(run, ColumnRun) else None)
    for phase, duration in zip(case.phase, durations, strict=True):
        if not np.isfinite(duration):
            raise SolverError(
                f"{case.source}: the biphasic-swelling model does not relax in phase {phase.name}; give its duration "
                "in s"
            )
    if problems := _overlong_ramps(case, durations):
        raise CaseError(problems, case.source)
    return durations


def _found(case: Case, given: Sequence[float | RelaxationTimes], like: ColumnRun | None) -> list[float]:
    """Durations found by running the biphasic-swelling model; nan where there is none."""
    run = like
    if run is None or run.model is not BIPHASIC_SWELLING:
        run = ColumnRun(case, BIPHASIC_SWELLING, like=like)
    patience = _PATIENCE * run.consolidation_time()
    multiples = [each.multiple if isinstance(each, RelaxationTimes) else np.nan for each in given]
    longest = [patience if isinstance(each, RelaxationTimes) else each for each in given]
    protocol = run.protocol(longest, multiples)
    control = error_control(_TOLERANCE, run.largest_strain(), run.first_step())
    state = run.start()
    record, work = record_room(state, 0, _STEPS), workspace(state, len(control.nodes))
    while state.counts[STATUS] == RUNNING:
        record.filled[:] = 0
        run.march(run.body, run.volumes, run.scale, protocol, control, state, record, work)
    found = protocol.duration.copy()
    found[~np.isnan(protocol.multiple)] = np.nan  # still not found
    return [float(value) for value in found]


def _overlong_ramps(case: Case, durations: Sequence[float]) -> list[Problem]:
    """Ramps that outlast their phases."""
    return [
        Problem(f"phase[{phase.name}].{key}", shown(load._asdict()), load.longer_than(length))
        for phase, length in zip(case.phase, durations, strict=True)
        for key, load in (("bath_concentration", phase.bath_concentration), *phase.loads().items())
        if isinstance(load, Ramp) and load.over > length
    ]
