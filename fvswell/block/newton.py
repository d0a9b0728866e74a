"""Newton's method for a block: damped, and close to the solution with the factors of the last Jacobian."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fvswell.block.block import BlockState
from fvswell.physics.tissue import Array

__all__ = ["NewtonResult", "newton"]

_MAX_ITERATIONS = 25
_MAX_HALVINGS = 12
_KEEP = 0.1  # the factors serve on while each step is shorter than this part of the last
_REMAINING = 1e-13  # change of an unknown still to come, relative to its size: rounding
_RESIDUAL = 1e-13  # relative: converged without asking how large the update was
_UNBALANCED = 1e-9  # relative: not accepted above, unless no update can make it better
_ROUNDING = 1e-12  # change of an unknown, relative to its size, that is rounding already


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
    factorise: Callable[[BlockState], Callable[[Array], Array]],
    change: Callable[[Array], float],
) -> NewtonResult:
    """Solve residual = 0 by Newton's method, with shorter steps where a full one is not admissible or makes it worse.

    Parameters
    ----------
    unknowns
        To start from; admissible.
    evaluate
        State and relative residual at some unknowns.
    factorise
        Gives, at a state, what turns a relative residual into a step.
    change
        Largest relative change that a step makes to the unknowns.
    """

    def look(at: Array) -> tuple[BlockState, Array, float]:
        with np.errstate(all="ignore"):  # a trial state may overflow: its norm is then not finite
            state, residual = evaluate(at)
        norm = float(np.abs(residual).max(initial=0.0)) if state.sound.all() else np.inf
        return state, residual, norm if np.isfinite(norm) else np.inf

    state, residual, norm = look(unknowns)
    if norm == 0.0 or not np.isfinite(norm):
        return NewtonResult(unknowns, state, residual, norm == 0.0, 0, (norm,))
    norms, solve, last = [norm], factorise(state), 1.0
    for iteration in range(1, _MAX_ITERATIONS + 1):
        full = solve(residual)
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
        size = change(full)
        shrinking = size / last if fraction == 1.0 else np.inf
        balanced = norm < _UNBALANCED or (np.isfinite(norm) and size < _ROUNDING)
        if norm < _RESIDUAL or (balanced and size * min(shrinking, 1.0) < _REMAINING):
            return NewtonResult(unknowns, state, residual, True, iteration, tuple(norms))
        if not np.isfinite(norm):
            break
        if not shrinking < _KEEP:
            solve = factorise(state)
        last = size
    return NewtonResult(unknowns, state, residual, False, len(norms), tuple(norms))
