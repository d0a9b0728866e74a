"""A column as the time integrator sees it: implicit stages by Newton's method, with everything about it in arrays.

The unknowns are the contents of the cells and, last, the pressure of the piston and the current along x. Where the
height of the column is given, the pressure is found together with the contents; where the potentials of both ends are,
the current is.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fvswell.column.balances import CURRENT, HEIGHT, PRESSURE
from fvswell.column.found import current_in_column, current_is_missing, evaluate_body, find_scalars, scalar_steps
from fvswell.compiled import compiled_type, generic, point
from fvswell.numerics.block_tridiagonal import solve_block_tridiagonal
from fvswell.numerics.body import admissible, complete_loads, find_rate, find_unknowns, global_strain, solve_stage
from fvswell.numerics.state import (
    BALANCE,
    CONVERGED,
    ITERATIONS,
    NEWTON,
    NO_WATER,
    NOT_CONVERGED,
    POINT,
    REASON,
    RESIDUAL,
    UPDATE,
)
from fvswell.physics.constants import FARADAY

__all__ = ["ColumnBody", "find_electric_response", "find_step"]

_MAX_ITERATIONS = 25
_MAX_HALVINGS = 8
_NEAR = 1e-6  # update so close to the solution that Newton's step is taken whole
_UNBALANCED = 1e-9  # residual, relative to the contents, below which it may grow: it is near rounding
_OFF = 1e-6  # mV, of a given potential, above which the residual may grow on the way to it
_ROUNDING = 1e-13  # update that is rounding: no balance can be closed better
_SMALLEST_KNOWN = 1e-7  # update that still says how fast Newton converges
_FORGETTING = 4.0  # how much slower it is taken to converge each time that it is relied upon and not seen
_DRY = 1e-4  # of the water at J = 1: less is none
_ROOM = 0.9  # of the water or salt in a cell that one iteration may take away


class ColumnBody(NamedTuple):
    """A column; arrays as in `fvswell.column.balances`."""

    evaluate: Any  # compiled balances of its combination of laws
    cells: Any
    faces: Any
    metric: Any
    ends: Any
    widths: Any  # (cells,) reference widths, mm
    scale: Any  # (balances,) natural size of the contents
    dry: Any  # (cells,) J without water, 1 - n_f0
    initial_height: float  # of the equilibrated column, mm
    fluxes: Any  # workspace from here on
    by_lower: Any
    by_upper: Any
    by_pressure: Any
    by_current: Any
    potentials: Any
    lower: Any
    diagonal: Any
    upper: Any
    right: Any
    step: Any
    response: Any
    electric: Any
    start: Any

    @property
    def _numba_type_(self) -> Any:
        """Type in compiled code, the same for all columns: to find it each time takes as long as many steps."""
        return compiled_type(self)


@generic
def find_step(body: Any, contents: Any, base: Any, duration: Any, loads: Any) -> Any:
    """Newton's step from contents into ``body.step``, and its derivative by the pressure into ``body.response``.

    The balances have been evaluated there; ``body.right`` holds their residual with the opposite sign.
    """


@generic
def find_electric_response(body: Any, contents: Any, base: Any, duration: Any, loads: Any) -> Any:
    """Derivative of the step that `find_step` has found by the current, into ``body.electric``."""


@find_step.register(ColumnBody)
def _find_step(body: Any, contents: Any, base: Any, duration: Any, loads: Any) -> Any:
    _assemble(body, duration)
    _set_right_sides(body, duration)
    solve_block_tridiagonal(body.lower, body.diagonal, body.upper, body.step, body.response)


@find_electric_response.register(ColumnBody)
def _find_electric_response(body: Any, contents: Any, base: Any, duration: Any, loads: Any) -> Any:
    balances, n = contents.shape
    _assemble(body, duration)
    for b in range(balances):
        for i in range(n):
            body.electric[b, i] = duration * (body.by_current[b, i] - body.by_current[b, i + 1])
    # the residual has been used: it is the second right side here, of which nothing is wanted
    solve_block_tridiagonal(body.lower, body.diagonal, body.upper, body.electric, body.right)


@global_strain.register(ColumnBody)
def _strain(body: Any, unknowns: Any, contents: Any) -> Any:
    height = 0.0
    for i in range(len(body.widths)):
        height += body.widths[i] * contents[0, i]
    return height / body.initial_height - 1.0


@admissible.register(ColumnBody)
def _admissible(body: Any, guess: Any, unknowns: Any) -> Any:
    n = len(body.widths)
    balances = (len(guess) - 2) // n
    for i in range(n):
        if not guess[i] - body.dry[i] > 0.5 * (unknowns[i] - body.dry[i]):
            return False
        if balances > 1 and not 0.5 * unknowns[n + i] < guess[n + i] < 2.0 * unknowns[n + i]:
            return False
    return True


@complete_loads.register(ColumnBody)
def _complete_loads(body: Any, unknowns: Any, contents: Any, loads: Any) -> Any:
    find_scalars(body, unknowns, contents, loads, np.nan)
    loads[CURRENT + 1] = -loads[CURRENT]
    height = 0.0
    for i in range(len(body.widths)):
        height += body.widths[i] * contents[0, i]
    loads[HEIGHT] = height


@find_unknowns.register(ColumnBody)
def _find_unknowns(body: Any, unknowns: Any, contents: Any, loads: Any, slopes: Any) -> Any:
    balances, n = contents.shape
    for b in range(balances):
        for i in range(n):
            unknowns[b * n + i] = contents[b, i]
    find_scalars(body, unknowns, contents, loads, np.nan if np.isnan(loads[HEIGHT]) else slopes[HEIGHT])


@find_rate.register(ColumnBody)
def _find_rate(
    body: Any, unknowns: Any, contents: Any, loads: Any, slopes: Any, rate: Any, crossing: Any, clock: Any, report: Any
) -> Any:
    balances, n = contents.shape
    _find_unknowns(body, unknowns, contents, loads, slopes)
    evaluate_body(body, contents, loads)
    for b in range(balances):
        for i in range(n):
            rate[b, i] = (body.fluxes[b, i] - body.fluxes[b, i + 1]) / body.widths[i]
    for q in range(3):
        crossing[0, q] = body.fluxes[min(q, 1), 0]
        crossing[1, q] = -body.fluxes[min(q, 1), n]
    crossing[0, 2] += loads[CURRENT] / FARADAY
    crossing[1, 2] -= loads[CURRENT] / FARADAY
    return np.isfinite(crossing[0, 0]) and np.isfinite(crossing[1, 0])


@solve_stage.register(ColumnBody)
def _solve_stage(
    body: Any,
    unknowns: Any,
    contents: Any,
    base: Any,
    duration: Any,
    loads: Any,
    tolerance: Any,
    crossing: Any,
    clock: Any,
    report: Any,
) -> Any:
    balances, n = contents.shape
    held = not np.isnan(loads[HEIGHT])
    pressure = unknowns[balances * n] if held else loads[PRESSURE]
    current = current_in_column(contents, loads)
    found = current_is_missing(body, contents, loads)
    if found:
        current = unknowns[balances * n + 1]
    start_current, current_step = current, 0.0
    for b in range(balances):
        for i in range(n):
            contents[b, i] = unknowns[b * n + i]
    before, size, last, fraction, halvings = np.inf, np.inf, np.inf, 1.0, 0
    pressure_step = 0.0
    report[REASON] = NOT_CONVERGED
    done = False
    report[ITERATIONS] = 0.0
    while report[ITERATIONS] < _MAX_ITERATIONS:
        loads[PRESSURE], loads[CURRENT] = pressure, current
        evaluate_body(body, contents, loads)
        norm = _residual(body, contents, base, duration, report)
        if not norm <= before and not size < _NEAR and halvings < _MAX_HALVINGS:
            halvings += 1  # worse than before: half the step
            fraction *= 0.5
            _go(body, contents, fraction)
            pressure = body.start[balances - 1, n] + fraction * pressure_step
            current = start_current + fraction * current_step
            continue
        if not np.isfinite(norm):
            break
        report[ITERATIONS] += 1.0
        halvings, before = 0, max(norm, _UNBALANCED)
        find_step(body, contents, base, duration, loads)
        pressure_step, current_step = 0.0, 0.0
        if found:
            find_electric_response(body, contents, base, duration, loads)
        if held or found:
            pressure_step, current_step, gap, lacked = scalar_steps(body, contents, loads, held, found)
            before = np.inf if abs(gap) > _UNBALANCED or abs(lacked) > _OFF else before
        fraction = _admissible_part(body, contents)
        last, size = size, _size(body)
        body.start[balances - 1, n], start_current = pressure, current
        for b in range(balances):
            for i in range(n):
                body.start[b, i] = contents[b, i]
        _go(body, contents, fraction)
        pressure += fraction * pressure_step
        current += fraction * current_step
        report[UPDATE] = size
        if not np.isfinite(size):
            break
        if fraction < 1.0:
            size = np.inf
        elif _has_converged(size, last, tolerance, clock):
            done = True
            break
    driest = _driest(body, contents if done else body.start)
    if driest >= 0:  # what the balances say of so little water is rounding
        report[REASON], report[POINT], report[BALANCE] = NO_WATER, driest, 0
        return False
    if done:
        report[REASON] = CONVERGED
        _set_crossing(body, pressure_step, current_step, current, crossing)
        for b in range(balances):
            for i in range(n):
                unknowns[b * n + i] = contents[b, i]
        unknowns[balances * n] = pressure
        unknowns[balances * n + 1] = current
    return done


@point
def _go(body: Any, contents: Any, fraction: Any) -> Any:
    """Go a fraction of the step from the start."""
    balances, n = contents.shape
    for b in range(balances):
        for i in range(n):
            contents[b, i] = body.start[b, i] + fraction * body.step[b, i]


@point
def _has_converged(size: Any, last: Any, tolerance: Any, clock: Any) -> Any:
    """Whether the error that a whole step leaves is within the tolerance; ``last`` is the size of the step before.

    Newton's method is quadratic: the error is ``clock[NEWTON]`` times the square of the size. How fast it is has been
    seen in this stage, or is remembered from an earlier one, and is trusted less each time.
    """
    seen = last < np.inf and size > _SMALLEST_KNOWN
    if seen:
        clock[NEWTON] = size / last**2
    if size <= max(tolerance, _ROUNDING):
        return True
    if not clock[NEWTON] * size * size <= tolerance:
        return False
    if not seen:
        clock[NEWTON] *= _FORGETTING
    return True


@point
def _driest(body: Any, contents: Any) -> Any:
    """The cell that holds least water for its size, if it is as good as dry; else -1."""
    driest, least = -1, _DRY
    for i in range(len(body.dry)):
        share = (contents[0, i] - body.dry[i]) / (1.0 - body.dry[i])
        if share < least:
            driest, least = i, share
    return driest


@point
def _residual(body: Any, contents: Any, base: Any, duration: Any, report: Any) -> Any:
    """Right sides of a Newton step, and the largest residual relative to the contents."""
    balances, n = contents.shape
    worst = 0.0
    for b in range(balances):
        for i in range(n):
            residual = body.widths[i] * (contents[b, i] - base[b, i]) + duration * (
                body.fluxes[b, i + 1] - body.fluxes[b, i]
            )
            body.right[b, i] = -residual
            relative = abs(residual) / (body.widths[i] * body.scale[b])
            if not relative <= worst:
                worst = relative
                report[BALANCE], report[POINT], report[RESIDUAL] = b, i, worst
                if np.isnan(worst):
                    return np.inf
    report[RESIDUAL] = worst
    return worst


@point
def _assemble(body: Any, duration: Any) -> Any:
    """Derivatives of the residual by the contents."""
    balances, n = body.step.shape
    for b in range(balances):
        for u in range(balances):
            for i in range(n):
                body.diagonal[b, u, i] = duration * (body.by_lower[b, u, i + 1] - body.by_upper[b, u, i])
                body.lower[b, u, i] = -duration * body.by_lower[b, u, i]
                body.upper[b, u, i] = duration * body.by_upper[b, u, i + 1]
        for i in range(n):
            body.diagonal[b, b, i] += body.widths[i]


@point
def _set_right_sides(body: Any, duration: Any) -> Any:
    """The residual, and its derivative by the pressure, both with the opposite sign."""
    balances, n = body.step.shape
    for b in range(balances):
        for i in range(n):
            body.step[b, i] = body.right[b, i]
            body.response[b, i] = 0.0
        body.response[b, 0] += duration * body.by_pressure[b, 0]
        body.response[b, n - 1] -= duration * body.by_pressure[b, 1]


@point
def _admissible_part(body: Any, contents: Any) -> Any:
    """Largest part of the step, at most 1, that leaves water and salt in every cell."""
    balances, n = contents.shape
    part = 1.0
    for i in range(n):
        if body.step[0, i] < 0.0:
            part = min(part, -_ROOM * (contents[0, i] - body.dry[i]) / body.step[0, i])
        if balances > 1 and body.step[1, i] < 0.0:
            part = min(part, -_ROOM * contents[1, i] / body.step[1, i])
    return part


@point
def _size(body: Any) -> Any:
    """Size of the step: mean over the column of the change of the contents, of the balance that changes most."""
    balances, n = body.step.shape
    largest, total = 0.0, 0.0
    for i in range(n):
        total += body.widths[i]
    for b in range(balances):
        mean = 0.0
        for i in range(n):
            mean += body.widths[i] * abs(body.step[b, i])
        mean /= total * body.scale[b]
        if not mean <= largest:  # or not a number: the system is singular
            largest = mean
    return largest


@point
def _set_crossing(body: Any, pressure_step: Any, current_step: Any, current: Any, crossing: Any) -> Any:
    """Rates of entering through both ends: the fluxes of the last iterate, linearised to the solution."""
    balances, n = body.step.shape
    for end in range(2):
        face, cell, sign = n * end, (n - 1) * end, 1.0 - 2.0 * end
        for b in range(balances):
            flux = body.fluxes[b, face] + body.by_pressure[b, end] * pressure_step
            flux += body.by_current[b, face] * current_step
            for u in range(balances):
                slope = body.by_upper[b, u, face] if end == 0 else body.by_lower[b, u, face]
                flux += slope * body.step[u, cell]
            crossing[end, b] = sign * flux
        if balances == 1:
            crossing[end, 1] = 0.0
        crossing[end, 2] = crossing[end, 1] + sign * current / FARADAY
