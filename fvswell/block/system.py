"""A block of tissue as the time loop sees it: implicit stages solved by Newton's method, everything at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fvswell.block.block import Block, BlockState, EdgeLoads
from fvswell.block.edges import drive_names
from fvswell.block.newton import NewtonResult, newton
from fvswell.block.sides import EDGES
from fvswell.block.transport import BlockInterval
from fvswell.numerics.system import LoadValues, Solution, Stage
from fvswell.physics.tissue import Array

__all__ = ["BlockSystem", "edge_loads", "loads_found"]


@dataclass(frozen=True)
class BlockSystem:
    """Balances of one block (batches of blocks have one row).

    Unknowns are ``(1, 1, unknowns)``, in the order of `fvswell.block.assembly`. Driven quantities are named by
    `edges.drive_names`; a tied edge is driven by one of pressure, force and displacement at a time, and what is
    not driven carries no load. The first content is J and what the stabilisation stores besides (nothing in total);
    fluxes are totals of all faces of the grid, from the first cell to the second or outward. The points of the
    residual are cells, for momentum vertices.
    """

    block: Block

    @property
    def volumes(self) -> Array:
        """Reference volumes of the cells, ``(cells,)``."""
        return self.block.grid.volumes

    @property
    def equations(self) -> tuple[str, ...]:
        """Names of the balances."""
        return (*self.block.balances, "momentum")

    def rows(self, index: Array) -> BlockSystem:
        """The system of a subset of the rows; there is one row."""
        return self

    def extrapolate(self, unknowns: Array, change: Array) -> Array:
        """Extrapolated unknowns, or the old ones where that would leave a cell with little water or go far."""
        block = self.block
        before, after = (block.volume_ratio(block.positions(u[0, 0])) for u in (unknowns, unknowns + change))
        dry = 1.0 - block.term.cells.tissue.fluid_fraction
        ions = block.potentials(change[0, 0])[1:]
        near = not ions.size or np.abs(ions).max() < 0.5
        return unknowns + change if near and (after - dry > 0.5 * (before - dry)).all() else unknowns

    def solve(self, guess: Array, loads: LoadValues, stage: Stage) -> Solution:
        """Solve the balances of one implicit stage.

        Parameters
        ----------
        guess
            Unknowns to start from, ``(1, 1, unknowns)``.
        loads
            Driven quantities as they are; names that the stage does not prescribe carry no load.
        stage
            Base contents, duration and what is prescribed.

        Raises
        ------
        ValueError
            If a tied edge is driven in two ways at once.
        """
        bath = stage.prescribed["bath"][0]
        interval = BlockInterval(stage.base, float(stage.duration[0]), float(bath))
        driven = edge_loads(stage.prescribed)
        result = self.iterate(guess[0, 0], interval, driven)
        balance, grid = result.state.balance, self.block.grid
        fluxes = np.zeros((len(self.block.balances), 1, grid.face_cells.shape[1]))
        fluxes[..., self.block.term.diamonds.faces] = balance.fluxes
        with np.errstate(invalid="ignore"):  # fluxes where the iteration failed
            inflow = -balance.fluxes[..., self.block.term.diamonds.boundary].sum(axis=-1)
        found = loads_found(self.block, result.unknowns, result.state, driven, float(bath))
        return Solution(
            unknowns=result.unknowns[None, None],
            loads={name: found[name] for name in loads},
            contents=result.state.balance.contents,
            fluxes=fluxes,
            inflow=inflow,
            residual=self._residual_at_points(result),
            converged=np.array([result.converged]),
            iterations=np.array([result.iterations]),
        )

    def iterate(self, unknowns: Array, interval: BlockInterval, driven: EdgeLoads) -> NewtonResult:
        """Newton's iteration from unknowns ``(unknowns,)``."""
        block = self.block
        scale = block.residual_scale(interval.bath_concentration)
        pattern, unknown_scale = block.pattern, block.unknown_scale
        entry_scale = unknown_scale[pattern.columns] / scale[pattern.rows]

        def evaluate(at: Array) -> tuple[BlockState, Array]:
            state = block.evaluate(at, interval, driven)
            return state, state.residual / scale

        def factorise(state: BlockState) -> Callable[[Array], Array]:
            factors = block.solver.factorise(block.jacobian(state, interval, driven) * entry_scale)
            return lambda residual: -unknown_scale * factors.solve(residual)

        return newton(unknowns, evaluate, factorise, lambda change: float(np.abs(change / unknown_scale).max()))

    def _residual_at_points(self, result: NewtonResult) -> Array:
        """Relative residuals; there is none of the volume balance in a cell that is not sound."""
        block, residual = self.block, result.residual
        V, cells, vertices = len(block.balances), block.grid.cells, block.grid.vertices.shape[1]
        at_points = np.zeros((V + 1, 1, vertices))
        at_points[:V, 0, :cells] = residual[block.degrees_of_freedom.number :].reshape(V, cells)
        at_points[0, 0, :cells][~result.state.sound] = np.inf
        momentum = np.abs(block.degrees_of_freedom.displacements(residual[: block.degrees_of_freedom.number]))
        at_points[V, 0] = momentum.max(axis=0)
        return at_points


def edge_loads(prescribed: LoadValues) -> EdgeLoads:
    """Loads of the edges from driven quantities by name."""

    def values(kind: str) -> Array:
        return np.array([prescribed.get(f"{edge}.{kind}", [np.nan])[0] for edge in EDGES], dtype=float)

    kinds = EdgeLoads(values("pressure"), values("force"), values("displacement"))
    for edge, count in zip(EDGES, (~np.isnan(kinds)).sum(axis=0), strict=True):
        if count > 1:
            raise ValueError(f"the {edge} edge is driven in more than one way: give pressure, force or displacement")
    return kinds._replace(pressure=np.nan_to_num(kinds.pressure), force=np.nan_to_num(kinds.force))


def loads_found(
    block: Block, unknowns: Array, state: BlockState, driven: EdgeLoads, bath_concentration: float
) -> LoadValues:
    """All driven quantities as they are: prescribed, or found on the tied edges; each ``(1,)``."""
    found = {"bath": bath_concentration}
    for edge, pressure in zip(EDGES, driven.pressure, strict=True):
        found[f"{edge}.pressure"] = pressure
    areas = dict(zip(EDGES, block.edge_areas(state.positions), strict=True))
    for edge, force in block.tied_edge_reactions(state, driven).items():
        found[f"{edge}.force"] = force
        found[f"{edge}.pressure"] = force / areas[edge]
        found[f"{edge}.displacement"] = unknowns[block.degrees_of_freedom.of_tied_edge[edge]]
    return {name: np.array([float(found[name])]) for name in drive_names(block.edges)}
