"""Protocols: values and slopes of loads, jumps, corners and segments."""

from __future__ import annotations

import numpy as np
import pytest

from fvswell.numerics.loads import Load, Protocol, Sine, TableLoad, load_slope, load_value, make_protocol

# one load steps to 1 and ramps to 3 over 4 s in the second phase; the other ramps to 2 over 5 s and is then found
PROTOCOL = make_protocol([[Load(1.0), Load(2.0, 5.0)], [Load(3.0, 4.0), None]], [10.0, 8.0])
START = np.array([0.0, 0.0])


def segment_at(protocol: Protocol, phase: int, time: float) -> int:
    """The segment that holds a time since its phase began; an end belongs to the segment that ends."""
    own = np.flatnonzero(protocol.phase == phase)
    return int(own[np.searchsorted(protocol.end[own], time)])


def at(phase: int, time: float, start: np.ndarray = START) -> list[float]:
    segment = segment_at(PROTOCOL, phase, time)
    return [load_value(PROTOCOL.table, segment, load, time, start) for load in range(2)]


def test_step_and_ramp() -> None:
    np.testing.assert_array_equal(at(0, 1e-9), [1.0, 2.0 * (1e-9 / 5.0)])
    np.testing.assert_array_equal(at(0, 2.5), [1.0, 1.0])
    np.testing.assert_array_equal(at(0, 5.0), [1.0, 2.0])
    np.testing.assert_array_equal(at(0, 10.0), [1.0, 2.0])


def test_second_phase_starts_where_the_first_ended() -> None:
    start = np.array([1.0, 2.0])
    np.testing.assert_array_equal(at(1, 1.0, start), [1.5, np.nan])
    np.testing.assert_array_equal(at(1, 8.0, start), [3.0, np.nan])


def test_segments_end_where_loads_turn() -> None:
    assert PROTOCOL.phase.tolist() == [0, 0, 1, 1]
    assert PROTOCOL.end.tolist() == [5.0, 10.0, 4.0, 8.0]


def test_a_segment_goes_on_beyond_its_end() -> None:
    """A stage may lie beyond the step (c = 26/25): it has to see this ramp, not what comes next."""
    ramp = segment_at(PROTOCOL, 0, 5.0)
    assert load_value(PROTOCOL.table, ramp, 1, 5.2, START) == pytest.approx(2.08, rel=1e-15)


@pytest.mark.parametrize("segment", range(4))
@pytest.mark.parametrize("load", range(2))
def test_slope_is_the_derivative(segment: int, load: int) -> None:
    low, high = (load_value(PROTOCOL.table, segment, load, time, START) for time in (1.0, 3.0))
    if not np.isnan(low):
        assert load_slope(PROTOCOL.table, segment, load, 2.0, START) == pytest.approx(0.5 * (high - low), abs=1e-15)


def test_a_sine_is_added() -> None:
    protocol = make_protocol([[Load(1.0)]], [10.0])
    protocol.table[0, 0, 4:] = 0.2, 3.0
    assert load_value(protocol.table, 0, 0, 0.7, START) == pytest.approx(1.0 + 0.2 * np.sin(2.1), rel=1e-15)
    h = 1e-6
    low, high = (load_value(protocol.table, 0, 0, 0.7 + dt, START) for dt in (-h, h))
    assert load_slope(protocol.table, 0, 0, 0.7, START) == pytest.approx((high - low) / (2 * h), rel=1e-9)


def test_ramps_that_fill_their_phase_make_no_further_segment() -> None:
    protocol = make_protocol([[Load(1.0, 10.0), Load(0.5, 4.0), Load(2.0, 4.0)]], [10.0])
    assert protocol.end.tolist() == [4.0, 10.0]
    assert load_value(protocol.table, 1, 0, 7.0, np.zeros(3)) == pytest.approx(0.7)
    assert load_value(protocol.table, 1, 1, 7.0, np.zeros(3)) == 0.5


def test_relative_durations_end_the_run_with_the_last_of_them() -> None:
    loads = [[Load(1.0)], [Load(0.0)], [Load(2.0)]]
    protocol = make_protocol(loads, [1e5, 1e5, 50.0], multiple=[1.5, np.nan, np.nan], equilibrium_strain=[0.2, 0, 0])
    assert protocol.last_phase == 0
    assert make_protocol(loads, [1.0, 1.0, 1.0]).last_phase == 2


def values_over(protocol: Protocol, load: int, times: np.ndarray, start: float) -> np.ndarray:
    """Values of a load in the first phase."""
    starts = np.full(protocol.table.shape[1], start)
    return np.array([load_value(protocol.table, segment_at(protocol, 0, t), load, t, starts) for t in times])


def test_a_table_is_linear_between_its_points_and_stays_at_the_last() -> None:
    knots, values = np.array([0.0, 1.0, 2.5, 7.0]), np.array([0.4, -1.0, 2.0, 0.5])
    protocol = make_protocol([[TableLoad(knots, values), Load(1.0, 3.0)]], [10.0])
    assert protocol.end.tolist() == [1.0, 2.5, 3.0, 7.0, 10.0]
    times = np.linspace(0.0, 10.0, 101)
    np.testing.assert_allclose(values_over(protocol, 0, times, 9.0), np.interp(times, knots, values), atol=1e-15)
    np.testing.assert_allclose(values_over(protocol, 1, times, 0.2), np.interp(times, [0.0, 3.0], [0.2, 1.0]))


def test_a_table_that_begins_later_is_reached_on_a_ramp() -> None:
    table = make_protocol([[TableLoad(np.array([4.0]), np.array([3.0]))]], [10.0])
    ramp = make_protocol([[Load(3.0, 4.0)]], [10.0])
    for one, other in zip(table, ramp, strict=True):
        np.testing.assert_array_equal(one, other)


def test_points_of_a_straight_line_make_no_corners() -> None:
    """A ramp and a hold as a machine samples them."""
    times = np.linspace(0.0, 10.0, 1001)
    protocol = make_protocol([[TableLoad(times, np.minimum(times, 4.0) / 4.0)]], [10.0])
    np.testing.assert_allclose(protocol.end, [4.0, 10.0])
    at = np.linspace(0.0, 10.0, 77)
    np.testing.assert_allclose(values_over(protocol, 0, at, 0.0), np.minimum(at, 4.0) / 4.0, atol=1e-14)


def test_a_table_of_one_point_at_the_start_is_a_step() -> None:
    protocol = make_protocol([[TableLoad(np.array([0.0]), np.array([3.0]))]], [10.0])
    assert protocol.end.tolist() == [10.0]
    assert load_value(protocol.table, 0, 0, 0.0, START) == 3.0
    assert load_slope(protocol.table, 0, 0, 0.0, START) == 0.0


def test_a_sine_load_swings_about_its_mean_and_limits_the_step() -> None:
    protocol = make_protocol([[Sine(1.0, 0.2, 4.0), Load(1.0)], [Load(0.0), Load(0.0)]], [10.0, 5.0])
    assert load_value(protocol.table, 0, 0, 1.0, START) == pytest.approx(1.2, rel=1e-15)
    assert load_value(protocol.table, 0, 0, 3.0, START) == pytest.approx(0.8, rel=1e-15)
    assert protocol.longest_step.tolist() == [4.0 / 12.0, np.inf]


def test_how_far_loads_go() -> None:
    protocol = make_protocol([[Load(1.0, 2.0), Sine(1.0, 0.5, 1.0), None], [Load(-2.0), Load(3.0), None]], [9.0, 9.0])
    np.testing.assert_array_equal(protocol.extent, [3.0, 2.5, 0.0])
