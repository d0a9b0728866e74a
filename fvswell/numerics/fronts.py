"""Multifrontal factors of sparse matrices with one pattern (Duff & Reid 1983): dense matrices, a part at a time.

The front of a part is the dense matrix of its unknowns and of its boundary, the later unknowns that they appear
together with. Once the part is eliminated what remains of it is added to the front of the part above. Nearly all of
the work is products of dense matrices, which is what makes this faster than factors column by column.
"""

from __future__ import annotations

from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg.blas import dgemm
from scipy.linalg.lapack import dgetrf, dgetrs

from fvswell.compiled import kernel, point
from fvswell.numerics.blas import one_blas_thread
from fvswell.numerics.dissection import Part
from fvswell.physics.tissue import Array

__all__ = ["FrontFactors", "Fronts"]

_Run = tuple[slice, slice]  # of a child's boundary, and where it is in the front


class _Front(NamedTuple):
    """What does not depend on the values; unknowns are numbered in the order of elimination."""

    own: slice
    boundary: Array
    entries: Array  # those of the matrix that belong to it
    at: Array  # where in the front they are, row by row
    children: list[tuple[int, list[_Run]]]


class _Layout(NamedTuple):
    """Where the factors of each part are in one array, part by part.

    They are, row by row: the transposed block of the own unknowns, factorised by LAPACK; the rows of the boundary,
    multiplied from the right by the inverse of that block; the columns of the boundary.
    """

    order: Array  # (unknowns,) of elimination
    first: Array  # (parts + 1,) of the own unknowns
    first_boundary: Array  # (parts + 1,)
    boundary: Array  # of all parts
    first_factor: Array  # (parts + 1,)


class Fronts:
    """Analysis of a pattern.

    Parameters
    ----------
    rows, columns
        Of the entries, ``(entries,)``, each place once.
    parts
        From `dissection.nested_dissection` of the pattern and its transpose.
    """

    def __init__(self, rows: Array, columns: Array, parts: list[Part]) -> None:
        order = np.concatenate([np.empty(0, dtype=int), *(part.unknowns for part in parts)])
        number = np.empty(len(order), dtype=int)
        number[order] = np.arange(len(order))
        rows, columns = number[rows], number[columns]
        starts = np.cumsum([0, *(len(part.unknowns) for part in parts)])
        first_part = np.searchsorted(starts, np.minimum(rows, columns), side="right") - 1
        by_part = np.argsort(first_part, kind="stable")
        ends = pairwise(np.searchsorted(first_part[by_part], np.arange(len(parts) + 1)))
        self._fronts: list[_Front] = []
        for part, (start, stop), (first, end) in zip(parts, pairwise(starts.tolist()), ends, strict=True):
            entries = by_part[first:end]
            self._add(part.children, slice(start, stop), entries, rows[entries], columns[entries])
        boundaries = [front.boundary for front in self._fronts]
        numbers, others = np.diff(starts), np.array([len(boundary) for boundary in boundaries], dtype=int)
        self._layout = _Layout(
            order, starts, np.cumsum([0, *others]), np.concatenate([np.empty(0, dtype=int), *boundaries]),
            np.cumsum([0, *(numbers * (numbers + 2 * others))]),
        )  # fmt: skip

    @one_blas_thread()
    def factorise(self, values: Array) -> FrontFactors | None:
        """Factors of the matrix with these values of the entries; None if the block of a part is singular."""
        layout = self._layout
        factors, pivots = np.empty(layout.first_factor[-1]), np.empty(layout.first[-1], dtype=np.int64)
        remaining: dict[int, Array] = {}
        for index, front in enumerate(self._fronts):
            number, others = front.own.stop - front.own.start, len(front.boundary)
            matrix = self._assembled(front, values, remaining)
            # a front is stored row by row, LAPACK and BLAS want columns: they get transposed blocks
            block, left, above = _views(factors[layout.first_factor[index] :], number, others)
            block[:], left[:], above[:] = matrix[:number, :number], matrix[number:, :number], matrix[:number, number:]
            _, pivots[front.own], singular = dgetrf(block.T, overwrite_a=True)
            if singular:
                return None
            if others:
                dgetrs(block.T, pivots[front.own], left.T, overwrite_b=True)
                remaining[index] = dgemm(-1.0, above.T, left.T, 1.0, matrix[number:, number:].T).T
        return FrontFactors(layout, factors, pivots)

    def _assembled(self, front: _Front, values: Array, remaining: dict[int, Array]) -> Array:
        """The dense matrix of a front; what remains of its children is taken away."""
        size = front.own.stop - front.own.start + len(front.boundary)
        matrix = np.zeros(size * size)
        matrix[front.at] = values[front.entries]
        matrix = matrix.reshape(size, size)
        for child, runs in front.children:
            added = remaining.pop(child)
            for (rows, to_rows), (columns, to_columns) in product(runs, runs):
                matrix[to_rows, to_columns] += added[rows, columns]
        return matrix

    def _add(self, children: list[int], own: slice, entries: Array, rows: Array, columns: Array) -> None:
        """Add the front of a part whose entries are in these rows and columns."""
        concerned = np.concatenate([rows, columns, *(self._fronts[child].boundary for child in children)])
        boundary = np.unique(concerned[concerned >= own.stop])
        number = own.stop - own.start

        def local(unknowns: Array) -> Array:
            return np.where(unknowns < own.stop, unknowns - own.start, number + np.searchsorted(boundary, unknowns))

        at = local(rows) * (number + len(boundary)) + local(columns)
        runs = [(child, _runs(local(self._fronts[child].boundary))) for child in children]
        self._fronts.append(_Front(own, boundary, entries, at, runs))


