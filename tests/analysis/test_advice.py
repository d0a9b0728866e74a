"""Advice: what is predicted of cases, against their simulation, and the recommendation that follows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sample_cases import CASES, small_compression, small_swelling

from fvswell.analysis.advice import ADEQUATE, GOOD, advise
from fvswell.analysis.comparison import compare
from fvswell.case.case import Case, CaseError, load_case
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.prediction.case_prediction import conditions_of, is_uniform, mean_tissue, predict_cases
from fvswell.prediction.conditions import Course
from fvswell.reporting.advice_report import advice_lines, advice_tables
from fvswell.simulation.column_run import ColumnRun

ACCURATE = {"time": {"scheme": "esdirk43", "tolerance": 1e-4}, "geometry.cells": 30, "geometry.grading": 10}
RELAXED = {"phase.loading.duration": "1.5 relaxation times", "phase.unloading.duration": "1.5 relaxation times"}


def report(case: Case) -> str:
    advice = advise(case)
    cells = [cell for table in advice_tables(advice) for row in table.rows for cell in row]
    return "\n".join([*cells, *advice_lines(advice)])


@pytest.mark.parametrize(
    "case",
    [
        small_compression(phase__loading__piston__pressure=0.01),
        small_compression(phase__loading__piston__pressure=0.1),
        small_swelling(phase__loading__bath_concentration=1.4e-4),
        small_swelling(phase__loading__bath_concentration=1.2e-4),
    ],
    ids=["0.01 MPa", "0.1 MPa", "0.14 M", "0.12 M"],
)
def test_advice_agrees_with_the_models(case: Case) -> None:
    """Predicted and simulated misfit, duration and largest error, for changes of a few percent of strain."""
    case = case.with_changes(ACCURATE | RELAXED)
    comparison = compare(case, ("biphasic-swelling", "electrochemical"))
    ends = comparison.results["electrochemical"]["phase_end"].values
    for phase, simulated, duration in zip(
        advise(case).phases, comparison.differences, np.diff(ends, prepend=0.0), strict=True
    ):
        assert 1.0 - phase.r_squared == pytest.approx(1.0 - simulated.r_squared, rel=0.15)
        assert phase.largest_difference == pytest.approx(simulated.largest, rel=0.15)
        assert phase.equilibrium == pytest.approx(simulated.reference_equilibrium_strain, abs=1e-6)
        assert phase.duration == pytest.approx(duration, rel=0.06)
        low, high = phase.r_squared_range
        assert low <= simulated.r_squared <= high


def test_advice_says_what_its_accuracy_is_not_known_of() -> None:
    assert advise(small_compression(**RELAXED)).beyond == ()
    other = small_compression(
        tissue__solid="neo-hookean-log", tissue__permeability_exponent=4.0, phase__loading__duration=30.0,
        phase__unloading__bath_concentration=1e-4,
        tissue__youngs_modulus={"depth": [0.0, 0.5], "value": [0.4, 0.6]},
    )  # fmt: skip
    assert advise(other).beyond == (
        "a tissue that varies with depth", "a neo-hookean-log solid", "a permeability that varies with strain",
        "a change before the last one is over", "load and bath changed at once",
    )  # fmt: skip
    assert any("take the brackets as rough" in line for line in advice_lines(advise(other)))


def test_advice_needs_no_simulation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ColumnRun, "march", property(lambda setup: pytest.fail("a simulation was run")))
    assert len(advise(small_swelling(**RELAXED)).phases) == 2


def test_recommendations() -> None:
    good = advise(small_compression(tissue__cation_diffusivity=1e-2, tissue__anion_diffusivity=1e-2))
    assert good.model == "biphasic-swelling"
    assert min(phase.r_squared_range[0] for phase in good.phases) >= GOOD
    assert "closely" in good.reason
    adequate = advise(load_case(CASES / "confined_compression.toml"))
    assert adequate.model == "biphasic-swelling"
    assert ADEQUATE <= min(phase.r_squared_range[0] for phase in adequate.phases) < GOOD
    assert "loading" in adequate.reason
    poor = advise(load_case(CASES / "free_swelling.toml"))
    assert poor.model == "electrochemical"
    assert min(phase.r_squared_range[0] for phase in poor.phases) < ADEQUATE
    assert "salt diffuses in about" in poor.reason


def test_slow_salt_takes_long() -> None:
    """The slower of the coupled times is the salt's where it diffuses far more slowly than the tissue consolidates."""
    slow = advise(small_swelling(tissue__cation_diffusivity=1e-5, tissue__anion_diffusivity=1e-5))
    usual = advise(small_swelling())
    for one, other in zip(slow.phases, usual.phases, strict=True):
        assert one.diffusion_time > 20.0 * other.diffusion_time
        assert one.r_squared < other.r_squared
        assert one.diffusion_time > one.consolidation_time


