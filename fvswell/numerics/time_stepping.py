"""Marching a batch of bodies through their protocols, each row with its own time and step.

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

from fvswell.numerics.protocol import Protocol
from fvswell.numerics.system import LoadValues, Solution, Stage, System
from fvswell.physics.tissue import Array

__all__ = [
    "BACKWARD_EULER",
    "FIRST_STEP",
    "SDIRK2",
    "SMALLEST_STRAIN",
    "Failure",
    "Marcher",
    "Scheme",
    "State",
    "Step",
    "StepControl",
]

_GAMMA = 1.0 - 1.0 / np.sqrt(2.0)
# SDIRK2 leaves (b.A.c - 1/6) dt^3 m''' for a linear problem
_SDIRK2_ERROR = (1.0 - _GAMMA) * _GAMMA**2 + _GAMMA * (2.0 * _GAMMA - _GAMMA**2) - 1.0 / 6.0
SMALLEST_STRAIN = 1e-5  # that tolerances are relative to where nothing is expected to happen
FIRST_STEP = 0.1  # after a jump, of the time in which the finest cell consolidates
_SMALLEST_STEP = 1e-13  # of the time to the next target


@dataclass(frozen=True)
class Scheme:
    """Diagonally implicit, stiffly accurate scheme of at most two stages: their times and weights."""

    diagonal: float
    nodes: tuple[float, ...]
    weights: tuple[float, ...]


BACKWARD_EULER = Scheme(diagonal=1.0, nodes=(1.0,), weights=(1.0,))
SDIRK2 = Scheme(diagonal=_GAMMA, nodes=(_GAMMA, 1.0), weights=(1.0 - _GAMMA, _GAMMA))


@dataclass(frozen=True)
class StepControl:
    """How steps are chosen; without a tolerance the given ones are taken, shorter only where they fail."""

    scheme: Scheme
    tolerance: Array | None = None  # (rows,): absolute, of the strain
    max_step: float = np.inf  # s
    first_step: Array | float = np.inf  # s, of all rows or (rows,): where loads jump or ramps begin and end


@dataclass
class State:
    """Where every row stands; rows are replaced as their steps are accepted."""

    unknowns: Array  # (kinds, rows, points)
    loads: LoadValues  # driven quantities as they are
    contents: Array  # (balances, rows, cells)
    fluxes: Array  # (balances, rows, faces)
    phase: Array  # (rows,)
    time: Array  # (rows,) since the phase began
    elapsed: Array  # (rows,) since the protocol began


@dataclass(frozen=True)
class Step:
    """An accepted step of some rows, as observers are told of it."""

    rows: Array
    size: Array  # (rows,) s
    iterations: Array  # (rows,) Newton iterations of all stages
    residual: Array  # (rows,) largest left by the last stage
    contents_before: Array  # (balances, rows, cells)
    inflow: Array  # (balances, rows): mean over the step of the rate of entering through the boundary
    ends_phase: Array  # (rows,)


@dataclass(frozen=True)
class Failure:
    """Why a row stopped."""

    row: int
    elapsed: float
    phase: int
    balance: str
    point: int
    residual: float

    def reason(self, place: str) -> str:
        """What did not converge, at a place told in words."""
        if not np.isfinite(self.residual):
            return f"the tissue would be inverted or without water at {place}, even with the smallest step"
        return (
            f"the {self.balance} balance did not converge at {place}, even with the smallest step (residual "
            f"{self.residual:.3g}, relative)"
        )


Observer = Callable[[State, Step], None]


@dataclass
class _Past:
    """The last two states before the present one, to extrapolate from; an age of nan says that there is none."""

    unknowns: Array  # (2, kinds, rows, points), the later first
    age: Array  # (2, rows): time from them to the present

    @classmethod
    def none(cls, unknowns: Array) -> _Past:
        return cls(np.zeros((2, *unknowns.shape)), np.full((2, unknowns.shape[1]), np.nan))

    def rows(self, index: Array) -> _Past:
        return _Past(self.unknowns[:, :, index], self.age[:, index])

    def then(self, unknowns: Array, time: Array) -> _Past:
        """The past once the present, ``unknowns``, lies a time back."""
        return _Past(np.stack([unknowns, self.unknowns[0]]), np.stack([time, self.age[0] + time]))

    def put(self, rows: Array, other: _Past, index: Array) -> None:
        """Take over rows of another batch's past."""
        self.unknowns[:, :, rows], self.age[:, rows] = other.unknowns[:, :, index], other.age[:, index]

    def forget(self, rows: Array) -> None:
        """There is nothing to extrapolate from."""
        self.age[:, rows] = np.nan

    def change(self, present: Array, time: Array) -> Array:
        """Change of the unknowns in a time to come, by the parabola (or line, or constant) through what is known."""
        near, far = self.age[:, :, None]
        time = time[:, None]
        with np.errstate(invalid="ignore"):
            slope = (present - self.unknowns[0]) / near
            bend = (slope - (self.unknowns[0] - self.unknowns[1]) / (far - near)) / far
        return time * (np.nan_to_num(slope) + np.nan_to_num(bend) * (time + np.nan_to_num(near)))


