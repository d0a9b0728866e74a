"""What `fvswell rules` says of a study: tables, files and a figure."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from fvswell.analysis.prediction_accuracy import Assessment, ErrorDistribution
from fvswell.analysis.rules import CurveFit, fitted_points, r_squared_by_rule, rule_errors
from fvswell.errors import OutputError
from fvswell.reporting.console import TextTable
from fvswell.reporting.plots import PAGE_WIDTH, in_print_style
from fvswell.results.table import write_table
from fvswell.study.points import CURVES, StudyPoints

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["POINT_COLORS", "draw_fit", "rules_figure", "rules_tables", "source_of", "write_points", "write_rules"]

POINT_COLORS = dict(zip(CURVES, ("#0072B2", "#D55E00", "#009E73"), strict=True))

_NUMBERS = dict(zip(CURVES, ("$f_c$", "$f_c$", "$f_s$"), strict=True))
_LEAST_R_SQUARED = -1.0  # drawn; points below are marked at the edge
_LEAST_MISFIT = 1e-7

Fits = Mapping[str, CurveFit]


def source_of(dataset: xr.Dataset) -> str:
    """Which study, in a line."""
    program = dataset.attrs["source"].partition(",")[0]
    return f"{dataset.attrs['title']} ({dataset.sizes['run']} runs, {program})"


def rules_tables(points: StudyPoints, fits: Fits, assessment: Assessment) -> list[TextTable]:
    """The fits, and the errors of fits and predictor."""
    fit_rows = [
        [curve, f"{fit.points}", *_interval(fit.a, fit.a_interval), *_interval(fit.b, fit.b_interval),
         f"{fit.scatter:.3g}", f"{100.0 * fit.explained:.0f} %"]
        for curve, fit in fits.items()
    ]  # fmt: skip
    header = ["curve", "points", "a", "95 %", "b", "95 %", "scatter", "explained"]
    tables = [TextTable("The paper's rule R^2 = 1 - a exp(-b f), fitted to this study", header, fit_rows)]
    rows = []
    for curve, errors in assessment.errors.items():
        rows.append([f"{curve}: predictor", *_error_cells(errors)])
        if curve in fits:
            rows.append([f"{curve}: rule", *_error_cells(rule_errors(points, curve, fits[curve]))])
    header = ["errors of R^2", "points", "median", "90 %", "<= 0.01", "misfit x/: median", "90 %", "bias x"]
    tables.append(TextTable("Predicted against simulated R^2 (misfit: 1 - R^2)", header, rows))
    rows = [
        [f"{each.curve}, {_bounds(each.low, each.high)}", *_error_cells(each.errors)] for each in assessment.by_strain
    ]
    tables.append(TextTable("The predictor by strain, between equilibria", header, rows))
    if assessment.choices:
        rows = [
            [f"{each.curve}, from {each.chosen_from}", f"{each.linearised_at:.2f}", *_error_cells(each.errors)]
            for each in assessment.choices
        ]
        title = "State linearised about (0: first equilibrium, 1: last) chosen on half of the runs; errors on the rest"
        tables.append(TextTable(title, [header[0], "state", *header[1:]], rows))
    return tables


def write_rules(path: Path, dataset: xr.Dataset, fits: Fits, assessment: Assessment) -> None:
    """Write all but the points as JSON.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    content = {
        "source": source_of(dataset),
        "study_sha256": dataset.attrs["study_sha256"],
        "fits": {curve: asdict(fit) for curve, fit in fits.items()},
        "errors": {curve: asdict(errors) for curve, errors in assessment.errors.items()},
        "by_strain": [_without_infinity(asdict(each)) for each in assessment.by_strain],
        "choices": [asdict(each) for each in assessment.choices],
    }
    try:
        path.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from None


