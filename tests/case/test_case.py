"""Case files: what they mean, and what is said about wrong ones."""

import pickle
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import fvswell
from fvswell.case.case import MODELS, Case, CaseError, load_case, parse_setting, starter_text
from fvswell.case.loads import Ramp, final_value
from fvswell.case.profiles import DepthProfile
from fvswell.case.reading import Heading, tables_below, value_type
from fvswell.case.reference import case_reference
from fvswell.case.schema import CaseTable
from fvswell.case.tables import inner_tables
from fvswell.case.values import RelaxationTimes
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import MODELS as MODEL
from fvswell.physics.osmotic import coefficients
from fvswell.physics.permeability import PERMEABILITIES
from fvswell.physics.solids import SOLIDS
from fvswell.physics.tissue import Tissue

ROOT = Path(fvswell.__file__).parents[1]
COMPRESSION = (ROOT / "cases" / "confined_compression.toml").read_text()


@pytest.fixture(scope="module")
def case() -> Case:
    return load_case(ROOT / "cases" / "confined_compression.toml")


@pytest.fixture(scope="module")
def timed(case: Case) -> Case:
    """The same with durations in seconds."""
    return case.with_changes({"phase.loading.duration": 600, "phase.unloading.duration": "10 min"})


def problems_of(case: Case, changes: dict) -> dict[str, str]:
    """Messages by key for changes that are refused."""
    with pytest.raises(CaseError) as caught:
        case.with_changes(changes)
    return {problem.key: problem.message for problem in caught.value.problems}


def of_blocks(heading: Heading) -> bool:
    """Whether a table is one that only cases of blocks have."""
    kinds = ("of a block", 'with kind = "plane-strain"', 'with kind = "axisymmetric"')
    return ".NAME" in heading.key or heading.variant in kinds


def edited(*replacements: tuple[str, str]) -> str:
    text = COMPRESSION
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    return text


# What a case holds


def test_reference_compression(case):
    assert case.model == "electrochemical"
    assert (case.geometry.height, case.geometry.cells, case.geometry.grading) == (0.5, 50, 20.0)
    tissue = case.tissue
    assert (tissue.youngs_modulus, tissue.poisson_ratio, tissue.fluid_fraction) == (0.5, 0.3, 0.8)
    assert (tissue.hydraulic_permeability, tissue.fixed_charge_density) == (1e-3, 2e-4)
    assert (tissue.cation_diffusivity, tissue.anion_diffusivity, tissue.hindrance_factor) == (5e-4, 8e-4, 0.4)
    assert (case.bath.concentration, case.bath.osmotic_coefficient, case.bath.temperature) == (
        1.5e-4,
        0.93,
        298.0,
    )
    assert [phase.piston.pressure for phase in case.phase] == [0.25, 0.0]
    assert [phase.duration for phase in case.phase] == [RelaxationTimes(1.5)] * 2
    assert (case.time.scheme, case.time.tolerance, case.time.relaxation_fraction) == ("esdirk43", 1e-4, 0.99)
    assert (case.output.per_phase, case.output.every, case.output.times) == (50, None, None)


def test_reference_cases_differ_in_the_protocol_only(case):
    swelling = load_case(ROOT / "cases" / "free_swelling.toml")
    assert [phase.bath_concentration for phase in swelling.phase] == [1e-4, 1.5e-4]
    assert [phase.piston.pressure for phase in swelling.phase] == [0.0, 0.0]
    for table in ("geometry", "tissue", "bath", "time", "output", "model"):
        assert getattr(swelling, table) == getattr(case, table)


def test_reference_tissue_has_the_published_equilibria(case):
    tissue = case.tissue_at(np.zeros(1))
    free = equilibrium_volume_ratio(tissue, 0.0, case.bath.concentration)
    assert free == pytest.approx(1.054503, abs=1e-6)


def test_defaults():
    lines = [line for line in COMPRESSION.splitlines() if not line.startswith(("cells", "grading", "hindrance"))]
    text = "\n".join(lines[: lines.index("[time]")])
    case = Case.from_toml(text)
    assert (case.geometry.cells, case.geometry.grading) == (50, 1.0)
    assert (case.tissue.permeability_exponent, case.tissue.activity_ratio, case.tissue.hindrance_factor) == (
        0,
        1,
        0,
    )
    assert (case.assembly, case.open_circuit_permeability) == ("compiled", "initial")
    assert (case.time.scheme, case.time.tolerance, case.time.max_step) == ("esdirk43", 1e-4, None)
    assert case.time.relaxation_fraction == 0.99
    assert (case.output.per_phase, case.output.every) == (50, None)
    assert Case.from_toml(text + "\n[time]\nmax_step = 9").time.max_step == 9
    equal = Case.from_toml(text + "\n[time]\nscheme = 'backward-euler'\n[output]")
    assert (equal.time.steps_per_phase, equal.output.every, equal.output.per_phase) == (50, 1, None)


def test_starter_is_a_valid_case_and_shows_every_key_of_columns():
    """But for the parameters of laws that it does not use."""
    case = Case.from_toml(starter_text())
    assert case.model in MODELS
    laws = (SOLIDS, case.tissue.solid), (PERMEABILITIES, case.tissue.permeability)
    assert case.tissue.osmotic == "activity"
    other = {
        key
        for registry, own in laws
        for law in registry.values()
        for key in set(law._fields) - set(registry[own]._fields)
    }
    for heading, table in tables_below(CaseTable):
        for key in table.model_fields.keys() - other if not of_blocks(heading) else ():
            assert key in starter_text()


