"""Figures of a fit: data with the best curve and its band, residuals, profiles, and pairs of parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator

from fvswell.fitting.fit import FitResult
from fvswell.fitting.parameters import Parameters
from fvswell.physics.tissue import Array
from fvswell.reporting.plots import PAGE_WIDTH, axis_label, handy_time, in_print_style, print_unit
from fvswell.reporting.reports import words

if TYPE_CHECKING:
    pass

__all__ = ["FIT_FIGURES", "fit_figures"]

FIT_FIGURES = ("fit_curves", "fit_profiles", "fit_pairs")
_DATA, _CURVE, _BAND, _LIMIT = "0.35", "#0072B2", "#56B4E9", "#D55E00"
_COLUMNS = 3
_POINTS = 200  # of a drawn ellipse
_MOST_DRAWN = 2000  # points of a data set
_PRINT_UNITS = {  # internal unit of a parameter: factor, unit in print
    "mm^4/(N s)": (1.0, "mm⁴ N⁻¹ s⁻¹"), "mmol/mm^3": (1e3, "M"), "mm^2/s": (1.0, "mm² s⁻¹"),
}  # fmt: skip


def fit_figures(result: FitResult) -> dict[str, Figure]:
    """Figures by name."""
    figures = {"fit_curves": curves_figure(result)}
    if result.profiles:
        figures["fit_profiles"] = profiles_figure(result)
    if len(result.best.values) > 1:
        figures["fit_pairs"] = pairs_figure(result)
    return figures


@in_print_style
def curves_figure(result: FitResult) -> Figure:
    """Each measurement with the best curve, the band that the parameters leave and that of the data, and residuals."""
    problem, best = result.problem, result.best
    columns = min(len(problem.measurements), _COLUMNS)
    rows = -(-len(problem.measurements) // columns)
    figure = Figure(figsize=(PAGE_WIDTH, 3.2 * rows), layout="constrained")
    grid = figure.add_gridspec(2 * rows, columns, height_ratios=[3, 1] * rows)
    band = _curve_band(result)
    for index, (measurement, span) in enumerate(zip(problem.measurements, problem.spans, strict=True)):
        row, column = divmod(index, columns)
        above = figure.add_subplot(grid[2 * row, column])
        below = figure.add_subplot(grid[2 * row + 1, column], sharex=above)
        factor, _ = print_unit(measurement.quantity)
        scale, unit = handy_time(float(measurement.times[-1]))
        at, data = measurement.times * scale, measurement.values * factor
        curve, half = best.curves[span.points] * factor, band[span.points] * factor
        every = slice(None, None, max(len(at) // _MOST_DRAWN, 1))
        dots: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 1.8, "markeredgewidth": 0.0}
        above.plot(at[every], data[every], color=_DATA, label="measured", zorder=1, **dots)
        above.fill_between(at, curve - half, curve + half, color=_BAND, alpha=0.5, linewidth=0.0, zorder=2,
                           label=f"{100.0 * problem.settings.confidence:g} % of the curve")  # fmt: skip
        above.plot(at, curve, color=_CURVE, linewidth=1.1, label="best", zorder=3)
        above.set_ylabel(axis_label(measurement.quantity))
        above.set_title(measurement.name)
        above.tick_params(labelbottom=False)
        noise = best.noise[index] * factor
        below.axhspan(-noise, noise, color="0.9", zorder=0)
        below.axhline(0.0, color="0.6", linewidth=0.6, zorder=1)
        below.plot(at[every], (data - curve)[every], color=_DATA, **dots)
        below.set(xlabel=f"time ({unit})", ylabel="residual")
        below.yaxis.set_major_locator(MaxNLocator(3))
        if index == 0:
            above.legend(loc="best")
    figure.align_ylabels()
    return figure


@in_print_style
def profiles_figure(result: FitResult) -> Figure:
    """Growth of the squares along each parameter to the quantile; dashed the parabola of the covariance."""
    count = len(result.profiles)
    columns = min(count, _COLUMNS)
    rows = -(-count // columns)
    figure = Figure(figsize=(PAGE_WIDTH, 2.1 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False)
    for panel in panels.flat[count:]:
        panel.set_axis_off()
    best, parameters = result.best, result.problem.parameters
    for index, (panel, profile) in enumerate(zip(panels.flat, result.profiles, strict=False)):
        error, own = best.standard_errors[index], profile.own
        centre = best.coordinates[index]
        fine = np.linspace(own.min(), own.max(), _POINTS)
        if np.isfinite(error):
            panel.plot(_values(parameters, index, fine), ((fine - centre) / error) ** 2, color="0.6", linewidth=0.8,
                       linestyle=(0, (4, 2)), label="from the covariance")  # fmt: skip
        if len(own) > 2:
            panel.plot(_values(parameters, index, fine), _smooth(own, profile.ratio, fine, centre), color=_CURVE)
        panel.plot(_values(parameters, index, own), profile.ratio, color=_CURVE, linestyle="none", marker="o",
                   markersize=2.5, label="profile")  # fmt: skip
        panel.axhline(profile.quantile, color=_LIMIT, linewidth=0.8)
        for end in (profile.low, profile.high):
            if np.isfinite(end):
                panel.axvline(
                    end * _print_factor(parameters, index),
                    color=_LIMIT,
                    linewidth=0.6,
                    linestyle=(0, (1, 1.5)),
                )
        panel.set_ylim(-0.05 * profile.quantile, 1.8 * profile.quantile)
        panel.set_xlabel(_label(result, index))
        _plain_ticks(panel.xaxis)
        panel.set_ylabel("likelihood ratio" if index % columns == 0 else "")
    panels.flat[0].legend(loc="upper center")
    return figure


@in_print_style
def pairs_figure(result: FitResult) -> Figure:
    """Pairs of parameters: ellipses of the covariance, ways of the profiles, samples where there are any."""
    count = len(result.best.values)
    figure = Figure(figsize=(PAGE_WIDTH, PAGE_WIDTH * (0.35 if count == 2 else 0.85)), layout="constrained")
    panels = figure.subplots(count - 1, count - 1, squeeze=False)
    best, parameters = result.best, result.problem.parameters
    for row in range(1, count):
        for column in range(count - 1):
            panel = panels[row - 1, column]
            if column >= row:
                panel.set_axis_off()
                continue
            if result.samples is not None:
                few = result.samples.values[:: max(len(result.samples.values) // _MOST_DRAWN, 1)]
                drawn = [few[:, i] * _print_factor(parameters, i) for i in (column, row)]
                panel.plot(*drawn, linestyle="none", marker="o", markersize=1.2, alpha=0.3, markeredgewidth=0.0,
                           color=_DATA, zorder=1)  # fmt: skip
            ellipse = _ellipse(
                best.covariance[np.ix_([column, row], [column, row])], result.problem.settings.confidence
            )
            if ellipse is not None:
                x, y = best.coordinates[[column, row]][:, None] + ellipse
                panel.plot(_values(parameters, column, x), _values(parameters, row, y), color=_CURVE, linewidth=0.9)
            for profile in (each for i, each in enumerate(result.profiles) if i in (row, column)):
                ways = [_values(parameters, i, profile.coordinates[:, i]) for i in (column, row)]
                panel.plot(*ways, color=_LIMIT, linewidth=0.8, marker="o", markersize=1.8)
            centre = [_values(parameters, i, best.coordinates[i]) for i in (column, row)]
            panel.plot(*centre, color="black", marker="+", markersize=6, linestyle="none")
            _plain_ticks(panel.xaxis)
            _plain_ticks(panel.yaxis)
            panel.tick_params(labelbottom=row == count - 1, labelleft=column == 0)
            if row == count - 1:
                panel.set_xlabel(_label(result, column))
            if column == 0:
                panel.set_ylabel(_label(result, row))
    _pairs_legend(figure, result)
    return figure


def _pairs_legend(figure: Figure, result: FitResult) -> None:
    """What the lines and dots of the pairs are."""
    region = f"{100.0 * result.problem.settings.confidence:g} % region of the covariance"
    kinds: list[tuple[str, dict[str, Any]]] = [(region, {"color": _CURVE, "linewidth": 0.9})]
    if result.profiles:
        kinds.append(("ways of the profiles", {"color": _LIMIT, "linewidth": 0.8, "marker": "o", "markersize": 1.8}))
    if result.samples is not None:
        kinds.append(
            ("samples of the posterior", {"color": _DATA, "linestyle": "none", "marker": "o", "markersize": 2})
        )
    handles = [Line2D([], [], label=label, **style) for label, style in kinds]
    figure.legend(handles=handles, loc="outside upper right", ncols=len(handles))


def _curve_band(result: FitResult) -> Array:
    """Half the width of the band that the data leave to the curve, linearised, (points,)."""
    from scipy.stats import norm, t

    best, problem = result.best, result.problem
    share = 0.5 + 0.5 * problem.settings.confidence
    factor = norm.ppf(share) if problem.noise_is_known else t.ppf(share, problem.degrees_of_freedom)
    variance = np.einsum("ij,jk,ik->i", best.sensitivities, best.covariance, best.sensitivities)
    return np.nan_to_num(float(factor) * np.sqrt(np.maximum(variance, 0.0)))


def _ellipse(covariance: Array, confidence: float) -> Array | None:
    """Outline of the region of two parameters about 0, (2, points); None where it is not known."""
    from scipy.stats import chi2

    if not np.isfinite(covariance).all():
        return None
    values, vectors = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * np.pi, _POINTS)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    outline: Array = np.sqrt(chi2.ppf(confidence, 2)) * vectors @ (np.sqrt(np.maximum(values, 0.0))[:, None] * circle)
    return outline


def _smooth(own: Array, ratio: Array, at: Array, centre: float) -> Array:
    """The profile between its points: its signed root is nearly straight."""
    from scipy.interpolate import PchipInterpolator

    usable = np.isfinite(ratio)
    roots = np.sign(own - centre) * np.sqrt(np.maximum(ratio, 0.0))
    smooth: Array = PchipInterpolator(own[usable], roots[usable], extrapolate=False)(at) ** 2
    return smooth


def _values(parameters: Parameters, index: int, coordinates: Array) -> Array:
    """Values of a parameter in the unit in print."""
    values = np.exp(coordinates) if parameters.free[index].log else coordinates
    return _print_factor(parameters, index) * values


def _print_factor(parameters: Parameters, index: int) -> float:
    return _PRINT_UNITS.get(parameters.free[index].unit, (1.0, ""))[0]


def _plain_ticks(axis: Any) -> None:
    """Few ticks, each with its whole number: a power of ten beside the axis would run into its label."""
    axis.set_major_locator(MaxNLocator(4))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.4g}"))


def _label(result: FitResult, index: int) -> str:
    parameter = result.problem.parameters.free[index]
    unit = _PRINT_UNITS.get(parameter.unit, (1.0, parameter.unit))[1]
    return f"{words(parameter.name)} ({unit})" if unit else words(parameter.name)
