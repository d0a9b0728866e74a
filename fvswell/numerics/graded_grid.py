"""Node coordinates of graded grids: cells in geometric progression from the finest."""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache

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


def graded_nodes(length: float, cells: int, grading: float = 1.0, finest: Collection[str] = ()) -> Array:
    """Node coordinates from 0 to ``length``, cells in geometric progression from the finest.

    Parameters
    ----------
    length, cells
        Length in mm and number of cells.
    grading
        Largest cell over smallest.
    finest
        Ends at which the smallest cells lie: "start", "end" or both.
    """
    if unknown := set(finest) - {"start", "end"}:
        raise ValueError(f"no such end: {', '.join(sorted(unknown))}; the ends are start and end")
    if not finest:
        grading = 1.0
    if len(set(finest)) == 2:
        half = graded_widths(0.5 * length, (cells + 1) // 2, grading)
        widths = np.concatenate([half[: cells // 2], half[::-1]])
    else:
        widths = graded_widths(length, cells, grading)[:: -1 if "end" in finest else 1]
    nodes = np.concatenate([[0.0], np.cumsum(widths)])
    return length * nodes / nodes[-1]
