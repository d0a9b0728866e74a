"""Indentation of a layer on bone by a flat-ended indenter without friction, against the solution of Hayes et al.

    P = 2 a E w kappa(a/h, nu)/(1 - nu^2)

at small strain, with the drained modulus and Poisson's ratio in equilibrium, and with nu = 1/2, E = 3 G in the first
instant (W. C. Hayes, L. M. Keer, G. Herrmann & L. F. Mockros, J. Biomech. 5 (1972) 541-551; kappa by their integral
equation). The stress is infinite at the rim of the indenter, so that the force converges at first order in the cells
there; grading makes its error small.
"""

from __future__ import annotations

import numpy as np
import pytest
from blocks import acting, integrate, make_control, make_protocol, no_time, one_stage, part, phase, uniform_block
from tissues import reference_tissue

from fvswell.block.block import Block
from fvswell.block.equilibrium import equilibrated_body
from fvswell.block.grid import block_grid
from fvswell.block.histories import part_histories
from fvswell.block.reactions import part_forces
from fvswell.numerics.graded_grid import graded_nodes
from fvswell.physics.models import BIPHASIC

KAPPA = {  # (a/h, nu)
    (0.4, 0.0): 1.4004, (0.4, 0.3): 1.4726, (0.4, 0.5): 1.6837, (1.0, 0.0): 2.2261, (1.0, 0.3): 2.4835,
    (1.0, 0.4): 2.7938, (1.0, 0.5): 3.6187,
}  # fmt: skip
WIDTH = {0.4: 4.0, 1.0: 8.0}  # of the layer, of height 1: 8 to 10 radii of the indenter
DEPTH = 1e-6
LONG, SHORT = 1e7, 1e-7  # s; the layer takes some 1e3 s to consolidate


def layer(radius: float, poisson_ratio: float, columns: int, rows: int) -> Block:
    """A layer 1 mm high of 1 MPa, its cells graded toward the rim of the indenter and toward the surface."""
    width = WIDTH[radius]
    grid = block_grid(
        "axisymmetric", graded_nodes(width, columns, 60.0, [radius]), graded_nodes(1.0, rows, 10.0, ["end"])
    )
    parts = part("left", "roller") | part("right", "free", open=True) | part("bottom", "fixed")
    parts |= part("top", "straight", "indenter", end=radius) | part("top", "free", "rest", open=True, start=radius)
    tissue = reference_tissue(youngs_modulus=1.0, poisson_ratio=poisson_ratio)
    return uniform_block(grid, parts, BIPHASIC, tissue)


def stiffness(block: Block, duration: float) -> float:
    """Force over depth, N/mm, after a time."""
    _, result = one_stage(block, duration, indenter__displacement=-DEPTH)
    state = block.evaluate(result.unknowns, no_time(block))
    force = part_forces(block, state, acting(block))[[part.name for part in block.parts].index("indenter")]
    return float(force / DEPTH)


def hayes(radius: float, poisson_ratio: float, drained: bool) -> float:
    """The exact one."""
    if drained:
        return 2.0 * radius * KAPPA[radius, poisson_ratio] / (1.0 - poisson_ratio**2)
    return 2.0 * radius * 1.5 / (1.0 + poisson_ratio) * KAPPA[radius, 0.5] / 0.75


@pytest.mark.parametrize("drained", [True, False], ids=["drained", "first-instant"])
@pytest.mark.parametrize(("radius", "poisson_ratio"), [key for key in KAPPA if key[1] < 0.5])
def test_force_of_a_flat_indenter_converges_to_hayes(radius: float, poisson_ratio: float, drained: bool) -> None:
    exact = hayes(radius, poisson_ratio, drained)
    errors = [
        stiffness(layer(radius, poisson_ratio, columns, columns // 2), LONG if drained else SHORT) / exact - 1.0
        for columns in (16, 30, 60)
    ]
    assert 0.0 < errors[-1] < 0.01, errors  # too stiff, as finite elements are
    orders = np.log(np.array(errors[:-1]) / errors[1:]) / np.log([30 / 16, 2.0])
    assert (orders > 1.0).all(), orders
    assert (orders < 2.0).all(), orders


def test_creep_under_an_indenter_leads_from_the_first_instant_to_the_drained_depth() -> None:
    block, force = layer(1.0, 0.3, 24, 12), 1e-6
    body, state = equilibrated_body(block)
    start = block.positions(state.unknowns)
    times = np.geomspace(1e-3, 1e6, 28)
    control = make_control(tolerance=1e-5, expected_strain=1e-6, first_step=1e-3)
    run = integrate(body, state, make_protocol([phase(body, indenter__force=force)], [1e6], times), control)
    assert run.complete
    depth = -part_histories(body, run.record, start)["indenter_displacement"]
    assert (np.diff(depth) > -1e-4 * depth[-1]).all()
    first, last = (force / stiffness(block, duration) for duration in (SHORT, LONG))
    assert depth[-1] == pytest.approx(last, rel=1e-4)
    # 1 ms in, water has left the surface only
    assert first < depth[0] < first + 0.05 * (last - first)
