"""Phases that end on a rate: when the exact solutions' rates have fallen to it, and what cannot be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from linear_columns import CONTROLLED, SMALL, linear, modulus_and_time
from sample_cases import small_block, small_compression
from scipy.optimize import brentq

import fvswell
from fvswell import CaseError, SolverError
from fvswell.simulation.relaxation import phase_durations
from fvswell.simulation.run import run

N = np.pi * (np.arange(400) + 0.5)


def test_creep_ends_when_the_strain_is_slow() -> None:
    """The exact rate of the linear column after a step p is p/H sum(2 exp(-n^2 t/tau))/tau."""
    H, tau = modulus_and_time(linear(1.0, piston__pressure=SMALL))
    for rate in (1e-1, 1e-2, 1e-3):  # of p/(H tau)
        exact = tau * brentq(lambda t, rate=rate: np.sum(2.0 * np.exp(-(N**2) * t)) - rate, 1e-3, 10.0)
        case = linear(100.0 * tau, piston__pressure=SMALL, until=f"{rate * SMALL / H / tau} 1/s")
        assert phase_durations(case) == pytest.approx([exact], rel=2e-3)


def test_relaxation_ends_when_the_pressure_is_slow() -> None:
    """After a ramp of the time T to a strain the pressure falls as exp(-n^2 (t - T)) - exp(-n^2 t), summed over n."""
    H, tau = modulus_and_time(linear(1.0, piston__pressure=SMALL))
    strain, T = 1e-5, 0.1

    n = np.pi * np.arange(1, 200)
    for rate in (1e-1, 1e-3):  # of H e/tau

        def slope(t: float) -> float:
            return float(np.sum(2.0 / T * (np.exp(-(n**2) * (t - T)) - np.exp(-(n**2) * t))))

        exact = tau * brentq(lambda t, rate=rate, slope=slope: slope(t) - rate, T + 1e-4, 5.0)
        load = {"ramp_to": f"{-100.0 * strain} %", "over": T * tau}
        case = linear(100.0 * tau, piston__displacement=load, until=f"{rate * H * strain / tau} MPa/s")
        assert phase_durations(case) == pytest.approx([exact], rel=2e-3)


def test_the_run_lasts_as_long_and_outputs_are_spread_over_it() -> None:
    case = small_compression(phase__loading__until="1e-3 /min", phase__loading__duration=1e4, **CONTROLLED,
                             phase__unloading__duration=100.0, output={"per_phase": 10})  # fmt: skip
    (end, unloading), result = phase_durations(case), fvswell.run(case)
    assert unloading == 100.0
    assert 50.0 < end < 1e4
    np.testing.assert_allclose(result["phase_end"].values, [end, end + 100.0])
    time, strain = result["time"].values, result["global_strain"].values
    for share in np.arange(1, 11) / 10:
        assert np.abs(time - share * end).min() < 1e-9 * end
    near = (time > 0.85 * end) & (time < end * (1.0 + 1e-9))
    last = np.gradient(strain[near], time[near])
    assert abs(last[-1]) < 1.3e-3 / 60.0
    assert abs(last[0]) > 1e-3 / 60.0


def test_equal_steps_divide_the_time_that_is_found() -> None:
    changes: dict[str, Any] = {"phase__loading__until": "1e-3 /min", "phase__loading__duration": 1e4}
    case = small_compression(**changes, output={"every": 1})
    end = phase_durations(case)[0]
    time = fvswell.run(case)["time"].values
    np.testing.assert_allclose(time[:9], np.linspace(0.0, end, 9))


def test_a_rate_that_is_not_reached_leaves_the_longest_duration() -> None:
    assert phase_durations(small_compression(phase__loading__until="1e-9 /h"))[0] == 300.0


def test_models_of_a_comparison_last_as_long_as_the_reference() -> None:
    case = small_compression(phase__loading__until="1e-2 /min", phase__loading__duration=1e4, model="biphasic")
    own = phase_durations(case)
    reference = phase_durations(case.with_changes({"model": "electrochemical"}))
    assert own[0] != pytest.approx(reference[0], rel=0.05)
    for result in fvswell.compare(case).results.values():
        np.testing.assert_allclose(result["phase_end"].values, np.cumsum(reference))


def test_relaxation_times_beside_rates() -> None:
    phases = {"phase__loading__until": "1e-2 /min", "phase__unloading__duration": "1 relaxation times"}
    durations = phase_durations(small_compression(**phases, phase__loading__duration=1e4))
    given = phase_durations(small_compression(phase__loading__duration=durations[0], **dict(list(phases.items())[1:])))
    assert durations[0] < 1e4
    assert durations[1] == pytest.approx(given[1], rel=0.05)  # found with the other model's time


def test_a_block_ends_when_a_column_would() -> None:
    """A disc between rollers is a column."""
    H, tau = modulus_and_time(linear(1.0, piston__pressure=SMALL))
    rate = f"{1e-2 * SMALL / H / tau} 1/s"
    column = linear(100.0 * tau, piston__pressure=SMALL, until=rate)
    column = column.with_changes({"geometry.cells": 20, "geometry.grading": 1})
    content = {
        "geometry": {"kind": "plane-strain", "width": 1.0, "height": 0.5, "cells": [1, 20]},
        "boundary": {"left": {"mechanical": "roller"}, "right": {"mechanical": "roller"},
                     "bottom": {"mechanical": "roller", "bath": "open"}, "top": {"mechanical": "straight"}},
        "phase": [{"name": "only", "duration": 100.0 * tau, "until": rate, "top": {"pressure": SMALL}}],
    }  # fmt: skip
    block = column.with_changes(content)
    assert phase_durations(block) == pytest.approx(phase_durations(column), rel=1e-3)
    moved = {
        "top": {"displacement": {"ramp_to": "-0.001 %", "over": 0.1 * tau}},
        "until": f"{1e-2 * H * 1e-5 / tau} MPa/s",
    }
    phase = {"name": "only", "duration": 100.0 * tau}
    held = block.with_changes({"phase": [phase | moved]})
    same = column.with_changes({"phase": [phase | {"piston": moved["top"], "until": moved["until"]}]})
    assert phase_durations(held) == pytest.approx(phase_durations(same), rel=1e-3)


def test_a_phase_in_which_nothing_changes_is_refused() -> None:
    case = small_compression(phase__unloading__until="1 /h", phase__unloading__piston={"pressure": 0.25},
                             phase__loading__duration=1e5)  # fmt: skip
    with pytest.raises(SolverError, match="phase unloading would last no time: what is measured changes more slowly"):
        fvswell.run(case)


def test_a_run_from_a_result_finds_its_own_durations(tmp_path: Path) -> None:
    case = small_compression(phase__loading__duration=50.0, phase__unloading__until="1e-2 /min",
                             phase__unloading__duration=1e4, **CONTROLLED)  # fmt: skip
    whole = phase_durations(case)
    first, second = (case.with_changes({"phase": [case.model_dump(exclude_none=True)["phase"][i]]}) for i in (0, 1))
    run(first, path=tmp_path / "first.nc")
    result = run(second, start_from=tmp_path / "first.nc")
    assert result["phase_end"].values == pytest.approx(whole[1:], rel=1e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"until": "1e-3 MPa/min"}, r'until = .*: must be of the strain, such as "1e-4 /min": no displacement moves'),
        ({"until": "1e-3 /min", "piston": {"displacement": {"ramp_to": -0.01, "over": 1.0}}},
         r'until = .*: must be of the pressure, such as "1e-3 MPa/min": a displacement moves piston'),
        ({"until": "1e-3 /min", "duration": "1 relaxation times"}, "until = .*: needs the longest duration in s"),
        ({"until": "1e-3 /min", "piston": {"pressure": {"mean": 0.1, "amplitude": 0.1, "period": 1.0}}},
         "piston.pressure = .*: never comes to rest: leave until away"),
        ({"until": "1e-3 /min", "piston": {"pressure": {"ramp_to": 0.1, "over": 300.0}}},
         "piston.pressure = .*: changes for all of the longest duration"),
        ({"duration": "1 relaxation times", "piston": {"pressure": {"mean": 0.1, "amplitude": 0.1, "period": 1.0}}},
         "piston.pressure = .*: never comes to rest: give the duration of the phase in s"),
        ({"until": 1e-3}, 'until = 0.001: must be a rate above 0, such as "1e-3 MPa/min"'),
    ],
)  # fmt: skip
def test_bad_rates(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(CaseError, match=message):
        small_compression(**{f"phase__loading__{key}": value for key, value in changes.items()})


def test_outputs_after_the_end_that_is_found_are_refused() -> None:
    for changes in ({"until": "1e-2 /min", "duration": 1e4}, {"duration": "1 relaxation times"}):
        named = {f"phase__loading__{key}": value for key, value in changes.items()}
        case = small_compression(**named, output={"times": [10.0, 1e4]}, **CONTROLLED)
        with pytest.raises(CaseError, match=r"output.times = .*: must not go beyond the end of the run, which is fo"):
            fvswell.run(case)


def test_jumps_of_displacements_in_other_words_are_refused() -> None:
    sine, table = {"mean": -0.01, "amplitude": 0.01, "period": 9.0}, {"times": [0.0, 9.0], "values": [-0.01, 0.0]}
    for load in (sine, table, "-1 %", {"mean": "-1 %", "amplitude": "1 %", "period": 9.0}):
        with pytest.raises(CaseError, match="piston stands at 0 mm and a jump would need infinite pressure: use"):
            small_compression(phase__loading__piston__displacement=load)
        with pytest.raises(CaseError, match="piston is where the pressure left it and a jump"):
            small_compression(phase__unloading__piston__displacement=load)
    ramp = {"displacement": {"ramp_to": "-2 %", "over": 9.0}}
    with pytest.raises(CaseError, match="piston stands at -2 %: begin there, in the same unit"):
        small_compression(phase__loading__piston=ramp, phase__unloading__piston__displacement=-0.01)
    small_compression(phase__loading__piston=ramp, phase__unloading__piston__displacement="-2 %")
    with pytest.raises(CaseError, match="leaves a height of"):
        small_compression(phase__loading__piston__displacement={"mean": 0, "amplitude": "90 %", "period": 9.0})
    with pytest.raises(CaseError, match="moves the edge through the block"):
        small_block(phase__compression__top={"displacement": {"ramp_to": "-101 %", "over": 9.0}})
