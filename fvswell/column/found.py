"""Pressure and current of a column where they are found with the contents.

The height of a column is linear in its contents, and its rise of the potential depends on them as the fluxes do; fluxes
and rise are linear in pressure and current. So both follow from two equations wherever contents are known, and in a
Newton step the two join the balances as a border.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fvswell.column.balances import CURRENT, HEIGHT, POTENTIAL, PRESSURE, RISE, current_along
from fvswell.compiled import point

__all__ = ["current_in_column", "current_is_missing", "evaluate_body", "find_scalars", "scalar_steps"]


@point
def evaluate_body(body: Any, contents: Any, loads: Any) -> Any:
    """Fluxes of a body and their derivatives, into its arrays."""
    body.evaluate(
        body.cells, body.faces, body.metric, contents, loads, body.ends, body.fluxes, body.by_lower, body.by_upper,
        body.by_pressure, body.by_current, body.potentials,
    )  # fmt: skip


@point
def current_in_column(contents: Any, loads: Any) -> Any:
    """Current along x, A/mm2: nan where it has to be found, 0 where ions are not transported."""
    return current_along(loads) if contents.shape[0] > 1 else 0.0


@point
def current_is_missing(body: Any, contents: Any, loads: Any) -> Any:
    """Whether the current has to be found, of a body that can find it."""
    return body.by_current.shape[0] > 2 and np.isnan(current_in_column(contents, loads))


@point
def _missing_potential(body: Any, loads: Any) -> Any:
    """What the rise of the potential along x lacks of the one that is given, mV."""
    missing = loads[POTENTIAL + 1] - loads[POTENTIAL]
    for i in range(body.fluxes.shape[1]):
        missing -= body.fluxes[RISE, i]
    return missing


@point
def _two_equations(a: Any, b: Any, c: Any, d: Any, first: Any, second: Any) -> Any:
    """Solve a x + b y = first, c x + d y = second; exact where b = c = 0."""
    y = (second - c * first / a) / (d - c * b / a)
    return (first - b * y) / a, y


@point
def find_scalars(body: Any, unknowns: Any, contents: Any, loads: Any, growth: Any) -> Any:
    """Find the pressure, the current or both, where they are not given: the last of the unknowns, and in the loads.

    ``growth`` is the rate at which the height changes, mm/s; the pressure is left as it is without one (nan).
    """
    balances, n = contents.shape
    pressure, current = balances * n, balances * n + 1
    held, found = not np.isnan(growth), current_is_missing(body, contents, loads)
    if not held:
        unknowns[pressure] = unknowns[pressure] if np.isnan(loads[PRESSURE]) else loads[PRESSURE]
    if not found:
        unknowns[current] = current_in_column(contents, loads)
    loads[PRESSURE], loads[CURRENT] = unknowns[pressure], unknowns[current]
    if not held and not found:
        return
    evaluate_body(body, contents, loads)
    a, b, c, d, lacking, missing = 1.0, 0.0, 0.0, 1.0, 0.0, 0.0
    if held:  # what enters is what the moving end makes room for
        lacking = growth - (body.fluxes[0, 0] - body.fluxes[0, n])
        a = body.by_pressure[0, 0] - body.by_pressure[0, 1]
    if found:
        missing, d = _missing_potential(body, loads), 0.0
        for i in range(n + 1):
            d += body.by_current[2, i]
    if held and found:
        b = body.by_current[0, 0] - body.by_current[0, n]
        c = body.by_pressure[2, 0] + body.by_pressure[2, 1]
    rise, change = _two_equations(a, b, c, d, lacking, missing)
    unknowns[pressure] += rise
    unknowns[current] += change
    loads[PRESSURE], loads[CURRENT] = unknowns[pressure], unknowns[current]


@point
def scalar_steps(body: Any, contents: Any, loads: Any, held: Any, found: Any) -> Any:
    """Newton steps of pressure and current, which are added to that of the contents, ``body.step``.

    Returns
    -------
    tuple
        Both steps, and what the height (relative) and the potential (mV) lacked before them, where they are given.
    """
    balances, n = contents.shape
    a, b, c, d, gap, missing, lacked = 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    if held:
        gap, a = loads[HEIGHT], 0.0
        for i in range(n):
            gap -= body.widths[i] * (contents[0, i] + body.step[0, i])
            a += body.widths[i] * body.response[0, i]
    if found:
        lacked = _missing_potential(body, loads)
        missing, d = lacked, 0.0
        for i in range(n + 1):
            d += body.by_current[2, i]
            for u in range(balances):
                if i > 0:
                    missing -= body.by_lower[2, u, i] * body.step[u, i - 1]
                    d += body.by_lower[2, u, i] * body.electric[u, i - 1]
                if i < n:
                    missing -= body.by_upper[2, u, i] * body.step[u, i]
                    d += body.by_upper[2, u, i] * body.electric[u, i]
    if held and found:
        c = body.by_pressure[2, 0] + body.by_pressure[2, 1]
        for i in range(n):
            b += body.widths[i] * body.electric[0, i]
            for u in range(balances):
                c += body.by_lower[2, u, i + 1] * body.response[u, i] + body.by_upper[2, u, i] * body.response[u, i]
    pressure_step, current_step = _two_equations(a, b, c, d, gap, missing)
    for u in range(balances):
        for i in range(n):
            if held:
                body.step[u, i] += pressure_step * body.response[u, i]
            if found:
                body.step[u, i] += current_step * body.electric[u, i]
    return pressure_step, current_step, gap / loads[HEIGHT] if held else 0.0, lacked
