"""Linear systems with one or two unknowns a cell, each cell coupled to its neighbours."""

from __future__ import annotations

from typing import Any

from fvswell.compiled import point

__all__ = ["solve_block_tridiagonal"]


@point
def solve_block_tridiagonal(lower: Any, diagonal: Any, upper: Any, first: Any, second: Any) -> Any:
    """Solve in place for two right sides, by elimination from the first cell to the last.

    Parameters
    ----------
    lower, diagonal, upper
        (unknowns, unknowns, cells), by equation and unknown: coupling to the cell before, to the own unknowns (is
        destroyed) and to the cell after.
    first, second
        Right sides (unknowns, cells), replaced by the solutions; not-a-number where there is none.
    """
    unknowns, n = first.shape
    if unknowns == 1:
        for i in range(1, n):
            factor = lower[0, 0, i] / diagonal[0, 0, i - 1]
            diagonal[0, 0, i] -= factor * upper[0, 0, i - 1]
            first[0, i] -= factor * first[0, i - 1]
            second[0, i] -= factor * second[0, i - 1]
        first[0, n - 1] /= diagonal[0, 0, n - 1]
        second[0, n - 1] /= diagonal[0, 0, n - 1]
        for i in range(n - 2, -1, -1):
            first[0, i] = (first[0, i] - upper[0, 0, i] * first[0, i + 1]) / diagonal[0, 0, i]
            second[0, i] = (second[0, i] - upper[0, 0, i] * second[0, i + 1]) / diagonal[0, 0, i]
        return
    for i in range(n):
        a, b, c, d = diagonal[0, 0, i], diagonal[0, 1, i], diagonal[1, 0, i], diagonal[1, 1, i]
        f, g, h, k = first[0, i], first[1, i], second[0, i], second[1, i]
        if i > 0:
            for row in range(2):
                x, y = lower[row, 0, i], lower[row, 1, i]
                # the part of the equation that the cell before has been solved for; see below
                by_J = x * upper[0, 0, i - 1] + y * upper[1, 0, i - 1]
                by_s = x * upper[0, 1, i - 1] + y * upper[1, 1, i - 1]
                one = x * first[0, i - 1] + y * first[1, i - 1]
                two = x * second[0, i - 1] + y * second[1, i - 1]
                if row == 0:
                    a, b, f, h = a - by_J, b - by_s, f - one, h - two
                else:
                    c, d, g, k = c - by_J, d - by_s, g - one, k - two
        scale = 1.0 / (a * d - b * c)
        first[0, i], first[1, i] = scale * (d * f - b * g), scale * (a * g - c * f)
        second[0, i], second[1, i] = scale * (d * h - b * k), scale * (a * k - c * h)
        if i < n - 1:  # upper becomes that of the solved cell: unknowns = first - upper unknowns of the cell after
            p, q, r, s = upper[0, 0, i], upper[0, 1, i], upper[1, 0, i], upper[1, 1, i]
            upper[0, 0, i], upper[0, 1, i] = scale * (d * p - b * r), scale * (d * q - b * s)
            upper[1, 0, i], upper[1, 1, i] = scale * (a * r - c * p), scale * (a * s - c * q)
    for i in range(n - 2, -1, -1):
        for row in range(2):
            first[row, i] -= upper[row, 0, i] * first[0, i + 1] + upper[row, 1, i] * first[1, i + 1]
            second[row, i] -= upper[row, 0, i] * second[0, i + 1] + upper[row, 1, i] * second[1, i + 1]
