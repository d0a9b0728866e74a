"""A block at rest in a bath without load: what a run starts from.

At rest the virtual bath in every cell is the real one, so the potentials are known and the momentum balance remains.
It is solved from the stress-free solid, if need be through blocks that swell less: both osmotic coefficients times
a share that grows to 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fvswell.block.block import Block, BlockState
from fvswell.block.edges import drive_names
from fvswell.block.newton import NewtonResult, newton
from fvswell.block.system import BlockSystem, edge_loads, loads_found
from fvswell.block.transport import BlockInterval, BlockTransportTerm
from fvswell.numerics.sparse_lu import DirectSolver
from fvswell.numerics.time_stepping import State
from fvswell.physics.models import Mixture
from fvswell.physics.permeability import open_circuit_ratio
from fvswell.physics.tissue import Array

__all__ = ["NoEquilibrium", "equilibrated_state", "initial_open_circuit_ratio", "with_open_circuit_ratio"]

_SMALLEST_INCREMENT = 1e-3


class NoEquilibrium(ValueError):
    """No state at rest was found."""


def equilibrated_state(system: BlockSystem, bath_concentration: float) -> State:
    """State of a block at rest in a bath, no edge loaded; what a `time_stepping.Marcher` starts from.

    Parameters
    ----------
    system
        Of the block.
    bath_concentration
        In mmol/mm3.

    Raises
    ------
    NoEquilibrium
        If the solid does not balance the osmotic pressure in any state that continuation finds.
    """
    block = system.block
    result = _swollen(block, bath_concentration)
    loads = loads_found(block, result.unknowns, result.state, edge_loads({}), bath_concentration)
    faces = block.grid.face_cells.shape[1]
    return State(
        unknowns=result.unknowns[None, None],
        loads={name: loads[name] for name in drive_names(block.edges)},
        contents=result.state.balance.contents,
        fluxes=np.zeros((len(block.balances), 1, faces)),
        phase=np.zeros(1, dtype=int),
        time=np.zeros(1),
        elapsed=np.zeros(1),
    )


def initial_open_circuit_ratio(block: Block, unknowns: Array, bath_concentration: float) -> Array:
    """k_open/k at all faces of the grid in a state ``(unknowns,)`` at rest, ``(1, faces)``; 1 where nothing crosses."""
    term = block.term
    positions = block.positions(unknowns)
    faces = term.face_state(block.potentials(unknowns), positions, bath_concentration)
    ratio = np.ones((1, block.grid.face_cells.shape[1]))
    ratio[:, term.diamonds.faces] = open_circuit_ratio(term.faces.tissue, *faces.local)
    return ratio


def with_open_circuit_ratio(block: Block, ratio: Array) -> Block:
    """The block with k_open/k held constant at the faces, ``(1, faces)`` or ``(1, 1)``."""
    term = block.term
    own = ratio[:, term.diamonds.faces] if ratio.shape[1] > 1 else ratio
    return _with_mixtures(block, term.cells, replace(term.faces, open_circuit_ratio=own))


def _with_mixtures(block: Block, cells: Mixture, faces: Mixture) -> Block:
    return replace(block, term=BlockTransportTerm(block.grid, block.term.diamonds, cells, faces))


def _swollen(block: Block, bath_concentration: float) -> NewtonResult:
    share, increment, unknowns = 0.0, 1.0, np.zeros(block.pattern.size)
    while increment > _SMALLEST_INCREMENT:
        trial = min(share + increment, 1.0)
        result = _balance_forces(_sharing(block, trial), unknowns, bath_concentration)
        if not result.converged:
            increment *= 0.25
        elif trial == 1.0:
            return result
        else:
            share, unknowns, increment = trial, result.unknowns, 2.0 * increment
    raise NoEquilibrium(
        f"no state at rest was found in the bath of {bath_concentration:g} mmol/mm3: with {share:.1%} of the osmotic "
        "pressures the block still is in balance, with more not"
    )


def _sharing(block: Block, share: float) -> Block:
    """The block with both osmotic coefficients reduced."""
    cells = block.term.cells
    tissue = replace(cells.tissue, osmotic_coefficient=share * cells.tissue.osmotic_coefficient)
    cells = replace(cells, tissue=tissue, bath_osmotic_coefficient=share * cells.bath_osmotic_coefficient)
    return _with_mixtures(block, cells, block.term.faces)


def _balance_forces(block: Block, unknowns: Array, bath_concentration: float) -> NewtonResult:
    """Displacements in balance with the bath's potentials in all cells."""
    bath = block.term.cells.bath_potentials(np.array([[bath_concentration]]))
    number, pattern, scale = block.degrees_of_freedom.number, block.pattern, block.momentum_scale
    start = unknowns.copy()
    start[number:] = np.broadcast_to(bath, (len(bath), 1, block.grid.cells)).ravel()
    unloaded = edge_loads({})
    interval = BlockInterval(np.zeros((len(bath), 1, block.grid.cells)), 0.0, bath_concentration)

    entries = np.flatnonzero((pattern.rows < number) & (pattern.columns < number))
    solver = DirectSolver(pattern.rows[entries], pattern.columns[entries], block.places[:, :number])

    def evaluate(at: Array) -> tuple[BlockState, Array]:
        state = block.evaluate(at, interval, unloaded)
        return state, state.residual[:number] / scale

    def factorise(state: BlockState) -> Callable[[Array], Array]:
        factors = solver.factorise(block.jacobian(state, interval, unloaded)[entries])

        def step(residual: Array) -> Array:
            change = np.zeros_like(start)
            change[:number] = -factors.solve(residual * scale)
            return change

        return step

    return newton(start, evaluate, factorise, lambda change: float(np.abs(change).max()) / block.length_scale)
