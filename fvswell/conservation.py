"""Books kept on what is conserved: contents of the body against what crossed its boundary."""

from __future__ import annotations

import numpy as np

from fvswell.time_stepping import State, Step
from fvswell.tissue import Array

__all__ = ["ConservationBooks"]

_TINY = 1e-300


class ConservationBooks:
    """Observer of the time loop that closes every balance in every step.

    ``error`` is, for each balance and row, the largest mismatch in a step since the last ``take_error``, relative to
    all that has crossed the boundary so far (in magnitude). Charge has no content; its mismatch is the net charge
    that crossed, relative to the anions that did. The cation's follows: its content is the anion's plus the
    fixed charge, its inflow the anion's plus the current.
    """

    def __init__(self, volumes: Array, balances: tuple[str, ...], rows: int) -> None:
        self.volumes, self.balances = volumes, balances
        self.crossed = np.zeros((len(balances), rows))
        self.largest = np.zeros(rows)  # of all steps and balances
        self.error = np.zeros((len(balances), rows))

    def __call__(self, state: State, step: Step) -> None:
        """Close the books of a step."""
        own = step.rows
        gained = (state.contents[:, own] - step.contents_before) @ self.volumes
        entered = step.inflow * step.size
        self.crossed[:, own] += np.abs(entered)
        scale = self.crossed[:, own].copy()
        if "charge" in self.balances:
            scale[self.balances.index("charge")] = scale[self.balances.index("anion")]
        # where nothing to speak of has crossed, rounding of the content itself is the measure
        scale += 1e-6 * np.abs(state.contents[:, own]) @ self.volumes + _TINY
        error = np.abs(gained - entered) / scale
        self.error[:, own] = np.maximum(self.error[:, own], error)
        self.largest[own] = np.maximum(self.largest[own], error.max(axis=0))

    def take_error(self) -> Array:
        """Largest errors since the last call, (balances, rows)."""
        error, self.error = self.error, np.zeros_like(self.error)
        return error