def test_optional_lines_of_the_starter_are_valid():
    """Uncommenting a line of the starter, in the place of its alternative, gives a valid case."""
    text = starter_text().replace("# hindrance", "hindrance")
    for line in (
        'permeability = "exponential"',
        "permeability_exponent",
        "reference_state",
        "bath_concentration",
        "relaxation_fraction",
        "assembly",
    ):
        text = text.replace(f"# {line}", line)
    text = text.replace("# open_circuit", "open_circuit").replace("# stiffening", "stiffening")
    text = text.replace('solid = "neo-hookean"', 'solid = "holmes-mow"')
    case = Case.from_toml(text.replace("# max_step", "max_step"))
    assert (case.tissue.stiffening_coefficient, case.time.max_step) == (0.35, 10.0)
    equal = text.replace('scheme = "esdirk43"', 'scheme = "backward-euler"').replace("tolerance = 1e-4", "")
    assert Case.from_toml(equal.replace("# steps_per_phase", "steps_per_phase")).time.steps_per_phase == 50
    constant = starter_text().replace('osmotic = "activity"', 'osmotic = "constant"')
    for line in ("osmotic_coefficient = ", "activity_ratio"):
        constant = constant.replace(f"# {line}", line)
    assert Case.from_toml(constant).tissue.osmotic_coefficient == 0.83
    reinforced = starter_text()
    for line in ("[[tissue.fibres]]", "directions", "law", "modulus", "exponent", "power"):
        reinforced = reinforced.replace(f"# {line}", line)
    assert Case.from_toml(reinforced).tissue.fibres[0].modulus == 1.0


def test_same_case_in_other_units_is_the_same_case(case):
    other = edited(
        ('"0.5 mm"', '"5e-4 m"'),
        ('"0.5 MPa"', '"500 kPa"'),
        ('"1e-3 mm^4/(N s)"', '"1e-15 m^4/(N s)"'),
        ('"0.2 mEq/ml"', '"200 mol/m^3"'),
        ('"5e-4 mm^2/s"', '"5e-10 m^2/s"'),
        ('"8e-4 mm^2/s"', '"480e-10 m^2/min"'),
        ('"0.15 M"', '"150 mM"'),
        ('"298 K"', '"24.85 degC"'),
        ('"0.25 MPa"', '"2.5 bar"'),
        ("piston.pressure = 0\n", 'piston.pressure = "0 Pa"\n'),
    )
    assert Case.from_toml(other) == case
    assert Case.from_toml(other).sha256 == case.sha256


# Writing and reading back


VARIANTS = {
    "as it is": {},
    "durations and times": {
        "phase.0.duration": "10 min",
        "phase.1.duration": 0.1,
        "output.times": [0, "1 s", 300.3],
    },
    "ramps": {"phase.loading.piston.displacement": {"ramp_to": "-0.05 mm", "over": "50 s"}},
    "tight": {"time.max_step": "5 s", "time.tolerance": 1e-5},
    "equal steps": {"time.scheme": "backward-euler", "time.steps_per_phase": 7},
    "Holmes-Mow": {"tissue.solid": "holmes-mow", "tissue.stiffening_coefficient": 0.35},
    "eq 14": {"tissue.osmotic_coefficient_per_charge": "500 mm^3/meq"},
    "activity": {"tissue.osmotic": "activity", "tissue.permeability": "constant"},
    "fibres": {
        "tissue.fibres": [
            {"directions": "isotropic", "modulus": {"depth": [0, "0.5 mm"], "value": ["1 MPa", 0]}},
            {"directions": "planar", "law": "logarithmic", "modulus": 2, "exponent": 8, "normal": "x"},
        ],
        "tissue.reference_state": "equilibrated",
    },
    "profiles": {
        "tissue.youngs_modulus": {"depth": ["0 mm", "0.3 mm"], "value": ["1 MPa", 0.3]},
        "tissue.poisson_ratio": {"depth": [0.1], "value": [0.2]},
    },
    "text": {"title": 'A "quoted" title\nof two lines: µ', "model": "biphasic", "assembly": "stock-terms"},
}


@pytest.mark.parametrize("changes", VARIANTS.values(), ids=VARIANTS)
def test_resolved_case_reads_back_as_itself(case, changes):
    changed = case.with_changes(changes)
    again = Case.from_toml(changed.to_toml(), source="elsewhere")
    assert again == changed
    assert hash(again) == hash(changed)
    assert again.to_toml() == changed.to_toml()
    assert again.sha256 == changed.sha256
    assert (changed == case) == (not changes)
    assert (changed.sha256 == case.sha256) == (not changes)
    assert pickle.loads(pickle.dumps(changed)) == changed


def test_resolved_case_holds_plain_numbers_and_every_default(case):
    content = tomllib.loads(case.to_toml())
    assert content["geometry"]["height"] == 0.5
    assert content["tissue"]["activity_ratio"] == 1.0
    assert content["phase"][0]["duration"] == "1.5 relaxation times"
    for heading, table in tables_below(CaseTable):
        if heading.several or heading.variant or heading.key.startswith("phase.") or of_blocks(heading):
            continue
        written = content
        for key in heading.key.split(".") if heading.key else ():
            written = written[key]
        assert {key for key, field in table.model_fields.items() if field.default is not None} <= written.keys() | {
            "osmotic_coefficient",
            "fibres",
        }