def write_points(path: Path, points: StudyPoints, fits: Fits, assessment: Assessment) -> None:
    """Write the points as text with commas: a line for each phase of each run.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    curves = [CURVES[index] for index in points.curve]
    columns = {
        "run": points.run, "phase": points.phase, "curve": curves, "applicability": points.applicability,
        "mobility_ratio": points.mobility_ratio, "strain": points.strain, "r_squared": points.r_squared,
        "predicted_r_squared": assessment.predicted, "fitted_r_squared": r_squared_by_rule(points, fits),
    }  # fmt: skip
    write_table(path, columns, zip(*columns.values(), strict=True))


@in_print_style
def rules_figure(points: StudyPoints, fits: Fits, assessment: Assessment) -> Figure:
    """Above, the rule's curves with their points; below, simulated against predicted misfit."""
    figure = Figure(figsize=(PAGE_WIDTH, 4.6), layout="constrained")
    axes = figure.subplots(2, len(points.curves), squeeze=False)
    for column, curve in enumerate(points.curves):
        draw_fit(axes[0, column], points, curve, fits.get(curve))
        axes[0, column].set_title(curve)
        _draw_predicted(axes[1, column], points, curve, assessment)
    axes[0, 0].set_ylabel("$R^2$, simulated")
    axes[1, 0].set_ylabel("$1 - R^2$, predicted")
    return figure


def draw_fit(axes: Axes, points: StudyPoints, curve: str, fit: CurveFit | None) -> None:
    """Draw the points of a curve, grey where the rule is not fitted to them, and its fit."""
    own, fitted = points.of_curve(curve), fitted_points(points, curve)
    shown = np.maximum(points.r_squared, _LEAST_R_SQUARED)
    low = points.r_squared < _LEAST_R_SQUARED
    f = points.applicability
    style: dict[str, Any] = {"s": 5, "linewidths": 0.0, "alpha": 0.45, "color": POINT_COLORS[curve], "rasterized": True}
    axes.scatter(f[fitted & ~low], shown[fitted & ~low], **style)
    axes.scatter(f[own & ~fitted & ~low], shown[own & ~fitted & ~low], **(style | {"color": "0.6"}))
    if np.any(own & low):
        label = f"{np.sum(own & low)} below {_LEAST_R_SQUARED:g}"
        axes.scatter(f[own & low], shown[own & low], **(style | {"s": 9}), marker="v", label=label, clip_on=False)
    if fit is not None:
        at = np.linspace(f[own].min(), f[own].max(), 200)
        label = f"$a$ = {fit.a:.3g}, $b$ = {fit.b:.3g}"
        axes.plot(at, np.where(fit(at) < _LEAST_R_SQUARED, np.nan, fit(at)), color="black", label=label)
    axes.set(xlabel=_NUMBERS[curve], ylim=(_LEAST_R_SQUARED if np.any(own & low) else None, 1.03))
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="lower right", frameon=True, framealpha=0.85, edgecolor="none")


def _draw_predicted(axes: Axes, points: StudyPoints, curve: str, assessment: Assessment) -> None:
    own = points.of_curve(curve)
    simulated, predicted = (
        np.maximum(1.0 - values[own], _LEAST_MISFIT) for values in (points.r_squared, assessment.predicted)
    )
    ends = min(simulated.min(), predicted.min()) / 2.0, max(simulated.max(), predicted.max()) * 2.0
    axes.plot(ends, ends, color="0.5", linewidth=0.6, zorder=0)
    strain = np.abs(points.strain[own])
    dots = axes.scatter(
        simulated, predicted, c=strain, s=5, linewidths=0.0, cmap="viridis_r", vmin=0.0, vmax=0.5, rasterized=True
    )
    axes.set(xscale="log", yscale="log", xlim=ends, ylim=ends, xlabel="$1 - R^2$, simulated", aspect="equal")
    if curve == points.curves[-1]:
        axes.figure.colorbar(dots, ax=axes, label="strain between equilibria", extend="max")


def _interval(value: float, interval: tuple[float, float]) -> list[str]:
    return [f"{value:.4g}", f"{interval[0]:.3g} to {interval[1]:.3g}"]


def _error_cells(errors: ErrorDistribution) -> list[str]:
    return [
        f"{errors.points}", f"{errors.median:.2g}", f"{errors.ninth_decile:.2g}",
        f"{100.0 * errors.within_hundredth:.0f} %", f"{errors.median_factor:.2f}", f"{errors.ninth_decile_factor:.2f}",
        f"{errors.bias_factor:.2f}",
    ]  # fmt: skip


def _bounds(low: float, high: float) -> str:
    return f"{low:g} to {high:g}" if np.isfinite(high) else f"above {low:g}"


def _without_infinity(content: dict[str, Any]) -> dict[str, Any]:
    return content | {"high": content["high"] if np.isfinite(content["high"]) else None}
