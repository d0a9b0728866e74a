"""Newton's method on the coupled balances of a batch of columns, banded and exact, each row on its own.

Rows share one factorisation but nothing else: a row that has converged leaves the batch, a row that fails does not
hold up the others, and a row takes the same iterates as it would alone.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np

from fvswell.column.column import Loads
from fvswell.column.transport_term import CoupledTransportTerm, Interval
from fvswell.numerics.system import LoadValues, Solution, Stage
from fvswell.physics.tissue import Array

__all__ = ["ColumnSystem"]

_MAX_ITERATIONS = 25
_MAX_HALVINGS = 8
_UPDATE = 1e-9  # change of an unknown (strain, ln c~, psi~) below which the next one would be rounding
_NEAR = 1e-6  # change of an unknown so close to the solution that Newton's step is taken whole
_ROUNDING = 1e-12  # change of an unknown that is rounding already: no balance can be closed better
_IMBALANCE = 1e-11  # of the largest change of content in a cell: converged whatever the last update was
_UNBALANCED = 1e-9  # of a cell's content: never accepted above
_DRY = 1e-4  # of the water at J = 1: less is none
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
            balanced = (iterate.norm < _UNBALANCED) | (size < _ROUNDING)
            settled = (size < _UPDATE) & balanced | (iterate.norm < _IMBALANCE * iterate.change)
            solution.converged[active[settled]] = True
            going = ~settled & np.isfinite(iterate.norm)
            if not going.any():
                break
            if not going.all():
                active, iterate = active[going], iterate.rows(going)
        laws = self.term.laws
        water = solution.contents[0] - laws.smallest_volume_ratio
        dry = (water < _DRY * laws.cells.tissue.fluid_fraction) & ~solution.converged[:, None]
        solution.residual[0][dry] = np.inf  # what the row has failed by, whichever balance is off by more
        return solution


class _Iterate:
    """State of the iteration in the rows still under way."""

    def __init__(self, term: CoupledTransportTerm, unknowns: Array, loads: LoadValues, stage: Stage) -> None:
        self.term, self.unknowns, self.stage = term, unknowns, stage
        prescribed = stage.prescribed
        self.held = np.isnan(prescribed["pressure"])  # the piston's position is prescribed, its pressure an unknown
        self.pressure = np.where(self.held, loads["pressure"], prescribed["pressure"])
        loads_now = Loads(self.pressure[:, None], prescribed["bath"][:, None])
        self.interval = Interval.under(term.laws, stage.base, stage.duration[:, None], loads_now)
        self.scale = term.laws.content_scale(loads_now)
        self._evaluate()

    def rows(self, index: Array) -> _Iterate:
        """The iterate of a subset of the rows, as it stands."""
        part = copy(self)
        base, duration, prescribed = self.stage
        part.stage = Stage(base[:, index], duration[index], {name: value[index] for name, value in prescribed.items()})
        part.term, part.interval, part.current = (
            self.term.rows(index),
            self.interval.rows(index),
            self.current.rows(index),
        )
        for name in ("unknowns", "scale", "residual"):
            setattr(part, name, getattr(self, name)[:, index])
        for name in ("held", "pressure", "missed", "norm", "change"):
            setattr(part, name, getattr(self, name)[index])
        return part

    def _put(self, index: Array, part: _Iterate) -> None:
        """Take over a subset of the rows from an iterate of just those."""
        self.current.put(index, part.current)
        for name in ("unknowns", "residual"):
            getattr(self, name)[:, index] = getattr(part, name)
        for name in ("pressure", "missed", "norm", "change"):
            getattr(self, name)[index] = getattr(part, name)

    def _evaluate(self) -> None:
        with np.errstate(all="ignore"):  # a trial state may overflow: its norm is then not finite
            self.current = self.term.balance(self.unknowns, self.interval)
            self.residual = self.current.residual / (self.scale * self.term.grid.widths)
            widths = self.term.grid.widths
            missed = (self.stage.prescribed["height"] - self.unknowns[0] @ widths) / widths.sum()
            self.missed = np.where(self.held, np.abs(missed), 0.0)  # how far the piston is from its place
            self.norm = np.maximum(np.abs(self.residual).max(axis=(0, 2)), self.missed)
            self.change = np.abs((self.current.contents - self.stage.base) / self.scale).max(axis=(0, 2))

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
        size = np.abs(step).max(axis=(0, 2))
        # balances that hold where the piston has not come to its place say nothing of the way there; and close to the
        # solution they are rounding
        whole = (self.missed > _UNBALANCED) | (size < _NEAR)
        before, start, start_pressure = np.where(whole, np.inf, self.norm), self.unknowns, self.pressure
        self._move_to(start + fraction[:, None] * step, start_pressure + fraction * pressure_step)
        for _ in range(_MAX_HALVINGS):
            worse = np.flatnonzero(~(self.norm <= np.maximum(before, _UNBALANCED)))
            if not len(worse):
                break
            fraction[worse] *= 0.5
            shorter, shorter_pressure = fraction[worse, None] * step[:, worse], fraction[worse] * pressure_step[worse]
            part = self.rows(worse)
            part._move_to(start[:, worse] + shorter, start_pressure[worse] + shorter_pressure)
            self._put(worse, part)
        return size

    def _move_to(self, unknowns: Array, pressure: Array) -> None:
        self.unknowns, self.pressure = unknowns, pressure
        if self.held.any():
            loads = self.interval.loads._replace(applied_pressure=pressure[:, None])
            self.interval = self.interval._replace(loads=loads)
        self._evaluate()

    def _newton_step(self) -> tuple[Array, Array]:
        step, response = self.term.newton_step(self.unknowns, self.interval, self.current, bool(self.held.any()))
        pressure_step = np.zeros(len(self.held))
        if response is None:
            return step, pressure_step
        widths = self.term.grid.widths
        gap = self.stage.prescribed["height"] - (self.unknowns[0] + step[0]) @ widths
        np.divide(gap, response[0] @ widths, out=pressure_step, where=self.held)
        return step + response * pressure_step[:, None], pressure_step

    def _admissible_fraction(self, step: Array) -> Array:
        """Largest part of the step, at most 1, that keeps water in every cell and the others within bounds."""
        room = self.unknowns[0] - self.term.laws.smallest_volume_ratio
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            fraction = np.where(step[0] < 0.0, -0.9 * room / step[0], 1.0).min(axis=-1)
            if len(step) > 1:
                fraction = np.minimum(fraction, _LARGEST_CHANGE / np.abs(step[1:]).max(axis=(0, 2)))
        return np.minimum(fraction, 1.0)