def test_negative_osmosis_is_report() -> None:
    """Free ions draw the water along with the salt; hindered ones do not."""
    backward = advise(small_swelling(tissue__hindrance_factor=0.0, tissue__hydraulic_permeability=1e-2))
    assert backward.salt_outdraws_osmosis
    hindered = advise(small_swelling(tissue__hindrance_factor=0.9))
    assert not hindered.salt_outdraws_osmosis
    assert not any(phase.flows_backward_first for phase in hindered.phases)


def test_nothing_happens() -> None:
    advice = advise(small_compression(phase__loading__piston__pressure=0.0))
    assert all(np.isnan(phase.r_squared) for phase in advice.phases)
    assert advice.reason.startswith("nothing changes")
    assert "nan" not in report(small_compression(phase__loading__piston__pressure=0.0))


def test_tissue_that_varies_is_taken_by_its_mean() -> None:
    """The mean over the height, whatever the cells."""
    profile = {"depth": [0.0, 0.1, 0.5], "value": [1e-4, 3e-4, 2e-4]}
    case = small_compression(tissue__fixed_charge_density=profile, geometry__cells=400)
    mean = (0.1 * 2e-4 + 0.4 * 2.5e-4) / 0.5
    assert mean_tissue([case]).fixed_charge_density.item() == pytest.approx(mean, rel=1e-4)
    assert not is_uniform(case)
    assert "mean properties" in report(case)
    uniform = small_compression(tissue__fixed_charge_density=mean)
    assert is_uniform(uniform)
    assert "mean properties" not in report(uniform)
    ours, theirs = (advise(each).phases[0].r_squared for each in (case, uniform))
    assert ours == pytest.approx(theirs, rel=1e-4)


HELD = {"phase__loading__piston__displacement": 0.0, "phase__loading__duration": 600.0}


@pytest.mark.parametrize(
    ("changes", "closeness"),
    [
        (HELD | {"phase__loading__bath_concentration": 1.45e-4}, 0.03),
        (HELD | {"phase__loading__bath_concentration": 1e-4}, 0.15),
        ({"phase__loading__piston__displacement": {"ramp_to": -0.005, "over": 100.0}}, 0.15),
    ],
    ids=["0.145 M", "0.1 M", "1 %"],
)
def test_advice_on_a_held_piston_agrees_with_the_models(changes: dict[str, Any], closeness: float) -> None:
    """The pressure is compared: of a bath step while the piston stands, of a ramp of its displacement."""
    case = small_compression(**changes).with_changes(ACCURATE)
    phase = advise(case).phases[0]
    simulated = compare(case, ("biphasic-swelling", "electrochemical")).differences[0]
    assert phase.quantity == "pressure"
    assert simulated.quantity.endswith("pressure")
    assert 1.0 - phase.r_squared == pytest.approx(1.0 - simulated.r_squared, rel=closeness)


@pytest.mark.parametrize(
    "load",
    [
        {"mean": 0.01, "amplitude": 0.01, "period": 200.0},
        {"times": [0.0, 100.0, 250.0], "values": [0.0, 0.02, 0.005]},
        {"times": [50.0, 100.0, 250.0], "values": [0.0, 0.02, 0.005]},
    ],
    ids=["sine", "table", "table that begins later"],
)
def test_advice_on_loads_that_turn_agrees_with_the_models(load: dict[str, Any]) -> None:
    case = small_compression(phase__loading__piston__pressure=load, phase__loading__duration=400.0)
    case = case.with_changes(ACCURATE)
    advice = advise(case)
    comparison = compare(case, ("biphasic-swelling", "electrochemical"))
    for phase, simulated in zip(advice.phases, comparison.differences, strict=True):
        assert 1.0 - phase.r_squared == pytest.approx(1.0 - simulated.r_squared, rel=0.3)
    assert "a load that turns on its way" in advice.beyond