@settings(deadline=None)  # timing is not what is tested, and the machine may be busy
@given(
    youngs_modulus=st.floats(0.05, 50.0),
    poisson_ratio=st.floats(-0.99, 0.49),
    permeability=st.floats(1e-8, 1.0),
    fixed_charge_density=st.floats(1e-6, 1e-3),
    multiple=st.floats(1e-3, 1e3),
)
def test_any_number_survives_writing(case, youngs_modulus, poisson_ratio, permeability, fixed_charge_density, multiple):
    changed = case.with_changes(
        {
            "tissue.youngs_modulus": youngs_modulus,
            "tissue.poisson_ratio": poisson_ratio,
            "tissue.hydraulic_permeability": permeability,
            "tissue.fixed_charge_density": fixed_charge_density,
            "phase.0.duration": f"{multiple!r} relaxation times",
        }
    )
    assert Case.from_toml(changed.to_toml()) == changed
    assert changed.phase[0].duration == RelaxationTimes(multiple)


# Tissue at points


def test_homogeneous_tissue_has_single_values(case):
    tissue = case.tissue_at(np.linspace(0.0, 0.5, 7))
    assert isinstance(tissue, Tissue)
    numbers = [*tissue.solid, *tissue.permeability, *tissue.osmotic, *tissue[3:]]
    assert {np.shape(number) for number in numbers} == {()}
    assert tissue.thermal_energy == pytest.approx(2477.7098602)


def test_profile_is_linear_between_knots_and_constant_outside(case):
    profile = {"depth": ["0.1 mm", 0.3], "value": ["0.2 meq/ml", "0.1 meq/ml"]}
    changed = case.with_changes({"tissue.fixed_charge_density": profile})
    depth = np.array([0.0, 0.1, 0.2, 0.25, 0.3, 0.5])
    tissue = changed.tissue_at(depth)
    assert tissue.fixed_charge_density == pytest.approx([2e-4, 2e-4, 1.5e-4, 1.25e-4, 1e-4, 1e-4])
    assert np.shape(tissue.solid.youngs_modulus) == ()
    assert changed.tissue.fixed_charge_density == DepthProfile((0.1, 0.3), (2e-4, 1e-4))


def test_osmotic_coefficient_per_charge_follows_the_charge(case):
    changed = case.with_changes(
        {
            "tissue.osmotic_coefficient_per_charge": "500 mm^3/meq",
            "tissue.fixed_charge_density": {"depth": [0.0, 0.5], "value": [2e-4, 0.0]},
        }
    )
    tissue = changed.tissue_at(np.array([0.0, 0.25, 0.5]))
    assert coefficients(tissue.osmotic)[0] == pytest.approx([0.83, 0.88, 0.93])
    homogeneous = changed.with_changes({"tissue.fixed_charge_density": 2e-4})
    assert coefficients(homogeneous.tissue_at(np.zeros(3)).osmotic)[0] == pytest.approx(0.83)


# Changes


def test_changes_by_dotted_key(case):
    changed = case.with_changes(
        {
            "tissue.hindrance_factor": 0.0,
            "phase.loading.piston.pressure": "100 kPa",
            "phase.1.duration": 600,
            "model": "biphasic",
            "geometry.cells": np.int64(20),
            "tissue.youngs_modulus": np.float64(0.4),
            "time": {"scheme": "backward-euler"},
        }
    )
    assert changed.tissue.hindrance_factor == 0.0
    assert changed.phase[0].piston.pressure == 0.1
    assert changed.phase[1].duration == 600.0
    assert (changed.model, changed.geometry.cells, changed.tissue.youngs_modulus) == ("biphasic", 20, 0.4)
    assert changed.time.scheme == "backward-euler"
    assert changed.phase[1].piston.pressure == case.phase[1].piston.pressure


def test_changes_leave_the_original_alone(case):
    before = case.to_toml()
    case.with_changes(
        {"phase.loading.piston.pressure": 0.1, "tissue.poisson_ratio": 0.1, "time.scheme": "backward-euler"}
    )
    assert case.to_toml() == before
    assert case.sha256 == Case.from_toml(before).sha256


def test_key_that_excludes_another_takes_its_place(case):
    changed = case.with_changes({"tissue.osmotic_coefficient_per_charge": 500.0, "output.times": [0.0, 1.0]})
    assert (changed.tissue.osmotic_coefficient, changed.output.per_phase) == (None, None)
    back = changed.with_changes({"tissue.osmotic_coefficient": 0.83, "output.per_phase": 50})
    assert back == case
    assert "phase[loading].piston.displacement" in problems_of(
        case, {"phase.loading.piston.displacement": 0, "phase.loading.piston.pressure": 0.1}
    )


def test_none_takes_a_key_away(case):
    law = case.with_changes({"tissue.solid": "holmes-mow", "tissue.stiffening_coefficient": 0.3})
    assert law.with_changes({"tissue.solid": "neo-hookean", "tissue.stiffening_coefficient": None}) == case
    assert problems_of(case, {"bath": None}) == {"bath": "missing; must be given: a table"}
    assert case.with_changes({"phase.loading.piston.pressure": None}).phase[0].loads() == {}


def test_other_scheme_leaves_the_keys_of_the_first_behind(case):
    equal = case.with_changes({"time.steps_per_phase": 20, "time.scheme": "backward-euler"})
    assert equal.time.steps_per_phase == 20
    assert equal.with_changes({"time.scheme": "esdirk43"}) == case
    assert "time.tolerance" in problems_of(case, {"time.scheme": "backward-euler", "time.tolerance": 1e-3})


