"""Newton's method on the coupled balances of a batch of columns, banded and exact, each row on its own.

Rows share one factorisation but nothing else: a row that has converged leaves the batch, a row that fails does not
hold up the others, and a row takes the same iterates as it would alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from fvswell.tissue import Array
from fvswell.transport_term import Balance, BandedJacobian, CoupledTransportTerm, Stage

__all__ = ["Solution", "solve_stage"]

_MAX_ITERATIONS = 25
_MAX_HALVINGS = 8
_ERROR = 1e-11  # of the state (strain, ln c~, psi~) that may be left, estimated from the last two updates
_RESIDUAL = 1e-9  # of the contents that may be left in a cell
_LARGEST_CHANGE = 2.0  # of ln c~ or psi~ in one iteration


@dataclass
class Solution:
    """Result of a stage; arrays with a row axis hold the last iterate of rows that did not converge.

    ``residual`` is in units of content (strain, concentration over that of the bath).
    """

    unknowns: Array  # (balances, rows, cells)
    pressure: Array  # (rows, 1)
    contents: Array  # (balances, rows, cells)
    fluxes: Array  # (balances, rows, cells + 1)
    residual: Array  # (balances, rows, cells)
    converged: Array  # (rows,)
    iterations: Array  # (rows,)

    @classmethod
    def start(cls, unknowns: Array, pressure: Array) -> Solution:
        V, R, n = unknowns.shape
        return cls(
            unknowns.copy(), pressure.copy(), np.empty_like(unknowns), np.empty((V, R, n + 1)),
            np.full_like(unknowns, np.inf), np.zeros(R, dtype=bool), np.zeros(R, dtype=int),
        )  # fmt: skip

    def store(self, rows: Array, unknowns: Array, pressure: Array, balance: Balance, residual: Array) -> None:
        """Put the iterate of some rows in its place."""
        self.unknowns[:, rows], self.pressure[rows] = unknowns, pressure
        self.contents[:, rows], self.fluxes[:, rows] = balance.contents, balance.fluxes
        self.residual[:, rows] = residual


def solve_stage(
    term: CoupledTransportTerm, guess: Array, pressure: Array, stage: Stage, height: Array
) -> Solution:
    """Solve the balances of one implicit stage for every row.

    Parameters
    ----------
    term
        The balances.
    guess
        Unknowns to start from, ``(balances, rows, cells)``.
    pressure
        Applied pressure to start from where the height is prescribed, ``(rows, 1)``, MPa.
    stage
        Base contents, duration and loads.
    height
        Prescribed height of the column, ``(rows,)``, mm; nan where the pressure of the loads acts.

    Returns
    -------
    Solution
        With ``converged`` false for the rows that failed.
    """
    solution = Solution.start(guess, np.where(np.isnan(height)[:, None], stage.loads.applied_pressure, pressure))
    active = np.arange(guess.shape[1])
    last_size = np.full(len(active), np.inf)
    iterate = _Iterate(term, solution.unknowns, solution.pressure, stage, height)
    for iteration in range(1, _MAX_ITERATIONS + 1):
        size = iterate.advance()
        solution.iterations[active] = iteration
        solution.store(active, iterate.unknowns, iterate.pressure, iterate.current, iterate.residual)
        with np.errstate(divide="ignore", invalid="ignore"):
            remaining = np.where(np.isfinite(last_size), size**3 / last_size**2, size)
        settled = (np.minimum(remaining, size) < _ERROR) & (iterate.norm < _RESIDUAL)
        solution.converged[active[settled]] = True
        going = ~settled & np.isfinite(iterate.norm)
        if not going.any():
            break
        if not going.all():
            active, iterate, size = active[going], iterate.rows(np.flatnonzero(going)), size[going]
        last_size = size
    return solution


class _Iterate:
    """State of the iteration for the rows still in the batch."""

    def __init__(
        self, term: CoupledTransportTerm, unknowns: Array, pressure: Array, stage: Stage, height: Array
    ) -> None:
        self.term, self.unknowns, self.pressure = term, unknowns.copy(), pressure.copy()
        self.stage, self.height = stage, height
        self.scale = term.content_scale(stage)
        self._evaluate()

    def rows(self, index: Array) -> _Iterate:
        stage = Stage(
            self.stage.base[:, index],
            self.stage.duration[index],
            self.stage.loads._replace(**{k: v[index] for k, v in self.stage.loads._asdict().items()}),
        )
        return _Iterate(
            self.term.rows(index), self.unknowns[:, index], self.pressure[index], stage, self.height[index]
        )

    def _evaluate(self) -> None:
        stage = self.stage._replace(loads=self.stage.loads._replace(applied_pressure=self.pressure))
        with np.errstate(all="ignore"):  # a trial state may overflow; that shows as a norm that is not finite
            self.current = self.term.balance(self.unknowns, stage)
            self.residual = self.current.residual / self.scale
            self.norm = np.abs(self.residual).max(axis=(0, 2))

    def advance(self) -> Array:
        """One damped Newton update; returns its size in each row (largest change of an unknown)."""
        step, pressure_step = self._newton_step()
        fraction = self._admissible_fraction(step)
        before, start, start_pressure = self.norm, self.unknowns, self.pressure
        size = np.abs(step).max(axis=(0, 2))
        for _ in range(_MAX_HALVINGS):
            self.unknowns = start + fraction[:, None] * step
            self.pressure = start_pressure + fraction[:, None] * pressure_step
            self._evaluate()
            worse = ~(self.norm <= np.maximum(before, _RESIDUAL)) & (size > np.sqrt(_ERROR))
            if not worse.any():
                break
            fraction = np.where(worse, 0.5 * fraction, fraction)
        return size

    def _newton_step(self) -> tuple[Array, Array]:
        V, R, n = self.unknowns.shape
        stage = self.stage._replace(loads=self.stage.loads._replace(applied_pressure=self.pressure))
        jacobian = self.term.jacobian(self.unknowns, stage)
        held = ~np.isnan(self.height)
        sides = [self.current.residual, jacobian.pressure] if held.any() else [self.current.residual]
        solved = _solve_bands(jacobian, np.stack(sides)).reshape(len(sides), R, n, V)
        step = -np.moveaxis(solved[0], -1, 0)
        pressure_step = np.zeros((R, 1))
        if held.any():
            response = -np.moveaxis(solved[1], -1, 0)
            widths = self.term.grid.widths
            gap = self.height - (self.unknowns[0] + step[0]) @ widths
            with np.errstate(divide="ignore", invalid="ignore"):
                pressure_step[:, 0] = np.where(held, gap / (response[0] @ widths), 0.0)
            step = step + response * pressure_step
        return step, pressure_step

    def _admissible_fraction(self, step: Array) -> Array:
        """Largest part of the step, at most 1, that keeps water in every cell and the others within bounds."""
        room = self.unknowns[0] - self.term.laws.smallest_volume_ratio
        with np.errstate(divide="ignore", invalid="ignore"):
            fraction = np.where(step[0] < 0.0, -0.9 * room / step[0], 1.0).min(axis=-1)
            if len(step) > 1:
                fraction = np.minimum(fraction, _LARGEST_CHANGE / np.abs(step[1:]).max(axis=(0, 2)))
        return np.minimum(fraction, 1.0)


def _solve_bands(jacobian: BandedJacobian, sides: Array) -> Array:
    """Solve for sides (k, balances, rows, cells); returns (k, unknowns), nan in the rows that have no solution."""
    rows = sides.shape[2]
    columns = np.moveaxis(sides, 1, -1).reshape(len(sides), -1)
    solved = _gbsv(jacobian.bands.copy() if rows > 1 else jacobian.bands, jacobian.bandwidth, columns)
    if rows > 1 and not np.isfinite(solved).all():  # one bad row spoils those behind it: solve each by itself
        parts = zip(np.split(jacobian.bands, rows), np.split(columns, rows, axis=1), strict=True)
        solved = np.concatenate([_gbsv(bands, jacobian.bandwidth, part) for bands, part in parts], axis=1)
    return solved


def _gbsv(bands: Array, bandwidth: int, columns: Array) -> Array:
    _, _, solved, info = lapack.dgbsv(
        bandwidth, bandwidth, bands.T, np.asfortranarray(columns.T), overwrite_ab=True, overwrite_b=False
    )
    return solved.T if info == 0 else np.full_like(columns, np.nan)
