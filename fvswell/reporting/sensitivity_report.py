"""What `fvswell sensitivity` gives: tables, a file and a figure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fvswell.analysis.sensitivity import Sensitivity, SobolIndices
from fvswell.reporting.console import TextTable
from fvswell.reporting.plots import PAGE_WIDTH, in_print_style
from fvswell.results.table import write_table

__all__ = ["sensitivity_figure", "sensitivity_tables", "write_sensitivity"]

_BAR = 0.36
_SOURCES = {"predictor": "#0072B2", "models": "#D55E00"}


def sensitivity_tables(results: Sequence[Sensitivity]) -> list[TextTable]:
    """A table for each protocol and phase, the most important parameter first."""
    tables = []
    for result in results:
        for phase, name in enumerate(result.phases):
            header, rows = ["parameter"], [[result.parameters[i]] for i in _order(result, phase)]
            for source, indices in _sources(result):
                header += [f"first, {source}", "+-", f"total, {source}", "+-"]
                for row, i in zip(rows, _order(result, phase), strict=True):
                    row += [f"{values[i, phase]:.2f}" for values in _columns(indices)]
            effort = "; ".join(
                f"{source}: {indices.evaluations} runs, log10(1 - R^2) {indices.mean[phase]:.2f} "
                f"+- {indices.deviation[phase]:.2f}"
                for source, indices in _sources(result)
            )
            tables.append(TextTable(f"{result.protocol}, {name}: Sobol indices ({effort})", header, rows))
    return tables


def write_sensitivity(path: Path, results: Sequence[Sensitivity]) -> None:
    """Write the indices as text with commas.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    header = ["protocol", "phase", "parameter", "source", "evaluations", "first", "first_confidence", "total",
              "total_confidence"]  # fmt: skip
    write_table(path, header, _lines(results))


@in_print_style
def sensitivity_figure(results: Sequence[Sensitivity]) -> Figure:
    """Wide bars for total indices with 95 % intervals, narrow ones for first indices; a panel for each phase."""
    columns = max(len(result.phases) for result in results)
    height = sum(0.9 + 0.27 * len(result.parameters) for result in results)
    figure = Figure(figsize=(PAGE_WIDTH, height), layout="constrained")
    ratios = [len(result.parameters) for result in results]
    axes = figure.subplots(len(results), columns, squeeze=False, height_ratios=ratios)
    for row, result in zip(axes, results, strict=True):
        order = _order(result, 0)[::-1]  # the same in all phases, so that they can be compared
        place = np.arange(len(order))
        for phase, (panel, name) in enumerate(zip(row, result.phases, strict=False)):
            for shift, (source, indices) in zip((0.5, -0.5), _sources(result), strict=False):
                total, first = indices.total[order, phase], np.maximum(indices.first[order, phase], 0.0)
                style: dict[str, Any] = {"color": _SOURCES[source]}
                error = {
                    "xerr": indices.total_confidence[order, phase],
                    "error_kw": {"linewidth": 0.7, "color": "0.25"},
                }
                at = place + shift * _BAR
                panel.barh(at, total, _BAR, alpha=0.35, label=f"{source}, total", **error, **style)
                panel.barh(at, first, 0.4 * _BAR, label=f"{source}, first", **style)
            panel.set_yticks(place, [result.parameters[i].replace("_", " ") for i in order])
            panel.tick_params(labelleft=phase == 0, left=False)
            panel.set(title=f"{result.protocol}, {name}", xlim=(0.0, None), xlabel="Sobol index of log$_{10}(1 - R^2)$")
    axes[0, -1].legend(loc="lower right")
    return figure


def _order(result: Sensitivity, phase: int) -> list[int]:
    return [int(i) for i in np.argsort(-result.predictor.total[:, phase])]


def _sources(result: Sensitivity) -> list[tuple[str, SobolIndices]]:
    models = [] if result.models is None else [("models", result.models)]
    return [("predictor", result.predictor), *models]


def _columns(indices: SobolIndices) -> tuple[np.ndarray[Any, Any], ...]:
    return indices.first, indices.first_confidence, indices.total, indices.total_confidence


def _lines(results: Sequence[Sensitivity]) -> Iterator[list[Any]]:
    for result in results:
        for phase, name in enumerate(result.phases):
            for i, parameter in enumerate(result.parameters):
                for source, indices in _sources(result):
                    numbers = [values[i, phase] for values in _columns(indices)]
                    yield [result.protocol, name, parameter, source, indices.evaluations, *numbers]
