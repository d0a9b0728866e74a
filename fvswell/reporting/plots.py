"""Figures for print: histories of columns and profiles over their depth.

Sizes are those of a journal page. Colours (Okabe & Ito) are distinct to the colour-blind, and lines
differ in style as well. Figures are made without pyplot, so no display or global state is involved.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from fvswell.analysis.comparison import Comparison, Difference
from fvswell.analysis.histories import local_strain, profile_at
from fvswell.case.acting_loads import acting_loads, moved_part
from fvswell.case.case import Case
from fvswell.case.errors import nearest_name
from fvswell.errors import OutputError
from fvswell.physics.tissue import Array
from fvswell.results.fields import FIELDS, field, is_field
from fvswell.units import QuantityError, number_or_text, parse

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "FORMATS",
    "LABEL_WIDTH",
    "MOST_COLUMNS",
    "PAGE_WIDTH",
    "Line",
    "axis_label",
    "chosen_times",
    "chosen_variables",
    "comparison_figure",
    "draw_gaps",
    "draw_histories",
    "handy_time",
    "histories_among",
    "in_print_style",
    "line_styles",
    "lines_in_order",
    "nearest_model",
    "print_unit",
    "result_figure",
    "result_labels",
    "save_figure",
    "time_text",
    "time_unit",
]

FORMATS = (".png", ".pdf", ".svg")

PAGE_WIDTH = 180.0 / 25.4  # inches: two columns of a journal page
_DEFAULT_VARIABLES = ("volume_ratio", "fluid_pressure", "anion_concentration")
_DEFAULT_TIMES = (0.02, 0.1, 0.5)  # of the first phase
MOST_COLUMNS = 4
LABEL_WIDTH = 22  # letters that fit beside a panel
_DEPTH_LABEL = "distance from filter (mm)"
_PRINT_STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.titlesize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-3, 4),
    "axes.formatter.use_mathtext": True,
    "lines.linewidth": 1.3,
    "pdf.fonttype": 42,  # text stays text
    "svg.fonttype": "none",
    "savefig.dpi": 300,
}


class Line(NamedTuple):
    """Colour and style of a curve."""

    color: str
    style: Any


_MODEL_LINES = {
    "electrochemical": Line("#0072B2", "-"),
    "biphasic-swelling": Line("#D55E00", (0, (4, 1.5))),
    "biphasic": Line("#009E73", (0, (1, 1.2))),
}
_OTHER_LINES = (
    Line("#0072B2", "-"),
    Line("#D55E00", (0, (4, 1.5))),
    Line("#009E73", (0, (1, 1.2))),
    Line("#CC79A7", (0, (6, 1.5, 1, 1.5))),
    Line("#000000", "-"),
    Line("#E69F00", (0, (4, 1.5))),
    Line("#56B4E9", (0, (1, 1.2))),
)
_PRINT_UNITS = {  # unit in the file: factor, unit in print
    "N mm-2": (1.0, "MPa"),
    "mmol mm-3": (1e3, "M"),
    "mm s-1": (1e3, "µm/s"),
    "mmol mm-2 s-1": (1e6, "nmol/(mm² s)"),
    "A mm-2": (1e6, "µA/mm²"),
    "A": (1e6, "µA"),
    "mm3": (1.0, "mm³"),
    "mmol mm-2": (1e6, "nmol/mm²"),
    "mmol": (1e6, "nmol"),
}
_Parameters = ParamSpec("_Parameters")


def in_print_style(draw: Callable[_Parameters, Figure]) -> Callable[_Parameters, Figure]:
    """Draw a figure with sizes and fonts for print."""

    @wraps(draw)
    def styled(*args: _Parameters.args, **kwargs: _Parameters.kwargs) -> Figure:
        with mpl.rc_context(_PRINT_STYLE):
            return draw(*args, **kwargs)

    return styled


@in_print_style
def result_figure(results: Mapping[str, xr.Dataset], times: Sequence[float], variables: Sequence[str]) -> Figure:
    """Histories, and a row of profiles for each variable with a panel for each time.

    Parameters
    ----------
    results
        Results of columns by label.
    times
        Times of the profiles, s.
    variables
        Histories, and fields in cells or at nodes. Without a history that which the experiment measures is drawn.
    """
    histories, variables = histories_among(results, variables)
    histories = histories or [measured_history(results)]
    columns, above = max(len(times), 1), len(histories)
    figure = Figure(figsize=(PAGE_WIDTH, 2.1 * above + 1.55 * len(variables)), layout="constrained")
    grid = figure.add_gridspec(above + len(variables), columns, height_ratios=[1.35] * above + [1.0] * len(variables))
    lines = line_styles(results)
    scale, _ = time_unit(results)
    for row, history in enumerate(histories):
        top = figure.add_subplot(grid[row, :])
        draw_histories(top, results, lines, history)
        for at in times if variables else ():
            top.axvline(at * scale, color="0.75", linewidth=0.6, zorder=0)
    first: Axes | None = None
    for row, variable in enumerate(variables, start=above):
        shared: Axes | None = None
        for column, at in enumerate(times):
            axes = figure.add_subplot(grid[row, column], sharex=first, sharey=shared)
            first, shared = first or axes, shared or axes
            for label, result in results.items():
                if variable in result:
                    _draw_profile(axes, result, variable, at, lines[label])
            if row == above:
                axes.set_title(f"$t$ = {time_text(at)}")
            axes.tick_params(labelleft=column == 0, labelbottom=row == above + len(variables) - 1)
            if column == 0:
                axes.set_ylabel(fill(axis_label(variable), LABEL_WIDTH))
            if row == above + len(variables) - 1:
                axes.set_xlabel(_DEPTH_LABEL)
    figure.align_ylabels()
    return figure


@in_print_style
def comparison_figure(comparison: Comparison) -> Figure:
    """Histories of the models, how far they are from the reference, and local strains where that is most.

    The time of the local strains is that of the largest difference of the nearest of the other models.
    """
    results = comparison.results
    phases = comparison.phases[:MOST_COLUMNS]
    figure = Figure(figsize=(PAGE_WIDTH, 4.9), layout="constrained")
    grid = figure.add_gridspec(2, 2 * len(phases))
    lines = line_styles(results)
    histories = figure.add_subplot(grid[0, : len(phases)])
    draw_histories(histories, results, lines, comparison.quantity)
    draw_gaps(figure.add_subplot(grid[0, len(phases) :]), comparison, lines)
    shared: Axes | None = None
    for column, phase in enumerate(phases):
        axes = figure.add_subplot(grid[1, 2 * column : 2 * column + 2], sharey=shared)
        shared = shared or axes
        nearest = nearest_model(comparison, phase)
        for label, result in results.items():
            profile = profile_at(result, local_strain(result), nearest.time)
            _draw_over_depth(axes, result, "x", profile, lines[label])
        axes.set_title(f"{phase}, after {time_text(nearest.time_in_phase)}")
        axes.set_xlabel(_DEPTH_LABEL)
        axes.tick_params(labelleft=column == 0)
        if column == 0:
            axes.set_ylabel("local strain")
    for letter, axes in zip("abcdef", figure.axes, strict=False):
        axes.set_title(letter, loc="left", fontweight="bold")
    return figure


def line_styles(results: Mapping[str, xr.Dataset]) -> dict[str, Line]:
    """A line for each result: that of its model if all models differ, else in order."""
    models = [result.attrs["model"] for result in results.values()]
    if len(set(models)) == len(models):
        return {label: _MODEL_LINES[model] for label, model in zip(results, models, strict=True)}
    return lines_in_order(results)


def lines_in_order(labels: Iterable[str]) -> dict[str, Line]:
    """A line for each label, in the order of the palette."""
    return {label: _OTHER_LINES[index % len(_OTHER_LINES)] for index, label in enumerate(labels)}


def result_labels(paths: Sequence[Path], results: Sequence[xr.Dataset]) -> list[str]:
    """Labels that distinguish results: their models, else their paths."""
    models = [str(result.attrs["model"]) for result in results]
    if len(set(models)) == len(models):
        return models
    stems = [path.stem for path in paths]
    if len(set(stems)) == len(stems):
        return stems
    labels = [str(path.with_suffix("")) for path in paths]
    for label in labels:
        if labels.count(label) > 1:
            raise OutputError(f"{label}.nc: is given more than once")
    return labels


def chosen_variables(results: Mapping[str, xr.Dataset], names: Sequence[str] | None) -> list[str]:
    """Histories, and fields over the depth or the grid, to draw: those asked for, or the usual fields.

    Raises
    ------
    OutputError
        If a name is no history of the results, and no field that has a profile.
    """
    present = dict.fromkeys(str(name) for result in results.values() for name in result)
    known = [name for name in present if is_field(name) and field(name).location in ("cell", "node", "global")]
    if not names:
        return [name for name in _DEFAULT_VARIABLES if name in known]
    problems = []
    for name in names:
        if name not in known:
            near = nearest_name(name, known)
            hint = f"did you mean {near}?" if near else f"there are {', '.join(known)}"
            problems.append(f"variable {name}: is no field of these results; {hint}")
    if problems:
        raise OutputError("\n".join(problems))
    return list(names)


def histories_among(
    results: Mapping[str, xr.Dataset], variables: Sequence[str]
) -> tuple[list[str], list[str]]:  # fmt: skip
    """Variables that are histories, and those that are not."""
    histories = {str(name) for result in results.values() for name in result if result[name].dims == ("time",)}
    return [name for name in variables if name in histories], [name for name in variables if name not in histories]


def measured_history(results: Mapping[str, xr.Dataset]) -> str:
    """What the experiment measures in its first phase: what the case says, the pressure of a moved part, or strain."""
    result = next(iter(results.values()))
    case = Case.from_toml(result.attrs["case_toml"])
    part = moved_part(case, acting_loads(case)[0])
    name = case.output.measured or ("global_strain" if part is None else f"{part}_pressure")
    return name if all(name in result for result in results.values()) else "global_strain"


def chosen_times(results: Mapping[str, xr.Dataset], text: str | None) -> list[float]:
    """Times of the profiles, s, each the output time of the first result that is nearest to what is wanted.

    Without a text they lie in the first phase, where the models differ most.

    Raises
    ------
    OutputError
        If the text is no list of times, or a time is beyond the results.
    """
    first = next(iter(results.values()))
    outputs = first["time"].values
    if text is None:
        wanted = [fraction * float(first["phase_end"][0]) for fraction in _DEFAULT_TIMES]
    else:
        wanted, problems = [], []
        for item in text.split(","):
            try:
                seconds = parse(number_or_text(item.strip()), "time")
            except QuantityError as error:
                problems.append(f'time "{item.strip()}": {error}')
                continue
            if not 0.0 <= seconds <= outputs[-1]:
                problems.append(f'time "{item.strip()}": must be from 0 to {outputs[-1]:.6g} s')
            wanted.append(seconds)
        if problems:
            raise OutputError("\n".join(problems))
    later = outputs[outputs > 0.0]  # the state before anything happened stands for itself only
    nearest = [later[np.abs(later - at).argmin()] if at > 0.0 and later.size else outputs[0] for at in wanted]
    return sorted({float(at) for at in nearest})


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure; PNG at 300 dots an inch, PDF or SVG by the name.

    Raises
    ------
    OutputError
        If the name ends otherwise or the file cannot be written.
    """
    if path.suffix.lower() not in FORMATS:
        raise OutputError(f"{path}: must end in {', '.join(FORMATS)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with mpl.rc_context(_PRINT_STYLE):
            figure.savefig(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from None


def axis_label(variable: str, units: str | None = None) -> str:
    """Name of a field with its unit in print; ``units`` are those of a result, where they differ by geometry."""
    name, unit = variable.replace("_", " "), print_unit(variable, units)[1]
    return f"{name} ({unit})" if unit else name


def print_unit(variable: str, units: str | None = None) -> tuple[float, str]:
    """Factor from the unit of a field in the file to its unit in print, and that unit."""
    unit = units or field(variable).units
    return _PRINT_UNITS.get(unit, (1.0, "" if unit == "1" else unit))


def _units_of(results: Mapping[str, xr.Dataset], variable: str) -> str | None:
    return next((str(result[variable].attrs["units"]) for result in results.values() if variable in result), None)


def nearest_model(comparison: Comparison, phase: str) -> Difference:
    """Difference of the model that follows the reference best in a phase, the one whose use is in question."""
    return min(comparison.of_phase(phase), key=lambda each: abs(each.largest))


def time_unit(results: Mapping[str, xr.Dataset]) -> tuple[float, str]:
    """Factor and unit that keep times readable."""
    return handy_time(max(float(result["time"][-1]) for result in results.values()))


def time_text(time: float) -> str:
    """A time, s, in a readable unit."""
    scale, unit = handy_time(time)
    return f"{np.format_float_positional(time * scale, precision=4, fractional=False, trim='-')} {unit}"


def handy_time(time: float) -> tuple[float, str]:
    """Factor and unit in which a time, s, is readable."""
    return (1.0, "s") if time < 2e4 else (1.0 / 3600.0, "h")


def draw_histories(
    axes: Axes, results: Mapping[str, xr.Dataset], lines: Mapping[str, Line], variable: str = "global_strain"
) -> None:
    """Draw a quantity of each result against time."""
    scale, unit = time_unit(results)
    for label, result in results.items():
        _plot(axes, result["time"].values * scale, result[variable].values, lines[label], label)
    axes.set(xlabel=f"time ({unit})", ylabel=axis_label(variable, _units_of(results, variable)))
    axes.margins(x=0.02)
    axes.legend()


def draw_gaps(axes: Axes, comparison: Comparison, lines: Mapping[str, Line]) -> None:
    """Draw how far the models are above the reference against time."""
    scale, unit = time_unit(comparison.results)
    for model in comparison.results:
        if model != comparison.reference:
            time, gap = comparison.gap(model)
            _plot(axes, time * scale, gap, lines[model], model)
    axes.axhline(0.0, color="0.6", linewidth=0.6, zorder=0)
    units = _units_of(comparison.results, comparison.quantity)
    label = f"{axis_label(comparison.quantity, units)},\nless that of {comparison.reference}"
    axes.set(xlabel=f"time ({unit})", ylabel=label)
    axes.margins(x=0.02)
    axes.legend()


def _draw_profile(axes: Axes, result: xr.Dataset, variable: str, at: float, line: Line) -> None:
    position = "x" if FIELDS[variable].location == "cell" else "x_node"
    values = profile_at(result, result[variable].values, at) * print_unit(variable)[0]
    _draw_over_depth(axes, result, position, values, line)


def _draw_over_depth(axes: Axes, result: xr.Dataset, position: str, values: Array, line: Line) -> None:
    _plot(axes, result[position].values, values, line)
    axes.set_xlim(0.0, float(result["x_node"][-1]))


def _plot(axes: Axes, x: Array, y: Array, line: Line, label: str | None = None) -> None:
    # broken lines over full ones, so that both are seen where they agree
    axes.plot(x, y, color=line.color, linestyle=line.style, label=label, zorder=2.0 if line.style == "-" else 3.0)
