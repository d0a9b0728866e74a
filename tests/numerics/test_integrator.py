"""The time integrator on a body with an exact solution: orders, times it has to hit, steps that fail, stops."""

from __future__ import annotations

import numpy as np
import pytest
from integrations import make_control
from reservoir import Reservoir, empty_reservoir, fill

from fvswell.numerics.integrator import march
from fvswell.numerics.loads import (
    AMPLITUDE,
    FREQUENCY,
    STRAIN,
    Load,
    Protocol,
    Sine,
    TableLoad,
    finding,
    make_protocol,
)
from fvswell.numerics.state import (
    BALANCE,
    COMPLETE,
    ELAPSED,
    FAILED,
    OUTPUT,
    POINT,
    RUNNING,
    STATUS,
    STEP,
    State,
    record_room,
    workspace,
)
from fvswell.numerics.tableaux import BACKWARD_EULER, ESDIRK43, Tableau
from fvswell.physics.tissue import Array

RATE, END = 0.8, 4.0
SCHEMES = {"backward Euler": (BACKWARD_EULER, 1), "ESDIRK43": (ESDIRK43, 4)}


def sine(output_times: Array | tuple[float, ...] = ()) -> Protocol:
    """A load that swings smoothly about zero."""
    protocol = make_protocol([[Load(0.0)]], [END], output_times)
    protocol.table[0, 0, AMPLITUDE], protocol.table[0, 0, FREQUENCY] = 1.0, 2.0
    return protocol


def exact_sine(time: Array | float) -> Array:
    """Solution of dm/dt = RATE (sin 2 t - m), m(0) = 0."""
    a, w = RATE, 2.0
    particular = a * (a * np.sin(w * time) - w * np.cos(w * time)) / (a * a + w * w)
    return np.asarray(particular + a * w / (a * a + w * w) * np.exp(-a * np.asarray(time)))


def jump(phases: int = 1, output_times: Array | tuple[float, ...] = ()) -> Protocol:
    return make_protocol([[Load(float(p + 1))] for p in range(phases)], [END] * phases, output_times)


def steps_of(scheme: Tableau, steps: int) -> dict[str, float]:
    """Settings for steps of one length, whatever their error."""
    if scheme is BACKWARD_EULER:
        return {"fixed_steps": steps}
    size = END / steps * (1.0 - 1e-9)  # a hair less, so that rounding does not halve the last one
    return {"tolerance": 1e9, "max_step": END / steps, "first_step": size}


@pytest.mark.parametrize("name", SCHEMES)
def test_order_of_the_scheme(name: str) -> None:
    scheme, order = SCHEMES[name]
    error = []
    for steps in (40, 80, 160):
        state, _ = fill(Reservoir(RATE), sine(), make_control(scheme, **steps_of(scheme, steps)))
        error.append(abs(state.contents[0, 0] - exact_sine(END)))
    orders = np.log2(np.array(error[:-1]) / error[1:])
    assert np.all(orders > order - 0.2)
    assert orders[-1] < order + 0.7  # on so simple a problem the leading term is small, and hardly seen


def test_outputs_within_steps_are_of_the_same_order() -> None:
    times, error = np.linspace(0.05, END - 0.03, 57), []
    for steps in (20, 40, 80):
        control = make_control(**steps_of(ESDIRK43, steps))
        _, record = fill(Reservoir(RATE), sine(times), control)
        assert record.filled[0] == 57
        error.append(np.abs(record.contents[:57, 0, 0] - exact_sine(times)).max())
    np.testing.assert_allclose(np.log2(np.array(error[:-1]) / error[1:]), 4.0, atol=0.3)


def test_balances_hold_at_outputs_within_steps() -> None:
    """What is inside is what has crossed, to rounding."""
    times = np.linspace(0.05, 2 * END - 0.03, 157)
    state, record = fill(Reservoir(RATE), jump(2, times), make_control(tolerance=1e-2, first_step=0.1))
    np.testing.assert_allclose(record.contents[:157, 0, 0], record.crossed[:157, 0, 0], rtol=1e-14, atol=1e-14)
    assert record.errors.max() < 1e-14
    assert state.contents[0, 0] == pytest.approx(state.crossed[0, 0], rel=1e-14)


