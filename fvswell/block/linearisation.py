"""A block linearised at a state: what a Newton step changes, and what crosses the faces by it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fvswell.block.block import Block, BlockState, Interval
from fvswell.block.transport import flux_change
from fvswell.compiled import kernel
from fvswell.physics.tissue import Array

__all__ = ["Linearisation", "NewtonStep"]


class NewtonStep(NamedTuple):
    """Change of the unknowns, and what the linear balances make of it."""

    change: Array  # (unknowns,)
    flow: Array  # (balances, crossed): what passes each crossed face in the interval
    contents: Array  # (balances, cells) at the end of the step


class Linearisation:
    """Factors of the Jacobian at a state, with the derivatives that it consists of.

    Parameters
    ----------
    block
        The block.
    state
        Where it is linearised.
    interval
        That the balances are drawn up over; the factors hold for any base and any values of the loads, but not for
        another duration or other kinds of loads.
    """

    def __init__(self, block: Block, state: BlockState, interval: Interval) -> None:
        self.block, self.state = block, state
        self._local = block.local_derivatives(state, interval.duration)
        entries = block.jacobian(self._local, interval.loads)
        self._factors = block.solver.factorise(entries * block.entry_scale)

    def step(self, state: BlockState, interval: Interval) -> NewtonStep:
        """The step from a state, which may be another one than that of the linearisation.

        The contents at its end are those that the flows leave behind, so that balances close to rounding. They differ
        from the contents at the new unknowns by what the linearisation leaves out.
        """
        block = self.block
        change = -block.unknown_scale * self._factors.solve(state.residual / block.residual_scale)
        potentials = np.ascontiguousarray(block.potentials(change))
        flow, points = np.empty_like(state.transport.fluxes), np.empty_like(state.transport.points)
        moved = block.degrees_of_freedom.displacements(change[: block.degrees_of_freedom.number])
        across, along = block.outside_change(block.outer(change))
        flux_change(block.tables, self._local.transport, moved, potentials, across, along, points, flow)
        flow += interval.duration * state.transport.fluxes
        outflow = (block.diamonds.outflow @ flow.T).T
        contents = interval.base - outflow / block.grid.volumes
        contents[2:] = 0.0  # no charge is stored; what the linear solution leaves of it shows in the balance of cations
        return NewtonStep(change, flow, contents)

    def distance(self, state: BlockState) -> float:
        """How far a state is from that of the linearisation, see `measure`."""
        if state is self.state:
            return 0.0
        contents = state.transport.contents - self.state.transport.contents
        return measure(self.block, contents, state.unknowns - self.state.unknowns)


def measure(block: Block, contents: Array, unknowns: Array) -> float:
    """Size of changes, comparable to a strain: the largest of means over the block, each relative to a natural size."""
    return float(_measure(block.grid.volumes, block.content_scale, *block.measure_scale, contents, unknowns))


@kernel
def _measure(volumes: Any, content_scale: Any, length: Any, modulus: Any, contents: Any, unknowns: Any) -> Any:
    balances, cells = contents.shape
    first = len(unknowns) - balances * cells
    largest, total = 0.0, 0.0
    for k in range(first):
        largest += abs(unknowns[k]) / (first * length)
    for c in range(cells):
        total += volumes[c]
    for b in range(balances):
        stored, potential = 0.0, 0.0
        for c in range(cells):
            stored += abs(contents[b, c]) * volumes[c]
            potential += abs(unknowns[first + b * cells + c]) * volumes[c]
        for mean in (stored / (total * content_scale[b]), potential / (total * (modulus if b == 0 else 1.0))):
            if largest == largest and not mean <= largest:  # or not a number: the system is singular
                largest = mean
    return largest
