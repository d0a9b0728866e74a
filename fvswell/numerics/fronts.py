"""Multifrontal factors of sparse matrices with one pattern (Duff & Reid 1983): dense matrices, a part at a time.

The front of a part is the dense matrix of its unknowns and of its boundary, the later unknowns that they appear
together with. Once the part is eliminated what remains of it is added to the front of the part above. Nearly all of
the work is products of dense matrices, which is what makes this faster than factors column by column.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg.blas import dgemm
from scipy.linalg.lapack import dgetrf, dgetrs

from fvswell.compiled import kernel, point
from fvswell.numerics.blas import one_blas_thread
from fvswell.numerics.dissection import Part
from fvswell.physics.tissue import Array

__all__ = ["FrontFactors", "Fronts"]


class _Front(NamedTuple):
    """What does not depend on the values; unknowns are numbered in the order of elimination."""

    own: slice
    boundary: Array
    entries: Array  # those of the matrix that belong to it
    at: Array  # where they are: in the factors of the front, and behind those in what remains of it
    children: list[tuple[int, Array]]  # parts that it separates, and where the boundary of each is in the front


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
            own = factors[layout.first_factor[index] : layout.first_factor[index + 1]]
            rest = np.empty((others, others))
            _scatter(values, front.entries, front.at, own, rest.reshape(-1))
            for child, places in front.children:
                _extend(remaining.pop(child), places, number, own, rest)
            # a front is stored row by row, LAPACK and BLAS want columns: they get transposed blocks
            block, left, above = _views(own, number, others)
            _, pivots[front.own], singular = dgetrf(block.T, overwrite_a=True)
            if singular:
                return None
            if others:
                dgetrs(block.T, pivots[front.own], left.T, overwrite_b=True)
                dgemm(-1.0, above.T, left.T, 1.0, rest.T, overwrite_c=True)
            remaining[index] = rest
        return FrontFactors(layout, factors, pivots)

    def _add(self, children: list[int], own: slice, entries: Array, rows: Array, columns: Array) -> None:
        """Add the front of a part whose entries are in these rows and columns."""
        concerned = np.concatenate([rows, columns, *(self._fronts[child].boundary for child in children)])
        boundary = np.unique(concerned[concerned >= own.stop])
        number = own.stop - own.start

        def local(unknowns: Array) -> Array:
            return np.where(unknowns < own.stop, unknowns - own.start, number + np.searchsorted(boundary, unknowns))

        row, column, others = local(rows), local(columns), len(boundary)
        inner_row, inner_column = row < number, column < number
        above, rest = number * (number + others), number * (number + 2 * others)
        at = np.select(
            [inner_row & inner_column, inner_column, inner_row],
            [row * number + column, row * number + column, above + row * others + column - number],
            rest + (row - number) * others + column - number,
        )
        places = [(child, local(self._fronts[child].boundary)) for child in children]
        self._fronts.append(_Front(own, boundary, entries, at, places))


@kernel
def _scatter(values: Any, entries: Any, at: Any, own: Any, rest: Any) -> Any:
    """Put the entries of the matrix that belong to a front into it, and zeros elsewhere."""
    for i in range(len(own)):
        own[i] = 0.0
    for i in range(len(rest)):
        rest[i] = 0.0
    for entry in range(len(entries)):
        if at[entry] < len(own):
            own[at[entry]] = values[entries[entry]]
        else:
            rest[at[entry] - len(own)] = values[entries[entry]]


@kernel
def _extend(remaining: Any, places: Any, number: Any, own: Any, rest: Any) -> Any:
    """Add what remains of a part that a front separates; places are increasing, those of own unknowns below number."""
    others, inner = len(rest), 0
    while inner < len(places) and places[inner] < number:
        inner += 1
    for i in range(len(places)):
        row = places[i]
        for j in range(inner):
            own[row * number + places[j]] += remaining[i, j]  # the rows of the boundary follow those of the block
        above = number * (number + others) + row * others - number
        for j in range(inner, len(places)):
            if row < number:
                own[above + places[j]] += remaining[i, j]
            else:
                rest[row - number, places[j] - number] += remaining[i, j]


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