def test_outputs_force_no_steps() -> None:
    control = make_control(tolerance=1e-4)
    _, without = fill(Reservoir(RATE), jump(2), control)
    _, with_many = fill(Reservoir(RATE), jump(2, np.linspace(0.01, 2 * END, 200)), control)
    assert without.filled[0] == 0
    assert with_many.filled[0] == 200
    np.testing.assert_array_equal(without.steps, with_many.steps)


@pytest.mark.parametrize("name", SCHEMES)
@pytest.mark.parametrize("rate", [1e9, 1e12])
def test_long_steps_end_in_equilibrium(name: str, rate: float) -> None:
    scheme, _ = SCHEMES[name]
    state, _ = fill(Reservoir(rate), jump(), make_control(scheme, **steps_of(scheme, 1)))
    assert state.contents[0, 0] == pytest.approx(1.0, abs=1e-8)


def test_tolerance_bounds_the_error() -> None:
    """It falls with the tolerance, and the number of steps grows as its fourth root."""
    times, errors, counts = np.geomspace(1e-3, END, 50), [], []
    for tolerance in (1e-3, 1e-5, 1e-7):
        control = make_control(tolerance=tolerance, expected_strain=1.0)
        _, record = fill(Reservoir(RATE), jump(1, times), control)
        errors.append(np.abs(record.contents[:50, 0, 0] - (1.0 - np.exp(-RATE * times))).max())
        counts.append(record.filled[1])
        assert errors[-1] < tolerance
    assert errors[0] > 10.0 * errors[1] > 100.0 * errors[2]
    assert counts[2] < 100.0**0.25 * 1.3 * counts[1]


def test_tolerance_is_relative_to_the_largest_strain() -> None:
    """To the expected one, and to what is seen where that is larger: fewer steps."""
    counts = [
        fill(Reservoir(RATE), jump(), make_control(tolerance=1e-6, expected_strain=expected))[1].filled[1]
        for expected in (1e-3, 1.0, 1e3)
    ]
    assert counts[0] > counts[1] > counts[2]


@pytest.mark.parametrize("times", [(0.1, 1 / 3, np.pi / 2, 3.9, END)])
def test_equal_steps_are_made_to_end_at_outputs(times: tuple[float, ...]) -> None:
    control = make_control(BACKWARD_EULER, fixed_steps=10)
    _, record = fill(Reservoir(RATE), jump(1, times), control)
    count, steps = record.filled[0], record.steps[: record.filled[1]]
    np.testing.assert_allclose(record.time[:count], times, rtol=1e-14)
    expected = np.unique(np.concatenate([times, END / 10 * np.arange(1, 11)]).round(12))
    np.testing.assert_allclose(steps[:, 0], expected, rtol=1e-11)
    assert steps[:, 1].sum() == pytest.approx(END, rel=1e-14)


def test_outputs_that_differ_from_the_end_of_a_phase_by_rounding_are_that_end() -> None:
    """0.7 + 0.1 is not 0.8 in binary."""
    for scheme, settings in ((BACKWARD_EULER, {"fixed_steps": 7}), (ESDIRK43, {})):
        protocol = make_protocol([[Load(1.0)], [Load(0.0)], [Load(1.0)]], [0.7, 0.1, 1.0], [0.7, 0.8, 1.8])
        state, record = fill(Reservoir(RATE), protocol, make_control(scheme, **settings))
        assert record.filled[0] == 3
        assert record.phase[:3].tolist() == [0, 1, 2]
        np.testing.assert_allclose(record.time[:3], [0.7, 0.8, 1.8], rtol=1e-14)
        assert state.counts[STATUS] == COMPLETE


