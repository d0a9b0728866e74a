"""Newton's method on the coupled balances of a batch of columns, banded and exact, each row on its own.

Rows share one factorisation but nothing else: a row that has converged leaves the batch, a row that fails does not
hold up the others, and a row takes the same iterates as it would alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from fvswell.column import Loads
from fvswell.system import LoadValues, Solution, Stage
from fvswell.tissue import Array
from fvswell.transport_term import BandedJacobian, CoupledTransportTerm, Interval

__all__ = ["ColumnSystem"]

_MAX_ITERATIONS = 25
_MAX_HALVINGS = 8
_UPDATE = 1e-9  # change of an unknown (strain, ln c~, psi~) below which the next one would be rounding
_RESIDUAL = 1e-12  # of a cell's content: converged without asking how large the update was
_UNBALANCED = 1e-9  # of a cell's content: never accepted above
_LARGEST_CHANGE = 2.0  # of ln c~ or psi~ in one iteration


@dataclass(frozen=True)
class ColumnSystem:
    """Balances of a batch of columns under a piston, solved by Newton's method.

    Driven quantities: ``pressure`` on the piston (MPa) or ``height`` of the column (mm), and ``bath`` (mmol/mm3).
    """

    term: CoupledTransportTerm

    @property
    def volumes(self) -> Array:
        """Reference widths of the cells: volumes per area, mm."""
        return self.term.grid.widths

    @property
    def equations(self) -> tuple[str, ...]:
        """Names of the balances."""
        return self.term.laws.balances

    def rows(self, index: Array) -> ColumnSystem:
        """The system of a subset of the rows."""
        return ColumnSystem(self.term.rows(index))

    def extrapolate(self, unknowns: Array, change: Array) -> Array:
        """Extrapolated unknowns, or the old ones in rows where that would leave a cell with little water."""
        guess = unknowns + change
        dry = self.term.laws.smallest_volume_ratio
        safe = (guess[0] - dry > 0.5 * (unknowns[0] - dry)).all(axis=-1) & (np.abs(change).max(axis=(0, 2)) < 0.5)
        return np.where(safe[:, None], guess, unknowns)

    def solve(self, guess: Array, loads: LoadValues, stage: Stage) -> Solution:
        """Solve the balances of one implicit stage for every row.

        Parameters
        ----------
        guess
            Unknowns to start from, ``(balances, rows, cells)``.
        loads
            Driven quantities to start from.
        stage
            Base contents, duration and what is prescribed.

        Returns
        -------
        Solution
            With ``converged`` false for the rows that failed.
        """
        iterate = _Iterate(self.term, guess, loads, stage)
        V, R, n = guess.shape
        solution = Solution(
            unknowns=np.empty_like(guess), loads={name: np.array(value) for name, value in loads.items()},
            contents=np.empty_like(guess), fluxes=np.empty((V, R, n + 1)), inflow=np.empty((V, R)),
            residual=np.empty_like(guess), converged=np.zeros(R, dtype=bool), iterations=np.zeros(R, dtype=int),
        )  # fmt: skip
        active = np.arange(R)
        for iteration in range(1, _MAX_ITERATIONS + 1):
            size = iterate.advance()
            iterate.store(solution, active, iteration)
            settled = (size < _UPDATE) & (iterate.norm < _UNBALANCED) | (iterate.norm < _RESIDUAL)
            solution.converged[active[settled]] = True
            going = ~settled & np.isfinite(iterate.norm)
            if not going.any():
                break
            if not going.all():
                active, iterate = active[going], iterate.rows(going)
        return solution


class _Iterate:
    """State of the iteration in the rows still under way."""

    def __init__(self, term: CoupledTransportTerm, unknowns: Array, loads: LoadValues, stage: Stage) -> None:
        self.term, self.unknowns, self.stage = term, unknowns, stage
        prescribed = stage.prescribed
        self.held = np.isnan(prescribed["pressure"])  # the piston's position is prescribed, its pressure an unknown
        self.pressure = np.where(self.held, loads["pressure"], prescribed["pressure"])
        self._evaluate()

    def rows(self, index: Array) -> _Iterate:
        base, duration, prescribed = self.stage
        return _Iterate(
            self.term.rows(index), self.unknowns[:, index], {"pressure": self.pressure[index]},
            Stage(base[:, index], duration[index], {name: value[index] for name, value in prescribed.items()}),
        )  # fmt: skip

    @property
    def _interval(self) -> Interval:
        base, duration, prescribed = self.stage
        return Interval(base, duration[:, None], Loads(self.pressure[:, None], prescribed["bath"][:, None]))

    def _evaluate(self) -> None:
        interval = self._interval
        with np.errstate(all="ignore"):  # a trial state may overflow: its norm is then not finite
            self.current = self.term.balance(self.unknowns, interval)
            self.residual = self.current.residual / self.term.content_scale(interval.loads)
            self.norm = np.abs(self.residual).max(axis=(0, 2))

    def store(self, solution: Solution, rows: Array, iteration: int) -> None:
        """Put the iterate in its place among all rows."""
        solution.unknowns[:, rows] = self.unknowns
        solution.contents[:, rows], solution.fluxes[:, rows] = self.current.contents, self.current.fluxes
        solution.inflow[:, rows] = self.current.fluxes[..., 0]
        solution.residual[:, rows], solution.iterations[rows] = self.residual, iteration
        solution.loads["pressure"][rows] = self.pressure
        solution.loads["bath"][rows] = self.stage.prescribed["bath"]
        solution.loads["height"][rows] = self.unknowns[0] @ self.term.grid.widths

    def advance(self) -> Array:
        """One damped Newton update; returns its size in each row (largest change of an unknown)."""
        step, pressure_step = self._newton_step()
        fraction = self._admissible_fraction(step)
        before, start, start_pressure = self.norm, self.unknowns, self.pressure
        size = np.abs(step).max(axis=(0, 2))
        for _ in range(_MAX_HALVINGS):
            self.unknowns = start + fraction[:, None] * step
            self.pressure = start_pressure + fraction * pressure_step
            self._evaluate()
            worse = ~(self.norm <= np.maximum(before, _UNBALANCED))
            if not worse.any():
                break
            fraction = np.where(worse, 0.5 * fraction, fraction)
        return size

    def _newton_step(self) -> tuple[Array, Array]:
        V, R, n = self.unknowns.shape
        jacobian = self.term.jacobian(self.unknowns, self._interval)
        any_held = self.held.any()
        sides = [self.current.residual, jacobian.pressure] if any_held else [self.current.residual]
        solved = _solve_bands(jacobian, np.stack(sides)).reshape(len(sides), R, n, V)
        step = -np.moveaxis(solved[0], -1, 0)
        if not any_held:
            return step, np.zeros(R)
        response, widths = -np.moveaxis(solved[1], -1, 0), self.term.grid.widths
        gap = self.stage.prescribed["height"] - (self.unknowns[0] + step[0]) @ widths
        pressure_step = np.zeros(R)
        np.divide(gap, response[0] @ widths, out=pressure_step, where=self.held)
        return step + response * pressure_step[:, None], pressure_step

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
    solved = _gbsv(jacobian.bands, jacobian.bandwidth, columns)
    if rows > 1 and not np.isfinite(solved).all():  # one bad row spoils those behind it: solve each by itself
        parts = zip(np.split(jacobian.bands, rows), np.split(columns, rows, axis=1), strict=True)
        solved = np.concatenate([_gbsv(bands, jacobian.bandwidth, part) for bands, part in parts], axis=1)
    return solved


def _gbsv(bands: Array, bandwidth: int, columns: Array) -> Array:
    _, _, solved, info = lapack.dgbsv(bandwidth, bandwidth, bands.T, columns.T)
    return solved.T if info == 0 else np.full_like(columns, np.nan)
