"""Blocks of tissue that several tests use, and their integration without a case or a file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from integrations import make_control
from scipy import sparse
from tissues import BATH, reference_tissue

from fvswell.block.block import Block, Interval
from fvswell.block.body import BlockBody
from fvswell.block.edges import EdgeCondition, EdgeLoads
from fvswell.block.equilibrium import equilibrated_body
from fvswell.block.grid import BlockGrid, shaped_block_grid
from fvswell.block.make_block import make_block
from fvswell.block.march import march_block
from fvswell.block.newton import Newton, NewtonResult
from fvswell.numerics.loads import Load, Protocol, make_protocol
from fvswell.numerics.state import COMPLETE, STATUS, Control, Record, State, record_room, workspace
from fvswell.physics.models import Model
from fvswell.physics.tissue import Array, Tissue

# the 2D case of Wilson et al. (2005): glued below, symmetric on the left, draining on the right, under a plate
GLUED = {
    "left": EdgeCondition("roller"),
    "right": EdgeCondition("free", permeable=True),
    "bottom": EdgeCondition("fixed"),
    "top": EdgeCondition("straight"),
}
UNCONFINED = GLUED | {"bottom": EdgeCondition("roller")}
FREE = UNCONFINED | {"top": EdgeCondition("free", permeable=True)}
CLAMPED = dict.fromkeys(("left", "right", "bottom", "top"), EdgeCondition("fixed", permeable=True))
CLAMPED_DISC = CLAMPED | {"left": EdgeCondition("roller")}
NAN = np.nan


def distorted_vertices(columns: int, rows: int, width: float = 2.0, height: float = 1.0, amount: float = 0.07) -> Array:
    """Vertices of a grid whose inner vertices are shifted smoothly; (2, rows + 1, columns + 1)."""
    x, y = np.meshgrid(np.linspace(0.0, 1.0, columns + 1), np.linspace(0.0, 1.0, rows + 1))
    shift = amount * np.sin(2 * np.pi * x) * np.sin(2 * np.pi * y)
    shift[[0, -1]] = shift[:, [0, -1]] = 0.0
    return np.stack([width * (x + shift), height * (y - shift)])


def rough_grid(kind: str, columns: int = 5, rows: int = 4, seed: int = 3) -> BlockGrid:
    """A 2 mm x 1 mm block whose inner vertices are shifted at random."""
    x, y = np.meshgrid(np.linspace(0.0, 2.0, columns + 1), np.linspace(0.0, 1.0, rows + 1))
    vertices = np.stack([x, y])
    size = np.array([2.0 / columns, 1.0 / rows])[:, None, None]
    vertices[:, 1:-1, 1:-1] += np.random.default_rng(seed).uniform(-0.25, 0.25, (2, rows - 1, columns - 1)) * size
    return shaped_block_grid(kind, vertices)


def uniform_block(
    grid: BlockGrid, edges: dict[str, EdgeCondition], model: Model, tissue: Tissue | None = None,
    concentration: float = BATH, ratio: float | None = None, **options: Any,
) -> Block:  # fmt: skip
    """A block of reference tissue, the same everywhere; with k_open/k held at ``ratio``, if given."""
    own = model.tissue(reference_tissue() if tissue is None else tissue)
    block = make_block(grid, edges, model, own, own, own, concentration, **options)
    return block if ratio is None else block.with_open_circuit_ratio(ratio)


def edge_values(**loads: float) -> EdgeLoads:
    """Loads of the edges, as left=..., top=... with a kind behind ``__``; what is not named carries none."""
    pressure, force, displacement = np.zeros(4), np.zeros(4), np.full(4, NAN)
    values = {"pressure": pressure, "force": force, "displacement": displacement}
    for name, value in loads.items():
        edge, kind = name.split("__")
        values[kind][("left", "right", "bottom", "top").index(edge)] = value
    return EdgeLoads(pressure, force, displacement)


def no_time(block: Block, bath: float = BATH, **loads: float) -> Interval:
    """An interval of no length, from nothing."""
    return Interval(np.zeros((len(block.balances), block.grid.cells)), 0.0, bath, edge_values(**loads))


def random_unknowns(block: Block, seed: int = 5) -> Array:
    """A state far from equilibrium, admissible, (unknowns,)."""
    draw = np.random.default_rng(seed)
    unknowns = draw.uniform(-0.02, 0.02, block.pattern.size)
    potentials = block.potentials(unknowns)
    potentials *= 5.0
    if len(potentials) > 1:
        potentials[1] += np.log(BATH)
    return unknowns


def jacobian_matrix(block: Block, unknowns: Array, interval: Interval) -> sparse.csc_array:
    """The Jacobian of a block."""
    state, pattern = block.evaluate(unknowns, interval), block.pattern
    values = block.jacobian(block.local_derivatives(state, interval.duration), interval.loads)
    return sparse.csc_array((values, (pattern.rows, pattern.columns)), shape=(pattern.size, pattern.size))


def one_stage(block: Block, duration: float, bath: float = BATH, **loads: float) -> tuple[BlockBody, NewtonResult]:
    """A stage of backward Euler from equilibrium, solved to rounding."""
    body, state = equilibrated_body(block)
    interval = Interval(state.contents, duration, bath, edge_values(**loads))
    result = Newton(block).solve(state.unknowns, interval, 1e-14)
    assert result.step is not None
    return body, result


def phase(body: BlockBody, **loads: float | Load | None) -> list[Load | None]:
    """Loads of one phase by name, with ``__`` for the dot; pressures that are not named are zero."""
    named = {name.replace("__", "."): load for name, load in loads.items()}
    driven = {name.split(".")[0] for name in named}
    chosen: dict[str, Any] = {"bath": BATH} | {
        name: 0.0 for name in body.load_names if name.endswith(".pressure") and name.split(".")[0] not in driven
    }
    chosen |= named
    values = [chosen.get(name) for name in body.load_names]
    return [load if load is None or isinstance(load, Load) else Load(load) for load in values]


@dataclass(frozen=True)
class Integration:
    """A run of a block to the end."""

    body: BlockBody
    state: State
    record: Record

    @property
    def complete(self) -> bool:
        """Whether the protocol is over."""
        return bool(self.state.counts[STATUS] == COMPLETE)

    def filled(self, name: str) -> Array:
        """What has been recorded of one of the arrays of the record."""
        values: Array = getattr(self.record, name)[: self.record.filled[1 if name == "steps" else 0]]
        return values

    def load(self, name: str) -> Array:
        """Values of a load at the outputs."""
        values: Array = self.filled("loads")[:, self.body.load_names.index(name)]
        return values


def integrate(body: BlockBody, state: State, protocol: Protocol, control: Control, outputs: int = 2000) -> Integration:
    """Run a block from a state on."""
    record = record_room(state, outputs, outputs)
    work = workspace(state, len(control.nodes))
    march_block(body, body.block.grid.volumes, body.block.content_scale, protocol, control, state, record, work)
    return Integration(body, state, record)


__all__ = ["BATH", "make_control", "make_protocol"]
