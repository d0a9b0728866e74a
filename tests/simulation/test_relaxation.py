"""Durations given in relaxation times."""

from __future__ import annotations

import numpy as np
import pytest
from sample_cases import CASES, small_compression

import fvswell
from fvswell import CaseError
from fvswell.exact.linear_swelling import LinearColumn
from fvswell.physics.models import BIPHASIC_SWELLING
from fvswell.simulation.column_run import ColumnRun
from fvswell.simulation.relaxation import phase_durations

REFERENCE = CASES / "confined_compression.toml"


def test_small_step_relaxes_in_the_exact_time() -> None:
    """The linear solution's time to 99 %, for a load of 1e-4 MPa: 1e-4 of the strain is 1 % of what is left then."""
    phase = {"name": "only", "duration": "1 relaxation times", "piston": {"pressure": 1e-4}}
    case = fvswell.load_case(REFERENCE).with_changes({"phase": [phase], "geometry.cells": 40})
    run = ColumnRun(case, BIPHASIC_SWELLING)
    column = LinearColumn.at_equilibrium(BIPHASIC_SWELLING, run.tissue, 0.5, 0.0, 1.5e-4)
    assert phase_durations(case) == pytest.approx([float(np.squeeze(column.relaxation_time(0.99)))], rel=5e-3)


@pytest.mark.parametrize("fraction", [0.9, 0.99])
def test_strain_has_gone_its_fraction_of_the_way_when_the_time_is_over(fraction: float) -> None:
    """Loading and unloading of the reference case, each 1.5 relaxation times of the biphasic-swelling model."""
    case = fvswell.load_case(REFERENCE).with_changes({"time.relaxation_fraction": fraction, "geometry.cells": 25})
    loading, unloading = (duration / 1.5 for duration in phase_durations(case))
    times = [loading, 1.5 * loading, 1.5 * loading + unloading]
    changes = {
        "time.tolerance": 1e-6, "output.times": times,
        "phase.loading.duration": 1.5 * loading, "phase.unloading.duration": 1.5 * unloading,
    }  # fmt: skip
    result = fvswell.run(case.with_changes(changes), "biphasic-swelling")
    start, there, end, back = result["global_strain"].values[:4]
    equilibrium = result["equilibrium_strain"].values
    assert start == 0.0
    assert there / equilibrium[0] == pytest.approx(fraction, abs=3e-5)
    assert (back - end) / (equilibrium[1] - end) == pytest.approx(fraction, abs=3e-5)


def test_given_durations_are_kept() -> None:
    case = fvswell.load_case(REFERENCE).with_changes({"phase.unloading.duration": 123.0})
    loading, unloading = phase_durations(case)
    assert unloading == 123.0
    assert 300.0 < loading < 900.0
    assert phase_durations(small_compression()) == [300.0, 300.0]


def test_a_phase_after_one_of_a_given_length_starts_where_that_one_ends() -> None:
    """Cut short, the loading leaves less to unload from, and the way back takes another time."""
    case = fvswell.load_case(REFERENCE).with_changes({"phase.loading.duration": 50.0})
    duration = phase_durations(case)[1] / 1.5
    case = case.with_changes({"phase.unloading.duration": duration, "output.times": [50.0, 50.0 + duration]})
    _, end, back = fvswell.run(case, "biphasic-swelling")["global_strain"].values
    assert back / end == pytest.approx(0.01, abs=1e-4)
    assert duration != pytest.approx(phase_durations(fvswell.load_case(REFERENCE))[1] / 1.5, rel=0.01)


def test_time_goes_with_permeability_and_height() -> None:
    """Twice the permeability, half the time; twice the height, four times as long."""
    case = fvswell.load_case(CASES / "free_swelling.toml").with_changes(
        {"geometry.cells": 20, "open_circuit_permeability": "none"}
    )
    durations = np.array(phase_durations(case))
    faster = phase_durations(case.with_changes({"tissue.hydraulic_permeability": 2e-3}))
    thicker = phase_durations(case.with_changes({"geometry.height": 1.0}))
    np.testing.assert_allclose(faster, 0.5 * durations, rtol=1e-8)
    np.testing.assert_allclose(thicker, 4.0 * durations, rtol=1e-8)


def test_all_models_run_for_the_time_of_the_one() -> None:
    case = fvswell.load_case(REFERENCE).with_changes({"geometry.cells": 10, "output.per_phase": 4})
    ends = [fvswell.run(case, model)["phase_end"].values for model in ("biphasic", "electrochemical")]
    np.testing.assert_array_equal(*ends)


def test_a_ramp_longer_than_the_phase_found_is_refused() -> None:
    case = small_compression(
        phase__loading__duration="0.01 relaxation times",
        phase__loading__piston__pressure={"ramp_to": 0.1, "over": 5000.0},
    )
    with pytest.raises(
        CaseError, match=r"phase\[loading\].piston.pressure = .*: over: 5000 s is longer than the phase, "
    ):
        fvswell.run(case)
    with pytest.raises(CaseError, match="longer than the phase"):
        fvswell.compare(case)
