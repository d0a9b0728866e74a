"""Durations told in relaxation times."""

from __future__ import annotations

import numpy as np
import pytest
from columns import CASES, compression, single_phase

import fvswell
from fvswell import CaseError
from fvswell.exact.linear_swelling import LinearColumn
from fvswell.physics.models import BIPHASIC_SWELLING
from fvswell.simulation.column_batch import ColumnBatch
from fvswell.simulation.relaxation import phase_durations


def test_small_step_relaxes_in_the_exact_time() -> None:
    """The linear solution's time to 99 %, for a load of 1e-4 MPa: 1e-4 of the strain is 1 % of what is left then."""
    case = single_phase(compression(geometry__cells=40), 1.0, piston_pressure=1e-4)
    case = case.with_changes({"phase.only.duration": "1 relaxation times"})
    batch = ColumnBatch.of([case], BIPHASIC_SWELLING)
    column = LinearColumn.at_equilibrium(batch.cells, 0.5, 0.0, np.array([[1.5e-4]]))
    expected = column.relaxation_time(0.99).item()
    assert phase_durations([case]).item() == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize("fraction", [0.9, 0.99])
def test_strain_has_gone_its_fraction_of_the_way_when_the_time_is_over(fraction: float) -> None:
    """Loading and unloading of the reference case, each 1.5 relaxation times of the biphasic-swelling model."""
    case = fvswell.load_case(CASES / "confined_compression.toml").with_changes(
        {"time.relaxation_fraction": fraction, "geometry.cells": 25}
    )
    loading, unloading = phase_durations([case])[0] / 1.5
    times = [float(loading), float(1.5 * loading), float(1.5 * loading + unloading)]
    changes = {
        "time.scheme": "sdirk2", "time.tolerance": 1e-5, "output.times": times,
        "phase.loading.duration": 1.5 * loading, "phase.unloading.duration": 1.5 * unloading,
    }  # fmt: skip
    result = fvswell.run(case.with_changes(changes), "biphasic-swelling")
    start, there, end, back = result["global_strain"].values[:4]
    rest = result["equilibrium_strain"].values
    assert start == 0.0
    assert there / rest[0] == pytest.approx(fraction, abs=3e-4)
    assert (back - end) / (rest[1] - end) == pytest.approx(fraction, abs=3e-4)


def test_given_durations_are_kept() -> None:
    case = fvswell.load_case(CASES / "confined_compression.toml").with_changes({"phase.unloading.duration": 123.0})
    durations = phase_durations([case])[0]
    assert durations[1] == 123.0
    assert 300.0 < durations[0] < 900.0
    np.testing.assert_array_equal(phase_durations([compression()]), [[600.0, 600.0]])


def test_every_column_has_its_own_time() -> None:
    """Twice the permeability, half the time; in a batch as alone."""
    case = fvswell.load_case(CASES / "free_swelling.toml").with_changes(
        {"geometry.cells": 20, "open_circuit_permeability": "none"}
    )
    faster = case.with_changes({"tissue.hydraulic_permeability": 2e-3})
    both = phase_durations([case, faster])
    np.testing.assert_allclose(both[0], 2.0 * both[1], rtol=2e-3)
    np.testing.assert_allclose(both[1], phase_durations([faster])[0], rtol=1e-6)


def test_all_models_run_for_the_time_of_the_one() -> None:
    case = fvswell.load_case(CASES / "confined_compression.toml").with_changes(
        {"geometry.cells": 10, "time.steps_per_phase": 4}
    )
    ends = [fvswell.run(case, model)["phase_end"].values for model in ("biphasic", "electrochemical")]
    np.testing.assert_array_equal(*ends)


def test_a_ramp_longer_than_the_phase_found_is_refused() -> None:
    case = compression(
        phase__loading__duration="0.01 relaxation times",
        phase__loading__piston_pressure={"ramp_to": 0.1, "over": 5000.0},
    )
    with pytest.raises(
        CaseError, match=r"phase\[loading\].piston_pressure = .*: over: 5000 s is longer than the phase, "
    ):
        fvswell.run(case)
    with pytest.raises(CaseError, match="longer than the phase"):
        fvswell.compare(case)
