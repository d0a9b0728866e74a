"""Sparse direct solution of many systems with one pattern: the ordering that keeps the factors sparse is found once."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache, cached_property, partial
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from fvswell.numerics.dissection import nested_dissection
from fvswell.numerics.fronts import Fronts
from fvswell.physics.tissue import Array

__all__ = ["DirectSolver", "Factors"]

_VARIABLE = "FVSWELL_SPARSE_SOLVER"
_METHODS = ("fronts", "superlu")
_REFINED = 1e-10  # residual relative to the right side: refined above
_SOLVED = 1e-6  # no solution above
_REFINEMENTS = 2
_TINY = np.finfo(float).tiny  # for a right side of zeros


class _Solves(Protocol):
    """Factors of one matrix, by whichever method."""

    @property
    def entries(self) -> int | None:
        """Number of entries that are stored."""

    def solve(self, right_side: Array) -> Array:
        """Solution of the system, or anything if the factors are bad."""


class DirectSolver:
    """Factorises matrices whose entries lie in the same places.

    Fronts take their pivots from within a part of the grid. Where there is none, or the solution does not satisfy
    the system, SuperLU is asked, which takes them from the whole matrix. FVSWELL_SPARSE_SOLVER=superlu in the
    environment asks SuperLU alone.

    Parameters
    ----------
    rows, columns
        Of the entries, ``(entries,)``, each place once.
    places
        Of the unknowns on the grid, ``(2, unknowns)``, see `nested_dissection`.

    Raises
    ------
    ValueError
        If the environment asks for a method that there is not.
    """

    def __init__(self, rows: Array, columns: Array, places: Array) -> None:
        self._rows, self._columns, size = rows, columns, places.shape[1]
        self._by_row = np.lexsort((columns, rows))
        self._indices = columns[self._by_row].astype(np.int32)
        self._indptr = np.searchsorted(rows[self._by_row], np.arange(size + 1)).astype(np.int32)
        graph = self._matrix(np.ones(len(rows)))
        self._parts = nested_dissection(graph + graph.T, places)
        self._fronts = Fronts(rows, columns, self._parts) if _method() == "fronts" else None

    def factorise(self, values: Array) -> Factors:
        """Factors of the matrix with these values of the entries."""
        attempts: list[Callable[[], _Solves | None]] = [lambda: self._superlu.factorise(values)]
        if self._fronts is not None:
            attempts.insert(0, partial(self._fronts.factorise, values))
        return Factors(self._matrix(values), attempts)

    @cached_property
    def _superlu(self) -> _SuperLU:
        return _SuperLU(self._rows, self._columns, np.concatenate([part.unknowns for part in self._parts]))

    def _matrix(self, values: Array) -> sparse.csr_array:
        size = len(self._indptr) - 1
        return sparse.csr_array((values[self._by_row], self._indices, self._indptr), shape=(size, size))


class Factors:
    """Factors of a matrix.

    Parameters
    ----------
    matrix
        With finite values, or the solutions are nan.
    attempts
        Ways to factorise it. The first is taken at once, each other one when those before it do not solve a system.
    """

    def __init__(self, matrix: sparse.csr_array, attempts: list[Callable[[], _Solves | None]]) -> None:
        self._matrix = matrix
        finite = bool(np.isfinite(matrix.data).all())
        self._attempts = [cache(attempt) for attempt in attempts] if finite else [lambda: None]
        self._attempts[0]()

    @property
    def entries(self) -> int | None:
        """Number of entries that are stored; None if the matrix is singular or the library does not say."""
        factors = self._attempts[0]()
        return factors.entries if factors else None

    def solve(self, right_side: Array) -> Array:
        """Solution of the system, nan if the matrix is singular or close to it."""
        for attempt in self._attempts:
            factors = attempt()
            if factors is not None:
                solution, error = self._refined(factors, right_side)
                if error <= _SOLVED:
                    return solution
        return np.full_like(right_side, np.nan)

    def _refined(self, factors: _Solves, right_side: Array) -> tuple[Array, float]:
        """Solution, and its residual relative to the right side."""
        solution, size = factors.solve(right_side), float(np.abs(right_side).max(initial=_TINY))
        residual = right_side - self._matrix @ solution
        error = float(np.abs(residual).max(initial=0.0)) / size
        for _ in range(_REFINEMENTS):
            if not _REFINED < error < 1.0:
                break
            solution = solution + factors.solve(residual)
            residual = right_side - self._matrix @ solution
            error = float(np.abs(residual).max(initial=0.0)) / size
        return solution, error


def _method() -> str:
    """Method that the environment asks for."""
    method = os.environ.get(_VARIABLE, _METHODS[0])
    if method not in _METHODS:
        raise ValueError(f"{_VARIABLE} is {method!r} in the environment; it can be {' or '.join(_METHODS)}")
    return method


class _SuperLU:
    """SuperLU with the unknowns in a given order."""

    def __init__(self, rows: Array, columns: Array, order: Array) -> None:
        self._order = order
        number = np.empty(len(order), dtype=np.int32)
        number[order] = np.arange(len(order))
        rows, columns = number[rows], number[columns]
        self._entries = np.lexsort((rows, columns))
        self._indices = rows[self._entries]
        self._indptr = np.searchsorted(columns[self._entries], np.arange(len(order) + 1)).astype(np.int32)

    def factorise(self, values: Array) -> _SuperLUFactors | None:
        """Factors of the matrix with these values of the entries; None if it is exactly singular."""
        size = len(self._order)
        matrix = sparse.csc_array((values[self._entries], self._indices, self._indptr), shape=(size, size))
        try:
            factors = splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0.01, options={"SymmetricMode": True})
        except RuntimeError:  # exactly singular
            return None
        return _SuperLUFactors(factors, self._order)


class _SuperLUFactors(NamedTuple):
    factors: Any  # scipy.sparse.linalg.SuperLU
    order: Array

    @property
    def entries(self) -> int:
        """Number of entries that are stored."""
        return int(self.factors.nnz)

    def solve(self, right_side: Array) -> Array:
        """Solution of the system."""
        solution = np.empty_like(right_side)
        solution[self.order] = self.factors.solve(right_side[self.order])
        return solution
