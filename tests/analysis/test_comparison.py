"""The numbers that say how far models are apart, against hand computation and against what physics demands."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from sample_cases import small_block, small_compression, small_swelling

import fvswell
from fvswell.analysis.characteristics import characteristics
from fvswell.analysis.comparison import Comparison, compare, compare_results, reference_model, with_models
from fvswell.analysis.histories import all_histories, common_times, history_at, local_strain, profile_at
from fvswell.case.case import MODELS, CaseError
from fvswell.errors import OutputError
from fvswell.reporting.comparison_report import comparison_remarks
from fvswell.results.table import write_table

TIMES = np.array([0.0, 1.0, 2.0, 4.0, 6.0])


@pytest.fixture(scope="module")
def compression() -> Comparison:
    return compare(small_compression(time__steps_per_phase=40))


def made_up_result(model: str, strain: list[float], J: list[list[float]]) -> xr.Dataset:
    """Three outputs of a phase of 2 s on three cells, with the numbers that a comparison reads."""
    case = small_compression(
        model=model, phase__loading__duration=2.0, phase__unloading__duration=2.0, time__steps_per_phase=2
    )
    return xr.Dataset(
        {
            "global_strain": ("time", strain),
            "volume_ratio": (("time", "cell"), J),
            "phase_end": ("phase", [2.0, 4.0]),
            "equilibrium_strain": ("phase", [-0.3, 0.0]),
        },
        coords={"time": [0.0, 1.0, 2.0, 3.0, 4.0], "x": ("cell", [0.1, 0.2, 0.4])},
        attrs={"case_toml": case.to_toml(), "model": model},
    )


def test_numbers_against_hand_computation() -> None:
    start, flat = [2.0, 1.0, 1.0], [1.0, 1.0, 1.0]
    reference = made_up_result(
        "electrochemical", [0.0, -0.1, -0.2, -0.1, 0.0], [start, [1.8, 0.9, 0.8], start, flat, start]
    )
    other = made_up_result(
        "biphasic-swelling", [0.0, -0.14, -0.21, -0.1, 0.0], [start, [1.6, 0.84, 0.85], start, flat, start]
    )
    loading, unloading = compare_results({"biphasic-swelling": other, "electrochemical": reference}).differences
    # residuals 0.04^2 + 0.01^2 over 2 (0.05^2)
    assert loading.r_squared == pytest.approx(1.0 - (0.0016 + 0.0001) / 0.005)
    assert loading.largest == pytest.approx(-0.04)
    assert (loading.time, loading.time_in_phase) == (1.0, 1.0)
    # local strains -0.2, -0.16, -0.15 less -0.1, -0.1, -0.2
    assert loading.local_strain == pytest.approx(-0.1)
    assert loading.local_strain_ratio == pytest.approx(1.0)
    assert loading.depth == 0.1
    assert unloading.r_squared == 1.0
    assert unloading.largest == 0.0


def test_times_are_those_of_the_output_where_all_agree() -> None:
    np.testing.assert_array_equal(common_times([TIMES, TIMES * (1 + 1e-15)], 0.0, 4.0), [1.0, 2.0, 4.0])
    np.testing.assert_array_equal(common_times([TIMES, TIMES], 4.0, 6.0), [6.0])


def test_times_are_fifty_equal_steps_where_outputs_differ() -> None:
    at = common_times([TIMES, np.array([0.0, 1.0, 3.0, 4.0])], 2.0, 4.0)
    np.testing.assert_allclose(at, 2.0 + 0.04 * np.arange(1, 51))


def test_times_are_fifty_equal_steps_where_all_have_outputs_there_and_more() -> None:
    """So that R^2 does not weigh times by how densely results were written."""
    even = np.arange(1, 51) / 50.0
    dense = np.union1d(even, np.linspace(0.0, 0.02, 9))
    np.testing.assert_array_equal(common_times([dense, dense], 0.0, 1.0), even)


def test_history_at_its_own_times_is_exact() -> None:
    values = np.random.default_rng(1).normal(size=5)
    np.testing.assert_array_equal(history_at(TIMES, values, 0.0, TIMES[1:]), values[1:])


def test_history_between_its_times_follows_the_root_of_time() -> None:
    at = np.linspace(2.1, 6.0, 7)
    values = np.where(TIMES <= 2.0, 7.0, 7.0 - 3.0 * np.sqrt(np.maximum(TIMES - 2.0, 0.0)))
    np.testing.assert_allclose(history_at(TIMES, values, 2.0, at), 7.0 - 3.0 * np.sqrt(at - 2.0), rtol=1e-13)


def test_history_is_unknown_beyond_its_end() -> None:
    values = history_at(TIMES, TIMES, 0.0, np.array([5.0, 6.5]))
    assert np.isfinite(values[0])
    assert np.isnan(values[1])
    assert np.isnan(history_at(TIMES[:1], TIMES[:1], 2.0, np.array([5.0]))).all()


def test_a_jump_at_the_start_of_a_phase_is_not_interpolated() -> None:
    """The displacement of a free edge jumps with the load; first outputs lie at different times."""
    made_up = {
        name: xr.Dataset({"jumps": ("time", [0.0, *np.ones(len(times))])}, coords={"time": [0.0, *times]})
        for name, times in (("early", [0.01, 1.0, 2.0]), ("late", [0.5, 2.0]))
    }
    every, histories = all_histories(made_up, "jumps", 0.0, 2.0)
    assert every[0] == 0.5
    np.testing.assert_array_equal(histories["late"], histories["early"])


def test_profile_is_linear_between_outputs_of_a_phase_and_unknown_elsewhere() -> None:
    profiles = np.stack([TIMES, 2.0 * TIMES], axis=1)
    result = xr.Dataset({"phase_end": ("phase", [4.0, 6.0])}, coords={"time": TIMES})
    np.testing.assert_allclose(profile_at(result, profiles, 3.5), [3.5, 7.0])
    np.testing.assert_array_equal(profile_at(result, profiles, 6.0), [6.0, 12.0])
    np.testing.assert_array_equal(profile_at(result, profiles, 0.0), [0.0, 0.0])
    assert np.isnan(profile_at(result, profiles, 6.1)).all()
    assert np.isnan(profile_at(result, profiles, 0.5)).all()  # the load may jump at the start of a phase
    assert np.isnan(profile_at(result, profiles, 5.0)).all()
    np.testing.assert_array_equal(profile_at(result.isel(time=[0]), profiles[:1], 0.0), [0.0, 0.0])  # stopped at once
    sparse = result.assign(phase_end=("phase", [5.0, 6.0]))  # the load changes between two outputs
    assert np.isnan(profile_at(sparse, profiles, 4.5)).all()
    np.testing.assert_array_equal(profile_at(sparse, profiles, 4.0), [4.0, 8.0])


def test_fullest_model_is_the_reference() -> None:
    assert reference_model(["biphasic", "electrochemical", "biphasic-swelling"]) == "electrochemical"
    assert reference_model(["biphasic-swelling", "biphasic"]) == "biphasic-swelling"


def test_models_of_compression(compression: Comparison) -> None:
    assert compression.reference == "electrochemical"
    assert tuple(compression.results) == MODELS
    assert compression.phases == ("loading", "unloading")
    for phase in compression.phases:
        biphasic, swelling = compression.of_phase(phase)
        assert (biphasic.model, swelling.model) == ("biphasic", "biphasic-swelling")
        assert swelling.r_squared > 0.9 > biphasic.r_squared
        assert swelling.equilibrium_strain == pytest.approx(swelling.reference_equilibrium_strain, abs=1e-12)
    biphasic, swelling = compression.of_phase("loading")
    assert biphasic.equilibrium_strain < swelling.equilibrium_strain < 0.0
    # without swelling pressure to carry part of the load the sample gives way much further
    assert biphasic.largest < swelling.largest < 0.0


def test_differences_are_those_of_the_results(compression: Comparison) -> None:
    reference = compression.results["electrochemical"]
    for difference in compression.differences:
        own = compression.results[difference.model]
        gap = own["global_strain"] - reference["global_strain"]
        end = float(reference["phase_end"][compression.phases.index(difference.phase)])
        within = gap.where((gap["time"] > end - 300.0) & (gap["time"] <= end), drop=True)
        assert abs(difference.largest) == pytest.approx(float(abs(within).max()), abs=1e-15)
        assert float(gap.sel(time=difference.time)) == difference.largest
        local = (local_strain(own) - local_strain(reference))[list(gap["time"]).index(difference.time)]
        assert abs(difference.local_strain) == np.abs(local).max()
        time, above = compression.gap(difference.model)
        np.testing.assert_allclose(above, gap.sel(time=time), atol=1e-15)


def test_python_gets_what_the_command_saves(compression: Comparison, tmp_path: Path) -> None:
    write_table(tmp_path / "table.csv", compression.header, compression.rows)
    with (tmp_path / "table.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["phase"], row["model"]) for row in rows] == [
        (each.phase, each.model) for each in compression.differences
    ]
    for row, difference in zip(rows, compression.differences, strict=True):
        assert float(row["r_squared"]) == difference.r_squared
        assert float(row["largest"]) == difference.largest
        assert row["reference"] == "electrochemical"


def test_fast_ions_make_the_models_agree() -> None:
    slow, fast = (
        fvswell.compare(
            small_compression(tissue__cation_diffusivity=5e-4 * speed, tissue__anion_diffusivity=8e-4 * speed),
            ["electrochemical", "biphasic-swelling"],
        ).differences
        for speed in (10.0, 100.0)
    )
    for left, right in zip(slow, fast, strict=True):
        assert right.r_squared > 1.0 - 1e-5
        # what is left is inversely proportional to the diffusivity
        assert left.largest / right.largest == pytest.approx(10.0, rel=0.05)
        assert left.local_strain / right.local_strain == pytest.approx(10.0, rel=0.05)


def test_uncharged_tissue_is_biphasic_in_all_models() -> None:
    case = small_compression(
        tissue__fixed_charge_density=0.0, tissue__osmotic_coefficient=0.93, tissue__hindrance_factor=0.0
    )
    for difference in compare(case).differences:
        assert difference.r_squared == pytest.approx(1.0, abs=1e-9)


def test_biphasic_model_does_not_feel_the_bath() -> None:
    biphasic, _ = compare(small_swelling()).of_phase("loading")
    assert biphasic.local_strain_ratio == pytest.approx(1.0)
    assert biphasic.equilibrium_strain == pytest.approx(0.0, abs=1e-12)
    assert biphasic.reference_equilibrium_strain > 0.05
    assert biphasic.r_squared < 0.0


def test_models_with_different_steps_are_compared_at_equal_times() -> None:
    fine = small_compression(time__steps_per_phase=4000)
    free = small_compression(time={"scheme": "esdirk43", "tolerance": 1e-5})
    names = ["electrochemical", "biphasic-swelling"]
    expected, found = (compare(case, names) for case in (fine, free))
    for left, right in zip(expected.differences, found.differences, strict=True):
        assert right.r_squared == pytest.approx(left.r_squared, abs=2e-3)
        assert right.times == 50
        assert right.largest == pytest.approx(np.interp(right.time, *expected.gap(right.model)), abs=1e-4)


def test_largest_difference_is_found_between_the_times_that_r_squared_takes() -> None:
    """A step of the load that is over before the first of 50 equal times of a long phase."""
    changes = {"phase.loading.duration": 1e6, "time": {"scheme": "esdirk43", "tolerance": 1e-4}}
    names = ["electrochemical", "biphasic-swelling"]
    brief, lengthy = (
        compare(small_compression().with_changes(changes | {"phase.loading.duration": duration}), names).of_phase(
            "loading"
        )[0]
        for duration in (2e3, 1e6)
    )
    assert lengthy.time_in_phase == pytest.approx(brief.time_in_phase, rel=0.2)
    assert lengthy.largest == pytest.approx(brief.largest, rel=0.02)
    assert np.isnan(lengthy.r_squared)  # at the 50 times nothing happens any more
    assert 0.9 < brief.r_squared < 1.0


def test_phase_without_outputs_is_left_out_and_reported(tmp_path: Path) -> None:
    """Nothing is read off a straight line across a change of load."""
    times = [1.0, 10.0, 100.0, 200.0, 300.0]
    case = small_compression(output={"times": times})
    comparison = compare(case, ["electrochemical", "biphasic-swelling"])
    assert comparison.phases == ("loading",)
    assert comparison.left_out == ("unloading",)
    (line,) = comparison_remarks(comparison)
    assert line.startswith("too few outputs to compare models in unloading: give more output times")
    with pytest.raises(CaseError, match="leaves no phase with 2 outputs"):
        compare(case.with_changes({"output.times": [600.0]}), ["electrochemical", "biphasic-swelling"])


def test_pressure_is_compared_where_the_displacement_is_given() -> None:
    ramp = {"ramp_to": -0.02, "over": 100.0}
    hold = -0.02
    case = small_compression(phase__loading__piston__displacement=ramp, phase__unloading__piston__displacement=hold)
    comparison = compare(case)
    assert comparison.quantity == "piston_pressure"
    biphasic, swelling = comparison.of_phase("loading")
    # the charge stiffens the tissue: without it less pressure is needed for the same strain
    assert biphasic.largest < 0.0
    assert swelling.r_squared > biphasic.r_squared
    assert biphasic.equilibrium_strain == pytest.approx(swelling.equilibrium_strain, rel=0.06)


def test_probe_that_is_held_is_reported() -> None:
    case = small_block(geometry__probe=[0.0, 0.0])
    comparison = compare(case, ["electrochemical", "biphasic-swelling"])
    assert all(np.isnan(each.r_squared) for each in comparison.differences)
    assert comparison_remarks(comparison) == ["the probe does not move: give another place for it, geometry.probe"]


def test_wrong_models_are_all_reported_at_once() -> None:
    with pytest.raises(CaseError) as caught:
        with_models(small_compression(), ["biphasic", "electro", "triphasic"])
    assert len(caught.value.problems) == 2
    assert 'did you mean "electrochemical"' in str(caught.value)


@pytest.mark.parametrize("models", [[], ["biphasic"], ["biphasic", "biphasic"]])
def test_one_model_cannot_be_compared(models: list[str]) -> None:
    with pytest.raises(CaseError, match="must be two or more of biphasic, biphasic-swelling"):
        compare(small_compression(), models)


def test_load_that_a_model_cannot_bear_is_reported_before_any_run() -> None:
    heavy = small_compression(phase__loading__piston__pressure=1.5)
    with pytest.raises(CaseError, match="leaves no equilibrium with water"):
        compare(heavy)


def test_characteristics_of_the_reference_tissue() -> None:
    numbers = characteristics(small_compression())
    assert numbers.equilibria["electrochemical"].initial_stretch == pytest.approx(1.054503, abs=1e-6)
    assert numbers.equilibria["biphasic"].initial_stretch == pytest.approx(1.0, abs=1e-12)
    loaded = {model: each.strain[0] for model, each in numbers.equilibria.items()}
    assert loaded["electrochemical"] == pytest.approx(0.822614 / 1.054503 - 1.0, abs=2e-6)
    assert loaded["biphasic-swelling"] == loaded["electrochemical"]
    assert loaded["biphasic"] == pytest.approx(0.682746 - 1.0, abs=1e-6)
    assert numbers.open_circuit_ratio[0] == pytest.approx(0.83945, abs=1e-5)
    assert numbers.open_circuit_ratio[1] == pytest.approx(numbers.open_circuit_ratio[0])
    # h^2/(k H) with H = K + 4 G/3 = 0.67308 MPa
    assert numbers.consolidation_time == pytest.approx((0.5 * 1.054503) ** 2 / (1e-3 * 0.673077), rel=1e-5)


def test_salt_is_as_fast_as_in_water_without_charge_and_as_its_co_ion_with_much() -> None:
    free = characteristics(small_compression(tissue__fixed_charge_density=0.0))
    diffusivity = 2.0 * 5e-4 * 8e-4 / (5e-4 + 8e-4)  # Nernst and Hartley
    height = 0.5 * free.equilibria["electrochemical"].initial_stretch
    assert height**2 / free.diffusion_time == pytest.approx(diffusivity)
    charged = characteristics(small_compression(tissue__fixed_charge_density="20 M"))
    height = 0.5 * charged.equilibria["electrochemical"].initial_stretch
    assert height**2 / charged.diffusion_time == pytest.approx(8e-4, rel=1e-2)


def test_nothing_to_explain_has_no_r_squared(tmp_path: Path) -> None:
    """A phase in which nothing happens: what differs is rounding."""
    comparison = compare(small_block(phase__swelling__bath_concentration=1.5e-4))
    for each in comparison.of_phase("swelling"):
        assert np.isnan(each.r_squared)
        assert np.isnan(each.local_strain_ratio)
    with pytest.raises(OutputError, match="cannot be written"):
        write_table(tmp_path, comparison.header, comparison.rows)


def test_models_are_compared_by_what_is_asked_for(compression: Comparison) -> None:
    """By the case, or by whoever compares; a history that one of the models does not have is named."""
    assert compression.quantity == "global_strain"
    by_water = compare_results(compression.results, "filter_water_volume")
    assert by_water.quantity == "filter_water_volume"
    result, base = (compression.results[model] for model in ("biphasic-swelling", "electrochemical"))
    end = float(result["phase_end"][0])
    gap = [float(np.interp(end, each["time"], each["filter_water_volume"])) for each in (result, base)]
    (difference,) = (d for d in by_water.differences if d.model == "biphasic-swelling" and d.phase == "loading")
    assert abs(difference.largest) >= abs(gap[0] - gap[1])
    with pytest.raises(CaseError, match="the biphasic model has no such history"):
        compare_results(compression.results, "piston_potential")


@pytest.mark.parametrize(("name", "near"), [("piston_presure", "piston_pressure"), ("global_stran", "global_strain")])
def test_a_history_that_no_sample_has_is_refused_in_the_case(name: str, near: str) -> None:
    with pytest.raises(CaseError, match=f"output.measured.*is no history of this sample.*did you mean {near}"):
        small_compression(output__measured=name)


def test_a_fixed_piston_is_compared_by_its_pressure() -> None:
    changes = {
        "boundary.piston.mechanical": "fixed", "phase.loading.piston": None, "phase.unloading.piston": None,
        "phase.loading.bath_concentration": 1e-4, "phase.unloading.bath_concentration": 1.5e-4,
    }  # fmt: skip
    comparison = compare(small_compression().with_changes(changes), ["biphasic-swelling", "electrochemical"])
    assert comparison.quantity == "piston_pressure"
