"""Figures: what they draw, that nothing of it is cut off, and what is reported when it cannot be drawn."""

from __future__ import annotations

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from sample_cases import small_compression

import fvswell
from fvswell.analysis.comparison import Comparison, compare
from fvswell.case.case import MODELS
from fvswell.errors import OutputError
from fvswell.reporting.plots import (
    axis_label,
    chosen_times,
    chosen_variables,
    comparison_figure,
    line_styles,
    result_figure,
    result_labels,
    save_figure,
)


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    return compare(small_compression())


@pytest.fixture(scope="module")
def results(comparison: Comparison) -> dict[str, xr.Dataset]:
    return comparison.results


def drawn(axes: Axes) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Curves with a label."""
    return {
        str(line.get_label()): (np.asarray(line.get_xdata()), np.asarray(line.get_ydata()))
        for line in axes.get_lines()
        if not str(line.get_label()).startswith("_")
    }


def assert_nothing_is_cut_off(figure: Figure) -> None:
    figure.draw_without_rendering()
    outer, inner = figure.bbox_inches, figure.get_tightbbox()
    assert inner.x0 >= outer.x0
    assert inner.y0 >= outer.y0
    assert inner.x1 <= outer.x1
    assert inner.y1 <= outer.y1


def test_result_figure_draws_strain_and_profiles(results: dict[str, xr.Dataset]) -> None:
    variables = chosen_variables(results, None)
    times = chosen_times(results, "40 s, 5 min")
    figure = result_figure(results, times, variables)
    top, *panels = figure.axes
    for model, (time, strain) in drawn(top).items():
        np.testing.assert_array_equal(time, results[model]["time"])
        np.testing.assert_array_equal(strain, results[model]["global_strain"])
    assert set(drawn(top)) == set(MODELS)
    assert len(panels) == len(variables) * len(times) == 6
    pressures = [line.get_ydata() for line in panels[3].get_lines()]
    for expected, found in zip(results.values(), pressures, strict=True):
        np.testing.assert_allclose(found, expected["fluid_pressure"].sel(time=300.0))
    assert top.get_ylabel() == "global strain"
    assert top.get_xlabel() == "time (s)"
    assert panels[0].get_title().endswith("37.5 s")
    assert_nothing_is_cut_off(figure)


def test_model_without_a_field_is_left_out_of_its_panels(results: dict[str, xr.Dataset]) -> None:
    panel = result_figure(results, [300.0], ["anion_concentration"]).axes[1]
    assert len(panel.get_lines()) == 2
    np.testing.assert_allclose(
        panel.get_lines()[-1].get_ydata(),
        1e3 * results["electrochemical"]["anion_concentration"].sel(time=300.0),
    )
    assert panel.get_ylabel() == "anion concentration (M)".replace(" (", "\n(")


def test_fluxes_are_drawn_at_the_nodes(results: dict[str, xr.Dataset]) -> None:
    figure = result_figure(results, [37.5], ["water_flux", "cation_flux_migration"])
    line = figure.axes[1].get_lines()[0]
    np.testing.assert_array_equal(line.get_xdata(), results["biphasic"]["x_node"])
    assert_nothing_is_cut_off(figure)


def test_comparison_figure_draws_models_and_differences(comparison: Comparison) -> None:
    figure = comparison_figure(comparison)
    histories, gaps, loading, unloading = figure.axes
    assert set(drawn(histories)) == set(MODELS)
    assert set(drawn(gaps)) == {"biphasic", "biphasic-swelling"}
    largest = {each.model: each.largest for each in comparison.of_phase("loading")}
    for model, (time, gap) in drawn(gaps).items():
        assert largest[model] in gap[time <= 300.0]
    assert "electrochemical" in gaps.get_ylabel()
    for axes in (loading, unloading):
        assert len(axes.get_lines()) == 3
        assert axes.get_xlabel() == "distance from filter (mm)"
    assert "loading" in loading.get_title()
    assert_nothing_is_cut_off(figure)


def test_models_differ_in_colour_and_in_style(results: dict[str, xr.Dataset]) -> None:
    lines = line_styles(results)
    assert len({line.color for line in lines.values()}) == len({str(line.style) for line in lines.values()}) == 3
    assert line_styles({"biphasic": results["biphasic"]})["biphasic"] == lines["biphasic"]


def test_results_of_one_model_differ_in_colour_and_in_style(results: dict[str, xr.Dataset]) -> None:
    lines = line_styles(dict.fromkeys("abcd", results["biphasic"]))
    assert len({line.color for line in lines.values()}) == 4
    assert len({str(line.style) for line in lines.values()}) == 4


@pytest.mark.parametrize("suffix", [".png", ".pdf", ".svg"])
def test_figure_is_written_by_its_name(results: dict[str, xr.Dataset], tmp_path: Path, suffix: str) -> None:
    path = tmp_path / "new" / f"figure{suffix}"
    save_figure(result_figure(results, [37.5], ["volume_ratio"]), path)
    start = path.read_bytes()[:200]
    assert {".png": b"PNG", ".pdf": b"%PDF", ".svg": b"<?xml"}[suffix] in start


def test_figure_is_as_wide_as_a_page_at_300_dots_an_inch(results: dict[str, xr.Dataset], tmp_path: Path) -> None:
    save_figure(result_figure(results, [37.5], ["volume_ratio"]), tmp_path / "figure.png")
    pixels = matplotlib.image.imread(tmp_path / "figure.png").shape[1]
    assert pixels == pytest.approx(180.0 / 25.4 * 300.0, abs=2)


def test_figure_of_another_kind_is_refused(results: dict[str, xr.Dataset], tmp_path: Path) -> None:
    (tmp_path / "result.nc").write_text("precious")
    figure = result_figure(results, [37.5], ["volume_ratio"])
    with pytest.raises(OutputError, match=r"must end in \.png, \.pdf, \.svg"):
        save_figure(figure, tmp_path / "result.nc")
    with pytest.raises(OutputError, match="cannot be written"):
        save_figure(figure, tmp_path / "result.nc" / "figure.png")
    assert (tmp_path / "result.nc").read_text() == "precious"


def test_times_are_the_nearest_outputs(results: dict[str, xr.Dataset]) -> None:
    assert chosen_times(results, "40 s,1 min") == [37.5, 75.0]
    assert chosen_times(results, "1 s") == [37.5]  # not the state before the load
    assert chosen_times(results, "0 s") == [0.0]
    assert chosen_times(results, None) == [37.5, 150.0]


def test_wrong_times_are_all_reported(results: dict[str, xr.Dataset]) -> None:
    with pytest.raises(OutputError) as reported:
        chosen_times(results, "10 mm, 3 h, soon, 60 s")
    assert str(reported.value).count("\n") == 2
    assert "must be from 0 to 600 s" in str(reported.value)


def test_wrong_variables_are_all_reported(results: dict[str, xr.Dataset]) -> None:
    with pytest.raises(OutputError) as reported:
        chosen_variables(results, ["fluid_presure", "step_size", "water_flux"])
    assert "did you mean fluid_pressure?" in str(reported.value)
    assert str(reported.value).count("\n") == 1
    assert chosen_variables({"b": results["biphasic"]}, None) == ["volume_ratio", "fluid_pressure"]


def test_labels_tell_results_apart(results: dict[str, xr.Dataset]) -> None:
    own = list(results.values())
    assert result_labels([Path("a.nc")] * 3, own) == list(MODELS)
    same = [results["biphasic"]] * 2
    assert result_labels([Path("a.nc"), Path("b.nc")], same) == ["a", "b"]
    assert result_labels([Path("a/b.nc"), Path("c/b.nc")], same) == ["a/b", "c/b"]
    with pytest.raises(OutputError, match="given more than once"):
        result_labels([Path("a.nc"), Path("a.nc")], same)


def test_axes_are_labelled_with_units() -> None:
    assert axis_label("fluid_pressure") == "fluid pressure (MPa)"
    assert axis_label("volume_ratio") == "volume ratio"
    assert axis_label("electric_potential") == "electric potential (mV)"


def test_histories_are_drawn_by_name_with_the_unit_of_the_result(results: dict[str, xr.Dataset]) -> None:
    """Water that has entered is a volume per area in a column; profiles may stand below."""
    variables = chosen_variables(results, ["filter_water_volume", "piston_pressure", "volume_ratio"])
    figure = result_figure(results, chosen_times(results, "40 s"), variables)
    water, pressure, *profiles = figure.axes
    assert (water.get_ylabel(), pressure.get_ylabel()) == ("filter water volume (mm)", "piston pressure (MPa)")
    for label, result in results.items():
        np.testing.assert_array_equal(drawn(water)[label][1], result["filter_water_volume"])
    assert len(profiles) == 1
    assert_nothing_is_cut_off(figure)


def test_what_the_experiment_measures_is_drawn_first() -> None:
    """The pressure of a piston that is moved or fixed; what the case names; else strain."""
    case = small_compression(model="biphasic")
    pulled = case.with_changes(
        {"phase.loading.piston.displacement": {"ramp_to": -0.02, "over": 50.0}, "phase.loading.duration": 100.0}
    )
    for each, label in ((case, "global strain"), (pulled, "piston pressure (MPa)")):
        figure = result_figure({"one": fvswell.run(each)}, [], [])
        assert figure.axes[0].get_ylabel() == label
    named = case.with_changes({"output.measured": "filter_water_volume"})
    assert result_figure({"one": fvswell.run(named)}, [], []).axes[0].get_ylabel() == "filter water volume (mm)"
