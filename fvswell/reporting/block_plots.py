"""Figures for print of blocks: histories of the probe, and fields on the grid as it moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from fvswell.analysis.comparison import Comparison
from fvswell.analysis.histories import is_known, local_strain, profile_at
from fvswell.boundary.parts import Part
from fvswell.case.case import Case
from fvswell.errors import OutputError
from fvswell.physics.tissue import Array
from fvswell.reporting.part_marks import mark_parts, part_legend
from fvswell.reporting.plots import (
    LABEL_WIDTH,
    MOST_COLUMNS,
    PAGE_WIDTH,
    axis_label,
    draw_gaps,
    draw_histories,
    histories_among,
    in_print_style,
    line_styles,
    nearest_model,
    print_unit,
    time_text,
    time_unit,
)
from fvswell.results.fields import FIELDS
from fvswell.results.moved_grid import AXES, is_block, moved_nodes, quadrilaterals

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["all_blocks", "block_comparison_figure", "block_figure"]

_HISTORY_HEIGHT = 2.0  # inches
_TITLES_HEIGHT = 0.5
_PANEL_SPACE = 0.16  # between rows of panels
_BAR_WIDTH = 0.85  # colour bar with its numbers and label
_SHORTEST_PANEL, _TALLEST_PANEL = 1.0, 2.6
_LETTERS = 13  # of a label along an inch
_MOST_SLENDER = 8.0  # length over width of what is drawn to scale
_MARGIN = 0.03  # of the width of the block, around it
_FIELD_COLOURS, _DIFFERENCE_COLOURS = "viridis", "RdBu_r"


def all_blocks(results: Mapping[str, xr.Dataset]) -> bool:
    """Whether results are of blocks; False if they are of columns.

    Raises
    ------
    OutputError
        If there are some of each: they do not go into one figure.
    """
    blocks = [label for label, result in results.items() if is_block(result)]
    if blocks and len(blocks) < len(results):
        columns = [label for label in results if label not in blocks]
        raise OutputError(f"blocks ({', '.join(blocks)}) and columns ({', '.join(columns)}) need figures of their own")
    return bool(blocks)


@in_print_style
def block_figure(results: Mapping[str, xr.Dataset], times: Sequence[float], variables: Sequence[str]) -> Figure:
    """Histories against time, and a row of maps for each variable and result, a panel for each time.

    Parameters
    ----------
    results
        Results of blocks by label.
    times
        Times of the maps, s.
    variables
        Histories, and fields in cells or at nodes. Without a history the displacement of the probe is drawn.
    """
    histories, variables = histories_among(results, variables)
    histories = histories or [f"probe_displacement_{axis}" for axis in AXES]
    rows = [(name, label) for name in variables for label, result in results.items() if name in result]
    limits = _limits(results, times)
    columns = max(len(times), 1)
    abreast = min(len(histories), 2)
    above = -(-len(histories) // abreast)
    heights = [_HISTORY_HEIGHT * above] + [_panel_height(limits, columns)] * len(rows)
    figure = Figure(figsize=(PAGE_WIDTH, sum(heights) + _TITLES_HEIGHT), layout="constrained")
    parts = figure.subfigures(1 + bool(rows), 1, squeeze=False, height_ratios=_ratios(heights)[: 1 + bool(rows)])
    top, below = parts[0, 0], parts[-1, 0]
    lines = line_styles(results)
    scale, _ = time_unit(results)
    for history, axes in zip(histories, top.subplots(above, abreast, squeeze=False).flat, strict=False):
        draw_histories(axes, results, lines, history)
        for at in times:
            axes.axvline(at * scale, color="0.75", linewidth=0.6, zorder=0)
        if history != histories[0]:
            axes.legend().remove()
    if not rows:
        return figure
    panels = below.subplots(len(rows), columns, squeeze=False, sharex=True, sharey=True)
    part_legend(below, _boundary_parts(next(iter(results.values())).attrs["case_toml"])[0])
    for row, (name, label) in enumerate(rows):
        colours = _colours(results, times, name)
        for column, at in enumerate(times):
            axes = panels[row, column]
            _draw_field(axes, results[label], name, at, colours)
            _frame(axes, limits)
            axes.tick_params(left=column == 0, bottom=row == len(rows) - 1)
            if row == 0:
                axes.set_title(f"$t$ = {time_text(at)}")
            if row == len(rows) - 1:
                axes.set_xlabel("$x$ (mm)")
        names = [] if len(results) == 1 else [label.replace("/", "/\n")]
        panels[row, 0].set_ylabel("\n".join([*names, _height_label(limits)]))
    for name in variables:
        own = [row for row, (each, _) in enumerate(rows) if each == name]
        if own:
            bar = below.colorbar(
                _colours(results, times, name), ax=list(panels[own].ravel()), pad=0.01, aspect=14 * len(own)
            )
            letters = int(_LETTERS * len(own) * _panel_height(limits, columns))
            bar.set_label(fill(axis_label(name), min(LABEL_WIDTH, letters)))
            bar.outline.set_linewidth(0.4)
    return figure


@in_print_style
def block_comparison_figure(comparison: Comparison) -> Figure:
    """Histories of the models, how far they are from the reference, and where in the block they differ most.

    The maps are of the local strain of the nearest of the other models less that of the reference, at the time of the
    largest difference of the histories.
    """
    results, lines = comparison.results, line_styles(comparison.results)
    phases = comparison.phases[:MOST_COLUMNS]
    nearest = [nearest_model(comparison, phase) for phase in phases]
    base = comparison.results[comparison.reference]
    limits = _limits({comparison.reference: base}, [each.time for each in nearest])
    heights = [_HISTORY_HEIGHT, _panel_height(limits, len(phases)) + _TITLES_HEIGHT]
    figure = Figure(figsize=(PAGE_WIDTH, sum(heights)), layout="constrained")
    top, below = figure.subfigures(2, 1, squeeze=False, height_ratios=heights)[:, 0]
    histories, gaps = top.subplots(1, 2)
    draw_histories(histories, results, lines, comparison.quantity)
    draw_gaps(gaps, comparison, lines)
    differences = []
    for each in nearest:
        own, reference = (profile_at(result, local_strain(result), each.time) for result in (results[each.model], base))
        differences.append(own - reference)
    largest = max(float(np.nanmax(np.abs(difference))) for difference in differences) or 1.0
    colours = ScalarMappable(Normalize(-largest, largest), _DIFFERENCE_COLOURS)
    panels = below.subplots(1, len(phases), squeeze=False, sharex=True, sharey=True)[0]
    part_legend(below, _boundary_parts(base.attrs["case_toml"])[0])
    for axes, each, difference in zip(panels, nearest, differences, strict=True):
        _draw_cells(axes, base, difference, each.time, colours)
        _frame(axes, limits)
        axes.tick_params(left=axes is panels[0])
        axes.set_title(f"{each.phase}, after {time_text(each.time_in_phase)}:\n{each.model}")
        axes.set_xlabel("$x$ (mm)")
    panels[0].set_ylabel(_height_label(limits))
    bar = below.colorbar(colours, ax=list(panels), pad=0.01)
    bar.set_label(f"local strain,\nless that of\n{comparison.reference}")
    bar.outline.set_linewidth(0.4)
    for letter, axes in zip("abcdef", (histories, gaps, *panels), strict=False):
        axes.set_title(letter, loc="left", fontweight="bold")
    return figure


def _ratios(heights: Sequence[float]) -> list[float]:
    return [heights[0], sum(heights[1:]) + _TITLES_HEIGHT]


def _limits(results: Mapping[str, xr.Dataset], times: Sequence[float]) -> Array:
    """Least and largest coordinates of all that is drawn, ``(2 axes, 2)``, mm."""
    drawn = [moved_nodes(result, at) for result in results.values() for at in [0.0, *times] if is_known(result, at)]
    points = np.concatenate(drawn, axis=1)
    low, high = points.min(axis=1), points.max(axis=1)
    slender = not _to_scale(np.stack([low, high], axis=1))
    margin = _MARGIN * (high - low if slender else high[0] - low[0])
    return np.stack([low - margin, high + margin], axis=1)


def _slenderness(limits: Array) -> float:
    """Height over width of what is drawn."""
    width, height = np.diff(limits, axis=1)[:, 0]
    return float(height / width)


def _to_scale(limits: Array) -> bool:
    return 1.0 / _MOST_SLENDER <= _slenderness(limits) <= _MOST_SLENDER


def _panel_height(limits: Array, columns: int) -> float:
    tallest = (PAGE_WIDTH - _BAR_WIDTH) / columns * _slenderness(limits)
    return float(np.clip(tallest, _SHORTEST_PANEL, _TALLEST_PANEL)) + _PANEL_SPACE


def _colours(results: Mapping[str, xr.Dataset], times: Sequence[float], name: str) -> ScalarMappable:
    """The scale of a variable, the same for all times and results."""
    values = np.concatenate(
        [
            profile_at(result, result[name].values, at)
            for result in results.values()
            if name in result
            for at in times
            if is_known(result, at)
        ]
        or [np.zeros(1)]
    )
    factor = print_unit(name)[0]
    return ScalarMappable(Normalize(factor * values.min(), factor * values.max()), _FIELD_COLOURS)


def _frame(axes: Axes, limits: Array) -> None:
    axes.set(xlim=limits[0], ylim=limits[1], aspect="equal" if _to_scale(limits) else "auto")
    axes.spines[["left", "bottom"]].set_visible(False)
    axes.tick_params(length=2.0)


def _height_label(limits: Array) -> str:
    return "$y$ (mm)" if _to_scale(limits) else "$y$ (mm),\nnot to scale"


def _draw_field(axes: Axes, result: xr.Dataset, name: str, at: float, colours: ScalarMappable) -> None:
    if not is_known(result, at):
        axes.text(0.5, 0.5, "no output", transform=axes.transAxes, ha="center", va="center", color="0.5")
        return
    values = profile_at(result, result[name].values, at) * print_unit(name)[0]
    if FIELDS[name].location == "node":
        values = values[quadrilaterals(result)].mean(axis=1)
    _draw_cells(axes, result, values, at, colours)


def _draw_cells(axes: Axes, result: xr.Dataset, values: Array, at: float, colours: ScalarMappable) -> None:
    """Fill the cells where they are, and draw the outline of the block there and in equilibrium."""
    cells = quadrilaterals(result)
    corners = moved_nodes(result, at).T[cells]
    style: dict[str, Any] = {"facecolors": colours.to_rgba(values), "edgecolors": "face", "linewidths": 0.1}
    axes.add_collection(PolyCollection(list(corners), rasterized=True, **style))
    before = moved_nodes(result, 0.0).T[_boundary(cells)]
    axes.add_collection(LineCollection(list(before), colors="0.55", linewidths=0.7, capstyle="round"))
    mark_parts(axes, *_boundary_parts(result.attrs["case_toml"]), moved_nodes(result, at))


@lru_cache(maxsize=8)
def _boundary_parts(case_toml: str) -> tuple[tuple[Part, ...], tuple[Array, Array]]:
    """Parts of the boundary of a block, and the lines of its grid, from the case in a result."""
    case = Case.from_toml(case_toml)
    geometry: Any = case.geometry
    return case.parts, geometry.grid_nodes(case.parts)


def _boundary(cells: Array) -> Array:
    """Pairs of nodes of the edges that belong to one cell only, ``(edges, 2)``."""
    edges = np.sort(np.stack([cells, np.roll(cells, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    unique, counts = np.unique(edges, axis=0, return_counts=True)
    return unique[counts == 1]