def test_other_scheme_writes_as_it_does_by_default_unless_the_case_says_when(case):
    equal = case.with_changes({"time.scheme": "backward-euler"})
    assert (equal.output.every, equal.output.per_phase) == (1, None)
    given = case.with_changes({"output.per_phase": 20}).with_changes({"time.scheme": "backward-euler"})
    assert given.output.per_phase == 20
    assert case.with_changes({"output.per_phase": None}) == case


def test_parts_of_inline_tables_can_be_changed(case):
    ramped = case.with_changes({"phase.loading.piston.pressure": {"ramp_to": 0.2, "over": 10}})
    assert ramped.with_changes({"phase.loading.piston.pressure.over": "1 min"}).phase[0].piston.pressure == (
        0.2,
        60.0,
    )
    graded = case.with_changes({"tissue.youngs_modulus": {"depth": [0, 0.5], "value": [1, 2]}})
    changed = graded.with_changes({"tissue.youngs_modulus.value": np.array([3.0, 4.0])})
    assert changed.tissue.youngs_modulus == DepthProfile((0.0, 0.5), (3.0, 4.0))


def test_whole_phase_can_be_replaced(case):
    phase = {"name": "rest", "duration": 5, "piston": {"pressure": 0}}
    assert case.with_changes({"phase.loading": phase}).phase[0].name == "rest"
    assert len(case.with_changes({"phase": [phase]}).phase) == 1


def test_changes_that_lead_nowhere(case):
    messages = problems_of(case, {"phase.laoding.duration": 3, "title.x": 3, "phase.2.duration": 1})
    assert "did you mean loading?" in messages["phase.laoding.duration"]
    assert "holds a single value" in messages["title.x"]
    assert "there are loading, unloading" in messages["phase.2.duration"]
    assert "did you mean tissue?" in problems_of(case, {"tisue.poisson_ratio": 0.3})["tisue"]
    assert "hindrance_factor?" in problems_of(case, {"tissue.hindrence": 0.3})["tissue.hindrence"]


def test_changed_case_keeps_its_source(case):
    assert case.with_changes({"model": "biphasic"}).source == str(ROOT / "cases" / "confined_compression.toml")


def test_changes_with_numbers_do_not_ask_the_slow_library_of_units(case, monkeypatch):
    """A study makes thousands of cases."""
    monkeypatch.setattr("fvswell.units._registry", lambda: pytest.fail("units were looked up"))
    changed = case.with_changes(
        {"tissue.hindrance_factor": 0.1, "phase.loading.piston.pressure": 0.1, "bath.concentration": 1e-4}
    )
    assert changed.phase[0].piston.pressure == 0.1


@pytest.mark.parametrize(
    ("setting", "expected"),
    [
        ("tissue.hindrance_factor=0", ("tissue.hindrance_factor", 0)),
        ("tissue.poisson_ratio = 0.25", ("tissue.poisson_ratio", 0.25)),
        ("phase.loading.piston.pressure=0.1 MPa", ("phase.loading.piston.pressure", "0.1 MPa")),
        ('phase.0.duration="2 h"', ("phase.0.duration", "2 h")),
        ("model=biphasic", ("model", "biphasic")),
        ("title=a=b", ("title", "a=b")),
        ("output.times=[1, 2]", ("output.times", [1, 2])),
        ("a={ramp_to=1, over='2 s'}", ("a", {"ramp_to": 1, "over": "2 s"})),
        ("title=1\nmodel=2", ("title", "1\nmodel=2")),
        ("title=", ("title", "")),
    ],
)
def test_setting(setting, expected):
    assert parse_setting(setting) == expected


@pytest.mark.parametrize("setting", ["", "model", "=3", " = 3"])
def test_setting_without_key_or_value(setting):
    with pytest.raises(CaseError, match="key=value"):
        parse_setting(setting)


# Loads


def test_final_value():
    assert final_value(0.25) == 0.25
    assert final_value(Ramp(ramp_to=0.25, over=10.0)) == 0.25


def test_bath_may_ramp(case):
    changed = case.with_changes({"phase.0.bath_concentration": {"ramp_to": "0.05 M", "over": "1 min"}})
    assert changed.phase[0].bath_concentration == Ramp(5e-5, 60.0)


def test_plain_displacement_can_only_hold_the_piston(timed):
    ramp = {"ramp_to": "-0.05 mm", "over": "50 s"}
    held = timed.with_changes(
        {"phase.loading.piston.displacement": ramp, "phase.unloading.piston.displacement": "-50 um"}
    )
    assert held.phase[1].piston.displacement == -0.05
    assert timed.with_changes({"phase.loading.piston.displacement": 0}).phase[0].piston.displacement == 0.0
    jump = problems_of(timed, {"phase.loading.piston.displacement": ramp, "phase.unloading.piston.displacement": 0})
    assert "at -0.05 mm" in jump["phase[unloading].piston.displacement"]
    assert "{ramp_to = 0, over = ...}" in jump["phase[unloading].piston.displacement"]
    unknown = problems_of(timed, {"phase.unloading.piston.displacement": 0})
    assert "where the pressure left it" in unknown["phase[unloading].piston.displacement"]


# What is wrong, and what is said about it


