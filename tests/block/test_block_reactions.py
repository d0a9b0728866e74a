"""Reactions of held and driven parts, plates that are glued or smooth, and histories of the parts."""

from __future__ import annotations

import numpy as np
import pytest
from blocks import (
    CLAMPED,
    CONFINED,
    GLUED,
    UNCONFINED,
    Parts,
    acting,
    integrate,
    make_control,
    make_protocol,
    no_time,
    one_stage,
    part,
    phase,
    rough_grid,
    uniform_block,
)
from tissues import reference_tissue

from fvswell.block.block import Block
from fvswell.block.equilibrium import equilibrated_body
from fvswell.block.grid import block_grid
from fvswell.block.histories import part_histories
from fvswell.block.newton import NewtonResult
from fvswell.block.reactions import part_areas, part_displacements, part_forces
from fvswell.numerics.loads import Load
from fvswell.physics.models import BIPHASIC, ELECTROCHEMICAL
from fvswell.physics.tissue import Array

by_kind = pytest.mark.parametrize("kind", ["plane-strain", "axisymmetric"])
INDENTED = {name: UNCONFINED[name] for name in ("left", "right", "bottom")}
INDENTED |= part("top", "straight", "indenter", end=0.8) | part("top", "free", "rest", open=True, start=0.8)


def forces(block: Block, result: NewtonResult, **loads: float) -> dict[str, float]:
    """Forces on the parts at the end of a stage, by name."""
    state = block.evaluate(result.unknowns, no_time(block, **loads))
    found = part_forces(block, state, acting(block, **loads))
    return {part.name: float(force) for part, force in zip(block.parts, found, strict=True)}


@by_kind
@pytest.mark.parametrize("bottom", ["roller", "fixed"])
def test_forces_along_the_axis_are_in_balance(kind: str, bottom: str) -> None:
    """What presses down is what presses up, with the pressures of the baths."""
    block = uniform_block(rough_grid(kind), INDENTED | part("bottom", bottom), ELECTROCHEMICAL)
    start = equilibrated_body(block)[1].unknowns
    moved = start[block.degrees_of_freedom.normal[list(block.parts).index(block.parts[3])]]
    loads = {"indenter__displacement": float(moved) - 0.1, "rest__bath_pressure": 0.04, "rest__pressure": 0.03}
    _, result = one_stage(block, 30.0, **loads)
    found = forces(block, result, **loads)
    area = part_areas(block, block.positions(result.unknowns))[list(INDENTED).index("rest")]
    assert found["indenter"] > 0.02
    assert found["rest"] == pytest.approx(0.03 * area, rel=1e-12)
    down = found["indenter"] + found["rest"] + 0.04 * area
    assert found["bottom"] == pytest.approx(down, rel=1e-10)


def test_forces_across_are_in_balance() -> None:
    """Of a block between a roller and a plate that is pressed on, both open to baths of their own."""
    parts = UNCONFINED | part("left", "roller", open=True) | part("right", "straight", open=True)
    block = uniform_block(rough_grid("plane-strain"), parts, BIPHASIC)
    loads = {"left__bath_pressure": 0.05, "right__bath_pressure": 0.02, "right__pressure": 0.1, "top__pressure": 0.2}
    _, result = one_stage(block, 30.0, **loads)
    found = forces(block, result, **loads)
    areas = dict(zip(parts, part_areas(block, block.positions(result.unknowns)), strict=True))
    assert found["right"] == pytest.approx(0.1 * areas["right"], rel=1e-10)
    assert found["top"] == pytest.approx(0.2 * areas["top"], rel=1e-10)
    across = found["right"] + 0.02 * areas["right"]
    assert found["left"] + 0.05 * areas["left"] == pytest.approx(across, rel=1e-10)
    assert found["bottom"] == pytest.approx(found["top"], rel=1e-10)


@by_kind
def test_pieces_of_a_plate_and_of_what_holds_share_their_forces(kind: str) -> None:
    """Under a uniform pressure each takes what falls on its area."""
    parts = {name: CONFINED[name] for name in ("left", "right")}
    parts |= part("bottom", "roller", "in", open=True, end=0.8) | part("bottom", "fixed", "out", open=True, start=0.8)
    parts |= part("top", "straight", "middle", end=0.4) | part("top", "straight", "around", start=0.4)
    block = uniform_block(block_grid(kind, np.linspace(0.0, 2.0, 6), np.linspace(0.0, 1.0, 4)), parts, BIPHASIC)
    force = 0.1 * float(part_areas(block, block.grid.vertices)[-1])
    _, result = one_stage(block, 50.0, middle__pressure=0.1, around__force=force)
    found = forces(block, result, middle__pressure=0.1)
    areas = dict(zip(parts, part_areas(block, block.positions(result.unknowns)), strict=True))
    for name in ("in", "out", "middle", "around"):
        assert found[name] / areas[name] == pytest.approx(0.1, rel=1e-9), name


