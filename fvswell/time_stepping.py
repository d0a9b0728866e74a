"""Marching a batch of columns through their protocols, each row with its own time and step.

    while rows are left:
        step = min(step size, next time that must be hit - time)         in each row
        solve the stages of the scheme                                   all rows in one solve
        rows that fail to converge, or miss the tolerance: smaller step, again
        the others: keep the new state, tell the observers, choose the next step size
        rows at the end of a phase enter the next one, where loads may jump

Backward Euler takes the steps it is given. SDIRK2 (Alexander 1977; two stages, L-stable, second order,
gamma = 1 - 1/sqrt 2) chooses them by the estimated error of the strain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fvswell.column import Loads
from fvswell.newton import Solution, solve_stage
from fvswell.protocol import Protocol
from fvswell.tissue import Array
from fvswell.transport_term import CoupledTransportTerm, Stage

__all__ = ["BACKWARD_EULER", "SDIRK2", "Failure", "Marcher", "Scheme", "State", "StepControl", "Step"]

_GAMMA = 1.0 - 1.0 / np.sqrt(2.0)
_SMALLEST_STEP = 1e-10  # of the time to the next target


@dataclass(frozen=True)
class Scheme:
    """Diagonally implicit, stiffly accurate scheme: stage times and the weights of the stages' fluxes."""

    diagonal: float
    nodes: tuple[float, ...]
    weights: tuple[float, ...]


BACKWARD_EULER = Scheme(diagonal=1.0, nodes=(1.0,), weights=(1.0,))
SDIRK2 = Scheme(diagonal=_GAMMA, nodes=(_GAMMA, 1.0), weights=(1.0 - _GAMMA, _GAMMA))


@dataclass(frozen=True)
class StepControl:
    """Error control; without a tolerance the given steps are taken, shorter only where they fail."""

    scheme: Scheme
    tolerance: Array | None = None  # (rows,): absolute, of the strain
    max_step: float = np.inf  # s
    first_step: Array | float = np.inf  # (rows,): after a jump, s


@dataclass
class State:
    """Where every row stands; the arrays are replaced row by row as steps are accepted."""

    unknowns: Array  # (balances, rows, cells)
    contents: Array  # (balances, rows, cells)
    fluxes: Array  # (balances, rows, cells + 1)
    pressure: Array  # (rows,) on the piston
    bath: Array  # (rows,)
    phase: Array  # (rows,)
    time: Array  # (rows,) since the phase began
    elapsed: Array  # (rows,) since the protocol began


@dataclass(frozen=True)
class Step:
    """An accepted step of some rows, as observers are told of it."""

    rows: Array
    size: Array  # (rows,) s
    iterations: Array  # (rows,) Newton iterations of all stages
    contents_before: Array  # (balances, rows, cells)
    filter_flux: Array  # (balances, rows): mean over the step of the flux at the filter
    ends_phase: Array  # (rows,)
    error: Array  # (rows,) estimated error over tolerance, 0 without tolerance


@dataclass(frozen=True)
class Failure:
    """Why a row stopped."""

    row: int
    elapsed: float
    phase: int
    balance: str
    cell: int
    residual: float

    @property
    def reason(self) -> str:
        """One line: what did not converge, when and where."""
        return (
            f"the {self.balance} balance did not converge at t = {self.elapsed:.6g} s in cell {self.cell}, "
            f"even with the smallest step (residual {self.residual:.3g} of the cell's content)"
        )


Observer = Callable[[State, Step], None]


@dataclass
class _Attempt:
    solution: Solution
    converged: Array
    iterations: Array
    stage_rates: list[Array]  # dJ/dt at the stages, (rows, cells)
    filter_flux: Array
    bath: Array
    worst: Array  # residual of the last stage solved


