"""Protocols: values of what is driven, jumps, corners and the times to hit."""

from __future__ import annotations

import numpy as np
import pytest
from columns import compression

from fvswell.numerics.protocol import Drive, Protocol, output_times, phase_targets
from fvswell.simulation.column_batch import ColumnBatch

ROWS = np.arange(2)
# row 0: a step to 1, then a ramp to 3 over 4 s; row 1: a ramp to 2 over 5 s, then not driven
LOAD = Drive(np.array([[1.0, 3.0], [2.0, np.nan]]), np.array([[0.0, 4.0], [5.0, 0.0]]))
PROTOCOL = Protocol(
    np.array([[10.0, 8.0], [10.0, 6.0]]), {"load": LOAD}, (np.array([[2.0, 5.0, 9.0]]), np.array([[4.0], [5.0]]))
)
START = {"load": np.array([0.0, 0.0])}


def at(phase: int, time: float, start: dict[str, np.ndarray] = START) -> np.ndarray:
    return PROTOCOL.prescribed(ROWS, np.full(2, phase), np.full(2, time), start)["load"]


def test_step_and_ramp() -> None:
    np.testing.assert_array_equal(at(0, 1e-9), [1.0, 2.0 * 1e-9 / 5.0])
    np.testing.assert_array_equal(at(0, 2.5), [1.0, 1.0])
    np.testing.assert_array_equal(at(0, 5.0), [1.0, 2.0])
    np.testing.assert_array_equal(at(0, 10.0), [1.0, 2.0])


def test_second_phase_starts_where_the_first_ended() -> None:
    start = {"load": np.array([1.0, 2.0])}
    np.testing.assert_array_equal(at(1, 1.0, start), [1.5, np.nan])
    np.testing.assert_array_equal(at(1, 8.0, start), [3.0, np.nan])


def test_jumps_are_steps_that_change_something() -> None:
    assert PROTOCOL.jumps(ROWS, np.zeros(2, int), START).tolist() == [True, False]
    assert PROTOCOL.jumps(ROWS, np.zeros(2, int), {"load": np.array([1.0, 0.0])}).tolist() == [False, False]
    assert PROTOCOL.jumps(ROWS, np.ones(2, int), START).tolist() == [False, False]


def test_corners_are_ends_of_ramps() -> None:
    assert PROTOCOL.corners(ROWS, np.zeros(2, int), np.full(2, 5.0)).tolist() == [False, True]
    assert PROTOCOL.corners(ROWS, np.ones(2, int), np.full(2, 4.0)).tolist() == [True, False]


@pytest.mark.parametrize(
    ("phase", "time", "expected"),
    [(0, 0.0, [2.0, 2.0]), (0, 2.0, [5.0, 5.0]), (0, 9.0, [10.0, 10.0]), (1, 0.0, [4.0, 5.0]), (1, 5.0, [8.0, 6.0])],
)
def test_next_target(phase: int, time: float, expected: list[float]) -> None:
    np.testing.assert_array_equal(PROTOCOL.next_target(ROWS, np.full(2, phase), np.full(2, time)), expected)


def test_case_becomes_a_protocol() -> None:
    """The bath keeps its value where a phase does not name it; heights are relative to the equilibrated sample."""
    bath = {"ramp_to": 2e-4, "over": 9.0}
    case = compression(phase=[
        {"name": "a", "duration": 10.0, "piston_pressure": {"ramp_to": 0.1, "over": 4.0}, "bath_concentration": 1e-4},
        {"name": "b", "duration": 20.0, "piston_displacement": {"ramp_to": -0.05, "over": 7.0}},
        {"name": "c", "duration": 30.0, "piston_displacement": -0.05, "bath_concentration": bath},
    ], time__scheme="sdirk2", output__times=[1.0, 15.0, 60.0])  # fmt: skip
    batch = ColumnBatch.of([case])
    protocol = batch.protocol(np.array([[10.0, 20.0, 30.0]]))
    drives, height = protocol.drives, batch.initial_height[0]
    np.testing.assert_array_equal(drives["pressure"].target, [[0.1, np.nan, np.nan]])
    np.testing.assert_array_equal(drives["height"].target, [[np.nan, height - 0.05, height - 0.05]])
    np.testing.assert_array_equal(drives["bath"].target, [[1e-4, 1e-4, 2e-4]])
    np.testing.assert_array_equal(drives["bath"].over, [[0.0, 0.0, 9.0]])
    hits = [sorted(set(targets[0][(targets[0] > 0) & np.isfinite(targets[0])])) for targets in protocol.targets]
    assert hits == [[1.0, 4.0, 10.0], [5.0, 7.0, 20.0], [9.0, 30.0]]


def test_output_times_at_the_ends_of_phases_belong_to_the_phase_that_ends() -> None:
    """0.7 + 0.1 is not 0.8 in binary, but it is the end of the second phase."""
    duration = np.array([[0.7, 0.1, 1.0]])
    told = [output_times([0.7, 0.8, 1.8], duration, phase)[0] for phase in range(3)]
    np.testing.assert_array_equal(told, [[0.7, np.inf, np.inf], [np.inf, 0.1, np.inf], [np.inf, np.inf, 1.0]])


def test_targets_that_differ_by_rounding_are_one() -> None:
    (targets,) = phase_targets(np.array([[0.6]]), [], 6, [0.1, 0.3, 0.35])
    np.testing.assert_allclose(targets[0, :7], [0.1, 0.2, 0.3, 0.35, 0.4, 0.5, 0.6], rtol=1e-12)
    assert np.isinf(targets[0, 7:]).all()
