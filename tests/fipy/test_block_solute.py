"""A solute of the user's own in a block that moves: FiPy's transient and source terms, and our diamond fluxes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fipy import CellVariable, ImplicitSourceTerm, TransientTerm

import fvswell
from fvswell.fipy import MovingBlock, direct_solver
from fvswell.simulation.setup import make_setup

CASES = Path(__file__).parents[2] / "cases"
EQUAL_STEPS = {"time.scheme": "backward-euler", "time.steps_per_phase": 3}
CHOSEN_STEPS = {"time.scheme": "esdirk43", "time.tolerance": 1e-2}
BLOCKS = ["plane_strain", "unconfined_disc"]


def moving(name: str, **changes: Any) -> MovingBlock:
    case = fvswell.load_case(CASES / f"{name}.toml").with_changes({"geometry.cells": [5, 4]} | changes)
    return MovingBlock(make_setup(case))


@pytest.mark.parametrize("name", BLOCKS)
@pytest.mark.parametrize("steps", [EQUAL_STEPS, CHOSEN_STEPS], ids=["equal", "chosen"])
def test_uniform_concentration_stays_uniform(name: str, steps: dict[str, Any]) -> None:
    """Carried by the water without hindrance: exact, whatever the scheme that moves the block."""
    block = moving(name, **steps)
    c = CellVariable(mesh=block.mesh, value=3.0, hasOld=True)
    least, most = np.inf, -np.inf
    for step in block:
        c.updateOld()
        flux = block.solute_flux(c, diffusivity=0.0, drag=1.0, outside=3.0)
        (TransientTerm(coeff=block.fluid_fraction, var=c) + flux).solve(dt=step.dt, solver=direct_solver())
        least, most = min(least, block.volume_ratio.value.min()), max(most, block.volume_ratio.value.max())
    assert most - least > 0.01  # it has moved
    np.testing.assert_allclose(c.value, 3.0, rtol=1e-13)


@pytest.mark.parametrize("name", BLOCKS)
@pytest.mark.parametrize("steps", [EQUAL_STEPS, CHOSEN_STEPS], ids=["equal", "chosen"])
def test_solute_is_conserved(name: str, steps: dict[str, Any]) -> None:
    """Diffusing, dragged with a hindrance of its own and consumed: to 1e-10 of what is in the block, every step."""
    block = moving(name, **steps)
    c = CellVariable(mesh=block.mesh, value=1.0, hasOld=True)
    start, entered, consumed = float((block.water * c.value).sum()), 0.0, 0.0
    rate = 0.1 / sum(block.durations)
    for step in block:
        c.updateOld()
        flux = block.solute_flux(c, diffusivity=3e-4, drag=0.7, outside=1.0)
        sink = ImplicitSourceTerm(coeff=rate * block.fluid_fraction, var=c)
        (TransientTerm(coeff=block.fluid_fraction, var=c) + flux + sink).solve(dt=step.dt, solver=direct_solver())
        amount = float((block.water * c.value).sum())
        entered -= step.dt * flux.fluxes(c.value)[block.block.diamonds.boundary].sum()
        consumed += step.dt * rate * amount
        assert abs(amount - start - entered + consumed) < 1e-10 * start
    assert consumed > 0.05 * start
    assert abs(entered) > 1e-3 * start


def test_decay_is_that_of_backward_euler_exactly() -> None:
    """In a block that nothing is done to."""
    block = moving("unconfined_disc", **EQUAL_STEPS, **{"phase.0.top": None})
    c = CellVariable(mesh=block.mesh, value=np.linspace(1.0, 2.0, 20), hasOld=True)
    expected = np.array(c.value)
    for step in block:
        c.updateOld()
        sink = ImplicitSourceTerm(coeff=1e-3 * block.fluid_fraction, var=c)
        (TransientTerm(coeff=block.fluid_fraction, var=c) + sink).solve(dt=step.dt, solver=direct_solver())
        expected /= 1.0 + 1e-3 * step.dt
    np.testing.assert_allclose(c.value, expected, rtol=1e-8)  # the block keeps still to that


@pytest.mark.parametrize("steps", [EQUAL_STEPS, CHOSEN_STEPS], ids=["equal", "chosen"])
def test_flow_is_that_of_the_run(steps: dict[str, Any]) -> None:
    """What leaves through the permeable edge is what the run records, and the mesh is where its vertices are."""
    block = moving("plane_strain", **steps)
    faces = block.block.crossed_faces[0]
    left, records = 0.0, [block.state.crossed[0, 0]]
    for step in block:
        left += step.dt * block.water_flow[faces].sum()
        records.append(block.state.crossed[0, 0])
    scale = np.abs(np.diff(records)).max()
    assert left == pytest.approx(-records[-1], abs=1e-6 * scale)
    positions = block.block.positions(block.state.unknowns)
    np.testing.assert_array_equal(block.mesh.vertexCoords, positions)
    np.testing.assert_allclose(block.volume_ratio.value, block.fields()["volume_ratio"], rtol=1e-12)
