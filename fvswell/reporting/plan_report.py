"""What `fvswell plan` gives: a table, words, a file and a figure of interval against protocol."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from fvswell.fitting.identifiability import COLLINEAR
from fvswell.fitting.planning import Plan, PlannedProtocol
from fvswell.reporting.console import TextTable
from fvswell.reporting.fit_report import width_text
from fvswell.reporting.plots import PAGE_WIDTH, in_print_style, time_text
from fvswell.reporting.reports import words
from fvswell.results.table import write_table

__all__ = ["plan_figure", "plan_lines", "plan_table", "write_plan"]

_MOST_SHOWN = 25
_PAIRS_SHOWN = 3
_LABEL = 38
_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
_MARKERS = "osD^vPX"
_WIDEST = 10.0  # half an interval, in the logarithm or of the range, beyond which it is drawn at the edge


def plan_table(plan: Plan) -> TextTable:
    """Half intervals of each parameter in each protocol, the best first; then the best pairs."""
    rows = [_row(each) for each in (*plan.protocols[:_MOST_SHOWN], *plan.pairs[:_PAIRS_SHOWN])]
    names = _names(plan)
    title = "What a fit would reach: half the interval of each parameter, the best protocol first"
    return TextTable(title, ["protocol", "lasts", *map(words, names), "collinearity"], rows)


def plan_lines(plan: Plan, confidence: float) -> list[str]:
    """What that says."""
    lines = [f"intervals hold the truth in {100.0 * confidence:g} % of experiments"]
    lines += [f"{_label(each)}: {each.reason}" for each in plan.protocols if each.reason]
    for name in plan.never_told:
        lines.append(f"no protocol tells {words(name)} to better than half of it")
    collinear = [each for each in plan.protocols if each.tells is not None and each.tells.collinearity > COLLINEAR]
    if collinear:
        lines.append(f"{len(collinear)} of {len(plan.protocols)} protocols tell some parameters in combination only")
    best = plan.best
    within = "" if np.isinf(plan.budget) else f" within {time_text(plan.budget)}"
    if best is None or best.tells is None:
        shortest = min(each.duration for each in plan.protocols)
        if shortest > plan.budget:
            return [
                *lines,
                f"no protocol is over within {time_text(plan.budget)}: the shortest takes {time_text(shortest)}",
            ]
        return [*lines, f"no protocol{within} tells all parameters"]
    told = ", ".join(
        f"{words(name)} to {width_text(width, is_log)}"
        for name, width, is_log in zip(best.tells.names, best.tells.together, best.tells.is_log, strict=True)
    )
    return [*lines, f"best{within}: {_label(best)}, {time_text(best.duration)}: {told}"]


def write_plan(path: Path, plan: Plan) -> None:
    """Write all protocols and pairs as text with commas."""
    names = _names(plan)
    header = ["protocol", "duration_s", "points", "score", "collinearity"]
    header += [f"{kind} {name}" for name in names for kind in ("half_interval", "half_interval_alone")]
    write_table(path, header, _lines(plan))


@in_print_style
def plan_figure(plan: Plan) -> Figure:
    """Half intervals of the parameters, a row for each protocol, the best at the top."""
    shown = [each for each in plan.protocols if each.tells is not None][:_MOST_SHOWN]
    names = _names(plan)
    labels = [fill(_label(each), _LABEL) for each in shown]
    lines = sum(label.count("\n") + 1 for label in labels)
    figure = Figure(figsize=(PAGE_WIDTH, 1.1 + 0.16 * lines + 0.1 * len(shown)), layout="constrained")
    axes = figure.subplots()
    place = np.arange(len(shown))[::-1]
    for index, name in enumerate(names):
        widths = np.array([_relative(each)[index] for each in shown])
        drawn = np.minimum(widths, _WIDEST)
        color, marker = _COLORS[index % len(_COLORS)], _MARKERS[index % len(_MARKERS)]
        open_ones = widths > _WIDEST
        style: dict[str, Any] = {"linestyle": "none", "marker": marker, "markersize": 4.5, "color": color}
        axes.plot(drawn[~open_ones], place[~open_ones], label=words(name), **style)
        axes.plot(drawn[open_ones], place[open_ones], markerfacecolor="none", **style)
    for row, each in zip(place, shown, strict=True):
        ends = np.minimum(_relative(each), _WIDEST)
        axes.plot([ends.min(), ends.max()], [row, row], color="0.8", linewidth=0.8, zorder=0)
    axes.axvline(0.1, color="0.6", linewidth=0.6, linestyle=(0, (1, 1.5)), zorder=0)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{100.0 * x:g} %"))
    axes.set_yticks(place, labels)
    axes.tick_params(axis="y", left=False)
    axes.set_ylim(-0.7, len(shown) - 0.3)
    axes.set_xlabel("half the interval, relative (of a logarithm, or of the range)")
    figure.legend(loc="outside upper right", ncols=min(len(names), 4))
    return figure


def _relative(protocol: PlannedProtocol) -> np.ndarray[Any, Any]:
    tells = protocol.tells
    assert tells is not None
    relative: np.ndarray[Any, Any] = tells.together / np.where(tells.is_log, 1.0, tells.ranges)
    return relative


def _names(plan: Plan) -> Sequence[str]:
    return next((each.tells.names for each in plan.protocols if each.tells is not None), ())


def _label(protocol: PlannedProtocol) -> str:
    return " and then ".join(protocol.names)


def _row(protocol: PlannedProtocol) -> list[str]:
    tells = protocol.tells
    if tells is None:
        return [_label(protocol), time_text(protocol.duration), "cannot be run"]
    widths = [width_text(width, is_log) for width, is_log in zip(tells.together, tells.is_log, strict=True)]
    return [_label(protocol), time_text(protocol.duration), *widths, f"{tells.collinearity:.1f}"]


def _lines(plan: Plan) -> Iterator[list[Any]]:
    for each in (*plan.protocols, *plan.pairs):
        row: list[Any] = [_label(each), each.duration, each.points, each.score]
        if each.tells is not None:
            row.append(each.tells.collinearity)
            for both in zip(each.tells.together, each.tells.alone, strict=True):
                row += both
        yield row