@by_kind
def test_a_plate_that_is_glued_is_stiffer_than_a_smooth_one(kind: str) -> None:
    found = {}
    for mechanical in ("straight", "glued-plate"):
        block = uniform_block(rough_grid(kind), UNCONFINED | part("top", mechanical), BIPHASIC)
        _, result = one_stage(block, 1e8, top__displacement=-0.05)
        found[mechanical] = forces(block, result, top__displacement=-0.05)["top"]
        x = block.positions(result.unknowns)[0]
        bulge = x[block.grid.edge_vertices("top")[-1]] - 2.0
        assert (abs(bulge) < 1e-12) == (mechanical == "glued-plate")
    assert 1.05 * found["straight"] < found["glued-plate"] < 2.0 * found["straight"]


@by_kind
def test_mean_displacements_of_parts(kind: str) -> None:
    block = uniform_block(rough_grid(kind), INDENTED, BIPHASIC)
    x, y = block.grid.vertices
    means = dict(zip(INDENTED, part_displacements(block, np.stack([0.1 * y, -0.2 * x])), strict=True))
    assert means["left"] == pytest.approx(0.05, rel=1e-12)
    assert means["right"] == pytest.approx(0.05, rel=1e-12)

    def mean(start: float, end: float) -> float:
        """Of the radius, or the abscissa, over the area."""
        power = 2 if kind == "axisymmetric" else 1
        return power / (power + 1) * (end ** (power + 1) - start ** (power + 1)) / (end**power - start**power)

    assert means["indenter"] == pytest.approx(-0.2 * mean(0.0, 0.8), rel=1e-12)
    assert means["rest"] == pytest.approx(-0.2 * mean(0.8, 2.0), rel=1e-12)


def run_histories(
    parts: Parts, times: Array, **loads: float | Load | None
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Histories and the crossed water of a run of one phase."""
    block = uniform_block(rough_grid("axisymmetric"), parts, BIPHASIC)
    body, state = equilibrated_body(block)
    start = block.positions(state.unknowns)
    protocol = make_protocol([phase(body, **loads)], [times[-1]], times)
    run = integrate(body, state, protocol, make_control(tolerance=1e-4, expected_strain=0.05, first_step=0.1))
    assert run.complete
    loads_found = dict(zip(body.load_names, run.filled("loads").T, strict=True))
    return part_histories(body, run.record, start), loads_found


def test_histories_of_a_relaxation_under_an_indenter() -> None:
    times = np.geomspace(1.0, 1e4, 12)
    found, loads = run_histories(INDENTED, times, indenter__displacement=Load(-0.1, 10.0), rest__bath_pressure=0.02)
    np.testing.assert_allclose(found["indenter_displacement"], -0.1 * np.minimum(times / 10.0, 1.0), rtol=1e-9)
    np.testing.assert_allclose(found["indenter_displacement"], loads["indenter.displacement"], rtol=1e-12)
    np.testing.assert_allclose(found["indenter_pressure"] * np.pi * 0.8**2, found["indenter_force"], rtol=0.2)
    assert found["indenter_force"].argmax() < 6  # it relaxes
    assert found["indenter_force"][-1] < 0.9 * found["indenter_force"].max()
    np.testing.assert_allclose(found["rest_pressure"], 0.0, atol=1e-15)
    np.testing.assert_allclose(found["rest_bath_pressure"], 0.02)
    np.testing.assert_allclose(found["rest_bath_concentration"], 1.5e-4)
    assert "left_bath_pressure" not in found
    assert "rest_current" not in found
    assert found["left_pressure"].tolist() == [0.0] * len(times)  # an axis
    assert (found["rest_water_volume"] < 0.0)[-1] or (found["right_water_volume"] < 0.0)[-1]
    # in balance to what the last iterations leave
    up, down = found["bottom_force"], found["indenter_force"] + 0.02 * np.pi * (2.0**2 - 0.8**2)
    np.testing.assert_allclose(up, down, rtol=0.05)


def test_a_glued_plate_says_how_far_it_has_slid() -> None:
    parts = {name: CLAMPED[name] for name in ("bottom",)} | part("left", "free") | part("right", "free")
    block = uniform_block(rough_grid("plane-strain"), parts | part("top", "glued-plate"), BIPHASIC, reference_tissue())
    body, state = equilibrated_body(block)
    start = block.positions(state.unknowns)
    loads = phase(body, top__tangential_displacement=Load(0.05, 10.0))
    run = integrate(body, state, make_protocol([loads], [20.0], np.array([5.0, 20.0])), make_control(tolerance=1e-4))
    found = part_histories(body, run.record, start)
    np.testing.assert_allclose(found["top_tangential_displacement"], [0.025, 0.05], rtol=1e-9)
    np.testing.assert_allclose(run.load("top.tangential_displacement"), [0.025, 0.05], rtol=1e-12)


def test_driven_and_held_parts_beside_each_other_leave_the_driven_one_its_own() -> None:
    """A reaction is without what a pressure beside it does at the vertex that both share."""
    block = uniform_block(rough_grid("plane-strain"), GLUED, BIPHASIC)
    _, result = one_stage(block, 30.0, top__force=0.2, right__pressure=0.1)
    assert forces(block, result, right__pressure=0.1)["top"] == pytest.approx(0.2, rel=1e-10)