def test_no_step_is_longer_than_the_longest() -> None:
    _, record = fill(Reservoir(RATE), jump(), make_control(tolerance=1e-2, max_step=0.3))
    assert record.steps[: record.filled[1], 1].max() <= 0.3


def test_every_so_many_steps_are_recorded_and_the_ends_of_phases() -> None:
    _, all_steps = fill(Reservoir(RATE), jump(2), make_control(BACKWARD_EULER, fixed_steps=10, every=1))
    _, some = fill(Reservoir(RATE), jump(2), make_control(BACKWARD_EULER, fixed_steps=10, every=4))
    assert all_steps.filled.tolist() == [20, 20]
    np.testing.assert_allclose(some.time[: some.filled[0]], [1.6, 3.2, 4.0, 4.8, 6.4, 8.0], rtol=1e-14)


# ---- jumps and corners ------------------------------------------------------------------------------------


def ramp() -> Protocol:
    """A step, then a ramp of 1 s in the second phase."""
    return make_protocol([[Load(1.0)], [Load(2.0, 1.0)]], [END, END])


def test_jumps_and_corners_are_hit() -> None:
    """Steps start small where the load jumps; where it turns, as small as the tolerance is."""
    for tolerance in (1e-4, 1e-6):
        _, record = fill(Reservoir(RATE), ramp(), make_control(tolerance=tolerance, first_step=1e-5))
        steps = record.steps[: record.filled[1]]
        for corner in (END, END + 1.0, 2 * END):
            assert np.abs(steps[:, 0] - corner).min() < 1e-14 * corner
        starts = steps[:, 0] - steps[:, 1]
        after = {corner: steps[np.abs(starts - corner).argmin(), 1] for corner in (0.0, END, END + 1.0)}
        assert after[0.0] <= 1e-5
        assert 10.0 * tolerance < after[END] == pytest.approx(after[END + 1.0], rel=1e-9)
        assert after[END] < 100.0 * tolerance


def test_the_error_stays_within_the_tolerance_behind_corners() -> None:
    times = END + np.geomspace(1e-3, END, 60)
    since = times - END
    at_corner = 1.0 - np.exp(-RATE * END)
    during = 1.0 + since - 1.0 / RATE + (at_corner - 1.0 + 1.0 / RATE) * np.exp(-RATE * since)
    at_end = 2.0 - 1.0 / RATE + (at_corner - 1.0 + 1.0 / RATE) * np.exp(-RATE)
    exact = np.where(since < 1.0, during, 2.0 + (at_end - 2.0) * np.exp(-RATE * (since - 1.0)))
    for tolerance in (1e-3, 1e-5):
        protocol = make_protocol([[Load(1.0)], [Load(2.0, 1.0)]], [END, END], times)
        _, record = fill(Reservoir(RATE), protocol, make_control(tolerance=tolerance, expected_strain=1.0))
        assert np.abs(record.contents[:60, 0, 0] - exact).max() < tolerance


def test_many_small_corners_cost_a_step_each() -> None:
    """A measured load of 2,000 points: as many steps, and none of its corners starts anew."""
    times = np.linspace(0.0, END, 2001)
    table = TableLoad(times, np.sin(2.0 * times))
    _, record = fill(Reservoir(RATE), make_protocol([[table]], [END]), make_control(tolerance=1e-4))
    assert record.filled[1] == pytest.approx(2000, rel=0.02)
    state, _ = fill(Reservoir(RATE), make_protocol([[table]], [END]), make_control(tolerance=1e-4))
    assert state.contents[0, 0] == pytest.approx(float(exact_sine(END)), abs=1e-6)  # the chords cut (2 dt)^2/8 off


