"""Study files: what their designs stand for, and everything wrong with a bad one at once."""

from __future__ import annotations

import numpy as np
import pytest
import studies

from fvswell.case.case import CaseError, load_case
from fvswell.study.study import Study, load_study


def problems(**changes) -> list[str]:
    with pytest.raises(CaseError) as caught:
        studies.study(**changes)
    return str(caught.value).splitlines()


def only_problem(**changes) -> str:
    (told,) = problems(**changes)
    return told


def combinations(**keys):
    return [{"name": "spread", "kind": "combinations", "count": 16, **keys}]


def test_the_paper_study_has_a_thousand_sets_of_each_protocol():
    study = load_study(studies.CASES / "studies" / "paper.toml")
    counts = np.bincount(study.runs.protocol)
    assert (counts >= 1000).all()
    assert [study.table.protocol[i].name for i in range(len(counts))] == ["compression", "swelling"]
    assert study.models == ("biphasic-swelling", "electrochemical")
    assert not study.impossible
    swelling = study.case(len(study.runs) - 1)
    first, back = swelling.phase
    assert back.bath_concentration == swelling.bath.concentration != first.bath_concentration


def test_the_example_study_is_valid():
    assert len(load_study(studies.CASES / "studies" / "example.toml").runs) == 41


def test_one_at_a_time_varies_one_parameter_over_its_range():
    study = studies.study(design=[{"name": "each", "kind": "one-at-a-time", "count": 4}])
    values = study.runs.values
    assert (np.isfinite(values).sum(axis=1) == 1).all()
    np.testing.assert_allclose(values[:4, 0], [0.3, 0.4, 0.5, 0.6], rtol=1e-15)
    ratios = values[5:, 1] / values[4:-1, 1]
    np.testing.assert_allclose(ratios, 4.0 ** (1.0 / 3.0), rtol=1e-14)
    assert values[4, 1] == 5e-4
    assert values[7, 1] == 2e-3


def test_what_is_not_varied_stays_as_in_the_case_and_is_known():
    study = studies.study(design=[{"name": "each", "kind": "one-at-a-time", "count": 2}])
    told = study.parameter_values()
    np.testing.assert_array_equal(told[:2, 1], 1e-3)
    np.testing.assert_array_equal(told[2:, 0], 0.5)
    assert study.case(0).tissue.hydraulic_permeability == 1e-3
    assert study.case(0).tissue.youngs_modulus == 0.3


def test_a_grid_has_every_combination_once():
    values = studies.study().runs.values
    assert {tuple(row) for row in values} == {(a, b) for a in (0.3, 0.6) for b in (5e-4, 2e-3)}
    assert len(values) == 4


@pytest.mark.parametrize("sampling", ["random", "sobol", "latin-hypercube", "halton"])
def test_combinations_cover_the_ranges_and_repeat_with_their_seed(sampling):
    keys = {"count": 64, "sampling": sampling}
    values = studies.study(design=combinations(seed=3, **keys)).runs.values
    again = studies.study(design=combinations(seed=3, **keys)).runs.values
    other = studies.study(design=combinations(seed=4, **keys)).runs.values
    np.testing.assert_array_equal(values, again)
    assert not np.array_equal(values, other)
    unit = np.column_stack([(values[:, 0] - 0.3) / 0.3, np.log(values[:, 1] / 5e-4) / np.log(4.0)])
    assert ((unit >= 0.0) & (unit <= 1.0)).all()
    occupied = {tuple(cell) for cell in np.floor(unit * 2).astype(int)}
    assert len(occupied) == 4
    if sampling == "sobol":  # a (0, 6, 2) net in base 2: every one of 8 x 8 boxes holds one of 64 points
        assert len({tuple(cell) for cell in np.floor(unit * 8).astype(int)}) == 64


def test_a_parameter_may_set_several_keys_and_be_of_one_protocol():
    swelling = studies.protocol("swelling", "free_swelling.toml")
    bath = studies.parameter(
        "bath", ["bath.concentration", "phase.unloading.bath_concentration"], "0.1 M", "0.2 M", protocols="swelling"
    )
    study = studies.study(
        protocol=[studies.protocol(), swelling], parameter=[studies.STIFFNESS, bath], design=combinations(count=4)
    )
    compression, swollen = study.runs.values[:4], study.runs.values[4:]
    assert np.isnan(compression[:, 1]).all()
    case = study.case(5)
    assert case.bath.concentration == case.phase[1].bath_concentration == swollen[1, 1]
    np.testing.assert_array_equal(study.parameter_values()[:4, 1], 1.5e-4)