def _views(factors: Array, number: int, others: int) -> tuple[Array, Array, Array]:
    """The three matrices of a part, as they lie one behind the other."""
    left, above = number * number, number * (number + others)
    return (
        factors[:left].reshape(number, number),
        factors[left:above].reshape(others, number),
        factors[above : above + number * others].reshape(number, others),
    )


class FrontFactors:
    """Factors of a matrix."""

    def __init__(self, layout: _Layout, factors: Array, pivots: Array) -> None:
        self._layout, self._factors, self._pivots = layout, factors, pivots

    @property
    def entries(self) -> int:
        """Number of entries that are stored."""
        return len(self._factors)

    def solve(self, right_side: Array) -> Array:
        """Solution of the system."""
        values, solution = np.empty((2, len(right_side))), np.empty(len(right_side))
        _solve(self._layout, self._factors, self._pivots, right_side, values, solution)
        return solution


@kernel
def _solve(layout: Any, factors: Any, pivots: Any, right_side: Any, work: Any, solution: Any) -> Any:
    """Solve with the factors of all parts: in a loop that is compiled, as most parts are small."""
    values, outer, parts = work[0], work[1], len(layout.first) - 1
    for i in range(len(right_side)):
        values[i] = right_side[layout.order[i]]
    for part in range(parts):
        start, boundary = layout.first[part], layout.first_boundary[part]
        number, others = layout.first[part + 1] - start, layout.first_boundary[part + 1] - boundary
        left = layout.first_factor[part] + number * number
        for i in range(others):
            values[layout.boundary[boundary + i]] -= _dot(factors, left + i * number, values, start, number)
    for part in range(parts - 1, -1, -1):
        start, boundary = layout.first[part], layout.first_boundary[part]
        number, others = layout.first[part + 1] - start, layout.first_boundary[part + 1] - boundary
        block = layout.first_factor[part]
        above = block + number * (number + others)
        for i in range(others):
            outer[i] = values[layout.boundary[boundary + i]]
        for i in range(number):  # with the upper factor of the transposed block, which is a lower one
            known = _dot(factors, above + i * others, outer, 0, others) + _dot(
                factors, block + i * number, values, start, i
            )
            values[start + i] = (values[start + i] - known) / factors[block + i * number + i]
        for i in range(number - 1, -1, -1):
            behind = number - i - 1
            values[start + i] -= _dot(factors, block + i * number + i + 1, values, start + i + 1, behind)
        for i in range(number - 1, -1, -1):
            other = start + pivots[start + i]
            values[start + i], values[other] = values[other], values[start + i]
    for i in range(len(right_side)):
        solution[layout.order[i]] = values[i]


@point
def _dot(a: Any, i: Any, b: Any, j: Any, number: Any) -> Any:
    """Product of parts of two arrays, in four sums that do not wait for each other."""
    first, second, third, fourth = 0.0, 0.0, 0.0, 0.0
    whole = number - number % 4
    for k in range(0, whole, 4):
        first += a[i + k] * b[j + k]
        second += a[i + k + 1] * b[j + k + 1]
        third += a[i + k + 2] * b[j + k + 2]
        fourth += a[i + k + 3] * b[j + k + 3]
    for k in range(whole, number):
        first += a[i + k] * b[j + k]
    return (first + second) + (third + fourth)


def _runs(places: Array) -> list[_Run]:
    """Consecutive pieces of increasing places; a few, because the unknowns of a line are numbered along it."""
    if not len(places):
        return []
    ends = [0, *(np.flatnonzero(np.diff(places) != 1) + 1).tolist(), len(places)]
    return [(slice(a, b), slice(int(places[a]), int(places[a]) + b - a)) for a, b in pairwise(ends)]