@pytest.mark.parametrize("period", [0.01, 0.7, 60.0])
def test_a_sine_is_resolved_however_small_it_is(period: float) -> None:
    """A thousandth of the strain at a tolerance of a thousandth: its amplitude and phase come out all the same."""
    w, size = 2.0 * np.pi / period, 1e-3
    end = 10.0 / RATE + 3.0 * period
    times = np.linspace(end - period, end, 40)
    protocol = make_protocol([[Load(1.0)], [Sine(1.0, size, period)]], [end, end], end + times)
    _, record = fill(Reservoir(RATE), protocol, make_control(tolerance=1e-3, expected_strain=1.0), steps=20_000)
    values = record.contents[:40, 0, 0]
    kernel = np.stack([np.sin(w * times), np.cos(w * times), np.ones(40)], axis=1)
    found = np.linalg.lstsq(kernel, values, rcond=None)[0]
    response = size * RATE / (RATE + 1j * w)
    assert found[0] + 1j * found[1] == pytest.approx(response, rel=2e-4)


def test_whole_periods_end_where_they_began() -> None:
    """The rounding that they end with is no jump."""
    phases = [[Load(1.0)], [Load(0.0, 1.0)], [Sine(0.0, 1.0, 0.5)], [Load(0.0)]]
    protocol = make_protocol(phases, [END] * 4)
    _, record = fill(Reservoir(RATE), protocol, make_control(tolerance=1e-2, first_step=1e-9))
    steps = record.steps[: record.filled[1]]
    assert steps[steps[:, 0] > END * (1.0 + 1e-12), 1].min() > 1e-4


# ---- phases that end on a rate ----------------------------------------------------------------------------


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8])
@pytest.mark.parametrize("rate", [1e-1, 1e-3])
def test_a_phase_ends_when_its_rate_has_fallen(rate: float, tolerance: float) -> None:
    """The load stands after a ramp of 1 s, and what follows falls as exp(-RATE t)."""
    protocol = finding(make_protocol([[Load(1.0, 1.0)]], [1e3]), [rate], [STRAIN])
    state, record = fill(Reservoir(RATE), protocol, make_control(tolerance=tolerance, expected_strain=1.0))
    assert state.counts[STATUS] == COMPLETE
    left = (1.0 - np.exp(-RATE)) / RATE  # at the end of the ramp
    exact = 1.0 + np.log(RATE * left / rate) / RATE
    # an error of the rate, some tolerance in a step, shifts the time by that over its slope, RATE times the rate there
    assert protocol.duration[0] == pytest.approx(exact, abs=30.0 * tolerance / (RATE * rate))
    assert protocol.end[-1] == protocol.duration[0]
    assert record.steps[: record.filled[1], 0].max() < protocol.duration[0]


def test_phases_after_one_that_ended_on_a_rate_start_from_there() -> None:
    phases = [[Load(1.0)], [Load(0.0)], [Load(1.0)]]
    protocol = finding(make_protocol(phases, [1e3, 2.0, 1e3]), [0.1, np.nan, 0.01], [STRAIN] * 3)
    state, _ = fill(Reservoir(RATE), protocol, make_control(tolerance=1e-8, expected_strain=1.0))
    first = np.log(RATE / 0.1) / RATE
    start = (1.0 - np.exp(-RATE * first)) * np.exp(-RATE * 2.0)
    np.testing.assert_allclose(protocol.duration, [first, 2.0, np.log(RATE * (1.0 - start) / 0.01) / RATE], rtol=1e-5)
    assert state.counts[STATUS] == COMPLETE


def test_a_rate_that_is_never_that_low_leaves_the_longest_duration() -> None:
    protocol = finding(make_protocol([[Load(1.0)], [Load(0.0)]], [2.0, 1e3]), [1e-3, 1e-3], [STRAIN] * 2)
    fill(Reservoir(RATE), protocol, make_control(tolerance=1e-6, expected_strain=1.0))
    assert protocol.duration[0] == 2.0
    assert np.isfinite(protocol.until[0])
    assert np.isnan(protocol.until[1])