def test_a_study_is_the_same_in_other_units_and_from_its_own_text():
    study = studies.study()
    same = {"low": "300 kPa", "high": 0.6}
    other = studies.study(parameter=[studies.STIFFNESS | same, studies.PERMEABILITY])
    again = Study.from_toml(study.to_toml())
    assert study.sha256 == other.sha256 == again.sha256
    np.testing.assert_array_equal(again.runs.values, study.runs.values)
    assert studies.study(title="Another").sha256 != study.sha256


def test_a_case_may_stand_in_the_study_itself():
    case = load_case(studies.CASES / "confined_compression.toml").with_changes(studies.SMALL)
    whole = studies.study(protocol=[{"name": "compression", "case": studies.case_content(case)}])
    assert whole.sha256 == studies.study().sha256


def test_paths_of_cases_begin_at_the_study_file(tmp_path):
    (tmp_path / "case.toml").write_text((studies.CASES / "free_swelling.toml").read_text())
    file = tmp_path / "study.toml"
    file.write_text(studies.text(protocol=[{"name": "swelling", "case": "case.toml"}]))
    assert load_study(file).cases[0].title.startswith("Free swelling")


def test_everything_wrong_is_told_at_once():
    told = problems(
        titel="x",
        reference_model="electrochemicl",
        protocol=[studies.protocol(), {"name": "swelling", "case": "nowhere.toml"}],
        parameter=[
            studies.parameter("a", "tissue.youngs_modulos", 0.1, 0.2),
            studies.parameter("b", "tissue.poisson_ratio", 0.3, 0.1),
            studies.parameter("c", "tissue.poisson_ratio", -0.1, 0.2, spacing="log"),
            studies.parameter("d", "tissue.cation_diffusivity", "1 mm", "2 mm^2/s"),
            studies.parameter("e e", "tissue.solid", 0, 1),
            studies.parameter("f", "tissue.fluid_fraction", 0.5, 1.5),
            studies.parameter("g", ["tissue.fluid_fraction", "bath.concentration"], 0.5, 0.6),
        ],
        design=[{"name": "s", "kind": "combinations", "count": 100}, {"name": "t", "kind": "gird"}],
    )
    expected = [
        ("titel", "did you mean title"),
        ("reference_model", "electrochemical"),
        ("protocol[swelling].case", "no such file"),
        ("parameter[a].key", "tissue.youngs_modulus"),
        ("parameter[b].high", "nothing between"),
        ("parameter[c].low", "above 0"),
        ("parameter[d].low", "diffusivity"),
        ("parameter[e e].name", "letters"),
        ("parameter[e e].key", "not a quantity"),
        ("parameter[f].high", "below 1"),
        ("parameter[g].key", "one dimension"),
        ("design[s].count", "power of two"),
        ("design[t].kind", '"grid"'),
    ]
    for parts in expected:
        assert any(all(part in line for part in parts) for line in told), (parts, told)
    assert len(told) == len(expected), told


def test_an_empty_range_is_refused():
    told = only_problem(parameter=[studies.parameter("a", "bath.concentration", 1, 1)], design=combinations())
    assert "parameter[a].high" in told
    assert "nothing between" in told


@pytest.mark.parametrize("key", ["parameter", "design", "protocol"])
def test_a_study_without_runs_is_refused(key):
    assert any(key in line and "no runs" in line for line in problems(**{key: []}))


def test_names_have_to_fit_together():
    told = problems(
        reference_model="biphasic-swelling",
        parameter=[studies.STIFFNESS, studies.STIFFNESS | {"protocols": "compresion"},
                   studies.PERMEABILITY | {"name": "r_squared"},
                   studies.parameter("load", "phase.laoding.piston.pressure", 0.1, 0.2)],
        design=combinations(parameters=["stifness"]),
    )  # fmt: skip
    expected = [
        ("reference_model", "judged"),
        ("parameter[stiffness].name", "earlier parameter"),
        ("parameter[stiffness].protocols", '"compression"'),
        ("parameter[stiffness].key", "already"),
        ("parameter[r_squared].name", "result"),
        ("parameter[load].key", "did you mean loading"),
        ("design[spread].parameters", '"stiffness"'),
    ]
    for parts in expected:
        assert any(all(part in line for part in parts) for line in told), (parts, told)
    assert len(told) == len(expected), told


def test_a_design_that_varies_nothing_is_refused():
    two = [studies.protocol(), studies.protocol("swelling", "free_swelling.toml")]
    load = studies.parameter("load", "phase.loading.piston.pressure", 0.1, 0.2, protocols="compression")
    told = only_problem(protocol=two, parameter=[load], design=combinations())
    assert "design[spread]" in told
    assert "protocol swelling" in told


