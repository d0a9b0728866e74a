"""The time integrator: one for columns, which run it compiled, and blocks, which run it in Python.

    until the protocol is over:
        enter the next segment: where a load jumps, start anew with a small step
        step = min(step size, end of the segment - time)
        solve the stages of the scheme
        a step that fails, or misses the tolerance: a smaller one, again
        else keep the new state, close the balances, record what is due, choose the next step size

The contents of the cells are what is integrated. A stage solves  contents - base - g F(contents) = 0  and its rate is
(contents - base)/g; what crosses the boundary is recorded from the fluxes of the last Newton iteration, linearised to
its end, so that every balance closes to rounding whatever ended the iteration.

Outputs within a step are those of a polynomial through its stages, as accurate as the scheme (dense output): they do
not force steps, and the balances hold there too. Only steps of given length are made to end at outputs.

What a body can do is in `fvswell.numerics.body`. Everything that is kept is in the arrays of a `State`, so that a run
may stop after any step and go on later; the arrays of a `Record` are filled until they are full.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fvswell.compiled import point
from fvswell.numerics.body import admissible, complete_loads, find_rate, find_unknowns, global_strain, solve_stage
from fvswell.numerics.loads import STRAIN
from fvswell.numerics.state import (
    COMPLETE,
    ELAPSED,
    ENTER,
    FAILED,
    ITERATIONS,
    LARGEST,
    OUTPUT,
    PHASE,
    RATE_KNOWN,
    RESTARTED,
    RUNNING,
    SAME_TIME,
    SEGMENT,
    SIZE,
    START_STRAIN,
    STATUS,
    STEP,
    TIME,
    UPDATE,
)
from fvswell.numerics.steps import (
    close_balances,
    copy,
    enter_segment,
    guess_unknowns,
    keep_past,
    keep_stage,
    mean_rate,
    next_target,
    resize,
    set_base,
    set_dense,
    set_loads,
    set_slopes,
    step_error,
    write_output,
)

__all__ = ["march"]

_SMALLEST_STEP = 1e-13  # of the time to the next target
# of the tolerance that the estimated error of a step may be: of 450 random columns and protocols all but 1 in 100 then
# err by less than the tolerance at all outputs (tests/column/test_tolerance.py)
_STEP_SHARE = 0.2
_NEWTON_SHARE = 0.1  # of the tolerance that the Newton iterations of a stage may leave
_FIRST_CHANGE = 3.0  # of the tolerance that contents change by at the rate at which a step from a jump starts
_SHORTEN, _SAFETY = 0.2, 0.9
_SPAN = 0.002  # of a step: half the time over which a rate is measured
_SHARPNESS = 1e-5  # of a step: how sharply the time is found at which it has fallen


@point
def _start_rate(body: Any, protocol: Any, state: Any, work: Any) -> Any:
    """Rate at the start of a step, where the last step does not give it."""
    segment, time = state.counts[SEGMENT], state.clock[TIME]
    set_loads(protocol, segment, time, state.phase_loads, work.loads)
    set_slopes(protocol, segment, time, state.phase_loads, work.slopes)
    copy(state.unknowns, work.unknowns)
    found = find_rate(
        body, work.unknowns, state.contents, work.loads, work.slopes, state.rate, state.crossing, state.clock,
        work.report,
    )  # fmt: skip
    if found:
        copy(work.unknowns, state.unknowns)
        state.counts[RATE_KNOWN] = 1
    return found


@point
def _attempt(body: Any, protocol: Any, control: Any, state: Any, work: Any, size: Any, tolerance: Any) -> Any:
    """Solve the stages of a step; the last one is the new state."""
    segment, time, stages = state.counts[SEGMENT], state.clock[TIME], len(control.nodes)
    first = 1 if control.error_order > 0 else 0
    if first == 1:
        if state.counts[RATE_KNOWN] == 0 and not _start_rate(body, protocol, state, work):
            return False
        copy(state.rate, work.rates[0])
        copy(state.crossing, work.crossings[0])
        copy(state.unknowns, work.stages[0])
    iterations = 0.0
    for i in range(first, stages):
        duration = control.coefficients[i, i] * size
        set_base(control, state, work, i, size)
        set_loads(protocol, segment, time + control.nodes[i] * size, state.phase_loads, work.loads)
        guess_unknowns(control, state, work, i, size)
        if not admissible(body, work.unknowns, state.unknowns):
            copy(state.unknowns, work.unknowns)
        done = solve_stage(
            body, work.unknowns, work.contents, work.base, duration, work.loads, tolerance, work.crossing,
            state.clock, work.report,
        )  # fmt: skip
        iterations += work.report[ITERATIONS]
        if not done:
            return False
        keep_stage(work, i, duration)
    work.report[ITERATIONS] = iterations
    return True


@point
def _set_within(body: Any, protocol: Any, control: Any, state: Any, work: Any, size: Any, share: Any) -> Any:
    """Set unknowns, contents (``work.base``) and loads to those at a part of a step that has been solved."""
    segment, time = state.counts[SEGMENT], state.clock[TIME] + share * size
    set_dense(control, state, work, size, share)
    set_loads(protocol, segment, time, state.phase_loads, work.loads)
    set_slopes(protocol, segment, time, state.phase_loads, work.slopes)
    find_unknowns(body, work.unknowns, work.base, work.loads, work.slopes)
    complete_loads(body, work.unknowns, work.base, work.loads)


@point
def _record_outputs(body: Any, protocol: Any, control: Any, state: Any, work: Any, record: Any, size: Any) -> Any:
    """Record the outputs that lie within a step that has been solved, and is kept afterwards."""
    clock, counts = state.clock, state.counts
    slack = SAME_TIME * (clock[ELAPSED] + size)
    while counts[OUTPUT] < len(protocol.output_times):
        due = protocol.output_times[counts[OUTPUT]] - clock[ELAPSED]
        if due > size + slack:
            return
        if due >= size - slack:
            return  # the end of the step itself
        _set_within(body, protocol, control, state, work, size, due / size)
        write_output(
            record, state, clock[ELAPSED] + due, counts[PHASE], work.unknowns, work.base, work.loads, work.dense
        )
        counts[OUTPUT] += 1


@point
def _relaxes(body: Any, protocol: Any, control: Any, state: Any, work: Any, size: Any) -> Any:
    """Whether this step brings the end of the phase, told in relaxation times, nearer than its own end."""
    clock, phase = state.clock, state.counts[PHASE]
    way = protocol.equilibrium_strain[phase] - clock[START_STRAIN]
    threshold = clock[START_STRAIN] + protocol.fraction * way
    arrived = global_strain(body, work.stages[len(work.rates) - 1], work.contents)
    if way == 0.0 or (arrived - threshold) * way < 0.0:
        return False
    low, high = 0.0, 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        set_dense(control, state, work, size, middle)
        if (global_strain(body, work.unknowns, work.base) - threshold) * way < 0.0:
            low = middle
        else:
            high = middle
    duration = protocol.multiple[phase] * (clock[TIME] + high * size)
    protocol.duration[phase] = duration
    protocol.multiple[phase] = np.nan
    protocol.end[state.counts[SEGMENT]] = duration
    return duration < clock[TIME] + size or phase == protocol.last_phase


@point
def _is_last(protocol: Any, segment: Any) -> Any:
    """Whether a segment is the last one of its phase."""
    return segment == len(protocol.end) - 1 or protocol.phase[segment + 1] != protocol.phase[segment]


@point
def _enter_next(protocol: Any, state: Any) -> Any:
    """Leave a segment at its end."""
    clock, counts = state.clock, state.counts
    segment = counts[SEGMENT]
    ends_phase = _is_last(protocol, segment)
    if segment == len(protocol.end) - 1 or (ends_phase and counts[PHASE] == protocol.last_phase):
        counts[STATUS] = COMPLETE
    else:
        counts[SEGMENT] = segment + 1
        counts[ENTER] = 1
        if ends_phase:
            clock[TIME] = 0.0


@point
def _measured(body: Any, protocol: Any, control: Any, state: Any, work: Any, size: Any, share: Any) -> Any:
    """What the end of the phase depends on, at a part of a step that has been solved."""
    _set_within(body, protocol, control, state, work, size, share)
    index = protocol.measured[state.counts[PHASE]]
    if index == STRAIN:
        return global_strain(body, work.unknowns, work.base)
    return work.loads[index]


@point
def _is_slow(body: Any, protocol: Any, control: Any, state: Any, work: Any, size: Any, share: Any) -> Any:
    """Whether what is measured changes more slowly, about a part of a step, than where the phase ends."""
    low = max(share - _SPAN, 0.0)
    before = _measured(body, protocol, control, state, work, size, low)
    after = _measured(body, protocol, control, state, work, size, low + 2.0 * _SPAN)
    return abs(after - before) < protocol.until[state.counts[PHASE]] * 2.0 * _SPAN * size


@point
def _settles(body: Any, protocol: Any, control: Any, state: Any, work: Any, size: Any) -> Any:
    """Whether the phase, which ends on a rate once its loads are constant, is over within this step."""
    clock, counts = state.clock, state.counts
    phase, segment = counts[PHASE], counts[SEGMENT]
    if not _is_last(protocol, segment):
        return False
    iterations, update = work.report[ITERATIONS], work.report[UPDATE]
    settled = _is_slow(body, protocol, control, state, work, size, 1.0)
    if settled:
        low, high = 0.0, 1.0
        if _is_slow(body, protocol, control, state, work, size, 0.0):
            high = 0.0
        while high - low > _SHARPNESS:
            middle = 0.5 * (low + high)
            if _is_slow(body, protocol, control, state, work, size, middle):
                high = middle
            else:
                low = middle
        duration = clock[TIME] + high * size
        protocol.duration[phase] = duration
        protocol.until[phase] = np.nan
        protocol.end[segment] = duration
        if phase == protocol.last_phase or duration == 0.0:
            counts[STATUS] = COMPLETE
        elif duration == clock[TIME]:
            _enter_next(protocol, state)
    work.report[ITERATIONS], work.report[UPDATE] = iterations, update
    return settled


@point
def _keep_step(
    body: Any,
    volumes: Any,
    protocol: Any,
    control: Any,
    state: Any,
    work: Any,
    record: Any,
    size: Any,
    time: Any,
    ends_segment: Any,
) -> Any:
    """Make the last stage of a step the new state, and enter what comes next."""
    clock, counts = state.clock, state.counts
    iterations, update = work.report[ITERATIONS], work.report[UPDATE]
    if control.every == 0 and control.error_order > 0:
        _record_outputs(body, protocol, control, state, work, record, size)
    close_balances(control, state, work, volumes, size)
    last, segment = len(work.rates) - 1, counts[SEGMENT]
    set_loads(protocol, segment, time, state.phase_loads, work.loads)
    keep_past(control, state, work, size)
    complete_loads(body, work.stages[last], work.contents, work.loads)
    copy(work.stages[last], state.unknowns)
    copy(work.contents, state.contents)
    copy(work.rates[last], state.rate)
    copy(work.crossings[last], state.crossing)
    copy(work.loads, state.loads)
    clock[TIME] = time
    clock[ELAPSED] = protocol.phase_start[counts[PHASE]] + time
    counts[STEP] += 1
    counts[RATE_KNOWN] = 1
    clock[LARGEST] = max(clock[LARGEST], abs(global_strain(body, state.unknowns, state.contents)))
    index = record.filled[1]
    record.steps[index, 0], record.steps[index, 1] = clock[ELAPSED], size
    record.steps[index, 2], record.steps[index, 3] = iterations, update
    record.filled[1] = index + 1
    ends_phase = ends_segment and _is_last(protocol, segment)
    due = control.every > 0 and (counts[STEP] % control.every == 0 or ends_phase)
    if control.every == 0 and counts[OUTPUT] < len(protocol.output_times):
        gap = abs(protocol.output_times[counts[OUTPUT]] - clock[ELAPSED])
        if gap <= SAME_TIME * clock[ELAPSED]:
            due = True
            counts[OUTPUT] += 1
    if due:
        write_output(
            record, state, clock[ELAPSED], counts[PHASE], state.unknowns, state.contents, state.loads, state.crossed
        )
    if ends_segment:
        _enter_next(protocol, state)


@point
def march(body: Any, volumes: Any, scale: Any, protocol: Any, control: Any, state: Any, record: Any, work: Any) -> Any:
    """Go on until the protocol is over, the run fails, or the record is full.

    Parameters
    ----------
    body
        What `fvswell.numerics.body` has implementations for.
    volumes
        Reference volumes of the cells.
    scale
        Natural size of the contents of each balance; 1 for J.
    protocol, control, state, record, work
        See `fvswell.numerics.loads` and `fvswell.numerics.state`; ``state`` and ``record`` are changed in place.
    """
    clock, counts = state.clock, state.counts
    while counts[STATUS] == RUNNING:
        if record.filled[1] == len(record.steps) or (control.every > 0 and record.filled[0] == len(record.time)):
            return
        if counts[ENTER] == 1:
            enter_segment(protocol, control, state, work)
            known = counts[RATE_KNOWN] == 1 or (control.error_order > 0 and _start_rate(body, protocol, state, work))
            if known and counts[RESTARTED] == 1:
                change = _FIRST_CHANGE * control.tolerance * max(clock[LARGEST], control.expected_strain)
                clock[SIZE] = min(clock[SIZE], change / mean_rate(state, volumes, scale))
            counts[RESTARTED] = 0
            if clock[TIME] == 0.0:
                clock[START_STRAIN] = global_strain(body, state.unknowns, state.contents)
        target = next_target(protocol, control, state)
        ahead = target - clock[TIME]
        size = min(min(clock[SIZE], control.max_step), ahead)
        if control.error_order > 0:
            size = min(size, protocol.longest_step[counts[SEGMENT]])
        if 0.5 * ahead < size < ahead:
            size = 0.5 * ahead  # no sliver before a target
        hits = size == ahead
        allowed, tolerance = 1.0, control.tolerance
        if control.error_order > 0:
            allowed = control.tolerance * max(clock[LARGEST], control.expected_strain)
            tolerance = _NEWTON_SHARE * allowed
        solved = _attempt(body, protocol, control, state, work, size, tolerance)
        error = 0.0
        if solved and control.error_order > 0:
            error = step_error(control, work, volumes, scale, size) / (_STEP_SHARE * allowed)
        if solved and error <= 1.0:
            if not np.isnan(protocol.multiple[counts[PHASE]]) and _relaxes(body, protocol, control, state, work, size):
                if counts[PHASE] == protocol.last_phase:
                    counts[STATUS] = COMPLETE
                continue  # the step leads beyond the end that has been found
            if not np.isnan(protocol.until[counts[PHASE]]) and _settles(body, protocol, control, state, work, size):
                continue
            time = target if hits else clock[TIME] + size
            ends_segment = hits and target == protocol.end[counts[SEGMENT]]
            _keep_step(body, volumes, protocol, control, state, work, record, size, time, ends_segment)
            resize(control, state, size, error)
        else:
            if size < _SMALLEST_STEP * ahead:
                counts[STATUS] = FAILED
                return
            shrink = 0.25 if not solved else max(_SHORTEN, _SAFETY * error ** (-1.0 / control.error_order))
            clock[SIZE] = shrink * size