def test_a_rate_that_is_that_low_when_the_load_stops_ends_the_phase_there() -> None:
    protocol = finding(make_protocol([[Load(1.0, 100.0)], [Load(0.0)]], [1e3, 1e3]), [0.5, 1e-3], [STRAIN] * 2)
    fill(Reservoir(RATE), protocol, make_control(tolerance=1e-8, expected_strain=1.0))
    left = (1.0 - np.exp(-RATE * 100.0)) / RATE / 100.0
    assert protocol.duration == pytest.approx([100.0, np.log(RATE * (1.0 - left) / 1e-3) / RATE], rel=1e-5)


def test_a_phase_in_which_nothing_changes_is_found_to_last_no_time() -> None:
    protocol = finding(make_protocol([[Load(1.0)], [Load(1.0)]], [40.0, 1e3]), [np.nan, 1e-3], [STRAIN] * 2)
    state, _ = fill(Reservoir(RATE), protocol, make_control())
    assert protocol.duration[1] == 0.0
    assert state.counts[STATUS] == COMPLETE


@pytest.mark.parametrize("name", SCHEMES)
def test_order_is_kept_across_corners(name: str) -> None:
    """A stage beyond the end of its step (c = 26/25) sees its own segment's load, and not the next one's."""
    scheme, order = SCHEMES[name]
    at_corner = 1.0 - np.exp(-RATE * END)
    during = 1.0 + 1.0 - 1.0 / RATE + (at_corner - 1.0 + 1.0 / RATE) * np.exp(-RATE)
    exact = 2.0 + (during - 2.0) * np.exp(-RATE * (END - 1.0))
    error = []
    for steps in (20, 40, 80):
        state, _ = fill(Reservoir(RATE), ramp(), make_control(scheme, **steps_of(scheme, steps)))
        error.append(abs(state.contents[0, 0] - exact))
    np.testing.assert_allclose(np.log2(np.array(error[:-1]) / error[1:]), order, atol=0.4)


def test_a_load_that_goes_on_is_no_corner() -> None:
    """Two phases with the same load: the second step size goes on from the first."""
    protocol = make_protocol([[Load(1.0)], [Load(1.0)]], [END, END])
    _, record = fill(Reservoir(RATE), protocol, make_control(tolerance=1e-3))
    steps = record.steps[: record.filled[1]]
    second = steps[steps[:, 0] > END * (1 + 1e-12)]
    assert second[0, 1] > 0.1


# ---- steps that fail --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCHEMES)
def test_failing_step_is_taken_smaller_and_grows_again(name: str) -> None:
    scheme, _ = SCHEMES[name]
    gamma = scheme.coefficients[-1, -1]
    body = Reservoir(RATE, longest=0.3 * gamma)
    settings = {"fixed_steps": 2} if scheme is BACKWARD_EULER else {"tolerance": 1e9, "first_step": 2.0}
    state, record = fill(body, jump(), make_control(scheme, **settings))
    assert state.counts[STATUS] == COMPLETE
    assert state.clock[ELAPSED] == END
    sizes = record.steps[: record.filled[1], 1]
    assert sizes.max() <= 0.3 * (1 + 1e-12)
    assert max(body.attempts) == pytest.approx(2.0 * gamma)
    assert np.sum(sizes > 0.05) > 10


@pytest.mark.parametrize("name", SCHEMES)
def test_what_never_converges_stops_where_it_stood(name: str) -> None:
    scheme, _ = SCHEMES[name]
    settings = {"fixed_steps": 40} if scheme is BACKWARD_EULER else {}
    body, protocol, control = Reservoir(2.0, most=0.6), jump(), make_control(scheme, **settings)
    state, record = empty_reservoir(), record_room(empty_reservoir(), 100, 5000)
    work = workspace(state, len(control.nodes))
    march(body, np.ones(1), np.ones(1), protocol, control, state, record, work)
    assert state.counts[STATUS] == FAILED
    assert 0.55 < state.contents[0, 0] <= 0.6
    assert state.clock[ELAPSED] == pytest.approx(-np.log(1 - state.contents[0, 0]) / 2.0, rel=0.1)
    assert (work.report[BALANCE], work.report[POINT]) == (0, 0)
    before = state.clock.copy()
    march(body, np.ones(1), np.ones(1), protocol, control, state, record, work)  # a failed run stays failed
    np.testing.assert_array_equal(state.clock, before)