WRONG = [
    ("tissue.youngs_modulus", "-0.5 MPa", "must be above 0 MPa"),
    ("tissue.youngs_modulus", 0, "must be above 0 MPa"),
    ("tissue.youngs_modulus", "0.5 mm", "is of dimension length: must be of dimension pressure"),
    ("tissue.youngs_modulus", "0.5", "has no unit"),
    ("tissue.youngs_modulus", "0.5 Mpaa", 'no unit known as "Mpaa"'),
    ("tissue.youngs_modulus", True, "must be of dimension pressure"),
    ("tissue.youngs_modulus", float("inf"), "must be a finite number"),
    ("tissue.youngs_modulus", float("nan"), "must be a finite number"),
    ("tissue.poisson_ratio", 0.5, "must be above -1 and below 0.5"),
    ("tissue.poisson_ratio", -1, "must be above -1 and below 0.5"),
    ("tissue.poisson_ratio", "0.3 mm", "without a unit"),
    ("tissue.hydraulic_permeability", 0, "must be above 0"),
    ("tissue.fluid_fraction", 0, "must be above 0 and below 1"),
    ("tissue.fluid_fraction", 1, "must be above 0 and below 1"),
    ("tissue.fixed_charge_density", "-0.1 M", "must be at least 0 mmol/mm^3"),
    ("tissue.osmotic_coefficient", 0, "must be above 0"),
    ("tissue.activity_ratio", 0, "must be above 0"),
    ("tissue.cation_diffusivity", -1, "must be above 0"),
    ("tissue.anion_diffusivity", 0, "must be above 0"),
    ("tissue.hindrance_factor", 1.01, "must be at least 0 and at most 1"),
    ("tissue.hindrance_factor", -0.01, "must be at least 0 and at most 1"),
    ("tissue.solid", "neohookean", 'did you mean "neo-hookean"?'),
    ("bath.concentration", 0, "must be above 0"),
    ("bath.concentration", {"depth": [0], "value": [1e-4]}, "cannot vary"),
    ("bath.temperature", "-300 degC", "must be above 0 K"),
    ("bath.osmotic_coefficient", 0, "must be above 0"),
    ("geometry.height", "0 mm", "must be above 0 mm"),
    ("geometry.cells", 1, "must be a whole number from 2 to 10000"),
    ("geometry.cells", 10.5, "must be a whole number"),
    ("geometry.cells", "10", "must be a whole number"),
    ("geometry.cells", True, "must be a whole number"),
    ("geometry.grading", 0.5, "must be at least 1"),
    ("geometry.kind", "colum", 'must be one of "column", "plane-strain", "axisymmetric"; did you mean "column"?'),
    ("model", "biphasic-sweling", 'did you mean "biphasic-swelling"?'),
    ("model", 3, "must be one of"),
    ("assembly", "stock", 'did you mean "stock-terms"?'),
    ("open_circuit_permeability", "held", 'must be one of "initial", "state", "none"'),
    ("title", "  ", "must be a text"),
    ("title", 3, "must be a text"),
    ("time.scheme", "esdirk", 'did you mean "esdirk43"?'),
    ("time.tolerance", 0, "above 0"),
    ("time.relaxation_fraction", 1, "must be above 0 and below 1"),
    ("output.every", 0, "at least 1"),
    ("output.times", [], "must be a list and not empty"),
    ("output.times", 3, "must be a list"),
    ("output.times", [0, "-1 s"], '[1] = "-1 s": must be at least 0 s'),
    ("output.times", [0, 5, 5], "must increase"),
    ("tissue", 3, "must be a table with the heading [tissue]"),
    ("phase", {"name": "a"}, "must be a table with the heading [[phase]]"),
    ("phase", [], "at least one [[phase]]"),
]


@pytest.mark.parametrize(("key", "value", "words"), WRONG, ids=[f"{key}={value}" for key, value, _ in WRONG])
def test_wrong_value_is_reported_with_what_is_allowed(case, key, value, words):
    messages = problems_of(case, {key: value})
    assert list(messages) == [key]
    assert words in messages[key]


WRONG_IN_PHASE = [
    ("name", "un.loading", "a name of letters"),
    ("name", "2", "a name of letters"),
    ("name", "loading", "must not be the name of an earlier phase"),
    ("duration", 0, "must be above 0 s"),
    ("duration", "-1 relaxation times", "must be above 0"),
    ("duration", "1.5 relaxations", "no unit known"),
    ("duration", "1.5 mm", "is of dimension length: must be of dimension time"),
    ("piston.pressure", "1 N", "is of dimension force"),
    ("piston.pressure", [1], "must be of dimension pressure"),
    ("piston.pressure", {"ramp_to": "1 kPa"}, "over: missing"),
    ("piston.pressure", {"ramp_to": "1 kPa", "over": 0}, "over: must be above 0 s"),
    ("piston.pressure", {"ramp_to": "1 kPa", "ovr": 1}, "ovr: unknown key; did you mean over?"),
    ("bath_concentration", 0, "must be above 0"),
    ("bath_concentration", {"ramp_to": 0, "over": 1}, "ramp_to: must be above 0"),
]


@pytest.mark.parametrize(("key", "value", "words"), WRONG_IN_PHASE)
def test_wrong_value_in_a_phase_is_reported_by_its_name(case, key, value, words):
    name = value if key == "name" else "unloading"
    messages = problems_of(case, {f"phase.unloading.{key}": value})
    assert words in messages[f"phase[{name}].{key}"]


def test_ramp_longer_than_its_phase(case, timed):
    ramp = {"phase.loading.piston.pressure": {"ramp_to": 0.1, "over": "11 min"}}
    assert "660 s is longer than the phase, 600 s" in problems_of(timed, ramp)["phase[loading].piston.pressure"]
    assert case.with_changes(ramp).phase[0].piston.pressure == Ramp(0.1, 660.0)
    whole = timed.with_changes({"phase.loading.piston.pressure": {"ramp_to": 0.1, "over": "10 min"}})
    assert whole.phase[0].piston.pressure == Ramp(0.1, 600.0)


