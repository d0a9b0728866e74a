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
from fvswell.block.equilibrium import equilibrated_body
from fvswell.block.grid import BlockGrid, shaped_block_grid
from fvswell.block.make_block import make_block
from fvswell.block.march import march_block
from fvswell.block.newton import Newton, NewtonResult
from fvswell.block.outside import Beyond
from fvswell.block.part_loads import PartLoads
from fvswell.boundary.parts import Part
from fvswell.numerics.loads import Load, Protocol, make_protocol
from fvswell.numerics.state import COMPLETE, STATUS, Control, Record, State, record_room, workspace
from fvswell.physics.models import Model
from fvswell.physics.tissue import Array, Tissue

Parts = dict[str, Part]


def part(edge: str, mechanical: Any, name: str = "", **conditions: Any) -> Parts:
    """A part of an edge, by default the whole of it, by its name; grounded if it is open, unless said otherwise."""
    usual = {"electrical": "grounded"} if conditions.get("open") else {}
    own = name or edge
    return {own: Part(own, mechanical, edge=edge, **(usual | conditions))}


# the 2D case of Wilson et al. (2005): glued below, symmetric on the left, draining on the right, under a plate
GLUED = part("left", "roller") | part("right", "free", open=True) | part("bottom", "fixed") | part("top", "straight")
UNCONFINED = GLUED | part("bottom", "roller")
FREE = UNCONFINED | part("top", "free", open=True)
CLAMPED = {edge: part(edge, "fixed", open=True)[edge] for edge in GLUED}
CLAMPED_DISC = CLAMPED | part("left", "roller")
CONFINED = part("left", "roller") | part("right", "roller") | part("bottom", "fixed", open=True)
CONFINED |= part("top", "straight")
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
    grid: BlockGrid, parts: Parts, model: Model, tissue: Tissue | None = None,
    concentration: float = BATH, ratio: float | None = None, **options: Any,
) -> Block:  # fmt: skip
    """A block of reference tissue, the same everywhere; with k_open/k held at ``ratio``, if given."""
    own = model.tissue(reference_tissue() if tissue is None else tissue)
    block = make_block(grid, tuple(parts.values()), model, own, own, own, concentration, **options)
    return block if ratio is None else block.with_open_circuit_ratio(ratio)


def acting(block: Block, bath: float = BATH, **loads: float) -> PartLoads:
    """Loads by name, with ``__`` for the dot, on a block in a bath; what is not named carries none."""
    names = [part.name for part in block.parts]
    values = {kind: list(array) for kind, array in block.unloaded._asdict().items()}
    values["bath_concentration"] = [bath] * len(names)
    for name, value in loads.items():
        own, kind = name.split("__")
        values[kind][names.index(own)] = value
    return PartLoads(**{kind: np.array(array, dtype=float) for kind, array in values.items()})


def beyond(block: Block, vertices: Array) -> Beyond:
    """Values of the potentials at the vertices ``(balances, vertices)`` in place of those of the baths."""
    maps = (block.diamonds.across_outside, block.diamonds.along_outside)
    across, along = (np.ascontiguousarray((part @ vertices.T).T) for part in maps)
    return Beyond(across, along, np.log(BATH))


def no_time(block: Block, bath: float = BATH, **loads: float) -> Interval:
    """An interval of no length, from nothing."""
    return Interval(np.zeros((len(block.balances), block.grid.cells)), 0.0, acting(block, bath, **loads))


def random_unknowns(block: Block, seed: int = 5) -> Array:
    """A state far from equilibrium, admissible, (unknowns,)."""
    draw = np.random.default_rng(seed)
    unknowns = draw.uniform(-0.02, 0.02, block.pattern.size)
    potentials = block.potentials(unknowns)
    potentials *= 5.0
    if len(potentials) > 1:
        potentials[1] += np.log(BATH)
        block.outer(unknowns)[block.outside.potential == 1] += np.log(BATH)
    return unknowns


def jacobian_matrix(block: Block, unknowns: Array, interval: Interval) -> sparse.csc_array:
    """The Jacobian of a block."""
    state, pattern = block.evaluate(unknowns, interval), block.pattern
    values = block.jacobian(block.local_derivatives(state, interval.duration), interval.loads)
    return sparse.csc_array((values, (pattern.rows, pattern.columns)), shape=(pattern.size, pattern.size))


def one_stage(block: Block, duration: float, bath: float = BATH, **loads: float) -> tuple[BlockBody, NewtonResult]:
    """A stage of backward Euler from equilibrium, solved to rounding."""
    body, state = equilibrated_body(block)
    interval = Interval(state.contents, duration, acting(block, bath, **loads))
    result = Newton(block).solve(state.unknowns, interval, 1e-14)
    assert result.step is not None
    return body, result


def steady_state(block: Block, tolerance: float = 1e-14, **loads: float) -> tuple[NewtonResult, Array]:
    """The state that constant loads lead to, and rates of entering through the parts, (parts, balances).

    In a block of a millimetre what is left of the beginning falls by a factor of 20 or more in each stage.
    """
    state, duration = equilibrated_body(block)[1], 2e4
    base, unknowns = state.contents, state.unknowns
    for _ in range(10):
        result = Newton(block).solve(unknowns, Interval(base, duration, acting(block, **loads)), tolerance)
        assert result.step is not None
        base, unknowns = result.step.contents, result.unknowns
    flow = result.step.flow / duration
    return result, np.array([-flow[:, faces].sum(axis=1) for faces in block.crossed_faces])


def phase(body: BlockBody, bath: float | Load = BATH, **loads: float | Load | None) -> list[Load | None]:
    """Loads of one phase by name, with ``__`` for the dot; those that are not named are zero, baths as ``bath``."""
    named = {name.replace("__", "."): load for name, load in loads.items()}
    assert set(named) <= set(body.load_names), set(named) - set(body.load_names)
    driven = {name.split(".")[0] for name in named if name.split(".")[1] in ("force", "displacement")}
    chosen: dict[str, Any] = {}
    for name in body.load_names:
        own, kind = name.split(".")
        if kind == "bath_concentration":
            chosen[name] = bath
        elif kind in ("bath_pressure", "current", "potential") or (kind == "pressure" and own not in driven):
            chosen[name] = 0.0
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
