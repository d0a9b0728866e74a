"""Fits recover what is known, and say how sure they are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from curves import TIMES, TRUTH, case, creep, measured, problem, relaxation, sought, swelling

import fvswell
from fvswell.case.case import Case, CaseError
from fvswell.errors import OutputError, SolverError
from fvswell.fitting.evaluator import FitProgress
from fvswell.fitting.measurement import Measurement
from fvswell.fitting.parameters import Parameter, Parameters
from fvswell.fitting.problem import FitProblem

EXPERIMENTS = {
    "relaxation": (relaxation(), "piston_pressure"),
    "creep": (creep(), "global_strain"),
    "free swelling": (swelling(), "global_strain"),
    "biphasic creep": (creep(model="biphasic", tissue__permeability_exponent=3.0), "global_strain"),
    "biphasic swelling relaxation": (relaxation(model="biphasic-swelling"), "piston_pressure"),
    "equal steps": (creep(time={"scheme": "backward-euler", "steps_per_phase": 20}), "global_strain"),
    "isometric bath step": (case({"piston": {"displacement": 0.0}, "bath_concentration": 5e-5}), "piston_pressure"),
}


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_noise_free_curves_give_back_what_they_were_made_with(name: str) -> None:
    of, quantity = EXPERIMENTS[name]
    result = fvswell.fit(
        problem([measured(of, quantity)], sought("youngs_modulus", "hydraulic_permeability")), with_profiles=False
    )
    for parameter, value in result.values.items():
        assert value == pytest.approx(TRUTH[parameter], rel=1e-6)
    assert not any(test.structured for test in result.residual_tests)


def test_the_charge_is_found_beside_them_from_two_baths() -> None:
    curves = [measured(relaxation(), "piston_pressure", name="one"),
              measured(relaxation(bath__concentration=1e-3), "piston_pressure", name="other")]  # fmt: skip
    result = fvswell.fit(problem(curves, sought(*TRUTH)), with_profiles=False)
    assert result.values == pytest.approx(TRUTH, rel=1e-6)


def test_samples_share_properties_and_have_their_own() -> None:
    stiff = creep(tissue__youngs_modulus=0.8)
    curves = [measured(creep(), "global_strain", name="soft"), measured(stiff, "global_strain", name="stiff")]
    own = [
        Parameter(f"modulus_{name}", ("tissue.youngs_modulus",), 0.6, 0.1, 2.0, True, (name,))
        for name in ("soft", "stiff")
    ]
    shared = sought("hydraulic_permeability").every
    result = fvswell.fit(problem(curves, Parameters([*own, *shared])), with_profiles=False)
    assert result.values == pytest.approx(
        {"modulus_soft": 0.5, "modulus_stiff": 0.8, "hydraulic_permeability": 1e-3}, rel=1e-6
    )
    moduli = sorted(float(case.tissue.youngs_modulus) for case in result.cases.values())
    assert moduli == pytest.approx([0.5, 0.8], rel=1e-6)


def test_quantities_of_one_case_share_a_run() -> None:
    pair = [measured(relaxation(), "piston_pressure", name="pressure"), measured(relaxation(), "height", name="height")]
    whole = problem(pair, sought("youngs_modulus"))
    assert len(whole.experiments) == 1
    np.testing.assert_allclose(whole.check()[: len(TIMES)], _curve(whole, 1.5 * TRUTH["youngs_modulus"])[:, 0])


def _curve(whole: FitProblem, value: float) -> np.ndarray:
    return whole.simulate([value], TIMES)


def test_tied_keys_take_one_value() -> None:
    of = creep(tissue__cation_diffusivity=6e-4, tissue__anion_diffusivity=6e-4, tissue__hindrance_factor=0.0)
    tied = Parameter("salt", ("tissue.cation_diffusivity", "tissue.anion_diffusivity"), 3e-4, 1e-4, 2e-3, True)
    result = fvswell.fit(problem([measured(of, "global_strain")], Parameters([tied])), with_profiles=False)
    assert result.values["salt"] == pytest.approx(6e-4, rel=1e-6)
    (found,) = result.cases.values()
    assert found.tissue.cation_diffusivity == found.tissue.anion_diffusivity == result.values["salt"]


def test_geometry_and_bounded_quantities_are_fitted_as_well() -> None:
    wanted = Parameters([
        Parameter("height", ("geometry.height",), 0.6, 0.2, 1.0, True),
        Parameter("hindrance", ("tissue.hindrance_factor",), 0.1, 0.0, 1.0, False),
    ])  # fmt: skip
    result = fvswell.fit(problem([measured(creep(), "height")], wanted), with_profiles=False)
    assert result.values == pytest.approx({"height": 0.5, "hindrance": 0.4}, rel=1e-6)


def test_fixed_parameters_stay() -> None:
    fixed = replace(sought("fixed_charge_density").every[0], start=1e-4, fixed=True)
    whole = problem([measured(creep(), "global_strain")], Parameters([*sought("youngs_modulus").every, fixed]))
    assert whole.n_parameters() == 1
    (found,) = fvswell.fit(whole, with_profiles=False).cases.values()
    assert found.tissue.fixed_charge_density == 1e-4


def test_noise_levels_of_two_curves_are_told_apart() -> None:
    curves = [measured(relaxation(), "piston_pressure", 0.01, 1, "rough"),
              measured(creep(), "global_strain", 0.001, 2, "fine")]  # fmt: skip
    result = fvswell.fit(problem(curves, sought("youngs_modulus", "hydraulic_permeability")), with_profiles=False)
    for measurement, noise, level in zip(curves, result.best.noise, (0.01, 0.001), strict=True):
        assert noise / measurement.size == pytest.approx(level, rel=0.3)
    assert result.best.variance == pytest.approx(1.0, abs=0.1)


def test_what_cannot_be_told_is_said_and_an_end_is_open() -> None:
    """Strain under a load follows k/h^2, whatever the height, so height and permeability trade off."""
    wanted = Parameters([
        Parameter("height", ("geometry.height",), 0.55, 0.3, 0.9, True), *sought("hydraulic_permeability").every
    ])  # fmt: skip
    of = creep(model="biphasic")
    result = fvswell.fit(problem([measured(of, "global_strain", 0.01, 3)], wanted))
    assert set(result.before.combined) == {"height", "hydraulic_permeability"}
    assert not result.before.told.any()
    low, high = result.intervals["height"]
    assert np.isnan(low)
    assert np.isnan(high)
    direction = result.before.weakest / result.before.weakest[0]
    assert direction[1] == pytest.approx(2.0, rel=1e-3)


def test_a_parameter_without_effect_is_refused() -> None:
    of = creep(model="biphasic")
    with pytest.raises(CaseError, match=r"parameter\[fixed_charge_density\].*makes no difference"):
        fvswell.fit(problem([measured(of, "global_strain")], sought("youngs_modulus", "fixed_charge_density")))


def test_a_history_that_the_case_does_not_have_is_refused() -> None:
    of = creep()
    strange = Measurement("curve", of, "top_force", TIMES, np.ones(len(TIMES)))
    with pytest.raises((CaseError, KeyError), match="top_force"):
        fvswell.fit(problem([strange], sought("youngs_modulus")))


def test_a_start_that_cannot_be_run_is_reported() -> None:
    of = relaxation(phase__only__piston__displacement={"ramp_to": -0.3, "over": 1.0})
    with pytest.raises((SolverError, CaseError)):
        fvswell.fit(problem([Measurement("c", of, "piston_pressure", TIMES, np.ones(50))], sought("youngs_modulus")))


def test_bounds_that_are_hit_are_said() -> None:
    narrow = Parameters([Parameter("youngs_modulus", ("tissue.youngs_modulus",), 0.7, 0.6, 1.0, True)])
    result = fvswell.fit(problem([measured(creep(), "global_strain", 0.001)], narrow))
    assert result.best.at_bound == ("low",)
    assert result.values["youngs_modulus"] == pytest.approx(0.6, rel=1e-3)
    assert np.isnan(result.intervals["youngs_modulus"][0])


def test_several_starts_find_the_same() -> None:
    whole = problem([measured(creep(), "global_strain", 0.005)], sought("youngs_modulus", "hydraulic_permeability"), 3)
    result = fvswell.fit(whole, with_profiles=False)
    assert len(result.best.searches) == 3
    assert result.best.agreeing >= 2


def test_an_interrupted_fit_goes_on_and_ends_the_same(tmp_path: Path) -> None:
    whole = problem([measured(creep(), "global_strain", 0.01)], sought("youngs_modulus", "hydraulic_permeability"))
    path = tmp_path / "fit.runs"

    def interrupt(progress: FitProgress) -> None:
        if progress.stage == "profiles" and progress.runs > 30:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fvswell.fit(whole, keep=path, report=interrupt)
    size = path.stat().st_size
    with path.open("ab") as file:
        file.write(b"cut off")  # in the midst of a record
    first: list[int] = []
    result = fvswell.fit(whole, keep=path, report=lambda progress: first.append(progress.runs))
    assert first[0] == (size - 64) // (8 * (2 + len(TIMES)))  # all that had been run
    assert not path.exists()
    again = fvswell.fit(whole)
    assert result.values == again.values
    assert result.intervals == again.intervals
    assert result.runs == again.runs


def test_runs_of_another_fit_are_not_taken(tmp_path: Path) -> None:
    path = tmp_path / "fit.runs"
    path.write_bytes(b"0" * 64)
    with pytest.raises(OutputError, match="holds runs of another fit"):
        fvswell.fit(problem([measured(creep(), "global_strain")], sought("youngs_modulus")), keep=path)


def test_processes_give_the_same_to_the_bit() -> None:
    whole = problem([measured(creep(), "global_strain", 0.01)], sought("youngs_modulus", "hydraulic_permeability"))
    alone, together = fvswell.fit(whole), fvswell.fit(whole, processes=2)
    assert alone.values == together.values
    assert alone.intervals == together.intervals


def test_it_speaks_the_convention_of_pints() -> None:
    whole = problem([measured(relaxation(), "piston_pressure")], sought("youngs_modulus", "hydraulic_permeability"))
    assert whole.n_parameters() == 2
    assert whole.n_outputs() == 1
    values = whole.simulate([0.5, 1e-3], TIMES)
    assert values.shape == (len(TIMES),)
    np.testing.assert_allclose(values, whole.data, rtol=1e-12)
    two = problem(
        [measured(relaxation(), "piston_pressure", name="a"), measured(creep(), "global_strain", name="b")],
        sought("youngs_modulus"),
    )
    with pytest.raises(ValueError, match="take each by of_measurement"):
        two.simulate([0.5], TIMES)
    np.testing.assert_allclose(two.of_measurement("b").simulate([0.5], TIMES), two.data[len(TIMES) :], rtol=1e-12)


def test_febio_curve_gives_back_its_properties() -> None:
    """A creep and recovery made with FEBio 4 by backward Euler of 2 s, whose error in time is all that is left."""
    times, strain = np.loadtxt(
        CASES_OF_FEBIO / "febio-biphasic-compression.csv", delimiter=",", skiprows=1
    ).T  # fmt: skip
    late = (times % 600.0 >= 20.0) & (times % 20.0 == 0.0)
    of = _febio_case()
    curve = Measurement("febio", of, "global_strain", times[late], strain[late])
    result = fvswell.fit(problem([curve], sought("youngs_modulus", "hydraulic_permeability")), with_profiles=False)
    assert result.values["youngs_modulus"] == pytest.approx(0.5, rel=1e-3)
    assert result.values["hydraulic_permeability"] == pytest.approx(1e-3, rel=0.01)


CASES_OF_FEBIO = Path(__file__).parents[1] / "verification" / "reference"


def _febio_case() -> Case:
    phases = [{"name": "loading", "duration": 600.0, "piston": {"pressure": 0.25}},
              {"name": "unloading", "duration": 600.0, "piston": {"pressure": 0.0}}]  # fmt: skip
    return creep(model="biphasic", tissue__hindrance_factor=0.0, geometry__cells=50, geometry__grading=20).with_changes(
        {"phase": phases}
    )