# ---- stopping and going on --------------------------------------------------------------------------------


def copy_of(state: State) -> State:
    return State(*(values.copy() for values in state))


@pytest.mark.parametrize("chunk", [1, 7, 1000])
@pytest.mark.parametrize("name", SCHEMES)
def test_stops_at_a_full_record_leave_no_trace(name: str, chunk: int) -> None:
    scheme, _ = SCHEMES[name]
    settings = {"fixed_steps": 20, "every": 1} if scheme is BACKWARD_EULER else {"every": 1}
    control = make_control(scheme, **settings)
    whole, record = fill(Reservoir(RATE), ramp(), control)
    state, pieces, protocol = empty_reservoir(), [], ramp()
    while state.counts[STATUS] == RUNNING:
        state, part = fill(Reservoir(RATE), protocol, control, copy_of(state), outputs=chunk, steps=2 * chunk)
        assert part.filled[0] <= chunk
        pieces.append(part.contents[: part.filled[0]])
    np.testing.assert_array_equal(np.concatenate(pieces), record.contents[: record.filled[0]])
    for one, other in zip(state, whole, strict=True):
        np.testing.assert_array_equal(one, other)


def test_stops_between_outputs_leave_no_trace() -> None:
    times, control = np.linspace(0.03, 2 * END, 60), make_control()
    protocol = make_protocol([[Load(1.0)], [Load(2.0, 1.0)]], [END, END], times)
    whole, record = fill(Reservoir(RATE), protocol, control)
    state, pieces = empty_reservoir(), []
    protocol = make_protocol([[Load(1.0)], [Load(2.0, 1.0)]], [END, END], times)
    while state.counts[STATUS] == RUNNING:
        state, part = fill(Reservoir(RATE), protocol, control, copy_of(state), outputs=60, steps=3)
        pieces.append(part.contents[: part.filled[0]])
    np.testing.assert_array_equal(np.concatenate(pieces), record.contents[:60])
    assert state.counts[OUTPUT] == 60
    assert state.counts[STEP] == whole.counts[STEP]


# ---- relaxation times -------------------------------------------------------------------------------------


@pytest.mark.parametrize("multiple", [0.4, 1.0, 1.5])
def test_durations_in_relaxation_times(multiple: float) -> None:
    """The way to the equilibrium is covered to 99 % after ln(100)/rate; the second phase starts from where it is."""
    tolerance = 1e-6
    protocol = make_protocol(
        [[Load(1.0)], [Load(3.0)]], [1e6, 1e6], multiple=[multiple, multiple], equilibrium_strain=[1.0, 3.0]
    )
    state, record = fill(Reservoir(RATE), protocol, make_control(tolerance=tolerance, expected_strain=1.0))
    assert state.counts[STATUS] == COMPLETE
    expected = multiple * np.log(100.0) / RATE
    # an error of the strain shifts the time by that over its slope, which is RATE/100 there
    np.testing.assert_allclose(protocol.duration, expected, rtol=500 * tolerance)
    if multiple >= 1.0:  # a phase may be over before its relaxation time has been found
        assert record.steps[: record.filled[1], 0].max() >= expected * (1 - 1e-3)


def test_relaxation_times_beside_given_durations() -> None:
    protocol = make_protocol(
        [[Load(1.0)], [Load(3.0)], [Load(0.0)]], [2.0, 1e6, 5.0], multiple=[np.nan, 2.0, np.nan],
        equilibrium_strain=[1.0, 3.0, 0.0], fraction=0.9,
    )  # fmt: skip
    state, _ = fill(Reservoir(RATE), protocol, make_control(tolerance=1e-6, expected_strain=1.0))
    assert state.counts[STATUS] == COMPLETE
    np.testing.assert_allclose(protocol.duration, [2.0, 2.0 * np.log(10.0) / RATE, 5.0], rtol=1e-4)
