"""Books kept on what is conserved: contents of the body against what crossed its boundary."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fvswell.numerics.time_stepping import State, Step
from fvswell.physics.tissue import Array

__all__ = ["ConservationBooks"]

_LARGEST_LOSS = 1e-8  # of what is in the body and has crossed its boundary: beyond it a result is refused

_ROUNDING_SCALE = 1e-4  # of the content: at rest, where nothing crosses, rounding is told relative to this


class ConservationBooks:
    """Observer of the time loop that closes every balance in every step.

    ``error`` is, for each balance and row, the largest mismatch in a step since the last ``take_error``, relative to
    all that has crossed the boundary so far (in magnitude). Charge has no content; its mismatch is the net charge
    that crossed, relative to the cations that did. ``loss`` is the largest mismatch of all steps and balances relative
    to what has crossed and what is there: a long step at rest moves nothing, but leaves rounding of large fluxes.

    Parameters
    ----------
    volumes
        Reference volumes of the cells, (cells,).
    balances
        Names of the balances solved for; ``self.balances`` adds "cation" where its contents are given.
    state
        Where the books begin.
    cation_contents
        Contents of the cells, (rows, cells), at unknowns: the cation's balance is not solved for, it has to follow
        from the others. Its inflow is the anion's plus the current.
    """

    def __init__(
        self, volumes: Array, balances: tuple[str, ...], state: State,
        cation_contents: Callable[[Array], Array] | None = None,
    ) -> None:  # fmt: skip
        self.volumes, self.cation_contents = volumes, cation_contents
        self.balances = balances if cation_contents is None else (*balances, "cation")
        rows = len(state.time)
        self.crossed = np.zeros((len(self.balances), rows))
        self.largest = np.zeros(rows)  # error of all steps and balances
        self.loss = np.zeros(rows)
        self.error = np.zeros((len(self.balances), rows))
        if cation_contents is not None:
            self._cations = cation_contents(state.unknowns) @ volumes

    def __call__(self, state: State, step: Step) -> None:
        """Close the books of a step."""
        own = step.rows
        gained = (state.contents[:, own] - step.contents_before) @ self.volumes
        entered = step.inflow * step.size
        held = np.abs(state.contents[:, own]) @ self.volumes
        if self.cation_contents is not None:
            cations = self.cation_contents(state.unknowns) @ self.volumes
            gained = np.concatenate([gained, (cations - self._cations)[None, own]])
            anion, charge = (entered[self.balances.index(name)] for name in ("anion", "charge"))
            entered = np.concatenate([entered, (anion + charge)[None]])
            held = np.concatenate([held, cations[None, own]])
            self._cations[own] = cations[own]
        self.crossed[:, own] += np.abs(entered)
        crossed = self.crossed[:, own].copy()
        if "cation" in self.balances:
            of_charge, of_cation = self.balances.index("charge"), self.balances.index("cation")
            crossed[of_charge], held[of_charge] = crossed[of_cation], held[of_cation]
        mismatch = np.abs(gained - entered)
        # where nothing to speak of has crossed, rounding of the content itself is the measure
        error = mismatch / (crossed + _ROUNDING_SCALE * held)
        self.error[:, own] = np.maximum(self.error[:, own], error)
        self.largest[own] = np.maximum(self.largest[own], error.max(axis=0))
        self.loss[own] = np.maximum(self.loss[own], (mismatch / (crossed + held)).max(axis=0))

    def refusal(self, row: int) -> str | None:
        """Why the result of a row is refused, if it is."""
        if self.loss[row] <= _LARGEST_LOSS:
            return None
        return f"a balance is off by {self.loss[row]:.3g} of what is in the tissue and crossed its boundary"

    def take_error(self) -> Array:
        """Largest errors since the last call, (balances, rows)."""
        error, self.error = self.error, np.zeros_like(self.error)
        return error
