"""Rules from a study: the paper's curve and numbers, and how the predictor is judged."""

from __future__ import annotations

import json

import numpy as np
import pytest
import studies
import xarray as xr

from fvswell.analysis.prediction_accuracy import assess, known_accuracy, prediction_errors
from fvswell.analysis.rules import fit_curve, fitted_points, paper_fits
from fvswell.case.case import CaseError
from fvswell.errors import OutputError
from fvswell.prediction.conditions import Conditions, kind_of_change
from fvswell.reporting.console import TextTable
from fvswell.reporting.rules_report import rules_figure, rules_tables, write_points, write_rules
from fvswell.study.file import read_study
from fvswell.study.points import CURVES, StudyPoints, study_points
from fvswell.study.run import run_study

IONS = ["tissue.cation_diffusivity", "tissue.anion_diffusivity"]
DIFFUSIVITY = studies.parameter("ions", IONS, 5e-4, 1e-2, spacing="log")
FIXED_TIME = {"phase__loading__duration": 500.0, "phase__unloading__duration": 500.0}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory) -> xr.Dataset:
    """24 small runs: loads of a tenth of the reference's, error-controlled."""
    accurate = {
        "time.scheme": "esdirk43", "time.steps_per_phase": None, "geometry.cells": 20, "geometry.grading": 10
    } | {key.replace("__", "."): value for key, value in FIXED_TIME.items()}  # fmt: skip
    small = [
        studies.protocol(**{"phase.loading.piston.pressure": 0.01}),
        studies.protocol("swelling", "free_swelling.toml", **{"phase.loading.bath_concentration": 1.45e-4}),
    ]
    for protocol in small:
        protocol["changes"] = {k: v for k, v in (protocol["changes"] | accurate).items() if v is not None}
    design = {"name": "all", "kind": "combinations", "sampling": "random", "count": 12, "seed": 3}
    study = studies.study(protocol=small, parameter=[studies.PERMEABILITY, DIFFUSIVITY], design=[design])
    path = tmp_path_factory.mktemp("rules") / "study.nc"
    run_study(study, path, processes=1)
    return read_study(path)


@pytest.fixture(scope="module")
def points(dataset) -> StudyPoints:
    return study_points(dataset)


@pytest.mark.parametrize(("a", "b"), [(0.14, 0.6), (2.1, 0.5), (0.03, 1.7)])
def test_the_fit_recovers_known_numbers(a: float, b: float) -> None:
    draw = np.random.default_rng(1)
    f = draw.uniform(-2.0, 3.0, 400)
    exact = 1.0 - a * np.exp(-b * f)
    fit = fit_curve(f, exact, resamples=20)
    assert (fit.a, fit.b) == pytest.approx((a, b), rel=1e-6)
    assert fit.explained == pytest.approx(1.0)
    np.testing.assert_allclose(fit(f), exact, rtol=0.0, atol=1e-7)


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    draw, held = np.random.default_rng(4), []
    for _ in range(40):
        f = draw.uniform(-2.0, 3.0, 100)
        fit = fit_curve(f, 1.0 - 0.2 * np.exp(-0.7 * f) + draw.normal(0.0, 0.05, 100), resamples=80)
        assert fit.scatter == pytest.approx(0.05, rel=0.3)
        held += [fit.a_interval[0] < 0.2 < fit.a_interval[1], fit.b_interval[0] < 0.7 < fit.b_interval[1]]
    assert 0.85 < np.mean(held) < 1.0


def test_intervals_shrink_with_the_root_of_the_points() -> None:
    draw = np.random.default_rng(2)

    def width(points: int) -> float:
        f = draw.uniform(-1.0, 3.0, points)
        fit = fit_curve(f, 1.0 - 0.2 * np.exp(-0.7 * f) + draw.normal(0.0, 0.05, points), resamples=200)
        return fit.a_interval[1] - fit.a_interval[0]

    assert width(1600) == pytest.approx(width(100) / 4.0, rel=0.4)


def test_a_curve_needs_points() -> None:
    with pytest.raises(ValueError, match="needs 10 points, not 3"):
        fit_curve(np.arange(3.0), np.arange(3.0))


def test_kinds_of_change() -> None:
    start = Conditions(0.1, 1.5e-4)
    after = [Conditions(0.2, 1.5e-4), Conditions(0.0, 1.5e-4), Conditions(0.1, 1e-4), Conditions(0.2, 1e-4), start]
    assert [kind_of_change(start, each).item() for each in after] == [0, 1, 2, -1, -1]


