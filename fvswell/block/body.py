"""A block as the time integrator sees it: implicit stages solved by Newton's method, everything at once."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fvswell.block.block import Block, Interval
from fvswell.block.newton import Newton, NewtonResult
from fvswell.block.part_loads import part_loads
from fvswell.block.reactions import part_areas, part_forces
from fvswell.block.transport import find_volume_ratio
from fvswell.boundary.parts import HELD, load_names
from fvswell.numerics.body import admissible, complete_loads, find_rate, find_unknowns, global_strain, solve_stage
from fvswell.numerics.state import (
    BALANCE,
    CONVERGED,
    ELAPSED,
    ITERATIONS,
    NO_WATER,
    POINT,
    REASON,
    RESIDUAL,
    UPDATE,
)
from fvswell.physics.permeability import hydraulic_permeability
from fvswell.physics.tissue import Array

__all__ = ["BlockBody"]

_FIRST_MOMENT = 1e-4  # of the time in which a cell consolidates: so short that no water flows after a jump
_RATE_TOLERANCE = 1e-10


@dataclass
class BlockBody:
    """A block and what the stages of a step share.

    Loads are in the order of `boundary.parts.load_names`. A plate is driven by one of pressure, force and displacement
    at a time, and what is not driven carries no load. The first content is J and what the stabilisation stores besides
    (nothing in total).

    Parameters
    ----------
    block
        The block.
    initial_height
        Mean height of the equilibrated block, mm.
    method
        That solves its stages.
    """

    block: Block
    initial_height: float
    method: type[Newton] = Newton
    _newton: Newton | None = field(default=None, repr=False)
    _stage: tuple[float, float, tuple[bool, ...]] | None = field(default=None, repr=False)

    @cached_property
    def load_names(self) -> tuple[str, ...]:
        """Names of the loads."""
        return load_names(self.block.parts)

    @property
    def equations(self) -> tuple[str, ...]:
        """Names of the balances that a report may point to; points are cells, for momentum vertices."""
        return (*self.block.balances, "momentum")

    @cached_property
    def height_weights(self) -> tuple[Array, Array, Array]:
        """Vertices of the top and of the bottom edge, and the share of each pair in the mean height.

        The mean is over the area of the stress-free solid.
        """
        grid = self.block.grid
        top, bottom = (grid.edge_vertices(edge) for edge in ("top", "bottom"))
        x = grid.vertices[0, top]
        widths = np.diff(x)
        share = 0.5 * (np.append(widths, 0.0) + np.append(0.0, widths))
        share *= x if grid.section.rings else 1.0
        return top, bottom, share / share.sum()

    def mean_height(self, positions: Array) -> Array:
        """Mean height (mm) from positions of the vertices ``(..., 2, vertices)``."""
        top, bottom, share = self.height_weights
        height: Array = (positions[..., 1, top] - positions[..., 1, bottom]) @ share
        return height

    def interval(self, base: Array, duration: float, loads: Array) -> Interval:
        """An interval at whose end loads act."""
        return Interval(base, duration, part_loads(self.block.parts, loads, self.block.concentration))

    def volume_is_held(self, loads: Array) -> bool:
        """Whether the parts of the boundary prescribe the volume of the block."""
        moved = self.interval(np.empty(0), 0.0, loads).loads.displacement
        return all(
            part.mechanical in HELD or not np.isnan(value) for part, value in zip(self.block.parts, moved, strict=True)
        )

    @cached_property
    def moment(self) -> float:
        """A time so short that no water flows after a jump, s."""
        grid, tissue = self.block.grid, self.block.cells
        x, y = grid.vertices[:, grid.cell_vertices]
        sides = np.hypot(np.roll(x, -1, axis=0) - x, np.roll(y, -1, axis=0) - y)
        speed = (hydraulic_permeability(tissue, 1.0) * self.block.modulus).max()
        return float(_FIRST_MOMENT * sides.min() ** 2 / speed)

    def newton(self, elapsed: float, duration: float, loads: Array) -> Newton:
        """Newton's method for a stage; the stages of one step share their factors, and how fast it converges.

        Those of the step before are not used: a run that goes on from a file does not have its factors, and just after
        a jump convergence is much slower in the next step, which is longer.
        """
        stage = (elapsed, duration, tuple(np.isnan(loads)))
        if self._newton is None or self._stage != stage:
            self._newton, self._stage = self.method(self.block), stage
        return self._newton


@global_strain.register(BlockBody)
def _strain(body: BlockBody, unknowns: Array, contents: Array) -> float:
    return float(body.mean_height(body.block.positions(unknowns)) / body.initial_height - 1.0)


@admissible.register(BlockBody)
def _admissible(body: BlockBody, guess: Array, unknowns: Array) -> bool:
    block = body.block
    before, after = (volume_ratio(block, u) for u in (unknowns, guess))
    dry = 1.0 - block.cells.fluid_fraction
    salt = block.potentials(guess - unknowns)[1:2]
    return bool(np.abs(salt).max(initial=0.0) < 0.5 and (after - dry > 0.5 * (before - dry)).all())


@complete_loads.register(BlockBody)
def _complete_loads(body: BlockBody, unknowns: Array, contents: Array, loads: Array) -> None:
    block, interval, missing = body.block, body.interval(contents, 0.0, loads), np.isnan(loads)
    given, unknown = interval.loads, block.degrees_of_freedom
    positions = block.positions(unknowns)
    areas = part_areas(block, positions)
    forces = given.force + given.pressure * areas
    if not np.isnan(given.displacement).all():
        reactions = part_forces(block, block.evaluate(unknowns, interval), given)
        forces = np.where(np.isnan(given.displacement), forces, reactions)
    moved = np.append(unknowns[: unknown.number], 0.0)  # the last is that of what is held
    found = given._asdict() | {
        "force": forces,
        "pressure": np.divide(forces, areas, out=np.zeros_like(forces), where=areas > 0.0),
        "displacement": moved[unknown.normal],
        "tangential_displacement": moved[unknown.tangential],
    }
    numbers = [(index, kind) for index, part in enumerate(block.parts) for kind in part.loads]
    for load, (part, kind) in enumerate(numbers):
        if missing[load]:
            loads[load] = found[kind][part]


@solve_stage.register(BlockBody)
def _solve_stage(
    body: BlockBody, unknowns: Array, contents: Array, base: Array, duration: float, loads: Array, tolerance: float,
    crossing: Array, clock: Array, report: Array,
) -> bool:  # fmt: skip
    newton = body.newton(clock[ELAPSED], duration, loads)
    result = newton.solve(unknowns, body.interval(base, duration, loads), tolerance)
    _set_report(body, result, report)
    unknowns[:] = result.unknowns
    if result.step is None:
        return False
    contents[:] = result.step.contents
    _set_crossing(body, result.step.flow / duration, crossing)
    return True


@find_unknowns.register(BlockBody)
def _find_unknowns(body: BlockBody, unknowns: Array, contents: Array, loads: Array, slopes: Array) -> None:
    """The guess is as accurate as the contents, which the stages that it has been found from go with."""


@find_rate.register(BlockBody)
def _find_rate(
    body: BlockBody, unknowns: Array, contents: Array, loads: Array, slopes: Array, rate: Array, crossing: Array,
    clock: Array, report: Array,
) -> bool:  # fmt: skip
    """Find how the block deforms at once when loads jump, as an incompressible body, and how water begins to flow.

    Two short stages find that: the first to see at which rate, the second from where the first must have begun to end
    at the contents. So potentials are found even where the contents say nothing of them, as those of a block that is
    held all around: they make the water flow as fast as the edges move.
    """
    block, duration, start = body.block, body.moment, contents
    if body.volume_is_held(loads):  # the contents may miss the volume by what the last iteration left
        start = block.evaluate(unknowns, body.interval(contents, 0.0, loads)).transport.contents
    newton = body.method(block)
    result = newton.solve(unknowns, body.interval(start, duration, loads + duration * slopes), _RATE_TOLERANCE)
    if result.step is not None:
        earlier = body.interval(2.0 * start - result.step.contents, duration, loads)
        result = newton.solve(result.unknowns, earlier, _RATE_TOLERANCE)
    _set_report(body, result, report)
    if result.step is None:
        return False
    unknowns[:] = result.unknowns
    flux = result.step.flow / duration
    rate[:] = -(block.diamonds.outflow @ flux.T).T / block.grid.volumes
    rate[2:] = 0.0
    _set_crossing(body, flux, crossing)
    return True


def volume_ratio(block: Block, unknowns: Array) -> Array:
    """J of the cells, ``(cells,)``."""
    ratio = np.empty(block.grid.cells)
    find_volume_ratio(block.grid.section, block.tables, block.positions(unknowns), ratio)
    return ratio


def _set_crossing(body: BlockBody, flux: Array, crossing: Array) -> None:
    """Rates of entering through each part that is crossed, from fluxes through the crossed faces."""
    for part, faces in enumerate(body.block.crossed_faces):
        entering = -flux[:, faces].sum(axis=1)
        crossing[part] = 0.0
        crossing[part, : min(len(entering), 2)] = entering[:2]
        if len(entering) > 2:
            crossing[part, 2] = entering[1] + entering[2]


def _set_report(body: BlockBody, result: NewtonResult, report: Array) -> None:
    report[ITERATIONS], report[UPDATE], report[REASON] = result.iterations, result.update, result.reason
    if result.reason == CONVERGED:
        return
    block, state = body.block, result.state
    V, cells, first = len(block.balances), block.grid.cells, block.degrees_of_freedom.number
    outside = first + V * cells
    if result.reason == NO_WATER:
        report[BALANCE], report[POINT], report[RESIDUAL] = 0, np.flatnonzero(~state.sound)[0], np.inf
        return
    residual = np.abs(state.residual / block.residual_scale)
    worst = int(np.nan_to_num(residual, nan=np.inf).argmax())
    report[RESIDUAL] = residual[worst]
    if worst >= outside:  # at the boundary: the cell beside it stands for it
        report[BALANCE] = block.outside.potential[worst - outside]
        report[POINT] = block.outside.cell[worst - outside]
    elif worst >= first:
        report[BALANCE], report[POINT] = divmod(worst - first, cells)
    else:
        report[BALANCE] = V
        report[POINT] = np.flatnonzero((block.of_vertex == worst).any(axis=0))[0]
