"""What the time loop asks of a spatial discretisation, be it a column or a block of tissue.

A batch has rows that do not interact. Driven quantities (loads) go by name, one value for each row; nan says that
the quantity is not prescribed now.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from fvswell.physics.tissue import Array

__all__ = ["LoadValues", "Solution", "Stage", "System"]

LoadValues = dict[str, Array]  # name -> (rows,)


class Stage(NamedTuple):
    """One implicit stage: the contents it starts from, its length in s, and what is prescribed at its end."""

    base: Array  # (balances, rows, cells), per reference volume
    duration: Array  # (rows,)
    prescribed: LoadValues


@dataclass
class Solution:
    """Result of a stage; rows that did not converge hold their last iterate."""

    unknowns: Array  # (kinds, rows, points)
    loads: LoadValues  # every driven quantity as it is now, prescribed or found
    contents: Array  # (balances, rows, cells), per reference volume; the first is J
    fluxes: Array  # (balances, rows, faces)
    inflow: Array  # (balances, rows): rate at which each content enters through the boundary
    residual: Array  # (equations, rows, points), relative to the size of what is balanced
    converged: Array  # (rows,)
    iterations: Array  # (rows,)


class System(Protocol):
    """Balances of a batch of bodies on one grid."""

    @property
    def volumes(self) -> Array:
        """Reference volumes of the cells, ``(cells,)``."""

    @property
    def equations(self) -> tuple[str, ...]:
        """Names of the balances in the order of the first axis of ``Solution.residual``."""

    def rows(self, index: Array) -> System:
        """The system of a subset of the rows."""

    def solve(self, guess: Array, loads: LoadValues, stage: Stage) -> Solution:
        """Solve one implicit stage, from a guess of the unknowns and of what is not prescribed."""

    def extrapolate(self, unknowns: Array, change: Array) -> Array:
        """``unknowns + change`` in the rows where that is admissible, else ``unknowns``."""