def test_points_of_a_study(dataset, points) -> None:
    """Every phase is a point, with the paper's numbers by hand."""
    assert points.curves == CURVES
    assert [int(points.of_curve(curve).sum()) for curve in CURVES] == [12, 12, 24]
    np.testing.assert_array_equal(points.r_squared, dataset["r_squared"].values[points.run, points.phase])
    k, D = (dataset[name].values[points.run] for name in ("permeability", "ions"))
    J0 = dataset["initial_height"].values[points.run, 0] / 0.5
    compression = D**2 * J0 / (0.5 * k) ** 2
    np.testing.assert_allclose(points.mobility_ratio, D**2 / (0.5 * k) ** 2, rtol=1e-12)
    swelling = points.of_curve("swelling")
    expected = np.log10(compression * np.where(swelling, 2e-4 / 1.5e-4, 1.0))
    np.testing.assert_allclose(points.applicability, expected, rtol=1e-6)
    final = dataset["equilibrium_strain"].sel(model="electrochemical").values
    np.testing.assert_allclose(points.strain[points.phase == 0], final[points.run, 0][points.phase == 0], rtol=1e-6)
    np.testing.assert_allclose(points.strain[points.phase == 1], -final[points.run, 0][points.phase == 1]
                               / (1.0 + final[points.run, 0][points.phase == 1]), rtol=1e-6)  # fmt: skip


def test_the_fit_of_swelling_leaves_out_what_the_paper_does(points) -> None:
    own = fitted_points(points, "swelling")
    assert 0 < own.sum() < points.of_curve("swelling").sum()
    np.testing.assert_array_equal(own, points.of_curve("swelling") & (points.mobility_ratio <= 100.0))
    np.testing.assert_array_equal(fitted_points(points, CURVES[0]), points.of_curve(CURVES[0]))


def test_small_changes_are_predicted_almost_exactly(points) -> None:
    """The theory behind the predictor is exact for small changes: only grid and time steps are left."""
    errors = assess(points).errors
    for curve in CURVES:
        assert errors[curve].median_factor < 1.03, curve
        assert errors[curve].bias_factor == pytest.approx(1.0, abs=0.03)


def test_errors_by_hand() -> None:
    errors = prediction_errors(np.array([0.9, 0.99, 0.0]), np.array([0.8, 0.99, 0.5]))
    assert errors.points == 3
    assert errors.median == pytest.approx(0.1)
    assert errors.median_factor == pytest.approx(2.0)
    assert errors.bias_factor == pytest.approx(1.0)
    assert errors.within_hundredth == pytest.approx(1.0 / 3.0)


def test_states_are_judged_on_runs_that_did_not_choose_them(points) -> None:
    choices = assess(points).choices
    assert {choice.chosen_from for choice in choices} == {"this curve", "all curves", "the program"}
    judged = {choice.curve: choice.errors.points for choice in choices}
    assert sum(judged.values()) == 24  # 12 of 24 runs, two phases each
    by_curve = {choice.curve: choice for choice in choices if choice.chosen_from == "this curve"}
    assert all(0.0 <= choice.linearised_at <= 1.0 for choice in by_curve.values())


def test_what_is_written(dataset, points, tmp_path) -> None:
    fits, assessment = paper_fits(points), assess(points)
    write_rules(tmp_path / "rules.json", dataset, fits, assessment)
    content = json.loads((tmp_path / "rules.json").read_text())
    assert content["study_sha256"] == dataset.attrs["study_sha256"]
    assert content["fits"]["swelling"]["a"] == fits["swelling"].a
    assert content["errors"]["swelling"]["points"] == 24
    write_points(tmp_path / "rules.csv", points, fits, assessment)
    header, *lines = (tmp_path / "rules.csv").read_text().splitlines()
    assert header.startswith("run,phase,curve,applicability")
    assert len(lines) == len(points.run)
    tables = rules_tables(points, fits, assessment)
    assert all(isinstance(table, TextTable) and table.rows for table in tables)
    assert all(len(row) == len(table.header) for table in tables for row in table.rows)
    assert len(rules_figure(points, fits, assessment).axes) == 7  # three curves, two rows, one colour bar


def test_other_studies_are_refused(dataset) -> None:
    other = dataset.copy()
    other.attrs["study_toml"] = studies.study(model="biphasic").to_toml()
    with pytest.raises(CaseError, match="must be a study of biphasic-swelling by electrochemical, not of biphasic"):
        study_points(other)
    failed = dataset.assign_coords(run_status=("run", ["failed"] * dataset.sizes["run"]))
    with pytest.raises(OutputError, match="no complete run"):
        study_points(failed)


def test_known_accuracy_covers_every_strain_and_grows_with_it() -> None:
    accuracy = known_accuracy()
    assert "runs" in accuracy.source
    for curve in (*CURVES, None):
        errors = [accuracy.expected(curve, strain).median_factor for strain in (0.0, 0.03, 0.07, 0.15, 0.25, 0.9)]
        assert min(errors) >= 1.0
        assert errors[-1] == max(errors), curve
    assert accuracy.expected(CURVES[0], -0.25) == accuracy.expected(CURVES[0], 0.25)
    both = accuracy.expected(None, 0.25).ninth_decile_factor
    assert both == max(accuracy.expected(curve, 0.25).ninth_decile_factor for curve in CURVES)
