"""A block in equilibrium with a bath, without load: what a run starts from.

In equilibrium the virtual bath in every cell is the real one, so the potentials are known and the momentum balance
remains. It is solved from the stress-free solid, if need be through blocks that swell less: all osmotic pressures times
a share that grows to 1.
"""

from __future__ import annotations

import numpy as np

from fvswell.block.block import Block, BlockState, Interval
from fvswell.block.body import BlockBody
from fvswell.block.make_block import unknown_places
from fvswell.numerics.body import complete_loads
from fvswell.numerics.sparse_lu import DirectSolver
from fvswell.numerics.state import State, start_state
from fvswell.physics.osmotic import ion_concentrations
from fvswell.physics.permeability import open_circuit_ratio
from fvswell.physics.tissue import Array, fixed_charge_density

__all__ = ["NoEquilibrium", "equilibrated_body", "initial_open_circuit_ratio", "start_of"]

_SMALLEST_INCREMENT = 1e-3
_MAX_ITERATIONS = 25
_MAX_HALVINGS = 12
_CONVERGED = 1e-13  # relative residual
_ROUNDING = 1e-12  # relative change that is rounding


class NoEquilibrium(ValueError):
    """No equilibrium was found."""


def equilibrated_body(block: Block) -> tuple[BlockBody, State]:
    """The block as it starts: in equilibrium with its bath, no part loaded.

    Raises
    ------
    NoEquilibrium
        If the solid does not balance the osmotic pressure in any state that continuation finds.
    """
    return start_of(block, _swollen(block))


def start_of(block: Block, unknowns: Array) -> tuple[BlockBody, State]:
    """Body and state of a block in equilibrium, from its unknowns there."""
    body = BlockBody(block, 1.0)
    body.initial_height = float(body.mean_height(block.positions(unknowns)))
    loads = np.full(len(body.load_names), np.nan)
    contents = block.transport_at(unknowns, block.unloaded).contents
    complete_loads(body, unknowns, contents, loads)
    return body, start_state(unknowns, contents, loads, parts=len(block.crossed_parts))


def initial_open_circuit_ratio(block: Block, unknowns: Array) -> Array:
    """k_open/k at the crossed faces ``(crossed,)`` of a block in equilibrium with its bath."""
    transport = block.transport_at(unknowns, block.unloaded)
    J, tissue = transport.face_ratio, block.faces
    ions = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), transport.face_activity)
    return np.broadcast_to(open_circuit_ratio(tissue, J, *ions), J.shape)


def _swollen(block: Block) -> Array:
    """Unknowns in equilibrium."""
    share, increment, unknowns = 0.0, 1.0, np.zeros(block.pattern.size)
    while increment > _SMALLEST_INCREMENT:
        trial = min(share + increment, 1.0)
        found = _balanced(block.with_osmotic_share(trial), unknowns)
        if found is None:
            increment *= 0.25
        elif trial == 1.0:
            return found
        else:
            share, unknowns, increment = trial, found, 2.0 * increment
    raise NoEquilibrium(
        f"no equilibrium was found in the bath of {block.concentration:g} mmol/mm3: with {share:.1%} of the osmotic "
        "pressures the block still is in balance, with more not"
    )


def _balanced(block: Block, unknowns: Array) -> Array | None:
    """Unknowns with displacements in balance with the bath's potentials in all cells; None if none are found."""
    number, pattern, scale = block.degrees_of_freedom.number, block.pattern, block.momentum_scale
    cells, balances = block.grid.cells, len(block.balances)
    interval = Interval(np.zeros((balances, cells)), 0.0, block.unloaded)
    places = unknown_places(block.grid, block.degrees_of_freedom, block.outside, balances)
    entries = np.flatnonzero((pattern.rows < number) & (pattern.columns < number))
    solver = DirectSolver(pattern.rows[entries], pattern.columns[entries], places[:, :number])

    def look(at: Array) -> tuple[BlockState, float]:
        with np.errstate(all="ignore"):
            state = block.evaluate(at, interval)
            norm = float(np.abs(state.residual[:number] / scale).max(initial=0.0))
        return state, norm if state.sound.all() and np.isfinite(norm) else np.inf

    start = unknowns.copy()
    bath = block.bath_potentials(block.concentration)
    start[number:] = np.concatenate([np.repeat(bath, cells), bath[block.outside.potential]])
    state, norm = look(start)
    for _ in range(_MAX_ITERATIONS):
        if norm <= _CONVERGED:
            return state.unknowns
        if not np.isfinite(norm):
            return None
        jacobian = block.jacobian(block.local_derivatives(state, 0.0), interval.loads)
        change = np.zeros_like(start)
        change[:number] = -solver.factorise(jacobian[entries]).solve(state.residual[:number])
        before, fraction, old = norm, 1.0, state.unknowns
        for _ in range(_MAX_HALVINGS):
            state, norm = look(old + fraction * change)
            if norm <= before:
                break
            fraction *= 0.5
        if np.isfinite(norm) and np.abs(change).max() < _ROUNDING * block.length_scale:
            return state.unknowns
    return None
