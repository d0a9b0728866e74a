"""The fit: it finds what is known, and reports what it did."""

from __future__ import annotations

from pathlib import Path

import pytest
from sample_cases import small_block, small_compression
from typer.testing import CliRunner

from fvswell.analysis.characteristics import characteristics
from fvswell.case.case import Case, CaseError
from fvswell.cli.main import app
from fvswell.fitting.reduced_model import ReducedFit, fit_reduced_model, reduced_problem

PERMEABILITY = "hydraulic_permeability"


def fit(case: Case, *, limits: object = None, phases: object = None, parameter: str = PERMEABILITY) -> ReducedFit:
    return fit_reduced_model(reduced_problem(case, parameter, "electrochemical", phases, limits))  # type: ignore[arg-type]


def gentle_compression(**changes: object) -> Case:
    return small_compression(phase__loading__piston__pressure=2e-3, time__steps_per_phase=20, **changes)


def test_fit_of_a_column_finds_the_models_own_permeability_where_salt_is_fast() -> None:
    fast = gentle_compression(tissue__cation_diffusivity=0.5, tissue__anion_diffusivity=0.5)
    found = fit(fast)
    assert found.ratio == pytest.approx(1.0, abs=4e-3)
    assert found.after[0] > 0.99999
    assert not found.at_limit


def test_fit_of_a_column_comes_near_the_open_circuit_permeability() -> None:
    case = gentle_compression()
    found, expected = fit(case), characteristics(case).open_circuit_ratio[0]
    # below it, as the salt that diffuses with its own slowness holds back the full model further
    assert 0.95 * expected < found.ratio < expected
    assert found.after[0] > 0.999 > found.before[0]
    assert found.reference_result.sizes["phase"] == 1  # what does not count is not run
    assert found.fitted_result.attrs["model"] == "biphasic-swelling"


def test_fit_of_a_block_on_a_later_phase() -> None:
    found = fit(small_block(), phases=["compression"], limits=(5e-4, "2e-3 mm^4/(N s)"))
    assert found.problem.phases == ("compression",)
    assert found.quantities == ("probe_displacement_x",)
    assert found.after[0] > found.before[0]
    assert 0.5 < found.ratio < 2.0


def test_optimum_beyond_the_limits_is_reported() -> None:
    found = fit(gentle_compression(), limits=(9e-4, 1.2e-3))
    assert found.at_limit
    assert found.best == pytest.approx(9e-4, rel=2e-3)


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        ({"parameter": "hydraulic_permeabilty"}, "did you mean hydraulic_permeability?"),
        ({"parameter": "solid"}, "must be of youngs_modulus"),
        ({"reference": "biphasic"}, "must be a fuller model than biphasic-swelling: electrochemical"),
        ({"phases": ["laoding"]}, "did you mean loading?"),
        ({"limits": (2e-3, 1e-3)}, "must be above 0 and increase"),
        ({"limits": ("1 mm", 1e-3)}, "between = 1 mm"),
        ({"limits": (1e-3,)}, "must be two values"),
    ],
)
def test_fit_that_cannot_be_is_refused(arguments: dict[str, object], reported: str) -> None:
    with pytest.raises(CaseError, match=reported.replace("?", r"\?")):
        reduced_problem(
            small_compression(), **({"parameter": "hydraulic_permeability", "reference": "electrochemical"} | arguments)
        )  # type: ignore[arg-type]


def test_fit_by_the_command_line(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(gentle_compression().to_toml(), encoding="utf-8")
    command = [
        "fit",
        str(path),
        "--against",
        "electrochemical",
        "-o",
        str(tmp_path / "fit"),
        "--between",
        "6e-4 mm^4/(N s), 1.2e-3",
    ]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.stderr
    names = {"fit.csv", "fit_electrochemical.nc", "fit_biphasic-swelling.nc"}
    assert {file.name for file in (tmp_path / "fit").iterdir()} == names
    rows = (tmp_path / "fit" / "fit.csv").read_text().splitlines()
    assert rows[0] == "value,hydraulic_permeability,r_squared loading"
    assert rows[1].startswith("case,0.001,")
    assert rows[2].startswith("best,0.0008")
    assert "runs of the fitted model" in done.stdout
    assert "best hydraulic permeability: 0.0008" in done.stdout
    again = CliRunner().invoke(app, command)
    assert again.exit_code == 2
    assert "exists already; use --force" in again.stderr


def test_a_phase_without_change_is_nothing_to_fit() -> None:
    with pytest.raises(CaseError, match="does not change in it: there is nothing to fit"):
        fit(small_block(phase__swelling__bath_concentration=1.5e-4), phases=["swelling"])


def test_a_property_that_the_fitted_model_does_not_have_is_nothing_to_fit() -> None:
    with pytest.raises(CaseError, match="hindrance_factor: makes no difference to the biphasic-swelling model"):
        fit(gentle_compression(), parameter="hindrance_factor", limits=(0.1, 0.5))


def test_a_phase_without_outputs_is_nothing_to_fit() -> None:
    case = small_block(output={"times": [1e3, 2e3, 1e4, 2e4]})
    with pytest.raises(CaseError, match="phases = compression: has too few outputs to follow"):
        fit(case, phases=["swelling", "compression"])


def test_the_cases_own_value_is_not_the_best_outside_the_limits() -> None:
    found = fit(small_block(), limits=(1e-5, 1.1e-5))
    assert found.problem.present == 1e-3
    assert 1e-5 <= found.best <= 1.1e-5
    assert found.at_limit


def test_limits_that_are_not_given_keep_within_bounds() -> None:
    low, high = reduced_problem(small_block(), "poisson_ratio", "electrochemical").limits
    assert 0.0 < low < 0.3 < high < 0.5
