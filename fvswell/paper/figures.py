"""The paper's figures, drawn anew: histories (3, 4), local strains (5, 6), the sweep (7, 8) and the block (9).

Our copy of the paper has no figures. What they show is inferred from its text: docs/studies.md says how.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from fvswell.analysis.comparison import ColumnDifference, Comparison
from fvswell.analysis.histories import history_at, local_strain, profile_at
from fvswell.analysis.rules import CurveFit
from fvswell.fitting.reduced_model import ReducedFit
from fvswell.paper.reproduction import PaperResults
from fvswell.reporting.plots import PAGE_WIDTH, axis_label, draw_histories, in_print_style, line_styles, time_unit
from fvswell.reporting.rules_report import draw_fit
from fvswell.study.points import CURVES, PAPER_MODELS, StudyPoints

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["FIGURES", "paper_figures"]

FIGURES = ("figure3", "figure4", "figure5", "figure6", "figure7", "figure8", "figure9")

_REDUCED, _FULL = PAPER_MODELS
_DRAWN = 300  # points of a history, denser where it begins
_BLURRED = 1e-3  # of a phase: before, the models' own times differ by too much for their difference
_COLUMN_WIDTH = 85.0 / 25.4  # inches, of a journal page


def paper_figures(results: PaperResults) -> dict[str, Figure]:
    """Figures by name."""
    drawn = (
        _histories(results.compression),
        _histories(results.swelling),
        _local_strains(results.compression),
        _local_strains(results.swelling),
        _sweep(results.points, CURVES[:2], results.fits),
        _sweep(results.points, CURVES[2:], results.fits),
        _block(results.block),
    )
    return dict(zip(FIGURES, drawn, strict=True))


@in_print_style
def _histories(comparison: Comparison) -> Figure:
    """Global strain of the three models, and the error of biphasic-swelling."""
    figure = Figure(figsize=(PAGE_WIDTH, 2.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    draw_histories(left, comparison.results, line_styles(comparison.results))
    scale, unit = time_unit(comparison.results)
    time, gap = comparison.gap(_REDUCED)
    right.axhline(0.0, color="0.6", linewidth=0.6, zorder=0)
    right.plot(time * scale, 100.0 * gap, color=line_styles(comparison.results)[_REDUCED].color)
    for difference in _reduced(comparison):
        right.plot(difference.time * scale, 100.0 * difference.largest, "o", color="black", markersize=3)
        label = f"{100.0 * difference.largest:+.2f} %\nafter {difference.time_in_phase * scale:.0f} {unit}"
        right.annotate(
            label, (difference.time * scale, 100.0 * difference.largest), textcoords="offset points", fontsize=7,
            xytext=(7, 5 if difference.largest > 0.0 else -5), va="bottom" if difference.largest > 0.0 else "top",
        )  # fmt: skip
    right.margins(x=0.02, y=0.22)
    right.set(xlabel=f"time ({unit})", ylabel=f"global strain, {_REDUCED}\nless {_FULL} (%)")
    _letter([left, right])
    return figure


@in_print_style
def _local_strains(comparison: Comparison) -> Figure:
    """Local strain of the swelling models when they are farthest apart, and the difference over it."""
    figure = Figure(figsize=(PAGE_WIDTH, 3.6), layout="constrained")
    differences = _reduced(comparison)
    axes = figure.subplots(2, len(differences), sharex=True, sharey="row", squeeze=False)
    lines, (scale, unit) = line_styles(comparison.results), time_unit(comparison.results)
    for (above, below), difference in zip(axes.T, differences, strict=True):
        strains = {}
        for model in (_FULL, _REDUCED):
            result = comparison.results[model]
            strains[model] = profile_at(result, local_strain(result), difference.time)
            x, line = result["x"].values, lines[model]
            above.plot(x, 100.0 * strains[model], color=line.color, linestyle=line.style, label=model)
        error = np.abs(strains[_REDUCED] - strains[_FULL]) / np.abs(strains[_FULL])
        below.plot(x, 100.0 * error, color="black")
        above.set_title(f"{difference.phase}, after {difference.time_in_phase * scale:.0f} {unit}")
        below.set(xlabel="distance from filter (mm)", xlim=(0.0, float(result["x_node"][-1])))
    axes[1, 0].set_ylim(bottom=0.0)
    axes[0, 0].set_ylabel("local strain (%)")
    axes[1, 0].set_ylabel(f"error of {_REDUCED}\n(% of local strain)")
    axes[0, 0].legend()
    _letter(axes.ravel())
    return figure


@in_print_style
def _sweep(points: StudyPoints, curves: Sequence[str], fits: dict[str, CurveFit]) -> Figure:
    """R^2 against the paper's number, with its fit."""
    width = PAGE_WIDTH if len(curves) > 1 else _COLUMN_WIDTH * 1.2
    figure = Figure(figsize=(width, 2.7), layout="constrained")
    axes = figure.subplots(1, len(curves), sharey=True, squeeze=False)[0]
    for panel, curve in zip(axes, curves, strict=True):
        draw_fit(panel, points, curve, fits.get(curve))
        panel.set_title(curve)
    axes[0].set_ylabel("$R^2$")
    if len(curves) > 1:
        _letter(axes)
    return figure


@in_print_style
def _block(fitted: ReducedFit) -> Figure:
    """Displacement of the probe by phase: the full model, and biphasic-swelling before and after the fit."""
    figure = Figure(figsize=(PAGE_WIDTH, 3.8), layout="constrained")
    results = {
        _FULL: fitted.reference_result,
        f"{_REDUCED}, k of the tissue": fitted.unfitted_result,
        f"{_REDUCED}, {fitted.ratio:.3f} k": fitted.fitted_result,
    }
    (quantity,), (scale, unit), lines = fitted.quantities, time_unit(results), line_styles(results)
    starts = [0.0, *fitted.reference_result["phase_end"].values]
    phases = fitted.problem.case.phase
    axes = figure.subplots(2, len(phases), sharex="col", squeeze=False)
    for (above, below), phase, (start, end) in zip(axes.T, phases, pairwise(starts), strict=True):
        at = start + (end - start) * np.linspace(0.0, 1.0, _DRAWN) ** 2
        histories = {
            label: history_at(result["time"].values, result[quantity].values, start, at)
            for label, result in results.items()
        }
        for label, values in histories.items():
            line = lines[label]
            above.plot((at - start) * scale, values, color=line.color, linestyle=line.style, label=label)
            if label != _FULL:
                gap = np.where(at > start + _BLURRED * (end - start), values - histories[_FULL], np.nan)
                below.plot((at - start) * scale, gap, color=line.color, linestyle=line.style)
        below.axhline(0.0, color="0.6", linewidth=0.6, zorder=0)
        above.set_title(phase.name)
        below.set(xlabel=f"time in the phase ({unit})")
        below.margins(x=0.02)
    axes[0, 0].set_ylabel(axis_label(quantity))
    axes[1, 0].set_ylabel(f"the same,\nless {_FULL} (mm)")
    axes[0, 0].legend()
    _letter(axes.ravel())
    return figure


def _reduced(comparison: Comparison) -> list[ColumnDifference]:
    return [d for d in comparison.differences if isinstance(d, ColumnDifference) and d.model == _REDUCED]


def _letter(panels: Iterable[Axes]) -> None:
    for letter, axes in zip("abcdef", panels, strict=False):
        axes.set_title(letter, loc="left", fontweight="bold")
