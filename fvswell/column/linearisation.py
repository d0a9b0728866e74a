"""A Newton step of the balances of a column: from derivatives of contents and fluxes to a banded system.

The residual of a cell of reference width W is W (content - base) + dt (upper flux - lower flux). Arrays are stacked
as (balances, unknowns, rows, cells or faces); faces are the filter and the inner ones, face i lying below cell i.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from fvswell.physics.tissue import Array

__all__ = ["Linearisation", "NewtonStep", "band_storage", "cell_blocks", "newton_step", "solve_blocks"]

Blocks = tuple[Array, Array, Array]


class Linearisation(NamedTuple):
    """Derivatives of contents and fluxes by the unknowns."""

    storage: Array  # (balances, unknowns, rows, cells)
    by_upper: Array  # (balances, unknowns, rows, faces): by the unknowns of the cell above the face
    by_lower: Array  # (balances, unknowns, rows, faces): of the cell below; zero at the filter
    by_pressure: Array  # (balances, rows): flux at the filter by the applied pressure


class NewtonStep(NamedTuple):
    """Newton step of the unknowns, and its derivative by the applied pressure where asked for; nan: no solution."""

    step: Array  # (balances, rows, cells)
    by_pressure: Array | None


def newton_step(
    linear: Linearisation, widths: Array, duration: Array, residual: Array, fluxes: Array, with_pressure: bool
) -> NewtonStep:
    """Solve for the step that makes the linearised balances zero.

    Parameters
    ----------
    linear
        Derivatives at the iterate.
    widths, duration
        Reference widths of the cells (cells,) and length of the interval (rows, 1).
    residual, fluxes
        At the iterate, (balances, rows, cells) and (balances, rows, faces).
    with_pressure
        Whether the derivative by the applied pressure is asked for.
    """
    sides, crossing = [residual], [fluxes]
    if with_pressure:
        by_pressure = np.zeros_like(fluxes)
        by_pressure[..., 0] = linear.by_pressure
        sides.append(duration * np.diff(by_pressure, append=0.0))
        crossing.append(by_pressure)
    if len(residual) == 3:
        steps = _condensed_steps(linear, widths, duration, sides, crossing)
    else:
        steps = [-x for x in solve_blocks(cell_blocks(widths, duration, linear), sides)]
    return NewtonStep(steps[0], steps[1] if with_pressure else None)


def _condensed_steps(
    linear: Linearisation, widths: Array, duration: Array, sides: Sequence[Array], fluxes: Sequence[Array]
) -> list[Array]:
    """Steps with the charge balance condensed face by face.

    No current passes the piston, so the charge balances of the cells say that none passes any face. That gives the
    step of the difference of psi~ across a face from the steps of J and ln c~ beside it, and two unknowns in a cell
    remain. The result is that of the whole system, to rounding.
    """
    by_difference = linear.by_upper[:, 2]  # of the fluxes, by the difference of psi~ across the face
    share = by_difference[:2] / by_difference[2]
    condensed = Linearisation(
        linear.storage[:2, :2],
        linear.by_upper[:2, :2] - share[:, None] * linear.by_upper[2, :2],
        linear.by_lower[:2, :2] - share[:, None] * linear.by_lower[2, :2],
        linear.by_pressure,
    )
    reduced = [
        side[:2] - duration * np.diff(share * flux[2], append=0.0) for side, flux in zip(sides, fluxes, strict=True)
    ]
    steps = []
    for solved, flux in zip(solve_blocks(cell_blocks(widths, duration, condensed), reduced), fluxes, strict=True):
        step = np.empty_like(sides[0])
        step[:2] = -solved
        current = flux[2] + np.einsum("urf,urf->rf", linear.by_upper[2, :2], step[:2])
        current[:, 1:] += np.einsum("urf,urf->rf", linear.by_lower[2, :2, :, 1:], step[:2, :, :-1])
        np.cumsum(-current / by_difference[2], axis=-1, out=step[2])
        steps.append(step)
    return steps


def cell_blocks(widths: Array, duration: Array, linear: Linearisation) -> Blocks:
    """Jacobian of the residual in blocks (balance, unknown, row, cell).

    Derivatives of a cell's balances by its own unknowns, by those of the cell below it (for all cells but the first)
    and by those of the cell above it (for all but the last).
    """
    diagonal = widths * linear.storage - duration * linear.by_upper
    diagonal[..., :-1] += duration * linear.by_lower[..., 1:]
    return diagonal, -duration * linear.by_lower[..., 1:], duration * linear.by_upper[..., 1:]


def band_storage(blocks: Blocks) -> Array:
    """LAPACK's bands of `cell_blocks`, transposed: (unknowns, 3 * bandwidth + 1), ordered row by row, cell by cell.

    The bandwidth is 2 V - 1 with V unknowns in a cell; transposed, LAPACK gets it in Fortran's order without a copy.
    """
    V, _, R, n = blocks[0].shape
    bandwidth = 2 * V - 1
    bands = np.zeros((R, n, V, 3 * bandwidth + 1))
    places = ((slice(None), 0), (slice(None, -1), V), (slice(1, None), -V))
    for block, (cells, offset) in zip(blocks, places, strict=True):
        for variable in range(V):
            start = 2 * bandwidth + offset - variable
            for equation in range(V):
                bands[:, cells, variable, start + equation] = block[equation, variable]
    return bands.reshape(R * n * V, -1)


def solve_blocks(blocks: Blocks, sides: Sequence[Array]) -> list[Array]:
    """Solve for each side (balances, rows, cells); nan in the rows that have no solution."""
    V, _, R, n = blocks[0].shape
    bands, columns = band_storage(blocks), np.moveaxis(np.stack(sides), 1, -1).reshape(len(sides), -1)
    solved = _gbsv(bands, 2 * V - 1, columns)
    if R > 1 and not np.isfinite(solved).all():  # one bad row spoils those behind it: solve each by itself
        parts = zip(np.split(bands, R), np.split(columns, R, axis=1), strict=True)
        solved = np.concatenate([_gbsv(own, 2 * V - 1, part) for own, part in parts], axis=1)
    return [np.moveaxis(x.reshape(R, n, V), -1, 0) for x in solved]


def _gbsv(bands: Array, bandwidth: int, columns: Array) -> Array:
    _, _, solved, info = lapack.dgbsv(bandwidth, bandwidth, bands.T, columns.T)
    return solved.T if info == 0 else np.full_like(columns, np.nan)
