"""Sparse direct solution of many systems with one pattern: the ordering that keeps the factors sparse is found once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from fvswell.physics.tissue import Array

__all__ = ["DirectSolver", "Factors", "nested_dissection"]

_UNDIVIDED = 40  # unknowns: smaller parts are not cut again (the time hardly depends on it from 10 to 60)


class DirectSolver:
    """Factorises matrices whose entries lie in the same places.

    Parameters
    ----------
    rows, columns
        Of the entries, ``(entries,)``.
    places
        Of the unknowns on the grid, ``(2, unknowns)``, see `nested_dissection`.
    """

    def __init__(self, rows: Array, columns: Array, places: Array) -> None:
        size = places.shape[1]
        graph = sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=(size, size))
        self._order = nested_dissection(graph + graph.T, places)
        number = np.empty(size, dtype=np.int32)
        number[self._order] = np.arange(size)
        rows, columns = number[rows], number[columns]
        self._entries = np.lexsort((rows, columns))
        self._indices = rows[self._entries]
        self._indptr = np.searchsorted(columns[self._entries], np.arange(size + 1)).astype(np.int32)

    def factorise(self, values: Array) -> Factors:
        """Factors of the matrix with these values of the entries."""
        size = len(self._order)
        matrix = sparse.csc_array((values[self._entries], self._indices, self._indptr), shape=(size, size))
        try:
            factors = splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0.01, options={"SymmetricMode": True})
        except RuntimeError:  # exactly singular
            factors = None
        return Factors(factors, self._order)


@dataclass(frozen=True)
class Factors:
    """Factors of a matrix, or None if it is singular, and the order of its unknowns in them."""

    factors: Any  # scipy.sparse.linalg.SuperLU
    order: Array

    @property
    def entries(self) -> int:
        """Number of entries that are stored."""
        return int(self.factors.nnz)

    def solve(self, right_side: Array) -> Array:
        """Solution of the system, nan if the matrix is singular."""
        solution = np.full_like(right_side, np.nan)
        if self.factors is not None:
            solution[self.order] = self.factors.solve(right_side[self.order])
        return solution


def nested_dissection(graph: sparse.csr_array, places: Array) -> Array:
    """Order of elimination: the two halves of a grid before the line of unknowns that separates them, and so on.

    Parameters
    ----------
    graph
        Positive where two unknowns appear together in an equation; symmetric.
    places
        Of the unknowns, ``(2, unknowns)``; nan for those that belong to no single place, which come last.

    Returns
    -------
    array
        Unknowns in the order of their elimination (George 1973).
    """
    behind = np.zeros(graph.shape[0])  # 1 for the unknowns of the first half

    def ordered(part: Array) -> list[Array]:
        if len(part) <= _UNDIVIDED:
            return [part]
        along = places[np.ptp(places[:, part], axis=1).argmax(), part]
        first = along < np.median(along)
        if not first.any():
            return [part]
        before, after = part[first], part[~first]
        behind[before] = 1.0
        separating = graph[after] @ behind > 0.0
        behind[before] = 0.0
        return [*ordered(before), *ordered(after[~separating]), after[separating]]

    placed = np.isfinite(places).all(axis=0)
    return np.concatenate([*ordered(np.flatnonzero(placed)), np.flatnonzero(~placed)])