@pytest.mark.parametrize(
    ("profile", "words"),
    [
        ({"depth": [0, 0.2, 0.1], "value": [1, 1, 1]}, "depth: must increase"),
        ({"depth": [0, 0.2], "value": [1, 1, 1]}, "has 2 depths and 3 values"),
        ({"depth": [0, 0.2]}, "value: missing"),
        ({"depth": [0, 0.2], "values": [1, 1]}, "values: unknown key; did you mean value?"),
        ({"depth": [0, 0.2], "value": [1, 1], "z": [1, 1]}, "z: unknown key"),
        ({"depth": ["0 s"], "value": [1]}, 'depth: [0] = "0 s": is of dimension time'),
        ({"depth": [-0.1], "value": [1]}, "at least 0 mm"),
        ({"depth": [0, 0.2], "value": ["1 MPa", "-2 MPa"]}, 'value: [1] = "-2 MPa": must be above 0 MPa'),
        ({"depth": 0, "value": [1]}, "depth: must be a list"),
        ({"depth": [], "value": []}, "depth: must be a list and not empty"),
    ],
)
def test_wrong_profile(case, profile, words):
    assert words in problems_of(case, {"tissue.youngs_modulus": profile})["tissue.youngs_modulus"]


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        (
            "youngs_modulus",
            "young_modulus",
            "tissue.young_modulus",
            "unknown key; did you mean youngs_modulus?",
        ),
        ("[bath]", "[baht]", "baht", "unknown key; did you mean bath?"),
        (
            "[bath]",
            "hight = 3\n[bath]",
            "tissue.hight",
            "did you mean height, which belongs under [geometry]?",
        ),
        ("[bath]", "cells = 3\n[bath]", "tissue.cells", "unknown key; belongs under [geometry]"),
        ("[bath]", "model = 3\n[bath]", "tissue.model", "unknown key; belongs under the title"),
        ("[bath]", "qqq = 3\n[bath]", "tissue.qqq", "unknown key; allowed here are solid, youngs_modulus"),
        (
            "[output]",
            "steps_per_phase = 3\n[output]",
            "time.steps_per_phase",
            'under [time] with scheme = "backward-euler"',
        ),
        ("tolerance", "tolerence", "time.tolerence", "did you mean tolerance?"),
        ("height =", "# height =", "geometry.height", "missing; must be given: above 0 (mm)"),
        ('kind = "column"', "", "geometry.kind", 'must be one of "column", "plane-strain", "axisymmetric"'),
        (
            "poisson_ratio",
            "# poisson_ratio",
            "tissue.poisson_ratio",
            'missing; solid = "neo-hookean" needs it',
        ),
        ('model = "', '# "', "model", 'missing; must be given: "biphasic"'),
        ('solid = "neo-hookean"', 'solid = "holmes-mow"', "tissue.stiffening_coefficient", "needs it"),
        ("[bath]", "stiffening_coefficient = 0.3\n[bath]", "tissue.stiffening_coefficient", "holmes-mow"),
        (
            "osmotic_coefficient = 0.83",
            'osmotic = "constant"',
            "tissue.osmotic_coefficient",
            'missing; osmotic = "constant" needs it',
        ),
        (
            "osmotic_coefficient = 0.83",
            "osmotic_coefficient = 0.83\nosmotic_coefficient_per_charge = 500",
            "tissue.osmotic_coefficient_per_charge",
            "cannot stand beside osmotic_coefficient",
        ),
        ("per_phase = 50", "per_phase = 50\ntimes = [1]", "output.times", "cannot stand beside per_phase"),
        (
            'piston.pressure = "0.25 MPa"',
            'piston.pressure = "0.25 MPa"\npiston.displacement = 0',
            "phase[loading].piston.displacement",
            "cannot stand beside pressure: give one of pressure, force, displacement",
        ),
        (
            'piston.pressure = "0.25 MPa"',
            'piston_pressure = "0.25 MPa"',
            "phase[loading].piston_pressure",
            "unknown key; is now piston.pressure",
        ),
    ],
)
def test_wrong_key_is_reported(old, new, key, words):
    with pytest.raises(CaseError) as caught:
        Case.from_toml(edited((old, new)), source="wrong.toml")
    messages = {problem.key: problem.message for problem in caught.value.problems}
    assert words in messages[key]


def test_no_phases():
    text = COMPRESSION[: COMPRESSION.index("[[phase]]")]
    with pytest.raises(CaseError, match="phase: missing"):
        Case.from_toml(text)


def test_all_problems_are_reported_at_once_with_file_key_and_value():
    text = edited(
        ('height = "0.5 mm"', 'heigth = "0.5 mm"'),
        ('"0.5 MPa"', '"-0.5 MPa"'),
        ("fluid_fraction = 0.8", "fluid_fraction = 1.2"),
        ('"0.2 mEq/ml"', '"0.2 mm"'),
        ('piston.pressure = "0.25 MPa"', 'piston.pressure = "0.25 MPa"\npiston.displacement = 0'),
        ("tolerance = 1e-4", "tolerance = 0"),
    )
    with pytest.raises(CaseError) as caught:
        Case.from_toml(text, source="wrong.toml")
    lines = str(caught.value).splitlines()
    assert caught.value.file == "wrong.toml"
    assert len(lines) == len(caught.value.problems) == 7
    assert all(line.startswith("wrong.toml: ") for line in lines)
    for start in (
        "geometry.height: missing",
        'geometry.heigth = "0.5 mm": unknown key; did you mean height?',
        'tissue.youngs_modulus = "-0.5 MPa": must be above 0 MPa',
        "tissue.fluid_fraction = 1.2: must be above 0 and below 1",
        'tissue.fixed_charge_density = "0.2 mm": is of dimension length: must be of dimension concentration',
        "time.tolerance = 0: must be above 0 and below 1",
        "phase[loading].piston.displacement = 0: cannot stand beside pressure",
    ):
        assert sum(line.startswith(f"wrong.toml: {start}") for line in lines) == 1


