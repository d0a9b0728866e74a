"""Values that are legal and hardly meant: each of them gives a warning that names it, and sound cases give none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import fvswell
from fvswell.case.case import Case, load_case, starter_text
from fvswell.case.plausibility import RANGES, warnings_of
from fvswell.physics.tissues import TISSUES
from fvswell.study.schema import varied_quantity

CASES = Path(fvswell.__file__).parents[1] / "cases"
SHIPPED = [path for folder in (CASES, CASES / "paper") for path in sorted(folder.glob("*.toml"))]


@pytest.fixture(scope="module")
def case() -> Case:
    return load_case(CASES / "confined_compression.toml")


def found(case: Case, changes: dict[str, Any]) -> dict[str, list[str]]:
    messages: dict[str, list[str]] = {}
    for warning in warnings_of(case.with_changes(changes)):
        messages.setdefault(warning.key, []).append(warning.message)
    return messages


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.name)
def test_shipped_cases_give_no_warning(path: Path) -> None:
    assert warnings_of(load_case(path)) == []


def test_starter_gives_no_warning() -> None:
    assert warnings_of(Case.from_toml(starter_text())) == []


@pytest.mark.parametrize(
    ("changes", "key", "words"),
    [
        ({"bath.concentration": 150}, "bath.concentration", "is 150 mmol/mm^3, and usual are"),
        ({"bath.concentration": 150}, "bath.concentration", "a strain of -80 % in equilibrium, over the stress-free"),
        ({"bath.temperature": 25}, "bath.temperature", "is 25 K"),
        (
            {"tissue.hydraulic_permeability": "1e-3 m^4/(N s)"},
            "tissue.hydraulic_permeability",
            "is 1e+09 mm^4/(N s)",
        ),
        ({"tissue.hydraulic_permeability": "1e-3 m^4/(N s)"}, "geometry.height", "h^2/(k H) = 3.71e-10 s"),
        ({"tissue.youngs_modulus": "500 GPa"}, "tissue.youngs_modulus", "is 5e+05 MPa"),
        ({"tissue.hydraulic_permeability": 1e-8, "geometry.height": 50}, "geometry.height", "= 3.71e+11 s"),
        ({"phase.loading.piston.pressure": 3}, "phase[loading].piston.pressure", "strain of -70 %"),
        ({"phase.loading.bath_concentration": 15}, "phase[loading].bath_concentration", "is 15 mmol/mm^3"),
        (
            {
                "phase.loading.duration": 100, "phase.unloading.duration": 100,
                "phase.loading.piston.displacement": {"ramp_to": "-0.32 mm", "over": "90 s"},
            },
            "phase[loading]",
            "the piston moves by -64 %",
        ),
        (
            {"tissue.fixed_charge_density": {"depth": [0, 0.5], "value": [200, 2e-4]}},
            "tissue.fixed_charge_density",
            "is 200 mmol/mm^3",
        ),
    ],
)  # fmt: skip
def test_what_is_hardly_meant_gives_a_warning(case: Case, changes: dict[str, Any], key: str, words: str) -> None:
    messages = found(case, changes)
    assert any(words in message for message in messages[key]), messages


def test_weakly_charged_tissue_that_the_papers_coefficients_shrink(case: Case) -> None:
    """J = .947 at c_F0 = .1 M in .15 M; the activity law swells it, and the biphasic model does not ask."""
    weak = {"tissue.fixed_charge_density": "0.1 M"}
    (message,) = found(case, weak)["bath.concentration"]
    assert "J = 0.947" in message
    assert "pi - pi_bath is -0.0362 MPa" in message
    assert found(case, weak | {"tissue.osmotic": "activity"}) == {}
    assert found(case, weak | {"model": "biphasic"}) == {}


def test_profile_that_is_weak_somewhere(case: Case) -> None:
    profile = {"tissue.fixed_charge_density": {"depth": [0, 0.5], "value": ["0.08 M", "0.22 M"]}}
    assert "J = 0.930" in found(case, profile)["bath.concentration"][0]


def test_a_bath_that_comes_later_is_named_with_its_phase(case: Case) -> None:
    strong = {"phase.unloading.bath_concentration": "1 M"}
    assert list(found(case, strong)) == ["phase[unloading].bath_concentration"]
    assert found(case, strong | {"tissue.osmotic": "activity"}) == {}


def test_blocks_are_looked_at_as_well() -> None:
    disc = load_case(CASES / "unconfined_disc.toml")
    assert "pi - pi_bath" in found(disc, {"tissue.fixed_charge_density": "0.05 M"})["bath.concentration"][0]
    assert "is 25 K" in found(disc, {"bath.temperature": 25})["bath.temperature"][0]


def test_ranges_are_of_keys_that_exist_and_have_sources() -> None:
    for key, usual in RANGES.items():
        assert usual.low < usual.high
        assert usual.source
        if "." in key:
            varied_quantity(key)


@pytest.mark.parametrize("name", TISSUES)
def test_sets_of_properties_are_within_the_ranges(name: str) -> None:
    for key, value in TISSUES[name].properties.items():
        usual = RANGES.get(f"tissue.{key}")
        assert usual is None or usual.holds(value)
