"""How figures show the parts of the boundary: which is held, which is driven, which is free, and which is open."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.lines import Line2D

from fvswell.boundary.parts import HELD, Part
from fvswell.boundary.sides import EDGE_AXIS, EDGES
from fvswell.physics.tissue import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
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


def block_outline(part: Part, nodes: Array) -> Array:
    """Nodes of a block on a part of its boundary, in order along it.

    Parameters
    ----------
    part
        Of the boundary.
    nodes
        Of the stress-free solid, ``(2, nodes)`` mm, in a rectangle from the origin.
    """
    axis = EDGE_AXIS[part.edge]
    extent = nodes.max(axis=1)
    side = extent[axis] if EDGES.index(part.edge) % 2 else 0.0
    slack = _ON_EDGE * extent.max()
    along = nodes[1 - axis]
    on = np.abs(nodes[axis] - side) <= slack
    chosen = np.flatnonzero(on & (along >= part.start - slack) & (along <= part.end + slack))
    order: Array = chosen[np.argsort(along[chosen])]
    return order


def mark_parts(axes: Axes, parts: Iterable[Part], reference: Array, moved: Array) -> None:
    """Draw all parts of a block where its nodes have moved to, ``(2, nodes)`` both."""
    for part in parts:
        draw_part(axes, part, moved[:, block_outline(part, reference)])


def part_legend(axes: Axes, parts: Sequence[Part], **where: Any) -> Legend:
    """Legend of the marks that occur."""
    kinds = {_kind(part) for part in parts}
    handles = [
        Line2D([], [], color=mark.color, linewidth=mark.width, label=mark.text)
        for kind, mark in _MARKS.items()
        if kind in kinds
    ]
    if any(part.open for part in parts):
        handles.append(Line2D([], [], label="open to a bath", **_OPEN))
    return axes.legend(handles=handles, **where)
