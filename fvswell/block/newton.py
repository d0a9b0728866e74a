"""Newton's method for a block: damped, and with the factors of one Jacobian for as long as they lead on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fvswell.block.block import Block, BlockState, Interval
from fvswell.block.linearisation import Linearisation, NewtonStep, measure
from fvswell.numerics.state import CONVERGED, NO_WATER, NOT_CONVERGED, SINGULAR
from fvswell.physics.tissue import Array

__all__ = ["Newton", "NewtonResult"]

_MAX_ITERATIONS = 50
_MAX_HALVINGS = 12
_UNBALANCED = 1e-9  # relative: residuals below may grow, by rounding or because a column is scaled differently
_ROUNDING = 1e-13  # update that is rounding: no balance can be closed better
_STALLED = 1e-10  # update that is rounding if it does not shrink any more
_SMALLEST_KNOWN = 1e-9  # update that still says how fast the iteration converges
_WORTHWHILE = 10  # more iterations than that cost more than a new Jacobian


class NewtonResult(NamedTuple):
    """Where the iteration ended."""

    state: BlockState  # before the last step
    step: NewtonStep | None  # the last step; None where the iteration failed
    reason: int  # see `fvswell.numerics.state`
    iterations: int
    update: float  # size of the last step
    sizes: tuple[float, ...]  # of all steps

    @property
    def unknowns(self) -> Array:
        """The solution."""
        return self.state.unknowns if self.step is None else self.state.unknowns + self.step.change


class Newton:
    """Iterations for stages of one step, which share their factors.

    What an iteration leaves is about  constant * size * (2 distance + size),  with the size of its step and the
    distance of its start from the state of the linearisation: quadratic where that is its start.

    Parameters
    ----------
    block
        The block.
    """

    linearise: type[Linearisation] = Linearisation

    def __init__(self, block: Block) -> None:
        self.block, self.constant = block, np.inf  # the constant is seen at the second iteration
        self.linearisation: Linearisation | None = None
        self.factorisations = 0

    def solve(self, unknowns: Array, interval: Interval, tolerance: float) -> NewtonResult:
        """Solve the balances of an interval.

        Parameters
        ----------
        unknowns
            To start from.
        interval
            Of the same duration and with the same kinds of loads as before.
        tolerance
            Of what the iteration leaves, in the measure of `linearisation.measure`.
        """
        tolerance = max(tolerance, _ROUNDING)
        state, norm = self._look(unknowns, interval)
        if not np.isfinite(norm):
            return NewtonResult(state, None, _reason(state), 0, np.inf, ())
        sizes: list[float] = []
        last, reach = np.inf, np.inf
        for iteration in range(1, _MAX_ITERATIONS + 1):
            fresh = self.linearisation is None
            linearisation = self._linearised(state, interval)
            step = linearisation.step(state, interval)
            size = measure(self.block, step.contents - state.transport.contents, step.change)
            sizes.append(size)
            if not np.isfinite(size):
                if fresh:
                    return NewtonResult(state, None, SINGULAR, iteration, size, tuple(sizes))
                self.linearisation = None
                continue
            if reach < np.inf and size > _SMALLEST_KNOWN:
                self.constant = size / reach
            distance = linearisation.distance(state)
            reach = size * (2.0 * distance + size)
            left = self.constant * reach if np.isfinite(self.constant) else np.inf
            stalled = size < _STALLED and size > 0.3 * last
            if size <= tolerance or left <= tolerance or stalled:
                return NewtonResult(state, step, CONVERGED, iteration, size, tuple(sizes))
            trial, after = self._look(state.unknowns + step.change, interval)
            fraction = 1.0
            if not after <= max(norm, _UNBALANCED) and not fresh:
                self.linearisation, reach, last = None, np.inf, np.inf
                continue
            while not after <= max(norm, _UNBALANCED) and fraction > 0.5**_MAX_HALVINGS:
                fraction *= 0.5
                trial, after = self._look(state.unknowns + fraction * step.change, interval)
            if not np.isfinite(after):
                return NewtonResult(trial, None, _reason(trial), iteration, size, tuple(sizes))
            if fraction < 1.0:
                self.linearisation, reach, size = None, np.inf, np.inf
            elif _slow(2.0 * self.constant * (distance + size), size, tolerance):
                self.linearisation = None
            state, norm, last = trial, after, size
        return NewtonResult(state, None, NOT_CONVERGED, _MAX_ITERATIONS, last, tuple(sizes))

    def _linearised(self, state: BlockState, interval: Interval) -> Linearisation:
        if self.linearisation is None:
            self.linearisation = self.linearise(self.block, state, interval)
            self.factorisations += 1
        return self.linearisation

    def _look(self, unknowns: Array, interval: Interval) -> tuple[BlockState, float]:
        """State at some unknowns, and its largest relative residual; infinite where it is not admissible."""
        with np.errstate(all="ignore"):  # a trial state may overflow: its norm is then not finite
            state = self.block.evaluate(unknowns, interval)
            norm = float(np.abs(state.residual / self.block.residual_scale).max(initial=0.0))
        return state, norm if state.sound.all() and np.isfinite(norm) else np.inf


def _slow(rate: float, size: float, tolerance: float) -> bool:
    """Whether steps that shrink at this rate with the factors at hand are worth the price of new ones."""
    return bool(np.isfinite(rate) and rate**_WORTHWHILE * size > tolerance)


def _reason(state: BlockState) -> int:
    return NOT_CONVERGED if state.sound.all() else NO_WATER