def test_strains_of_a_piston_are_shares_of_the_swollen_height() -> None:
    case = small_compression(phase__loading__piston__displacement={"ramp_to": "-5 %", "over": 100.0})
    phase = advise(case).phases[0]
    prediction = predict_cases([case])
    assert phase.quantity == "pressure"
    assert prediction.equilibrium_strain[0, 0] == pytest.approx(-0.05, rel=1e-9)


def test_loads_of_cases_that_differ_in_more_than_numbers() -> None:
    slow, fast = (
        small_compression(phase__loading__piston__pressure={"mean": 0.01, "amplitude": 0.01, "period": period})
        for period in (100.0, 50.0)
    )
    with pytest.raises(ValueError, match="different periods"):
        conditions_of([slow, fast])
    with pytest.raises(ValueError, match="together with other loads"):
        conditions_of([slow, small_compression()])


def test_what_a_held_piston_is_advised() -> None:
    """The stress jumps too soon where ions are in equilibrium with the bath, and that is the reason given."""
    case = small_compression(**HELD, phase__loading__bath_concentration=1e-4)
    advice = advise(case)
    assert advice.model == "electrochemical"
    assert "salt diffuses in about" in advice.reason
    assert "a piston that is held" in advice.beyond
    assert "MPa" in report(case)


def test_a_current_needs_ions() -> None:
    advice = advise(load_case(CASES / "electro_osmosis.toml"))
    assert advice.phases
    assert advice.model == "electrochemical"
    assert "carry an electric current" in advice.reason


def test_what_cannot_be_predicted_is_said_and_not_refused() -> None:
    case = load_case(CASES / "permeation.toml")
    advice = advise(case)
    assert advice.phases == ()
    assert advice.model == "electrochemical"
    assert "boundary.piston.bath" in report(case)
    with pytest.raises(CaseError, match="only a piston that is closed can be predicted"):
        predict_cases([case])


def test_blocks_are_refused() -> None:
    with pytest.raises(CaseError, match="must be column: only columns can be predicted"):
        advise(load_case(CASES / "plane_strain.toml"))


def test_conditions_of_cases() -> None:
    """Ramps are kept, and the bath stays as the phase before left it."""
    ramp = {"ramp_to": 0.2, "over": 50.0}
    case = small_swelling(phase__loading__piston__pressure=ramp, phase__unloading__bath_concentration=None)
    first, loading, unloading = conditions_of([case])
    assert tuple(each.item() for each in first.ends) == (0.0, 1.5e-4)
    for load, value, over in (
        (loading.piston_pressure, 0.2, 50.0), (loading.bath_concentration, 1e-4, 0.0),
        (unloading.piston_pressure, 0.0, 0.0), (unloading.bath_concentration, 1e-4, 0.0),
    ):  # fmt: skip
        assert isinstance(load, Course)
        assert (load.final().item(), load.times[0, -1]) == (value, over)


def test_predicted_cases_keep_their_own_equilibria() -> None:
    cases = [small_compression(), small_compression(tissue__youngs_modulus=0.3)]
    both = predict_cases(cases)
    tissue = mean_tissue(cases)
    J0, J1 = (equilibrium_volume_ratio(tissue, p, 1.5e-4) for p in (0.0, 0.25))
    np.testing.assert_allclose(both.equilibrium_strain[:, 0], J1 / J0 - 1.0, rtol=1e-10)
    np.testing.assert_array_equal(both.phase_duration, 300.0)
    for row, case in enumerate(cases):
        np.testing.assert_allclose(both.r_squared[row], predict_cases([case]).r_squared[0], rtol=1e-9)


def test_the_open_circuit_permeability_of_the_case_counts() -> None:
    """The streaming potential holds water back, and the more so in compressed tissue with its denser charge."""
    free, initial, state = (
        predict_cases([small_compression(open_circuit_permeability=kind)]).reduced_diffusivity[0, 0]
        for kind in ("none", "initial", "state")
    )
    assert initial / free == pytest.approx(8.3945e-4 / 1e-3, rel=1e-4)  # k_open/k of the reference tissue
    assert state < 0.95 * initial


@pytest.mark.parametrize("file", sorted(Path(CASES).glob("*_*.toml")), ids=lambda path: path.stem)
def test_the_example_cases_are_advised_on_or_refused(file: Path) -> None:
    case = load_case(file)
    if case.geometry.kind == "column":
        assert "recommended: " in report(case)
    else:
        with pytest.raises(CaseError):
            advise(case)
