"""The parts of a step that do not ask what body is integrated: loads, guesses, errors, balances, records."""

from __future__ import annotations

from typing import Any

import numpy as np

from fvswell.compiled import point
from fvswell.numerics.loads import START, TARGET, load_slope, load_value
from fvswell.numerics.state import (
    ELAPSED,
    ENTER,
    FAR,
    LOSS,
    NEAR,
    OUTPUT,
    PHASE,
    RATE_KNOWN,
    RESTARTED,
    SAME_TIME,
    SEGMENT,
    SIZE,
    TIME,
)

__all__ = [
    "close_balances", "copy", "enter_segment", "guess_unknowns", "keep_past", "keep_stage", "mean_rate",
    "next_target",
    "resize", "set_base", "set_dense", "set_loads", "set_slopes", "step_error", "write_output",
]  # fmt: skip

_ROUNDING_SCALE = 1e-4  # of the content: where nothing crosses, rounding is relative to this
# where a load turns, the next step is so short that the load strays in it from its former way by at most this many
# times the tolerance, of its extent
_TURN = 50.0
_SHORTEN, _LENGTHEN, _SAFETY = 0.2, 5.0, 0.9


@point
def copy(source: Any, target: Any) -> Any:
    """Copy the values of an array into another: a loop compiles much faster than a slice assignment."""
    for i in range(len(source)):
        if source.ndim == 1:
            target[i] = source[i]
        else:
            for j in range(source.shape[1]):
                target[i, j] = source[i, j]


@point
def set_loads(protocol: Any, segment: Any, time: Any, phase_loads: Any, loads: Any) -> Any:
    """Values of the loads at a time since the phase began, the segment's law continued beyond its end."""
    for i in range(len(loads)):
        loads[i] = load_value(protocol.table, segment, i, time, phase_loads)


@point
def set_slopes(protocol: Any, segment: Any, time: Any, phase_loads: Any, slopes: Any) -> Any:
    """Derivatives by time of the values that `set_loads` gives."""
    for i in range(len(slopes)):
        slopes[i] = load_slope(protocol.table, segment, i, time, phase_loads)


@point
def _extent(protocol: Any, segment: Any, load: Any, phase_loads: Any) -> Any:
    """How far a load goes: in a segment, or in the whole protocol where that is more."""
    start, target = protocol.table[segment, load, START], protocol.table[segment, load, TARGET]
    if np.isnan(start):
        start = phase_loads[load]
    return max(protocol.extent[load], abs(target - start))


@point
def enter_segment(protocol: Any, control: Any, state: Any, work: Any) -> Any:
    """Begin a segment. Where loads jump, the past is no guide: start with a small step, from a rate to be found.

    Where a load only turns, the step size is kept, as far as what the load then misses of its former way is small; and
    where the rates depend on its slope they are found anew.
    """
    clock, counts = state.clock, state.counts
    segment = counts[SEGMENT]
    first = segment == 0 or protocol.phase[segment] != protocol.phase[segment - 1]
    time = clock[TIME]
    jumps, turn = segment == 0, 0.0
    extents = work.extents
    if segment > 0:
        before = time
        if first:
            before = clock[ELAPSED] - protocol.phase_start[protocol.phase[segment - 1]]
        set_slopes(protocol, segment - 1, before, state.phase_loads, work.slopes)
        for i in range(len(extents)):
            extents[i] = _extent(protocol, segment - 1, i, state.phase_loads)
    if first:
        counts[PHASE] = protocol.phase[segment]
        copy(state.loads, state.phase_loads)
        protocol.phase_start[counts[PHASE]] = clock[ELAPSED]
    for i in range(len(state.loads)):
        value = load_value(protocol.table, segment, i, time, state.phase_loads)
        if segment > 0:
            driven = not np.isnan(load_value(protocol.table, segment - 1, i, 0.0, state.phase_loads))
            if driven == np.isnan(value):
                jumps = True
        if np.isnan(value) or segment == 0:
            continue
        extent = max(extents[i], _extent(protocol, segment, i, state.phase_loads))
        if abs(value - state.loads[i]) > 1e-12 * max(max(abs(value), abs(state.loads[i])), extent):
            jumps = True
        slope = load_slope(protocol.table, segment, i, time, state.phase_loads)
        change = abs(slope - work.slopes[i])
        if change > 1e-9 * max(abs(slope), abs(work.slopes[i])):
            turn = max(turn, change / extent)
            if protocol.slope_matters[i]:
                counts[RATE_KNOWN] = 0
    if jumps:
        counts[RATE_KNOWN] = 0
        counts[RESTARTED] = 1
        clock[SIZE] = control.first_step if control.error_order > 0 else np.inf
        clock[NEAR] = np.nan
        clock[FAR] = np.nan
    elif turn > 0.0 and control.error_order > 0:
        clock[SIZE] = min(clock[SIZE], _TURN * control.tolerance / turn)
    counts[ENTER] = 0


