"""Where one model becomes another, and one case the same as another."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from columns import CASES, compression, swelling

import fvswell
from fvswell.case.case import Case, load_case
from fvswell.physics.tissue import Array

SMALL = {"geometry__cells": 20, "time__steps_per_phase": 15}


def gap(case: Case, changes: dict[str, object]) -> float:
    """Largest difference of J between the full model and biphasic swelling, anywhere and at any time."""
    accurate = {
        "time": {"scheme": "esdirk43", "tolerance": 1e-7},
        "output": {"times": [5.0, 20.0, 100.0, 400.0, 605.0, 650.0, 900.0]},
    }  # fmt: skip
    changed = case.with_changes(changes | accurate | {"open_circuit_permeability": "state"})
    one, other = (fvswell.run(changed, model)["volume_ratio"] for model in ("electrochemical", "biphasic-swelling"))
    return float(np.abs(one - other).max())


@pytest.mark.parametrize("protocol", [compression(**SMALL), swelling(**SMALL)], ids=["compression", "swelling"])
def test_fast_ions_make_biphasic_swelling(protocol: Case) -> None:
    """Diffusivities up by 1e4: the salt follows at once, no current flows, k_open is left; in proportion to 1/D."""
    gaps = [gap(protocol, {"tissue.cation_diffusivity": 5e-4 * up, "tissue.anion_diffusivity": 8e-4 * up})
            for up in (1.0, 1e2, 1e3, 1e4)]  # fmt: skip
    assert gaps[0] > 2e-3
    assert gaps[3] < 2e-5
    np.testing.assert_allclose([gaps[1] / gaps[2], gaps[2] / gaps[3]], 10.0, rtol=0.15)


def test_without_charge_and_bath_change_all_models_are_biphasic() -> None:
    """Ions move with the water (no hindrance), so the salt stays as it is."""
    changes = {
        "tissue__fixed_charge_density": 0.0,
        "tissue__osmotic_coefficient": 0.93,
        "tissue__hindrance_factor": 0.0,
    }
    case = compression(**SMALL, **changes)
    plain = fvswell.run(case, "biphasic")
    for model in ("biphasic-swelling", "electrochemical"):
        result = fvswell.run(case, model)
        for name in ("global_strain", "volume_ratio", "effective_stress", "water_flux", "fluid_pressure"):
            scale = float(np.abs(plain[name]).max())
            shift = 0.0
            if name == "fluid_pressure":  # measured against pure water in one and the bath in the others
                shift = result[name][0, 0] - plain[name][0, 0]
            np.testing.assert_allclose(result[name] - shift, plain[name], rtol=0, atol=1e-8 * scale, err_msg=name)
    np.testing.assert_allclose(result["virtual_concentration"], 1.5e-4, rtol=1e-8)


def test_hindered_salt_is_held_back_even_without_charge() -> None:
    """With hindrance the water leaves salt behind: the limit above needs none."""
    changes = {"tissue__fixed_charge_density": 0.0, "tissue__osmotic_coefficient": 0.93}
    result = fvswell.run(compression(**SMALL, **changes), "electrochemical")
    assert result["virtual_concentration"][1:10].max() > 1.01 * 1.5e-4


def dissimilar_units(text: str) -> str:
    pairs = [
        ('"0.5 mm"', '"500 um"'), ('"0.5 MPa"', '"500 kPa"'), ('"1e-3 mm^4/(N s)"', '"1e-15 m^4/(N s)"'),
        ('"0.2 mEq/ml"', '"200 mol/m^3"'), ('"5e-4 mm^2/s"', '"5e-6 cm^2/s"'), ('"8e-4 mm^2/s"', '"8e-10 m^2/s"'),
        ('"0.15 M"', '"150 mol/m^3"'), ('"0.25 MPa"', '"2.5 bar"'),
    ]  # fmt: skip
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    return text


@pytest.mark.parametrize("model", ["biphasic", "electrochemical"])
def test_other_units_give_the_same_file(model: str, tmp_path: Path) -> None:
    """Every number of the result to the bit, and the case in it."""
    original = CASES / "confined_compression.toml"
    text = original.read_text(encoding="utf-8").replace('"1.5 relaxation times"', '"10 min"')
    files = []
    for name, content in (("one", text), ("other", dissimilar_units(text).replace('"10 min"', '"600 s"'))):
        case = tmp_path / f"{name}.toml"
        case.write_text(content, encoding="utf-8")
        files.append(tmp_path / f"{name}.nc")
        fvswell.run(load_case(case).with_changes({"geometry.cells": 10}), model, path=files[-1])
    one, other = (fvswell.read_result(file) for file in files)
    assert one.attrs["case_toml"] == other.attrs["case_toml"]
    assert one.attrs["case_sha256"] == other.attrs["case_sha256"]
    xr.testing.assert_identical(one.drop_attrs(), other.drop_attrs())


@pytest.mark.parametrize("model", ["biphasic", "biphasic-swelling", "electrochemical"])
def test_times_go_as_the_square_of_the_height(model: str) -> None:
    """Diffusion alone sets the pace: a column of half the height does everything in a quarter of the time."""

    def strain(height: float) -> Array:
        duration = 600.0 * (height / 0.5) ** 2
        case = compression(phase__loading__duration=duration, phase__unloading__duration=duration,
                           geometry__height=height, **SMALL)  # fmt: skip
        return fvswell.run(case, model)["global_strain"].values

    np.testing.assert_allclose(strain(0.25), strain(0.5), rtol=1e-9, atol=1e-11)


def test_equilibrium_stays_equilibrium() -> None:
    """A phase in which nothing is done, at the start: all models stay where they are and lose nothing."""
    for scheme in ("backward-euler", "esdirk43"):
        case = compression(phase__loading__piston__pressure=0.0, geometry__cells=10, time__scheme=scheme)
        for model in ("biphasic", "biphasic-swelling", "electrochemical"):
            result = fvswell.run(case, model)
            assert np.abs(result["global_strain"]).max() < 1e-12
            assert max(float(result[name].max()) for name in result if name.endswith("balance_error")) < 1e-9
