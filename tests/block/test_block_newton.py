"""Newton's method for a block: the exact Jacobian, convergence, kept factors, and what a step makes of the balances."""

from __future__ import annotations

import numpy as np
import pytest
from blocks import GLUED, UNCONFINED, acting, jacobian_matrix, random_unknowns, rough_grid, uniform_block
from tissues import reference_tissue

from fvswell.block.block import Block, Interval
from fvswell.block.equilibrium import equilibrated_body
from fvswell.block.newton import Newton
from fvswell.numerics.state import CONVERGED, NO_WATER
from fvswell.physics.models import ELECTROCHEMICAL, MODELS, Model
from fvswell.physics.tissue import Array

by_model = pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)


@by_model
@pytest.mark.parametrize("kind", ["plane-strain", "axisymmetric"])
@pytest.mark.parametrize("driven", ["force", "displacement"])
def test_jacobian_is_the_derivative_of_the_residual(kind: str, model: Model, driven: str) -> None:
    block = uniform_block(rough_grid(kind), UNCONFINED, model, reference_tissue(permeability_exponent=2.0))
    unknowns = random_unknowns(block)
    held = {"top__displacement": -0.1} if driven == "displacement" else {}
    loads = acting(block, 1.2e-4, right__pressure=0.1, top__pressure=0.05, top__force=0.03, **held)
    interval = Interval(np.zeros((len(model.balances), block.grid.cells)), 3.0, loads)
    assert block.evaluate(unknowns, interval).sound.all()
    exact = jacobian_matrix(block, unknowns, interval).toarray()
    step, scale = 3e-5 * block.unknown_scale, block.unknown_scale / block.residual_scale[:, None]

    def shifted(j: int, times: float) -> Array:
        at = unknowns.copy()
        at[j] += times * step[j]
        return block.evaluate(at, interval).residual

    for j in range(len(unknowns)):
        slope = 8.0 * (shifted(j, 1) - shifted(j, -1)) - (shifted(j, 2) - shifted(j, -2))
        gap = (exact[:, j] - slope / (12.0 * step[j])) * scale[:, j]
        assert np.abs(gap).max() < 1e-8, j


def swollen_and_loaded(model: Model) -> tuple[Block, Array, Interval]:
    """A block in equilibrium, and an interval over which a weaker bath and a plate act on it."""
    block = uniform_block(rough_grid("plane-strain"), GLUED, model)
    _, state = equilibrated_body(block)
    return block, state.unknowns, Interval(state.contents, 20.0, acting(block, 0.7e-4, top__pressure=0.3))


@by_model
def test_newton_converges_quadratically(model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fvswell.block.newton._slow", lambda *_: True)  # a Jacobian for every step
    block, unknowns, interval = swollen_and_loaded(model)
    newton = Newton(block)
    result = newton.solve(unknowns, interval, 0.0)
    assert newton.factorisations >= result.iterations - 1
    sizes = np.array(result.sizes)
    falling = sizes[(sizes < 0.2) & (sizes > 1e-12)]
    assert len(falling) >= 2
    assert (falling[1:] < 20.0 * falling[:-1] ** 2).all(), sizes
    assert np.abs(block.evaluate(result.unknowns, interval).residual / block.residual_scale).max() < 1e-12


@by_model
def test_kept_factors_lead_to_the_same_solution_in_fewer_factorisations(model: Model) -> None:
    block, unknowns, interval = swollen_and_loaded(model)
    kept = Newton(block)
    result = kept.solve(unknowns, interval, 1e-13)
    assert result.reason == CONVERGED
    assert kept.factorisations < result.iterations
    assert np.abs(block.evaluate(result.unknowns, interval).residual / block.residual_scale).max() < 1e-12


@by_model
@pytest.mark.parametrize("tolerance", [1e-2, 1e-5])
def test_a_tolerance_is_kept_and_balances_close_to_rounding_whatever_it_is(model: Model, tolerance: float) -> None:
    block, unknowns, interval = swollen_and_loaded(model)
    exact = Newton(block).solve(unknowns, interval, 1e-13)
    newton = Newton(block)
    for _ in range(2):  # the second time knowing how fast it converges
        result = newton.solve(unknowns, interval, tolerance)
        assert exact.step is not None
        assert result.step is not None
        gap = np.abs(result.step.contents - exact.step.contents) @ block.grid.volumes / block.grid.volumes.sum()
        assert (gap / block.content_scale).max() < 2.0 * tolerance
        entered = -result.step.flow[:, block.diamonds.boundary].sum(axis=1)
        gained = (result.step.contents - interval.base) @ block.grid.volumes
        through = np.abs(result.step.flow).max(axis=1)
        assert (np.abs(gained - entered) < 1e-12 * through).all()


def test_a_step_that_would_invert_cells_is_reported_as_such() -> None:
    block, unknowns, interval = swollen_and_loaded(ELECTROCHEMICAL)
    flat = interval._replace(loads=acting(block, 0.7e-4, top__displacement=-0.95))
    result = Newton(block).solve(unknowns, flat, 1e-8)
    assert result.reason != CONVERGED
    inverted = unknowns.copy()
    inverted[: block.degrees_of_freedom.number] = np.random.default_rng(1).normal(size=block.degrees_of_freedom.number)
    assert Newton(block).solve(inverted, interval, 1e-8).reason == NO_WATER