def test_all_problems_between_values_are_reported_at_once(timed):
    messages = problems_of(
        timed,
        {
            "model": "biphasic",
            "phase.loading.piston.pressure": 9,
            "phase.unloading.piston.displacement": 0,
            "phase.unloading.name": "loading",
            "output.times": [1, 1300],
        },
    )
    assert list(messages) == [
        "phase[loading].name",
        "output.times",
        "phase[loading].piston.displacement",
        "phase[loading].piston.pressure",
    ]


def test_case_error_can_cross_processes(case):
    with pytest.raises(CaseError) as caught:
        case.with_changes({"tissue.youngs_modulus": -1})
    again = pickle.loads(pickle.dumps(caught.value))
    assert str(again) == str(caught.value)


JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-3, 3),
    st.floats(),
    st.text(max_size=6),
    st.sampled_from(["1 mm", "1 MPa", "1 s", "backward-euler", "plane-strain", "loading"]),
    st.lists(st.one_of(st.integers(-1, 1), st.text(max_size=2)), max_size=2),
    st.dictionaries(st.sampled_from(["depth", "value", "ramp_to", "over", "kind", "scheme", "name"]), st.integers()),
)
KEYS = [
    *(
        "title",
        "model",
        "assembly",
        "geometry",
        "tissue",
        "bath",
        "phase",
        "time",
        "output",
        "phase.0",
        "nonsense",
    ),
    *("geometry.kind", "geometry.height", "geometry.cells", "tissue.solid", "tissue.youngs_modulus"),
    *("tissue.fluid_fraction", "tissue.osmotic_coefficient_per_charge", "bath.concentration", "phase.0.name"),
    *(
        "phase.0.duration",
        "phase.0.piston.pressure",
        "phase.1.piston.displacement",
        "phase.1.bath_concentration",
    ),
    *(
        "time.scheme",
        "time.tolerance",
        "output.every",
        "output.times",
        "phase.0.nonsense",
        "bath.nonsense.deep",
    ),
]


@settings(deadline=None)  # timing is not what is tested, and the machine may be busy
@given(changes=st.dictionaries(st.sampled_from(KEYS), JUNK, min_size=1, max_size=3))
def test_whatever_is_given_is_a_case_or_is_refused_with_a_key(case, changes):
    try:
        changed = case.with_changes(changes)
    except CaseError as error:
        refused = error
    else:
        assert Case.from_toml(changed.to_toml()) == changed
        return
    assert all(problem.key and problem.message for problem in refused.problems)


# Files


def test_missing_file_with_the_nearest_one(tmp_path):
    (tmp_path / "compression.toml").write_text(COMPRESSION)
    with pytest.raises(CaseError, match=r"compresion\.toml: no such file; did you mean .*compression\.toml\?"):
        load_case(tmp_path / "compresion.toml")
    with pytest.raises(CaseError, match=r"no such file$"):
        load_case(tmp_path / "nowhere" / "case.toml")


def test_folder_is_no_case(tmp_path):
    with pytest.raises(CaseError, match="cannot be read"):
        load_case(tmp_path)


def test_unreadable_toml_is_reported_with_its_line(tmp_path):
    file = tmp_path / "broken.toml"
    file.write_text('title = "x"\nmodel = biphasic\n')
    with pytest.raises(CaseError, match=r"broken\.toml: cannot be read as TOML: .*line 2"):
        load_case(file)


def test_text_that_is_not_utf8(tmp_path):
    file = tmp_path / "latin.toml"
    file.write_bytes("title = 'µ'".encode("latin-1"))
    with pytest.raises(CaseError, match="not UTF-8"):
        load_case(file)


def test_byte_order_mark_does_not_matter(tmp_path, case):
    file = tmp_path / "windows.toml"
    file.write_text(COMPRESSION, encoding="utf-8-sig")
    assert load_case(str(file)) == case


# Loads that the tissue cannot bear


def test_load_that_presses_all_water_out_names_the_largest_one(case):
    biphasic = case.with_changes({"model": "biphasic"})
    message = problems_of(biphasic, {"phase.loading.piston.pressure": "5 MPa"})["phase[loading].piston.pressure"]
    # All water is out at J = 0.2, where the solid pushes back with G (J^(-1/3) - J) - K/2 (J - 1/J).
    K, G, J = 0.5 / 1.2, 0.5 / 2.6, 0.2
    limit = G * (J ** (-1 / 3) - J) - K / 2 * (J - 1 / J)
    largest = float(message.split("up to ")[1].split()[0])
    assert 0.99 * limit < largest <= limit
    assert biphasic.with_changes({"phase.loading.piston.pressure": largest}).phase[0].piston.pressure == largest
    assert case.with_changes({"phase.loading.piston.pressure": 5}).model == "electrochemical"  # charge holds water


