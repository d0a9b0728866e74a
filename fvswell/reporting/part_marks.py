"""How figures show the parts of the boundary: which is held, which is driven, which is free, and which is open."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.lines import Line2D

from fvswell.boundary.parts import HELD, Part
from fvswell.boundary.sides import EDGE_AXIS
from fvswell.physics.tissue import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import FigureBase
    from matplotlib.legend import Legend

__all__ = ["block_outline", "draw_part", "mark_parts", "part_legend"]

_ON_EDGE = 1e-9  # of the extent of the block
_OPEN: dict[str, Any] = {"color": "#56B4E9", "linewidth": 1.6, "linestyle": (0, (1.0, 1.6)), "zorder": 4}


class _Mark(NamedTuple):
    color: str
    width: float
    text: str


_MARKS = {
    "held": _Mark("black", 2.4, "held (fixed or roller)"),
    "driven": _Mark("#E69F00", 2.4, "plate, driven or free to move"),
    "free": _Mark("0.45", 0.8, "free"),
}


def _kind(part: Part) -> str:
    if part.mechanical in HELD:
        return "held"
    return "free" if part.mechanical == "free" else "driven"


def draw_part(axes: Axes, part: Part, line: Array) -> None:
    """Draw a part along a line ``(2, points)``: its mechanical condition, and dots of water where it is open."""
    mark = _MARKS[_kind(part)]
    axes.plot(*line, color=mark.color, linewidth=mark.width, solid_capstyle="butt", zorder=3)
    if part.open:
        axes.plot(*line, **_OPEN)


def block_outline(part: Part, along: tuple[Array, Array]) -> Array:
    """Nodes of a block on a part of its boundary, in order along it, as indices among those of its grid.

    Parameters
    ----------
    part
        Of the boundary.
    along
        Coordinates of the grid's lines along x and along y, mm, of the body as the case gives it.
    """
    columns, rows = (len(lines) for lines in along)
    index = np.arange(rows * columns).reshape(rows, columns)
    edge = {"left": index[:, 0], "right": index[:, -1], "bottom": index[0], "top": index[-1]}[part.edge]
    lines = along[1 - EDGE_AXIS[part.edge]]
    slack = _ON_EDGE * lines[-1]
    chosen: Array = edge[(lines >= part.start - slack) & (lines <= part.end + slack)]
    return chosen


def mark_parts(axes: Axes, parts: Iterable[Part], along: tuple[Array, Array], nodes: Array) -> None:
    """Draw all parts of a block where its nodes are, ``(2, nodes)``; ``along`` as for `block_outline`."""
    for part in parts:
        draw_part(axes, part, nodes[:, block_outline(part, along)])


def part_legend(figure: FigureBase, parts: Sequence[Part]) -> Legend:
    """Legend, below a figure or a part of one, of the marks that occur."""
    kinds = {_kind(part) for part in parts}
    handles = [
        Line2D([], [], color=mark.color, linewidth=mark.width, label=mark.text)
        for kind, mark in _MARKS.items()
        if kind in kinds
    ]
    if any(part.open for part in parts):
        handles.append(Line2D([], [], label="open to a bath", **_OPEN))
    return figure.legend(handles=handles, loc="outside lower center", ncols=2 if len(handles) < 4 else 4)