class Marcher:
    """Time loop over a batch of columns."""

    def __init__(
        self, term: CoupledTransportTerm, protocol: Protocol, control: StepControl, state: State,
        observers: Sequence[Observer] = (),
    ) -> None:  # fmt: skip
        self.term, self.protocol, self.control, self.state = term, protocol, control, state
        self.observers = observers
        rows = len(state.time)
        self.failures: list[Failure] = []
        self.active = np.ones(rows, dtype=bool)
        self._size = np.full(rows, np.inf)
        self._rate = np.zeros_like(state.unknowns)  # d unknowns/dt over the last step, to start Newton from
        self._last_rate = np.full(state.unknowns.shape[1:], np.nan)  # dJ/dt at the end of the last step
        self._restarted = np.zeros(rows, dtype=bool)  # the step size was set anew, not from the last step
        self._start_pressure, self._start_height, self._start_bath = np.empty(rows), np.empty(rows), np.empty(rows)
        self._enter_phase(np.arange(rows))

    def run(self) -> None:
        """March until every row has finished its last phase or failed."""
        while self.active.any():
            rows = np.flatnonzero(self.active)
            if len(rows) == len(self.active):
                self._step(self.term, rows)
            else:
                self._step(self.term.rows(rows), rows)

    def _step(self, term: CoupledTransportTerm, rows: Array) -> None:
        state = self.state
        target = self.protocol.next_target(rows, state.phase[rows], state.time[rows])
        ahead = target - state.time[rows]
        size = np.minimum(np.minimum(self._size[rows], self.control.max_step), ahead)
        size = np.where((size < ahead) & (size > 0.5 * ahead), 0.5 * ahead, size)  # no sliver before a target
        attempt = self._attempt(term, rows, size)
        error = self._error(rows, size, attempt)
        accepted = attempt.converged & (error <= 1.0)
        if accepted.any():
            self._accept(rows, size, target, attempt, accepted, error)
        self._resize(rows, size, attempt.converged, error)
        for i in np.flatnonzero(~accepted & (self._size[rows] < _SMALLEST_STEP * ahead)):
            self._fail(rows[i], attempt.worst[:, i])

    def _loads(self, rows: Array, time: Array) -> tuple[Loads, Array]:
        """Loads of rows at a time since their phases began, and the prescribed heights (nan: pressure acts)."""
        phase, protocol = self.state.phase[rows], self.protocol
        pressure = protocol.pressure.at(rows, phase, time, self._start_pressure[rows])
        height = protocol.height.at(rows, phase, time, self._start_height[rows])
        bath = protocol.bath.at(rows, phase, time, self._start_bath[rows])
        held = np.isnan(pressure)
        pressure = np.where(held, self.state.pressure[rows], pressure)
        return Loads(pressure[:, None], bath[:, None]), np.where(held, height, np.nan)

    def _attempt(self, term: CoupledTransportTerm, rows: Array, size: Array) -> _Attempt:
        """Solve the stages of one step of the given rows."""
        state, scheme = self.state, self.control.scheme
        unknowns, contents = state.unknowns[:, rows], state.contents[:, rows]
        base, pressure = contents, state.pressure[rows, None]
        duration = scheme.diagonal * size[:, None]
        rate, done = self._rate[:, rows], 0.0
        attempt: _Attempt | None = None
        for node, weight in zip(scheme.nodes, scheme.weights, strict=True):
            loads, height = self._loads(rows, state.time[rows] + node * size)
            guess = self._guess(term, unknowns, rate * ((node - done) * size)[:, None])
            solution = solve_stage(term, guess, pressure, Stage(base, duration, loads), height)
            stage_rate = (solution.contents - base) / duration
            flux = weight * solution.fluxes[..., 0]
            if attempt is None:
                attempt = _Attempt(
                    solution, solution.converged, solution.iterations, [stage_rate[0]], flux,
                    loads.bath_concentration[:, 0], solution.residual,
                )  # fmt: skip
            else:
                attempt = _Attempt(
                    solution, attempt.converged & solution.converged, attempt.iterations + solution.iterations,
                    [*attempt.stage_rates, stage_rate[0]], attempt.filter_flux + flux,
                    loads.bath_concentration[:, 0],
                    np.where(attempt.converged[:, None], solution.residual, attempt.worst),
                )  # fmt: skip
            base = contents + (1.0 - scheme.diagonal) * size[:, None] * stage_rate
            rate = (solution.unknowns - unknowns) / ((node - done) * size)[:, None]
            unknowns, pressure, done = solution.unknowns, solution.pressure, node
            if not attempt.converged.any():
                break
        assert attempt is not None
        return attempt

    def _guess(self, term: CoupledTransportTerm, unknowns: Array, change: Array) -> Array:
        """Extrapolated unknowns, or the old ones in rows where that would leave a cell with little water."""
        guess = unknowns + change
        dry = term.laws.smallest_volume_ratio
        safe = (guess[0] - dry > 0.5 * (unknowns[0] - dry)).all(axis=-1) & (np.abs(change).max(axis=(0, 2)) < 0.5)
        return np.where(safe[:, None], guess, unknowns)

    def _error(self, rows: Array, size: Array, attempt: _Attempt) -> Array:
        """Estimated error of the strain in this step (rms over the cells) over the tolerance, ``(rows,)``.

        For a linear problem SDIRK2 leaves (b.A.c - 1/6) dt^3 m''' = 0.0404 dt^3 m'''; m''' comes from the rates at
        the step's start, first stage and end. After a jump the rate at the start is not known; then the change of the
        rate within the step bounds the error.
        """
        if self.control.tolerance is None:
            return np.zeros(len(rows))
        first, last = attempt.stage_rates if len(attempt.stage_rates) == 2 else attempt.stage_rates * 2
        start = self._last_rate[rows]
        slope = (last - first) / (1.0 - _GAMMA)
        curved = 2.0 * (slope - (first - start) / _GAMMA)
        constant = (1.0 - _GAMMA) * _GAMMA**2 + _GAMMA**2 * (2.0 - _GAMMA) - 1.0 / 6.0
        error = np.where(np.isnan(curved), 0.1 * slope, constant * curved) * size[:, None]
        widths = self.term.grid.widths
        rms = np.sqrt((error**2 @ widths) / widths.sum())
        return np.where(attempt.converged, rms / self.control.tolerance[rows], np.inf)

    def _accept(
        self, rows: Array, size: Array, target: Array, attempt: _Attempt, accepted: Array, error: Array
    ) -> None:
        state, solution = self.state, attempt.solution
        own = rows[accepted]
        before = state.contents[:, own]
        self._rate[:, own] = (solution.unknowns[:, accepted] - state.unknowns[:, own]) / size[accepted, None]
        self._last_rate[own] = attempt.stage_rates[-1][accepted]
        state.unknowns[:, own] = solution.unknowns[:, accepted]
        state.contents[:, own] = solution.contents[:, accepted]
        state.fluxes[:, own] = solution.fluxes[:, accepted]
        state.pressure[own] = solution.pressure[accepted, 0]
        state.bath[own] = attempt.bath[accepted]
        hits = (size >= target - state.time[rows])[accepted]
        state.time[own] = np.where(hits, target[accepted], state.time[own] + size[accepted])
        state.elapsed[own] += size[accepted]
        ends = state.time[own] >= self.protocol.duration[own, state.phase[own]]
        step = Step(
            own, size[accepted], attempt.iterations[accepted], before, attempt.filter_flux[:, accepted], ends,
            error[accepted],
        )  # fmt: skip
        for observer in self.observers:
            observer(state, step)
        if ends.any():
            self._next_phase(own[ends])
        self._meet_corners(own[~ends])

    def _resize(self, rows: Array, size: Array, converged: Array, error: Array) -> None:
        """Step size for the next attempt of each row still under way."""
        if self.control.tolerance is None:
            wanted = np.where(converged, np.where(np.isfinite(self._size[rows]), 4.0 * size, np.inf), 0.25 * size)
        else:
            with np.errstate(divide="ignore"):
                factor = np.clip(0.9 * error ** (-1.0 / 3.0), 0.2, 4.0)
            wanted = size * np.where(converged, factor, 0.25)
        succeeded = converged & (error <= 1.0)
        cut_short = succeeded & (size < self._size[rows])  # by a time that had to be hit: says nothing of the error
        wanted = np.where(cut_short, np.maximum(wanted, self._size[rows]), wanted)
        self._size[rows] = np.where(succeeded & self._restarted[rows], self._size[rows], wanted)
        self._restarted[rows] = False

    def _next_phase(self, rows: Array) -> None:
        state = self.state
        last = state.phase[rows] == self.protocol.phases - 1
        self.active[rows[last]] = False
        onward = rows[~last]
        state.phase[onward] += 1
        state.time[onward] = 0.0
        self._enter_phase(onward)

    def _enter_phase(self, rows: Array) -> None:
        """Remember what ramps start from; where something jumps, forget the past and start small."""
        state = self.state
        self._start_pressure[rows], self._start_bath[rows] = state.pressure[rows], state.bath[rows]
        self._start_height[rows] = state.unknowns[0, rows] @ self.term.grid.widths
        jump = self.protocol.is_jump(rows, state.phase[rows], state.pressure[rows], state.bath[rows])
        self._restart(rows, jump)

    def _meet_corners(self, rows: Array) -> None:
        """At the end of a ramp the rates jump."""
        phase, time = self.state.phase[rows], self.state.time[rows]
        corner = np.zeros(len(rows), dtype=bool)
        for drive in (self.protocol.pressure, self.protocol.height, self.protocol.bath):
            corner |= (drive.over[rows, phase] == time) & ~np.isnan(drive.target[rows, phase])
        self._restart(rows[corner], np.zeros(corner.sum(), dtype=bool))

    def _restart(self, rows: Array, jump: Array) -> None:
        self._last_rate[rows] = np.nan
        self._rate[:, rows[jump]] = 0.0
        self._restarted[rows] = True
        first = np.broadcast_to(self.control.first_step, self._size.shape)[rows]
        self._size[rows] = np.where(self.control.tolerance is None, np.inf, first)

    def _fail(self, row: int, residual: Array) -> None:
        worst = np.abs(np.nan_to_num(residual, nan=np.inf))
        balance, cell = np.unravel_index(np.argmax(worst), worst.shape)
        self.failures.append(
            Failure(
                int(row), float(self.state.elapsed[row]), int(self.state.phase[row]),
                self.term.laws.balances[balance], int(cell), float(worst[balance, cell]),
            )
        )  # fmt: skip
        self.active[row] = False


