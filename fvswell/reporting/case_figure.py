"""A case before it is run, in a figure: the body with the parts of its boundary, and what acts on them over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from fvswell.boundary.parts import Part
from fvswell.boundary.sides import EDGE_AXIS, EDGES
from fvswell.case.acting_loads import acting_loads, initial_loads
from fvswell.case.case import Case
from fvswell.case.loads import final_value, in_length, value_at
from fvswell.physics.tissue import Array
from fvswell.reporting.part_marks import draw_part, part_legend
from fvswell.reporting.plots import PAGE_WIDTH, handy_time, in_print_style, lines_in_order

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["case_figure", "load_curves"]

_POINTS = 400  # of a curve in a phase
_PANEL_HEIGHT = 1.35  # inches
_BODY_HEIGHT = 2.6
_COLUMN_WIDTH = 0.4  # of a column's height, as it is drawn
_SHADE = "#F3EDE3"
_LABELS = {
    "pressure": "pressure (MPa)",
    "force": "force (N)",
    "displacement": "displacement (mm)",
    "tangential_displacement": "displacement along the part (mm)",
    "bath_concentration": "bath (mM)",
    "bath_pressure": "pressure of the bath (kPa)",
    "current": "current",
    "potential": "potential (mV)",
}
_FACTORS = {"bath_concentration": 1e6, "bath_pressure": 1e3, "current": 1e6}


class Curve(NamedTuple):
    """A load over the phases in which it acts."""

    times: Array  # s, nan between stretches
    values: Array

    @property
    def changes(self) -> bool:
        """Whether it takes more than one value."""
        return bool(np.nanmax(self.values) > np.nanmin(self.values))


def load_curves(case: Case, durations: Sequence[float]) -> dict[str, Curve]:
    """What acts on each part over time, by the names of loads, "PART.KIND".

    Parameters
    ----------
    case
        Whose protocol is meant.
    durations
        Of the phases, s.
    """
    curves: dict[str, list[Array]] = {}
    before: Mapping[str, float] = initial_loads(case)
    start = 0.0
    for acting, duration in zip(acting_loads(case), durations, strict=True):
        within = np.linspace(0.0, duration, _POINTS)
        for name, given in acting.items():
            load, first = in_length(given, _extent_of(case, name)), before.get(name, 0.0)
            values = [value_at(load, time, first) for time in within]
            curves.setdefault(name, []).append(np.array([[start, *(start + within), np.nan], [first, *values, np.nan]]))
        before = {name: final_value(in_length(load, _extent_of(case, name)), duration) for name, load in acting.items()}
        start += duration
    return {name: Curve(*np.concatenate(parts, axis=1)) for name, parts in curves.items()}


@in_print_style
def case_figure(case: Case, durations: Sequence[float]) -> Figure:
    """The body with its parts beside the loads that change.

    Parameters
    ----------
    case
        To be looked at.
    durations
        Of its phases, s.
    """
    changing = {name: curve for name, curve in load_curves(case, durations).items() if curve.changes}
    kinds = list(dict.fromkeys(name.partition(".")[2] for name in changing))
    height = max(_BODY_HEIGHT, _PANEL_HEIGHT * max(len(kinds), 1))
    figure = Figure(figsize=(PAGE_WIDTH, height), layout="constrained")
    left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=(1.0, 1.25))[0]
    _draw_body(left.subplots(), case)
    part_legend(figure, case.parts)
    panels = right.subplots(max(len(kinds), 1), 1, squeeze=False, sharex=True)[:, 0]
    scale, unit = handy_time(sum(durations))
    for axes, kind in zip(panels, kinds, strict=False):
        own = {name.partition(".")[0]: curve for name, curve in changing.items() if name.endswith(f".{kind}")}
        for (part, curve), line in zip(own.items(), lines_in_order(own).values(), strict=True):
            values = _FACTORS.get(kind, 1.0) * curve.values
            axes.plot(scale * curve.times, values, color=line.color, linestyle=line.style, label=part)
        axes.set_ylabel(_label(case, kind))
        axes.legend(loc="best")
    if not kinds:
        panels[0].text(0.5, 0.5, "no load changes", ha="center", va="center", transform=panels[0].transAxes)
    ends = scale * np.cumsum([0.0, *durations])
    for axes in panels:
        for end in ends[1:-1]:
            axes.axvline(end, color="0.75", linewidth=0.6, zorder=0)
    for phase, begin, end in zip(case.phase, ends[:-1], ends[1:], strict=True):
        panels[0].annotate(
            phase.name, (0.5 * (begin + end), 1.02), xycoords=("data", "axes fraction"), ha="center", va="bottom",
            fontsize=7,
        )  # fmt: skip
    panels[-1].set_xlabel(f"time ({unit})")
    panels[-1].set_xlim(0.0, ends[-1])
    return figure


def _label(case: Case, kind: str) -> str:
    if kind == "current":
        return "current density\n(µA/mm²)" if case.geometry.kind == "column" else "current (µA)"
    return _LABELS[kind]


def _draw_body(axes: Axes, case: Case) -> None:
    """The stress-free body, its parts as lines with their names beside them."""
    extent, parts = _extent(case), case.parts
    axes.fill([0.0, extent[0], extent[0], 0.0], [0.0, 0.0, extent[1], extent[1]], color=_SHADE, linewidth=0.0, zorder=0)
    for part in parts:
        line = _line(part, extent)
        draw_part(axes, part, line)
        _name(axes, part, line, extent)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.28)
    column = case.geometry.kind == "column"
    axes.set_xlabel("" if column else ("$r$ (mm)" if case.geometry.kind == "axisymmetric" else "$x$ (mm)"))
    axes.set_ylabel("distance from the filter (mm)" if column else "$y$ (mm)")
    axes.spines[["left", "bottom"]].set_visible(False)
    axes.set_yticks(np.unique([0.0, 0.5 * extent[1], extent[1]]))
    axes.set_xticks([] if column else np.unique([0.0, 0.5 * extent[0], extent[0]]))


def _extent(case: Case) -> tuple[float, float]:
    """Width and height of the body as it is drawn, mm."""
    geometry = case.geometry
    if geometry.kind == "column":
        return _COLUMN_WIDTH * geometry.height, geometry.height
    extent: tuple[float, float] = geometry.extent
    return extent


def _extent_of(case: Case, name: str) -> float:
    """Extent of the body along the displacement of a part, which strains are shares of, mm."""
    part = next(part for part in case.parts if part.name == name.partition(".")[0])
    return _extent(case)[EDGE_AXIS[_edge(part)]]


def _edge(part: Part) -> str:
    return part.edge or {"filter": "bottom", "piston": "top"}[part.name]


def _line(part: Part, extent: tuple[float, float]) -> Array:
    """Ends of a part, ``(2, 2)`` mm."""
    edge = _edge(part)
    axis = EDGE_AXIS[edge]
    line = np.empty((2, 2))
    line[axis] = extent[axis] if EDGES.index(edge) % 2 else 0.0
    line[1 - axis] = part.start, min(part.end, extent[1 - axis])
    return line


def _name(axes: Axes, part: Part, line: Array, extent: tuple[float, float]) -> None:
    """The part's name outside the body, with its electrical condition where that is not the usual one."""
    edge = _edge(part)
    outward = np.zeros(2)
    outward[EDGE_AXIS[edge]] = 1.0 if EDGES.index(edge) % 2 else -1.0
    text = part.name
    if part.electrical != ("grounded" if part.open else "insulating"):
        text += f"\n{part.electrical}" + ("" if part.electrode == "bath" else f", {part.electrode} electrode")
    upright = EDGE_AXIS[edge] == 0
    axes.annotate(
        text, line.mean(axis=1), xytext=(7.0 * outward[0], 7.0 * outward[1]), textcoords="offset points", fontsize=7,
        zorder=5, rotation=90 if upright else 0,
        ha="center" if not upright else ("left" if outward[0] > 0 else "right"),
        va="center" if upright else ("bottom" if outward[1] > 0 else "top"),
    )  # fmt: skip
