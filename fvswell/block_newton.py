"""Newton's method for a block: damped, with a sparse direct solver."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse.linalg import MatrixRankWarning, splu

from fvswell.block import BlockState
from fvswell.tissue import Array

__all__ = ["NewtonResult", "newton", "solve_sparse"]

_MAX_ITERATIONS = 25
_MAX_HALVINGS = 12
_UPDATE = 1e-9  # change of an unknown, relative to its size, below which the next one would be rounding
_RESIDUAL = 1e-13  # relative: converged without asking how large the update was
_UNBALANCED = 1e-9  # relative: never accepted above


@dataclass(frozen=True)
class NewtonResult:
    """Where the iteration ended."""

    unknowns: Array
    state: BlockState
    residual: Array  # relative
    converged: bool
    iterations: int
    norms: tuple[float, ...]  # largest relative residual before and after each iteration


def newton(
    unknowns: Array,
    evaluate: Callable[[Array], tuple[BlockState, Array]],
    step: Callable[[BlockState], Array],
    change: Callable[[Array], float],
) -> NewtonResult:
    """Solve residual = 0 by Newton's method, with shorter steps where a full one is not admissible or makes it worse.

    Parameters
    ----------
    unknowns
        To start from; admissible.
    evaluate
        State and relative residual at some unknowns.
    step
        Newton's step from a state.
    change
        Largest relative change that a step makes to the unknowns.
    """

    def look(at: Array) -> tuple[BlockState, Array, float]:
        with np.errstate(all="ignore"):  # a trial state may overflow: its norm is then not finite
            state, residual = evaluate(at)
        norm = float(np.abs(residual).max()) if state.admissible else np.inf
        return state, residual, norm if np.isfinite(norm) else np.inf

    state, residual, norm = look(unknowns)
    norms = [norm]
    for iteration in range(1, _MAX_ITERATIONS + 1):
        full = step(state)
        if not np.isfinite(full).all():
            break
        before, start, fraction = norm, unknowns, 1.0
        for _ in range(_MAX_HALVINGS):
            unknowns = start + fraction * full
            state, residual, norm = look(unknowns)
            if norm <= max(before, _UNBALANCED):
                break
            fraction *= 0.5
        norms.append(norm)
        if norm < _RESIDUAL or (norm < _UNBALANCED and fraction == 1.0 and change(full) < _UPDATE):
            return NewtonResult(unknowns, state, residual, True, iteration, tuple(norms))
        if not np.isfinite(norm):
            break
    return NewtonResult(unknowns, state, residual, False, len(norms), tuple(norms))


def solve_sparse(matrix: Any, right_side: Array) -> Array:
    """Solution of a sparse system in compressed columns whose pattern is symmetric; nan if the matrix is singular."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", MatrixRankWarning)
        try:
            factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01, options={"SymmetricMode": True})
        except (RuntimeError, MatrixRankWarning):  # exactly singular
            return np.full_like(right_side, np.nan)
    return factors.solve(right_side)