@dataclass
class _Attempt:
    """One step of some rows before it is judged."""

    solutions: list[Solution]
    rates: list[Array]  # dJ/dt at the stages, (rows, cells)
    inflow: Array  # (balances, rows)
    past: _Past  # as seen from its end

    @property
    def converged(self) -> Array:
        return np.logical_and.reduce([solution.converged for solution in self.solutions])

    @property
    def iterations(self) -> Array:
        return np.sum([solution.iterations for solution in self.solutions], axis=0)

    def worst_residual(self, row: int) -> Array:
        """Residual of the stage that failed, (equations, points)."""
        failed = next(s for s in self.solutions if s is self.solutions[-1] or not s.converged[row])
        return np.nan_to_num(np.abs(failed.residual[:, row]), nan=np.inf, posinf=np.inf)


class Marcher:
    """Time loop over a batch of bodies."""

    def __init__(
        self, system: System, protocol: Protocol, control: StepControl, state: State,
        observers: Sequence[Observer] = (),
    ) -> None:  # fmt: skip
        self.system, self.protocol, self.control, self.state = system, protocol, control, state
        self.observers = observers
        self.failures: list[Failure] = []
        rows = len(state.time)
        self.active = np.ones(rows, dtype=bool)
        self._size = np.full(rows, np.inf)
        self._restarted = np.zeros(rows, dtype=bool)  # the size was set anew, not from the last step
        self._past = _Past.none(state.unknowns)
        self._last_rate = np.full(state.contents.shape[1:], np.nan)  # dJ/dt at the end of the last step
        self._phase_start = {name: value.copy() for name, value in state.loads.items()}
        self._enter_phase(np.arange(rows))

    def run(self) -> None:
        """March until every row has finished its last phase or failed."""
        while self.active.any():
            rows = np.flatnonzero(self.active)
            self._step(self.system if self.active.all() else self.system.rows(rows), rows)

    def stop(self, row: int) -> None:
        """End a row where it stands; for observers."""
        self.active[row] = False

    def _step(self, system: System, rows: Array) -> None:
        state = self.state
        target = self.protocol.next_target(rows, state.phase[rows], state.time[rows])
        ahead = target - state.time[rows]
        size = np.minimum(np.minimum(self._size[rows], self.control.max_step), ahead)
        size = np.where((size < ahead) & (size > 0.5 * ahead), 0.5 * ahead, size)  # no sliver before a target
        attempt = self._attempt(system, rows, size)
        error = self._error(rows, size, attempt)
        accepted = error <= 1.0
        if accepted.any():
            self._accept(rows, size, target, attempt, accepted)
        self._resize(rows, size, attempt.converged, error)
        for i in np.flatnonzero(~accepted & (self._size[rows] < _SMALLEST_STEP * ahead)):
            self._fail(int(rows[i]), attempt.worst_residual(int(i)))

    def _attempt(self, system: System, rows: Array, size: Array) -> _Attempt:
        """Solve the stages of one step of the given rows."""
        state, scheme = self.state, self.control.scheme
        contents = base = state.contents[:, rows]
        unknowns, loads = state.unknowns[:, rows], {name: value[rows] for name, value in state.loads.items()}
        attempt = _Attempt([], [], np.zeros((len(contents), len(rows))), self._past.rows(rows))
        done = np.zeros(len(rows))
        for node, weight in zip(scheme.nodes, scheme.weights, strict=True):
            ahead = node * size
            prescribed = self.protocol.prescribed(rows, state.phase[rows], state.time[rows] + ahead, self._phase_start)
            guess = system.extrapolate(unknowns, attempt.past.change(unknowns, ahead - done))
            stage = Stage(base, scheme.diagonal * size, prescribed)
            solution = system.solve(guess, loads, stage)
            rate = (solution.contents - base) / stage.duration[:, None]
            attempt.solutions.append(solution)
            attempt.rates.append(rate[0])
            attempt.inflow += weight * solution.inflow
            base = contents + (1.0 - scheme.diagonal) * size[:, None] * rate
            attempt.past = attempt.past.then(unknowns, ahead - done)
            unknowns, loads, done = solution.unknowns, solution.loads, ahead
            if not attempt.converged.any():
                break
        return attempt

    def _error(self, rows: Array, size: Array, attempt: _Attempt) -> Array:
        """Estimated error of the local strain in this step (its mean over the body) over the tolerance, ``(rows,)``.

        m''' comes from the rates at the step's start, first stage and end. After a jump the rate at the start is not
        known; then the change of the rate within the step, which is first order, stands in. Infinite for rows that
        did not converge.
        """
        if self.control.tolerance is None or len(attempt.rates) < 2:
            return np.where(attempt.converged, 0.0, np.inf)
        first, last = attempt.rates
        slope = (last - first) / (1.0 - _GAMMA)
        curvature = 2.0 * (slope - (first - self._last_rate[rows]) / _GAMMA)
        error = np.where(np.isnan(curvature), 0.1 * slope, _SDIRK2_ERROR * curvature) * size[:, None]
        volumes = self.system.volumes
        mean = np.abs(error) @ volumes / volumes.sum()
        return np.where(attempt.converged, mean / self.control.tolerance[rows], np.inf)

    def _accept(self, rows: Array, size: Array, target: Array, attempt: _Attempt, accepted: Array) -> None:
        state, solution = self.state, attempt.solutions[-1]
        own, size = rows[accepted], size[accepted]
        before = state.contents[:, own]
        self._past.put(own, attempt.past, accepted)
        self._last_rate[own] = attempt.rates[-1][accepted]
        state.unknowns[:, own] = solution.unknowns[:, accepted]
        state.contents[:, own] = solution.contents[:, accepted]
        state.fluxes[:, own] = solution.fluxes[:, accepted]
        for name, value in solution.loads.items():
            state.loads[name][own] = value[accepted]
        hits = size >= target[accepted] - state.time[own]
        state.time[own] = np.where(hits, target[accepted], state.time[own] + size)
        state.elapsed[own] += size
        ends = state.time[own] >= self.protocol.duration[own, state.phase[own]]
        residual = np.abs(solution.residual[:, accepted]).max(axis=(0, 2))
        step = Step(own, size, attempt.iterations[accepted], residual, before, attempt.inflow[:, accepted], ends)
        for observer in self.observers:
            observer(state, step)
        onward = own[~ends]
        self._restart(onward[self.protocol.corners(onward, state.phase[onward], state.time[onward])])
        self._next_phase(own[ends])

    def _resize(self, rows: Array, size: Array, converged: Array, error: Array) -> None:
        """Step size for the next attempt of each row still under way."""
        if self.control.tolerance is None:
            factor = np.where(np.isfinite(self._size[rows]), 4.0, np.inf)  # inf: the given steps
        else:
            with np.errstate(divide="ignore"):
                factor = np.clip(0.9 * error ** (-1.0 / 3.0), 0.2, 4.0)
        wanted = size * np.where(converged, factor, 0.25)
        succeeded = error <= 1.0
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
        """Remember what ramps start from; where something jumps, the past is no guide."""
        for name, value in self.state.loads.items():
            self._phase_start[name][rows] = value[rows]
        jump = self.protocol.jumps(rows, self.state.phase[rows], self._phase_start)
        self._past.forget(rows[jump])
        self._restart(rows)

    def _restart(self, rows: Array) -> None:
        """The rates are about to jump: start small."""
        self._last_rate[rows] = np.nan
        self._size[rows] = np.broadcast_to(self.control.first_step, self._size.shape)[rows]
        self._restarted[rows] = True

    def _fail(self, row: int, residual: Array) -> None:
        equation, point = np.unravel_index(np.argmax(residual), residual.shape)
        state = self.state
        self.failures.append(
            Failure(
                int(row), float(state.elapsed[row]), int(state.phase[row]), self.system.equations[equation],
                int(point), float(residual[equation, point]),
            )
        )  # fmt: skip
        self.active[row] = False