@settings(deadline=None)  # timing is not what is tested, and the machine may be busy
@given(
    pressure=st.floats(-2.0, 3.0),
    youngs_modulus=st.floats(0.1, 1.0),
    charge=st.sampled_from([0.0, 1e-5, 2e-4]),
)
def test_load_is_refused_exactly_where_there_is_no_equilibrium(case, pressure, youngs_modulus, charge):
    base = {"tissue.fixed_charge_density": charge, "tissue.osmotic_coefficient": 0.93}
    changes = base | {"phase.loading.piston.pressure": pressure, "tissue.youngs_modulus": youngs_modulus}
    for model in ("biphasic", "electrochemical"):
        tissue = case.with_changes(base | {"tissue.youngs_modulus": youngs_modulus}).tissue_at(np.zeros(1))
        balanced = np.isfinite(equilibrium_volume_ratio(MODEL[model].tissue(tissue), pressure, 1.5e-4))
        if balanced:
            case.with_changes(changes | {"model": model})
        else:
            assert list(problems_of(case, changes | {"model": model})) == ["phase[loading].piston.pressure"]


def test_end_of_a_ramp_and_the_weakest_depth_count(case):
    graded = {"depth": [0.0, 0.5], "value": [5.0, 0.05]}
    ramp = {"ramp_to": 0.25, "over": 10}
    changes = {"model": "biphasic", "phase.loading.piston.pressure": ramp, "tissue.youngs_modulus": graded}
    largest = problems_of(case, changes)["phase[loading].piston.pressure"].split("up to ")[1]
    assert largest == "0.129 MPa does"


def test_bath_that_draws_all_water_out(case):
    uncharged = {
        "tissue.fixed_charge_density": 0,
        "tissue.osmotic_coefficient": 0.1,
        "tissue.youngs_modulus": 1e-3,
    }
    assert "without a load" in problems_of(case, uncharged)["bath.concentration"]
    weak = case.with_changes(uncharged | {"bath.concentration": 1e-8, "phase.loading.piston.pressure": 0})
    later = problems_of(weak, {"phase.loading.piston.pressure": 0, "phase.loading.bath_concentration": 1.5e-4})
    assert "without a load" in later["phase[loading].piston.pressure"]
    assert "phase[unloading].piston.pressure" in later  # the bath stays as the phase before left it


def test_displacement_must_leave_room_for_the_solid(case):
    ramp = {"ramp_to": "-0.43 mm", "over": "50 s"}
    message = problems_of(case, {"phase.0.piston.displacement": ramp})["phase[loading].piston.displacement"]
    assert "0.527 mm in equilibrium" in message
    assert "the solid alone takes 0.1 mm: must be above -0.427 mm" in message
    deepest = case.with_changes({"phase.0.piston.displacement": ramp | {"ramp_to": -0.427}})
    assert deepest.phase[0].piston.displacement == Ramp(-0.427, 50.0)
    biphasic = problems_of(case, {"model": "biphasic", "phase.0.piston.displacement": ramp | {"ramp_to": -0.41}})
    assert "must be above -0.4 mm" in biphasic["phase[loading].piston.displacement"]


def test_room_for_the_solid_is_a_mean_over_the_depth(case):
    fraction = {"depth": [0.0, 0.5], "value": [0.6, 0.9]}
    changes = {
        "model": "biphasic",
        "tissue.fluid_fraction": fraction,
        "phase.0.piston.displacement": {"ramp_to": -0.38, "over": 1},
    }
    assert "must be above -0.375 mm" in problems_of(case, changes)["phase[loading].piston.displacement"]


def test_osmotic_coefficient_of_eq_14_must_stay_positive(case):
    message = problems_of(case, {"tissue.osmotic_coefficient_per_charge": "5000 mm^3/meq"})
    assert "values below 4.65e+03 mm^3/mmol" in message["tissue.osmotic_coefficient_per_charge"]
    graded = {
        "tissue.osmotic_coefficient_per_charge": 4000,
        "tissue.fixed_charge_density": {"depth": [0.1, 0.11, 0.12], "value": [1e-4, 2.5e-4, 1e-4]},
    }
    assert "osmotic" in problems_of(case, graded)["tissue.osmotic_coefficient_per_charge"]


def test_output_times_beyond_the_end(case, timed):
    assert "end of the run at 1200 s" in problems_of(timed, {"output.times": [0, "20.1 min"]})["output.times"]
    assert timed.with_changes({"output.times": [0, "20 min"]}).output.times == (0.0, 1200.0)
    assert case.with_changes({"output.times": [1e9]}).output.times == (1e9,)  # relaxation times are not known yet


# The schema and its reference


@pytest.mark.parametrize("table", [table for _, table in tables_below(CaseTable)], ids=lambda table: table.__name__)
def test_every_key_is_described_and_read_by_a_value_type(table):
    for key, field in table.model_fields.items():
        tables = inner_tables(table, key)
        assert tables or (field.description is not None and field.description.endswith("."))
        assert tables or key in ("kind", "scheme") or value_type(field) is not None


def test_every_quantity_of_the_tissue_may_vary_but_not_the_law(case):
    for key, field in type(case.tissue).model_fields.items():
        laws = ("solid", "permeability", "osmotic", "reference_state", "fibres")
        assert getattr(value_type(field), "varying", False) == (key not in laws)


def test_documentation_is_the_schema():
    assert (ROOT / "docs" / "case-file.md").read_text(encoding="utf-8") == case_reference()


def test_documentation_names_every_key():
    for _, table in tables_below(CaseTable):
        for key in table.model_fields:
            assert f"`{key}`" in case_reference() or f"[{key}]" in case_reference()
