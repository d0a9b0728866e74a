"""The laws of the tissue in a case: which parameters go with which, fibres, and the state that the numbers are of."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fvswell
from fvswell.case.case import Case, CaseError, load_case
from fvswell.case.checks import check_case
from fvswell.case.law_keys import parameters_of
from fvswell.case.reference_state import stress_free
from fvswell.physics.fibre_directions import (
    FIBRE_DIRECTIONS,
    IsotropicDirections,
    PlanarAcrossX,
    PlanarAcrossZ,
    PlanarDirections,
    one_direction,
)
from fvswell.physics.fibre_laws import FIBRE_LAWS, LogarithmicFibres, PowerFibres
from fvswell.physics.fibres import FibreFamily, ground_and_families
from fvswell.physics.models import BIPHASIC, ELECTROCHEMICAL
from fvswell.physics.osmotic import (
    OSMOTIC_LAWS,
    ActivityCoefficients,
    ChargeDependentCoefficients,
    ConstantCoefficients,
    Ideal,
)
from fvswell.physics.permeability import PERMEABILITIES
from fvswell.physics.reference_state import equilibrated_tissue
from fvswell.physics.solids import SOLIDS, NeoHookean
from fvswell.study.schema import varied_quantity

CASES = Path(fvswell.__file__).parents[1] / "cases"
ISOTROPIC = {"directions": "isotropic", "modulus": "2 MPa"}
ALONG = {"directions": "along", "angle": 90, "law": "logarithmic", "modulus": 3.0, "exponent": 8.0}


@pytest.fixture(scope="module")
def case() -> Case:
    return load_case(CASES / "confined_compression.toml")


@pytest.fixture(scope="module")
def disc() -> Case:
    return load_case(CASES / "unconfined_disc.toml")


def messages(case: Case, changes: dict[str, Any]) -> dict[str, str]:
    with pytest.raises(CaseError) as caught:
        case.with_changes(changes)
    return {problem.key: problem.message for problem in caught.value.problems}


# The osmotic law


def test_law_of_files_that_do_not_name_one(case: Case) -> None:
    text = case.to_toml().replace('osmotic = "constant"\n', "").replace("activity_ratio = 1.0\n", "")
    per_charge = text.replace("osmotic_coefficient = 0.83", "osmotic_coefficient_per_charge = 500.0")
    neither = text.replace("osmotic_coefficient = 0.83\n", "")
    for source, law in ((text, "constant"), (per_charge, "charge-dependent"), (neither, "activity")):
        assert Case.from_toml(source).tissue.osmotic == law
    without = neither.replace("osmotic_coefficient = 0.93\n", "")
    assert Case.from_toml(without).tissue_at(np.zeros(1)).osmotic == ActivityCoefficients(0.93)


def test_every_osmotic_law(case: Case) -> None:
    changes: dict[type, dict[str, Any]] = {
        ConstantCoefficients: {"tissue.osmotic_coefficient": 0.8},
        ChargeDependentCoefficients: {"tissue.osmotic_coefficient_per_charge": 400},
        ActivityCoefficients: {"tissue.osmotic": "activity"},
        Ideal: {"tissue.osmotic": "ideal", "bath.osmotic_coefficient": None},
    }
    assert set(changes) == set(OSMOTIC_LAWS.values())
    for law, change in changes.items():
        assert type(case.with_changes(change).tissue_at(np.zeros(1)).osmotic) is law


def test_a_coefficient_brings_its_law_along_and_a_law_drops_the_coefficients_of_others(case: Case) -> None:
    activity = case.with_changes({"tissue.osmotic": "activity"})
    assert activity.tissue.osmotic_coefficient is None
    back = activity.with_changes({"tissue.osmotic_coefficient": 0.83})
    assert back == case
    both = {"tissue.osmotic": "activity", "tissue.osmotic_coefficient": 0.83}
    assert 'osmotic = "constant" only' in messages(case, both)["tissue.osmotic_coefficient"]


def test_bath_coefficient_goes_with_the_law(case: Case) -> None:
    assert "needs it" in messages(case, {"bath.osmotic_coefficient": None})["bath.osmotic_coefficient"]
    assert "leave it out" in messages(case, {"tissue.osmotic": "ideal"})["bath.osmotic_coefficient"]


# Parameters go with their laws


@pytest.mark.parametrize(("key", "laws"), [("solid", SOLIDS), ("permeability", PERMEABILITIES)])
def test_a_law_that_is_chosen_drops_the_parameters_of_others_and_asks_for_its_own(
    case: Case, key: str, laws: dict[str, Any]
) -> None:
    for name, law in laws.items():
        needed = {
            field for field, default in parameters_of(law).items()
            if default is not None and not isinstance(default, float) and getattr(case.tissue, field) is None
        }  # fmt: skip
        if needed:
            found = messages(case, {f"tissue.{key}": name})
            assert found.keys() == {f"tissue.{field}" for field in needed}
            assert all("needs it" in message for message in found.values())
        chosen = case.with_changes({f"tissue.{key}": name, **{f"tissue.{field}": 0.1 for field in needed}})
        assert type(getattr(chosen.tissue_at(np.zeros(1)), key)) is law
        assert Case.from_toml(chosen.to_toml()) == chosen


# Fibres


def families(case: Case, points: Any = None) -> tuple[FibreFamily, ...]:
    ground, found = ground_and_families(case.tissue_at(np.zeros(1) if points is None else points).solid)
    assert isinstance(ground, NeoHookean)
    return found


def test_families_of_fibres(case: Case) -> None:
    given = [ISOTROPIC | {"exponent": 1.5, "power": 2.5}, {"directions": "planar", "modulus": 1}, ALONG]
    found = families(case.with_changes({"tissue.fibres": given}))
    assert found == (
        FibreFamily(IsotropicDirections(), PowerFibres(2.0, 1.5, 2.5)),
        FibreFamily(PlanarDirections(), PowerFibres(1.0, 0.0, 2.0)),
        FibreFamily(one_direction(90.0), LogarithmicFibres(3.0, 8.0)),
    )
    for normal, plane in (("x", PlanarAcrossX), ("y", PlanarDirections), ("z", PlanarAcrossZ)):
        (family,) = families(
            case.with_changes({"tissue.fibres": [{"directions": "planar", "normal": normal, "modulus": 1}]})
        )
        assert type(family.directions) is plane


def test_amount_and_direction_may_vary_in_space(case: Case, disc: Case) -> None:
    arcade = ALONG | {
        "modulus": {"depth": [0, 0.5], "value": ["2 MPa", "4 MPa"]},
        "angle": {"depth": [0, 0.5], "value": [90.0, 0.0]},
    }
    (family,) = families(case.with_changes({"tissue.fibres": [arcade]}), np.array([0.0, 0.25, 0.5]))
    np.testing.assert_allclose(family.law.modulus, [2.0, 3.0, 4.0])
    np.testing.assert_allclose(family.directions.yy, [1.0, 0.5, 0.0], atol=1e-15)
    radial = ISOTROPIC | {"modulus": {"x": [0, "1.5 mm"], "value": [0.0, 3.0]}}
    (family,) = families(disc.with_changes({"tissue.fibres": [radial]}), np.array([[0.0, 0.5], [0.1, 0.1]]))
    np.testing.assert_allclose(family.law.modulus, [0.0, 1.0])


def test_fibres_by_dotted_key_and_in_studies(case: Case) -> None:
    reinforced = case.with_changes({"tissue.fibres": [ISOTROPIC, ALONG]})
    changed = reinforced.with_changes({"tissue.fibres.1.modulus": "500 kPa", "tissue.fibres.0.power": 3})
    assert [family.law.modulus for family in families(changed)] == [2.0, 0.5]
    assert changed.tissue.fibres[0].power == 3.0
    assert reinforced.with_numbers({"tissue.fibres.1.modulus": 0.5, "tissue.fibres.0.power": 3.0}) == changed
    assert varied_quantity("tissue.fibres.0.modulus").dimension == "pressure"
    with pytest.raises(ValueError, match="did you mean"):
        varied_quantity("tissue.fibres.0.modulos")
    power = changed.with_changes({"tissue.fibres.1.law": "power"})  # k1 stays: both laws call theirs exponent
    assert families(power)[1].law == PowerFibres(0.5, 8.0, 2.0)


@pytest.mark.parametrize(
    ("family", "key", "words"),
    [
        ({"directions": "isotropc", "modulus": 1}, "directions", 'did you mean "isotropic"?'),
        ({"directions": "isotropic"}, "modulus", 'missing; law = "power" needs it'),
        ({"directions": "along", "modulus": 1}, "angle", 'missing; directions = "along" needs it'),
        (ISOTROPIC | {"angle": 3}, "angle", 'is for directions = "along" only'),
        (ISOTROPIC | {"normal": "x"}, "normal", 'is for directions = "planar" only'),
        (ISOTROPIC | {"power": 1.5}, "power", "must be at least 2"),
        (ISOTROPIC | {"law": "logarithmic"}, "exponent", 'missing; law = "logarithmic" needs it'),
        (ALONG | {"power": 2}, "power", 'is for law = "power" only'),
        (ISOTROPIC | {"modulus": "-1 MPa"}, "modulus", "must be at least 0 MPa"),
        (ISOTROPIC | {"modulus": "1 mm"}, "modulus", "must be of dimension pressure"),
        (ISOTROPIC | {"youngs_modulus": 3}, "youngs_modulus", "belongs under [tissue]"),
    ],
)
def test_wrong_fibres(case: Case, family: dict[str, Any], key: str, words: str) -> None:
    found = messages(case, {"tissue.fibres": [ISOTROPIC, family]})
    assert list(found) == [f"tissue.fibres[1].{key}"]
    assert words in found[f"tissue.fibres[1].{key}"]


def test_profile_of_fibres_has_to_fit_the_geometry(case: Case) -> None:
    family = ISOTROPIC | {"modulus": {"x": [0, 1], "value": [1, 2]}}
    assert "in a column give" in messages(case, {"tissue.fibres": [family]})["tissue.fibres[0].modulus"]
    assert "there are none" in messages(case, {"tissue.fibres.0.modulus": 1})["tissue.fibres.0.modulus"]


def test_every_law_of_fibres_can_be_given() -> None:
    assert {key for law in (*FIBRE_DIRECTIONS.values(), *FIBRE_LAWS.values()) for key in parameters_of(law)} == {
        "normal", "angle", "tilt", "modulus", "exponent", "power",
    }  # fmt: skip


# The reference state


def test_numbers_of_the_equilibrated_sample_are_those_of_its_stress_free_solid(case: Case) -> None:
    """What equilibrium makes of the case's stress-free numbers, given as measured ones, leads back to them."""
    activity = case.with_changes({"tissue.osmotic": "activity", "tissue.permeability_exponent": 2.0})
    point = np.zeros(1)
    measured, swollen = equilibrated_tissue(activity.tissue_at(point), activity.bath.concentration)
    given = {
        "tissue.fluid_fraction": float(measured.fluid_fraction),
        "tissue.fixed_charge_density": float(measured.fixed_charge_density),
        "tissue.hydraulic_permeability": float(measured.permeability.hydraulic_permeability),
        "tissue.reference_state": "equilibrated",
    }
    other = activity.with_changes(given)
    tissue, J = stress_free(other, other.tissue_at(point), ELECTROCHEMICAL)
    np.testing.assert_allclose(J, swollen, rtol=1e-12)
    for name in ("fluid_fraction", "fixed_charge_density"):
        np.testing.assert_allclose(getattr(tissue, name), getattr(activity.tissue, name), rtol=1e-12)
    np.testing.assert_allclose(tissue.permeability.hydraulic_permeability, 1e-3, rtol=1e-12)
    same, one = stress_free(other, other.tissue_at(point), BIPHASIC)
    assert one == pytest.approx(1.0, abs=1e-15)
    assert float(same.fluid_fraction) == pytest.approx(other.tissue.fluid_fraction, abs=1e-15)


def test_sample_that_no_solid_comes_to(case: Case) -> None:
    changes = {
        "tissue.osmotic": "activity", "tissue.reference_state": "equilibrated", "tissue.fluid_fraction": 0.3,
        "tissue.youngs_modulus": 1e-3, "tissue.fixed_charge_density": 1e-3,
    }  # fmt: skip
    assert "no stress-free solid" in messages(case, changes)["tissue.reference_state"]


def test_room_below_the_piston_is_that_of_the_sample(case: Case) -> None:
    """0.5 mm measured at n_f 0.8: the solid takes 0.1 mm whatever the stress-free numbers are."""
    held = {
        "tissue.osmotic": "activity", "tissue.reference_state": "equilibrated",
        "phase.loading.duration": 100, "phase.unloading.duration": 100,
    }  # fmt: skip
    for over, fits in ((-0.39, True), (-0.41, False)):
        ramp = {"phase.loading.piston.displacement": {"ramp_to": over, "over": "50 s"}}
        if fits:
            assert not check_case(case.with_changes(held | ramp))
        else:
            assert "must be above -0.4 mm" in messages(case, held | ramp)["phase[loading].piston.displacement"]
