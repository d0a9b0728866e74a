"""Node coordinates of graded grids: cells in geometric progression from the finest."""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache
from itertools import pairwise

import numpy as np

from fvswell.physics.tissue import Array

__all__ = ["graded_nodes", "graded_widths"]


def graded_widths(length: float, cells: int, grading: float) -> Array:
    """Widths in geometric progression from the finest at 0; ``grading`` is the largest over the smallest."""
    widths, total = _progression(cells, grading)
    return length * widths / total


@lru_cache(maxsize=64)
def _progression(cells: int, grading: float) -> tuple[Array, float]:
    """Widths relative to the finest, and their sum; kept, as many grids in a row are often of one shape."""
    widths = np.geomspace(1.0, grading, cells)
    return widths, widths.sum()


def graded_nodes(
    length: float, cells: int, grading: float = 1.0, finest: Collection[str | float] = (),
    through: Collection[float] = (),
) -> Array:  # fmt: skip
    """Node coordinates from 0 to ``length``, cells in geometric progression from the finest.

    Parameters
    ----------
    length, cells
        Length in mm and number of cells.
    grading
        Largest cell over smallest; about that where nodes are prescribed.
    finest
        Where the smallest cells lie: at the "start", at the "end", at places between (mm), on which a node falls then.
    through
        More places on which a node has to fall, mm.

    Raises
    ------
    ValueError
        If there is no such end or place, or there are more places than the cells can have nodes.
    """
    ends = {name for name in finest if isinstance(name, str)}
    if unknown := ends - {"start", "end"}:
        raise ValueError(f"no such end: {', '.join(sorted(unknown))}; the ends are start and end")
    inside = [float(place) for place in finest if not isinstance(place, str)]
    prescribed = np.unique([*inside, *through])
    if len(prescribed):
        fine = np.array([*([0.0] if "start" in ends else []), *inside, *([length] if "end" in ends else [])])
        return _through(length, cells, grading if len(fine) else 1.0, np.sort(fine), prescribed)
    if not ends:
        grading = 1.0
    if len(ends) == 2:
        half = graded_widths(0.5 * length, (cells + 1) // 2, grading)
        widths = np.concatenate([half[: cells // 2], half[::-1]])
    else:
        widths = graded_widths(length, cells, grading)[:: -1 if "end" in ends else 1]
    nodes = np.concatenate([[0.0], np.cumsum(widths)])
    return length * nodes / nodes[-1]


def _through(length: float, cells: int, grading: float, fine: Array, prescribed: Array) -> Array:
    """Nodes on prescribed places; cells grow in proportion to the distance from the nearest fine place, all alike.

    The places cut the length into pieces, each of which gets the whole number of cells nearest to its share.
    """
    if not (prescribed[0] > 0.0 and prescribed[-1] < length):
        raise ValueError(f"a node cannot be prescribed at 0, at the length of {length:g} mm, or beyond")
    if cells <= len(prescribed):
        raise ValueError(f"{cells} cells are too few to have nodes on {len(prescribed)} places between the ends")
    middles = 0.5 * (fine[1:] + fine[:-1])
    knots = np.unique(np.concatenate([[0.0, length], fine, middles, prescribed]))
    distance = np.abs(knots[:, None] - fine).min(axis=1) if len(fine) else np.zeros(len(knots))
    width = 1.0 + (grading - 1.0) * distance / max(distance.max(), np.finfo(float).tiny)
    slope = np.diff(width) / np.diff(knots)  # of the width of a cell over its place
    flat = np.abs(slope) * length < 1e-12
    counts = np.diff(knots) / width[:-1]
    counts[~flat] = np.log(width[1:] / width[:-1])[~flat] / slope[~flat]
    count = np.concatenate([[0.0], np.cumsum(counts)])  # of cells up to each knot, but for a factor

    at = np.concatenate([[0.0], prescribed, [length]])
    place = count[np.searchsorted(knots, at)]
    whole = np.rint(place * (cells / count[-1])).astype(int)
    for i in range(1, len(whole)):
        whole[i] = max(whole[i], whole[i - 1] + 1)
    for i in range(len(whole) - 1, 0, -1):
        whole[i - 1] = min(whole[i - 1], min(whole[i], cells) - 1)
    whole[0], whole[-1] = 0, cells
    wanted = np.concatenate(
        [[0.0]] + [np.linspace(place[i], place[j], whole[j] - whole[i] + 1)[1:] for i, j in pairwise(range(len(at)))]
    )
    piece = np.clip(np.searchsorted(count, wanted, side="right") - 1, 0, len(slope) - 1)
    more = wanted - count[piece]
    step = np.where(flat, 1.0, slope)[piece]
    nodes = knots[piece] + width[piece] * np.where(flat[piece], more, np.expm1(step * more) / step)
    nodes[whole] = at
    return nodes
