"""Advice: what is predicted of cases, against their simulation, and the recommendation that follows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sample_cases import CASES, small_compression, small_swelling

from fvswell.analysis.advice import ADEQUATE, GOOD, advise
from fvswell.analysis.comparison import compare
from fvswell.case.case import Case, CaseError, load_case
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.prediction.case_prediction import conditions_of, is_uniform, mean_tissue, predict_cases
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
        assert phase.equilibrium_strain == pytest.approx(simulated.reference_equilibrium_strain, abs=1e-6)
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


def test_a_displaced_piston_cannot_be_predicted_but_is_not_refused() -> None:
    moved = small_compression(phase__loading__piston__displacement={"ramp_to": -0.02, "over": 100.0})
    advice = advise(moved)
    assert advice.phases == ()
    assert advice.model == "electrochemical"
    assert "phase.loading.piston.displacement: is prescribed" in report(moved)
    with pytest.raises(CaseError, match="only pressures can be predicted"):
        predict_cases([moved])


def test_blocks_are_refused() -> None:
    with pytest.raises(CaseError, match="must be column: only columns can be predicted"):
        advise(load_case(CASES / "plane_strain.toml"))


def test_conditions_of_cases() -> None:
    """Ramps are kept, and the bath stays as the phase before left it."""
    ramp = {"ramp_to": 0.2, "over": 50.0}
    case = small_swelling(phase__loading__piston__pressure=ramp, phase__unloading__bath_concentration=None)
    first, loading, unloading = conditions_of([case])
    assert (first.piston_pressure.item(), first.bath_concentration.item()) == (0.0, 1.5e-4)
    assert (loading.piston_pressure.item(), loading.pressure_ramp.item()) == (0.2, 50.0)
    assert (loading.bath_concentration.item(), loading.bath_ramp.item()) == (1e-4, 0.0)
    assert (unloading.piston_pressure.item(), unloading.bath_concentration.item()) == (0.0, 1e-4)


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