@point
def next_target(protocol: Any, control: Any, state: Any) -> Any:
    """First time after this one, since the phase began, that a step must end at."""
    clock, counts = state.clock, state.counts
    time, end = clock[TIME], protocol.end[counts[SEGMENT]]
    target = end
    if control.fixed_steps > 0:
        duration = protocol.duration[counts[PHASE]]
        slack = SAME_TIME * (clock[ELAPSED] + duration)
        step = duration / control.fixed_steps
        following = np.floor((time + slack) / step) + 1.0
        regular = following * duration / control.fixed_steps
        if regular < end - slack:
            target = regular
        began = protocol.phase_start[counts[PHASE]]
        for i in range(counts[OUTPUT], len(protocol.output_times)):
            output = protocol.output_times[i] - began
            if output > time + slack:
                if output < target - slack:
                    target = output
                break
    return target


@point
def guess_unknowns(control: Any, state: Any, work: Any, stage: Any, size: Any) -> Any:
    """Unknowns of a stage by the polynomial through those that are known: of earlier stages, or of earlier steps."""
    if stage > 2:
        for k in range(len(work.unknowns)):
            work.unknowns[k] = 0.0
        for i in range(stage):
            weight = control.guesses[stage, i]
            if weight != 0.0:
                for k in range(len(work.unknowns)):
                    work.unknowns[k] += weight * work.stages[i, k]
        return
    nodes, clock, result = work.nodes, state.clock, work.unknowns
    now = control.nodes[stage] * size
    known = max(stage, 1)  # the present state, and perhaps the stage after it
    nodes[0] = 0.0
    for i in range(1, known):
        nodes[i] = control.nodes[i] * size
    total = known
    if total < 3 and not np.isnan(clock[NEAR]):
        nodes[total] = -clock[NEAR]
        total += 1
        if total < 3 and not np.isnan(clock[FAR]):
            nodes[total] = -clock[FAR]
            total += 1
    for k in range(len(result)):
        result[k] = 0.0
    for i in range(total):
        weight = 1.0
        for j in range(total):
            if j != i:
                weight *= (now - nodes[j]) / (nodes[i] - nodes[j])
        for k in range(len(result)):
            if i == 0:
                result[k] += weight * state.unknowns[k]
            elif i < known:
                result[k] += weight * work.stages[i, k]
            else:
                result[k] += weight * state.past[i - known, k]


@point
def keep_past(control: Any, state: Any, work: Any, size: Any) -> Any:
    """Remember unknowns to extrapolate from in the next step: of the middle stage and the start of this one."""
    clock, past = state.clock, state.past
    if control.error_order == 0:
        for k in range(past.shape[1]):
            past[1, k] = past[0, k]
            past[0, k] = state.unknowns[k]
        clock[FAR] = clock[NEAR] + size
        clock[NEAR] = size
    else:
        for k in range(past.shape[1]):
            past[0, k] = work.stages[1, k]
            past[1, k] = state.unknowns[k]
        clock[NEAR] = (1.0 - control.nodes[1]) * size
        clock[FAR] = size


@point
def step_error(control: Any, work: Any, volumes: Any, scale: Any, size: Any) -> Any:
    """Estimated error of a step: mean over the body of that of the contents, of the balance that is worst."""
    stages, balances, cells = work.rates.shape
    worst, total = 0.0, 0.0
    for i in range(cells):
        total += volumes[i]
    for b in range(min(balances, 2)):
        mean = 0.0
        for i in range(cells):
            error = 0.0
            for j in range(stages):
                error += control.error_weights[j] * work.rates[j, b, i]
            mean += abs(error) * volumes[i]
        worst = max(worst, mean * size / (total * scale[b]))
    return worst


@point
def mean_rate(state: Any, volumes: Any, scale: Any) -> Any:
    """Rate of change, 1/s: mean over the body of that of the contents, of the balance that changes fastest."""
    balances, cells = state.rate.shape
    fastest, total = 1e-300, 0.0
    for i in range(cells):
        total += volumes[i]
    for b in range(min(balances, 2)):
        mean = 0.0
        for i in range(cells):
            mean += abs(state.rate[b, i]) * volumes[i]
        fastest = max(fastest, mean / (total * scale[b]))
    return fastest


