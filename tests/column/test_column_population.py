"""A random population: every run completes or says truly why it cannot, and every balance is closed."""

from __future__ import annotations

import numpy as np
import pytest
from integrations import Integration, equal_steps, first_step, integrate, make_control
from random_columns import RandomRun, wild_run

from fvswell.numerics.loads import make_protocol
from fvswell.numerics.state import LOSS, NO_WATER, REASON
from fvswell.physics.equilibrium import equilibrium_volume_ratio

CLOSED = 1e-10  # of what has crossed


def run(case: RandomRun, seed: int) -> Integration:
    """Every third with backward Euler, few steps; the others controlled by the error."""
    times = np.cumsum(case.durations)
    if seed % 3 == 0:
        control = equal_steps(2 + seed % 10)
    else:
        tolerance = (1e-2, 1e-3, 1e-4)[seed % 7 % 3]
        control = make_control(
            tolerance=tolerance, expected_strain=case.expected_strain(), first_step=first_step(case.column)
        )
    return integrate(case.column, make_protocol(case.phases, case.durations, times), control)


def dries(case: RandomRun) -> bool:
    """Whether a load of the protocol would leave next to no water somewhere in the end, or a piston moves."""
    for pressure, height, bath, *_ in case.phases:
        if height is not None and height.over > 0.0:
            return True
        J = equilibrium_volume_ratio(case.column.cells, pressure.target if pressure else 0.0, bath.target)  # type: ignore[union-attr]
        if not np.isfinite(J).all() or np.min(J - 1.0 + case.column.cells.fluid_fraction) < 0.02:
            return True
    return False


def check(seed: int) -> str:
    case = wild_run(seed)
    done = run(case, seed)
    assert np.isfinite(done.state.contents).all()
    assert np.all(done.state.contents[0] > done.body.dry)
    if done.state.contents.shape[0] > 1:
        assert np.all(done.state.contents[1] > 0.0)
    assert done.state.clock[LOSS] < CLOSED, seed
    if len(done.time):
        assert done.filled("errors").max() < CLOSED * (1.0 if case.phases[0][1] is None else 100.0), seed
    if done.complete:
        assert done.time[-1] == pytest.approx(sum(case.durations), rel=1e-12)
        last = case.phases[-1][1]
        if last is not None:
            assert done.height[-1] == pytest.approx(last.target, rel=1e-10)
        return "complete"
    assert done.work.report[REASON] == NO_WATER, seed
    assert dries(case), seed
    return "dried"


@pytest.mark.parametrize("first", range(0, 200, 50))
def test_population(first: int) -> None:
    ends = [check(seed) for seed in range(first, first + 50)]
    assert ends.count("complete") > 35


@pytest.mark.slow
@pytest.mark.parametrize("first", range(1000, 2000, 100))
def test_large_population(first: int) -> None:
    ends = [check(seed) for seed in range(first, first + 100)]
    assert ends.count("complete") > 70
