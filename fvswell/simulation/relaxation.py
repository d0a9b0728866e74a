"""How long phases last whose durations are given in relaxation times, or which end on a rate.

The relaxation time of a phase is the time in which the biphasic-swelling model, run through the protocol, covers a
given fraction (99 % unless the case says otherwise) of the way from the strain at the start of the phase to the strain
in equilibrium under the phase's loads (Wilson et al. 2005 relate their durations to it, without a criterion).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from fvswell.case.case import Case
from fvswell.case.errors import CaseError, Problem, shown
from fvswell.case.loads import Ramp, TableLoad, shape_of
from fvswell.case.values import RelaxationTimes
from fvswell.errors import SolverError
from fvswell.numerics.loads import finding
from fvswell.numerics.state import RUNNING, STATUS, State, record_room, workspace
from fvswell.physics.models import BIPHASIC_SWELLING, MODELS
from fvswell.results.layout import SAME_TIME
from fvswell.simulation.column_run import ColumnRun
from fvswell.simulation.settling import ends_on_rate, rates_of, settled_durations
from fvswell.simulation.setup import Setup, make_setup
from fvswell.simulation.step_control import error_control

__all__ = ["phase_durations"]

_TOLERANCE = 3e-5  # of the largest strain: durations are right to some 1e-4
_PATIENCE = 100.0  # consolidation times after which a sample that has not relaxed never will
_STEPS = 1000


def phase_durations(case: Case, run: Setup | None = None, begin: Callable[[State], None] | None = None) -> list[float]:
    """Durations of the phases of a case, s.

    Parameters
    ----------
    case
        Of a column where any duration is given in relaxation times. Phases that end on a rate last as long as it takes
        the case's own model.
    run
        What is run of that case with any model, if there is that already.
    begin
        Puts a state to where the run starts, if that is not equilibrium.

    Raises
    ------
    CaseError
        If a load is longer than its phase turns out to be, or an output is due after the end.
    SolverError
        If the biphasic-swelling model fails, or does not relax, or a phase that ends on a rate would last no time.
    """
    given = [phase.duration for phase in case.phase]
    durations = [duration for duration in given if isinstance(duration, float)]
    if len(durations) < len(given):
        durations = _found(case, given, run if isinstance(run, ColumnRun) else None)
    for phase, duration in zip(case.phase, durations, strict=True):
        if not np.isfinite(duration):
            raise SolverError(
                f"{case.source}: the biphasic-swelling model does not relax in phase {phase.name}; give its duration "
                "in s"
            )
    if problems := list(_overlong_loads(case, durations)):
        raise CaseError(problems, case.source)
    if ends_on_rate(case):
        own = run if run is not None and run.model is MODELS[case.model] else make_setup(case)
        durations = settled_durations(case, durations, own, begin)
    if problems := list(_late_outputs(case, durations)):
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
    protocol = finding(run.protocol(longest, multiples), rates_of(case), run.measured())
    control = error_control(_TOLERANCE, run.largest_strain(), run.first_step())
    state = run.start()
    record, work = record_room(state, 0, _STEPS), workspace(state, len(control.nodes))
    while state.counts[STATUS] == RUNNING:
        record.filled[:] = 0
        run.march(run.body, run.volumes, run.scale, protocol, control, state, record, work)
    found = protocol.duration.copy()
    found[~np.isnan(protocol.multiple)] = np.nan  # still not found
    return [float(value) for value in found]


def _overlong_loads(case: Case, durations: Sequence[float]) -> Iterator[Problem]:
    """Ramps and tables that outlast their phases."""
    for phase, length in zip(case.phase, durations, strict=True):
        for place, load in phase.all_loads():
            shape = shape_of(load)
            if isinstance(shape, Ramp | TableLoad) and shape.settled > length:
                key = ".".join((f"phase[{phase.name}]", *place))
                yield Problem(key, shown(shape.plain()), shape.longer_than(length))


def _late_outputs(case: Case, durations: Sequence[float]) -> Iterator[Problem]:
    """Outputs that are due after the end."""
    end, times = math.fsum(durations), case.output.times
    if times is not None and times[-1] > end * (1.0 + SAME_TIME):
        message = f"must not go beyond the end of the run, which is found to be at {end:.6g} s"
        yield Problem("output.times", shown(times), message)
