"""The models beside each other in the same case."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from columns import compression, relaxed, swelling

import fvswell
from fvswell.physics.models import MODELS

Results = dict[str, xr.Dataset]
SWELLING = ("biphasic-swelling", "electrochemical")


@pytest.fixture(scope="module")
def loaded() -> Results:
    case = compression(geometry__cells=24, time__steps_per_phase=30)
    return {model: fvswell.run(case, model) for model in MODELS}


@pytest.fixture(scope="module")
def bathed() -> Results:
    case = swelling(geometry__cells=24, time__steps_per_phase=30)
    return {model: fvswell.run(case, model) for model in MODELS}


def test_swelling_models_start_from_the_same_state(loaded: Results) -> None:
    one, other = (loaded[model].isel(time=0) for model in SWELLING)
    for name in one.data_vars:
        if "step" not in one[name].dims:
            np.testing.assert_allclose(one[name], other[name], rtol=1e-12, atol=1e-15, err_msg=name)


def test_biphasic_starts_stress_free(loaded: Results) -> None:
    assert np.all(loaded["biphasic"]["volume_ratio"][0] == 1.0)
    assert np.all(loaded["biphasic"]["effective_stress"][0] == 0.0)


def test_swelling_models_head_for_the_same_equilibrium(loaded: Results, bathed: Results) -> None:
    for results in (loaded, bathed):
        rest = [results[model]["equilibrium_strain"].values for model in SWELLING]
        np.testing.assert_allclose(rest[0], rest[1], rtol=1e-12, atol=1e-14)


def test_biphasic_is_compressed_more_and_sooner(loaded: Results) -> None:
    """Nothing but the solid holds it up; and its water meets no streaming potential."""
    for model in SWELLING:
        assert loaded["biphasic"]["equilibrium_strain"][0] < 1.3 * loaded[model]["equilibrium_strain"][0] < 0.0
        assert np.all(loaded["biphasic"]["global_strain"][1:31] < loaded[model]["global_strain"][1:31])


def test_biphasic_does_not_notice_a_bath(bathed: Results) -> None:
    assert np.abs(bathed["biphasic"]["global_strain"]).max() < 1e-14
    for model in SWELLING:
        assert bathed[model]["global_strain"][30] > 0.05


def test_constant_open_circuit_permeability_makes_early_flow_differ(loaded: Results) -> None:
    """All models drain at first as the square root of time, each with its permeability: k, or k_open below it."""
    first = {model: float(loaded[model]["water_flux"][1, 0]) for model in MODELS}
    assert first["biphasic"] < first["biphasic-swelling"] < 0.0


def test_full_model_swells_faster_at_first_and_overshoots(bathed: Results) -> None:
    """As the linear solution has it: 9.2e-5 against 7.2e-5 of height a root second for a step of 1e-6 mmol/mm3."""
    early = {model: float(bathed[model]["global_strain"][1]) for model in SWELLING}
    assert 0.0 < early["biphasic-swelling"] < early["electrochemical"]
    rest = float(bathed["electrochemical"]["equilibrium_strain"][0])
    loading = {model: bathed[model]["global_strain"][:31] for model in SWELLING}
    assert loading["electrochemical"].max() > 1.005 * rest > loading["biphasic-swelling"].max()


def test_differences_between_the_swelling_models_are_largest_under_way(loaded: Results, bathed: Results) -> None:
    for results in (loaded, bathed):
        gap = np.abs(results["electrochemical"]["global_strain"] - results["biphasic-swelling"]["global_strain"]).values
        assert 3 * gap[[0, -1]].max() < gap.max()


def test_given_permeability_counts_in_biphasic_swelling() -> None:
    """Without the streaming potential it drains faster, by the ratio of the permeabilities in time."""
    case = relaxed(compression(geometry__cells=12), 600.0, 10)
    hindered, free = (
        fvswell.run(case.with_changes({"open_circuit_permeability": kind}), "biphasic-swelling")
        for kind in ("initial", "none")
    )
    assert np.all(free["global_strain"][1:11] < hindered["global_strain"][1:11])
    ratio = 8.3945e-4 / 1e-3
    scaled = case.with_changes({"open_circuit_permeability": "none", "tissue.hydraulic_permeability": 1e-3 * ratio})
    same = fvswell.run(scaled, "biphasic-swelling")
    np.testing.assert_allclose(same["global_strain"], hindered["global_strain"], atol=1e-5)
