"""When results are written, where that does not depend on the steps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sample_cases import small_block, small_compression, small_swelling

from fvswell.case.output_times import output_times

DURATIONS = [300.0, 500.0]


def test_equal_parts_of_each_phase_are_among_the_times() -> None:
    times = output_times(small_compression(output={"per_phase": 30}), DURATIONS)
    assert np.all(np.diff(times) > 0.0)
    assert times[-1] == 800.0
    for start, duration in ((0.0, 300.0), (300.0, 500.0)):
        for end in start + duration * np.arange(1, 31) / 30:
            assert np.abs(times - end).min() < 1e-9


@given(duration=st.floats(1e-3, 1e7), parts=st.integers(1, 60))
def test_the_end_of_every_phase_is_an_output(duration: float, parts: int) -> None:
    case = small_compression(output={"per_phase": parts})
    times = output_times(case, [duration, duration])
    assert duration in times
    assert times[-1] == duration + duration


def test_early_times_are_resolved_after_jumps_and_ramps() -> None:
    ramp = {"ramp_to": 1e-4, "over": 100.0}
    times = output_times(small_swelling(output={"per_phase": 30}, phase__loading__bath_concentration=ramp), DURATIONS)
    for corner in (0.0, 100.0, 300.0):
        later = times[times > corner * (1.0 + 1e-12)]
        assert later[0] - corner < 2e-3 * 500.0 / 30
    assert 100.0 in times  # a peak lies there


def test_a_root_of_time_is_drawn_true_from_the_outputs() -> None:
    """Straight lines between outputs stay within half a percent of what follows a jump."""
    case = small_compression(output={"per_phase": 50})
    times = np.append(0.0, output_times(case, [1.0, 1.0]))
    times = times[times <= 1.0]
    fine = np.linspace(0.0, 1.0, 100_001)
    assert np.abs(np.interp(fine, times, np.sqrt(times)) - np.sqrt(fine)).max() < 5e-3


def test_given_times_are_taken_and_the_start_is_not_among_them() -> None:
    case = small_block(output={"times": [0.0, 10.0, "1 h"]})
    np.testing.assert_array_equal(output_times(case, [2e4, 2e4]), [10.0, 3600.0])


@pytest.mark.parametrize("every", [1, 5])
def test_outputs_by_steps_have_no_times_of_their_own(every: int) -> None:
    assert not output_times(small_compression(output={"every": every}), DURATIONS).size
