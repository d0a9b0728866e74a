"""Multifrontal factors of sparse matrices with one pattern (Duff & Reid 1983): dense matrices, a part at a time.

The front of a part is the dense matrix of its unknowns and of its boundary, the later unknowns that they appear
together with. Once the part is eliminated what remains of it is added to the front of the part above. Nearly all of
the work is products of dense matrices, which is what makes this faster than factors column by column.
"""

from __future__ import annotations

from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
from scipy.linalg.blas import dgemm
from scipy.linalg.lapack import dgetrf, dgetrs

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


class _Eliminated(NamedTuple):
    own: slice
    boundary: Array
    factors: Array  # of the transposed block of the own unknowns, from LAPACK
    pivots: Array
    left: Array  # rows of the boundary, multiplied from the right by the inverse of that block
    above: Array  # columns of the boundary


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
        self._order = np.concatenate([np.empty(0, dtype=int), *(part.unknowns for part in parts)])
        number = np.empty(len(self._order), dtype=int)
        number[self._order] = np.arange(len(self._order))
        rows, columns = number[rows], number[columns]
        starts = np.cumsum([0, *(len(part.unknowns) for part in parts)])
        first_part = np.searchsorted(starts, np.minimum(rows, columns), side="right") - 1
        by_part = np.argsort(first_part, kind="stable")
        ends = pairwise(np.searchsorted(first_part[by_part], np.arange(len(parts) + 1)))
        self._fronts: list[_Front] = []
        for part, (start, stop), (first, end) in zip(parts, pairwise(starts.tolist()), ends, strict=True):
            entries = by_part[first:end]
            self._add(part.children, slice(start, stop), entries, rows[entries], columns[entries])

    @one_blas_thread()
    def factorise(self, values: Array) -> FrontFactors | None:
        """Factors of the matrix with these values of the entries; None if the block of a part is singular."""
        eliminated: list[_Eliminated] = []
        remaining: dict[int, Array] = {}
        for index, front in enumerate(self._fronts):
            number = front.own.stop - front.own.start
            size = number + len(front.boundary)
            matrix = np.zeros(size * size)
            matrix[front.at] = values[front.entries]
            matrix = matrix.reshape(size, size)
            for child, runs in front.children:
                added = remaining.pop(child)
                for (rows, to_rows), (columns, to_columns) in product(runs, runs):
                    matrix[to_rows, to_columns] += added[rows, columns]
            # a front is stored row by row, LAPACK and BLAS want columns: they get transposed blocks
            factors, pivots, singular = dgetrf(matrix[:number, :number].T)
            if singular:
                return None
            left, above = np.empty((0, number)), matrix[:number, number:].copy()
            if len(front.boundary):
                left = dgetrs(factors, pivots, matrix[number:, :number].T)[0].T
                remaining[index] = dgemm(-1.0, above.T, left.T, 1.0, matrix[number:, number:].T).T
            eliminated.append(_Eliminated(front.own, front.boundary, factors, pivots, left, above))
        return FrontFactors(eliminated, self._order)

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


class FrontFactors:
    """Factors of a matrix."""

    def __init__(self, eliminated: list[_Eliminated], order: Array) -> None:
        self._eliminated, self._order = eliminated, order

    @property
    def entries(self) -> int:
        """Number of entries that are stored."""
        return sum(part.factors.size + part.left.size + part.above.size for part in self._eliminated)

    @one_blas_thread()
    def solve(self, right_side: Array) -> Array:
        """Solution of the system."""
        values = right_side[self._order]
        for part in self._eliminated:
            values[part.boundary] -= part.left @ values[part.own]
        for part in reversed(self._eliminated):
            known = part.above @ values[part.boundary]
            values[part.own] = dgetrs(part.factors, part.pivots, values[part.own] - known, trans=1)[0]
        solution = np.empty_like(values)
        solution[self._order] = values
        return solution


def _runs(places: Array) -> list[_Run]:
    """Consecutive pieces of increasing places; a few, because the unknowns of a line are numbered along it."""
    if not len(places):
        return []
    ends = [0, *(np.flatnonzero(np.diff(places) != 1) + 1).tolist(), len(places)]
    return [(slice(a, b), slice(int(places[a]), int(places[a]) + b - a)) for a, b in pairwise(ends)]