def test_protocols_have_the_same_phases_and_steps():
    fine = studies.protocol("swelling", "free_swelling.toml", time__steps_per_phase=9)
    told = only_problem(protocol=[studies.protocol(), fine])
    assert "protocol[swelling].case" in told
    assert "9 steps" in told
    renamed = studies.protocol("swelling", "free_swelling.toml", phase__loading__name="swelling")
    told = only_problem(protocol=[studies.protocol(), renamed])
    assert "protocol[swelling].case" in told
    assert "loading, unloading" in told


# no swelling pressure holds the plain biphasic model's water: a high load presses all of it out
LOADS = studies.parameter("load", "phase.loading.piston.pressure", "0.1 MPa", "10 MPa")
MANY_LOADS = {
    "model": "biphasic",
    "parameter": [LOADS],
    "design": [{"name": "loads", "kind": "one-at-a-time", "count": 34}],
}


def test_impossible_parameter_sets_are_refused_and_listed():
    told = problems(**MANY_LOADS)
    assert len(told) == 12
    listed = [line for line in told if "run " in line]
    assert len(listed) == 10
    assert all("load = " in line and "no equilibrium with water" in line for line in listed)
    assert 'impossible = "skip"' in told[-1]
    assert any("more of 34 parameter sets" in line for line in told)


def test_impossible_parameter_sets_can_be_left_out():
    study = studies.study(**MANY_LOADS, impossible="skip")
    possible = [run for run in range(34) if run not in study.impossible]
    assert 0 < len(possible) < 34
    loads = study.runs.values[:, 0]
    assert loads[possible].max() < loads[list(study.impossible)].min()


def test_a_study_of_nothing_but_impossible_sets_is_refused():
    hard = [LOADS | {"low": "20 MPa", "high": "30 MPa"}]
    told = problems(**MANY_LOADS | {"parameter": hard}, impossible="skip")
    assert any("no equilibrium with water" in line for line in told)


def test_unreadable_files_are_reported(tmp_path):
    with pytest.raises(CaseError, match="no such file"):
        load_study(tmp_path / "nothing.toml")
    with pytest.raises(CaseError, match="cannot be read as TOML"):
        Study.from_toml("a = ")
    (tmp_path / "bad.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(CaseError, match="UTF-8"):
        load_study(tmp_path / "bad.toml")


def test_changes_of_a_protocol_are_checked():
    wrong = studies.protocol(tissue__youngs_modulos=1)
    told = only_problem(protocol=[wrong])
    assert "protocol[compression].case" in told
    assert "youngs_modulus" in told


def test_the_case_of_a_run_is_the_changed_case():
    """Made by way of numbers alone, which is faster; ramps and durations as well."""
    protocol = studies.protocol(
        phase__loading__piston__pressure={"ramp_to": 0.1, "over": 50.0}, phase__loading__duration=300.0
    )
    swelling = studies.protocol("swelling", "free_swelling.toml")
    both = ["bath.concentration", "phase.unloading.bath_concentration"]
    parameters = [
        studies.STIFFNESS, studies.HEIGHT, studies.parameter("bath", both, "0.1 M", "0.2 M"),
        studies.parameter("ramp", "phase.loading.piston.pressure.over", "10 s", "100 s", protocols="compression"),
        studies.parameter("load", "phase.loading.piston.pressure.ramp_to", 0.1, 0.2, protocols="compression"),
        studies.parameter("salt", "phase.loading.bath_concentration", "0.1 M", "0.2 M", protocols="swelling"),
    ]  # fmt: skip
    study = studies.study(protocol=[protocol, swelling], parameter=parameters, design=combinations(count=4))
    for run in range(len(study.runs)):
        base = study.cases[study.runs.protocol[run]]
        case = study.case(run)
        slow = base.with_changes(study.changes(run))
        assert case == slow
        assert (case.sha256, case.to_toml(), case.source) == (slow.sha256, slow.to_toml(), slow.source)
        assert case.sha256 != base.sha256


def test_numbers_that_cannot_be_together_are_refused_alike():
    case = load_case(studies.CASES / "confined_compression.toml").with_changes({"model": "biphasic"})
    impossible = {"tissue.youngs_modulus": 0.1, "phase.loading.piston.pressure": 50.0}
    with pytest.raises(CaseError) as slow:
        case.with_changes(impossible)
    with pytest.raises(CaseError) as fast:
        case.with_numbers(impossible)
    assert str(fast.value) == str(slow.value)
    assert case.with_numbers(impossible, checked=True).tissue.youngs_modulus == 0.1