@point
def close_balances(control: Any, state: Any, work: Any, volumes: Any, size: Any) -> Any:
    """Compare what the step changed with what crossed the boundary, in each balance."""
    stages, parts = work.crossings.shape[0], work.crossings.shape[1]
    balances, cells = state.contents.shape
    last = stages - 1
    for quantity in range(3):
        entered = 0.0
        for p in range(parts):
            through = 0.0
            for j in range(stages):
                through += control.coefficients[last, j] * work.crossings[j, p, quantity]
            state.crossed[p, quantity] += size * through
            state.traffic[quantity] += abs(size * through)
            entered += size * through
        row = min(quantity, 1)  # cations follow anions: the fixed charge per reference volume does not change
        if row >= balances:
            continue
        gained, held = 0.0, 0.0
        for i in range(cells):
            gained += volumes[i] * (work.contents[row, i] - state.contents[row, i])
            held += volumes[i] * abs(work.contents[row, i])
        mismatch = abs(gained - entered)
        relative = mismatch / (state.traffic[quantity] + _ROUNDING_SCALE * held)
        state.errors[quantity] = max(state.errors[quantity], relative)
        state.clock[LOSS] = max(state.clock[LOSS], mismatch / (state.traffic[quantity] + held))


@point
def write_output(
    record: Any, state: Any, time: Any, phase: Any, unknowns: Any, contents: Any, loads: Any, crossed: Any
) -> Any:
    """Write an output into the next row of the record, with the errors of the balances since the last one."""
    index = record.filled[0]
    record.time[index] = time
    record.phase[index] = phase
    copy(unknowns, record.unknowns[index])
    copy(contents, record.contents[index])
    copy(loads, record.loads[index])
    copy(crossed, record.crossed[index])
    copy(state.errors, record.errors[index])
    for q in range(3):
        state.errors[q] = 0.0
    record.filled[0] = index + 1


@point
def set_base(control: Any, state: Any, work: Any, stage: Any, size: Any) -> Any:
    """Contents that a stage starts from: those of the present state and the rates of the earlier stages."""
    balances, cells = state.contents.shape
    for b in range(balances):
        for k in range(cells):
            total = 0.0
            for j in range(stage):
                total += control.coefficients[stage, j] * work.rates[j, b, k]
            work.base[b, k] = state.contents[b, k] + size * total


@point
def keep_stage(work: Any, stage: Any, duration: Any) -> Any:
    """Keep the rates and unknowns of a stage that has been solved."""
    balances, cells = work.base.shape
    for b in range(balances):
        for k in range(cells):
            work.rates[stage, b, k] = (work.contents[b, k] - work.base[b, k]) / duration
    copy(work.crossing, work.crossings[stage])
    copy(work.unknowns, work.stages[stage])


@point
def set_dense(control: Any, state: Any, work: Any, size: Any, share: Any) -> Any:
    """Contents, unknowns and what has crossed at a part of a step, from all stages."""
    stages, powers = control.dense_weights.shape
    balances, cells = work.base.shape
    copy(state.contents, work.base)
    copy(state.crossed, work.dense)
    copy(work.stages[0], work.unknowns)
    for i in range(stages):
        weight, moved = 0.0, 0.0
        for k in range(powers - 1, -1, -1):
            weight = share * (weight + control.dense_weights[i, k])
            moved = share * (moved + control.dense_stages[i, k])
        for b in range(balances):
            for k in range(cells):
                work.base[b, k] += size * weight * work.rates[i, b, k]
        for p in range(len(state.crossed)):
            for q in range(3):
                work.dense[p, q] += size * weight * work.crossings[i, p, q]
        for k in range(len(work.unknowns)):
            work.unknowns[k] += moved * (work.stages[i, k] - work.stages[0, k])


@point
def resize(control: Any, state: Any, size: Any, error: Any) -> Any:
    """Choose the size of the step after one that was kept."""
    clock = state.clock
    if control.error_order == 0:
        wanted = 4.0 * size if np.isfinite(clock[SIZE]) else np.inf
    elif error > 0.0:
        wanted = size * min(_LENGTHEN, max(_SHORTEN, _SAFETY * error ** (-1.0 / control.error_order)))
    else:
        wanted = _LENGTHEN * size
    if size < clock[SIZE]:  # cut short by a time that had to be hit, which says nothing of the error
        wanted = max(wanted, clock[SIZE])
    clock[SIZE] = wanted
