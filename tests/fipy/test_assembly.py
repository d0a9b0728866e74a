"""Runs that FiPy assembles and solves, against compiled ones: every shipped case, in every model, at small size."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fvswell
from fvswell.case.case import Case
from fvswell.physics.models import MODELS

CASES = Path(__file__).parents[2] / "cases"
COLUMNS = ["confined_compression", "free_swelling", "paper/compression", "paper/swelling"]
SMALL = {"geometry.cells": 5, "geometry.grading": 4, "phase.0.duration": 100.0, "phase.1.duration": 100.0}
EQUAL_STEPS = {"time.scheme": "backward-euler", "time.steps_per_phase": 2}
CHOSEN_STEPS = {"time.scheme": "esdirk43", "time.tolerance": 1e-2, "output.per_phase": 4}


def small(name: str, model: str, **changes: Any) -> Case:
    case = fvswell.load_case(CASES / f"{name}.toml")
    return case.with_changes(SMALL | {"model": model} | changes)


def assert_same(case: Case, assembly: str) -> None:
    """All results are equal to 1e-8 of the largest of their kind, and so are the steps."""
    ours, other = fvswell.run(case), fvswell.run(case.with_changes({"assembly": assembly}))
    np.testing.assert_array_equal(other["step_iterations"], ours["step_iterations"])
    for name in ours.data_vars:
        if not name.endswith("_error") and name != "step_update":
            scale = float(np.abs(ours[name]).max())
            if name == "current_density":  # nothing but rounding: open circuit
                scale = float(np.abs(ours["anion_flux"]).max()) * 96.5
            np.testing.assert_allclose(other[name], ours[name], rtol=0, atol=1e-8 * scale + 1e-12, err_msg=name)
    assert float(other["volume_balance_error"].max()) < 1e-9  # of what crossed; rounding where nothing does


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("name", COLUMNS)
@pytest.mark.parametrize("steps", [EQUAL_STEPS, CHOSEN_STEPS], ids=["equal-steps", "chosen-steps"])
def test_columns_by_our_term_and_fipys_solver(name: str, model: str, steps: dict[str, Any]) -> None:
    assert_same(small(name, model, **steps), "fipy")


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("name", COLUMNS)
def test_columns_by_fipys_stock_terms(name: str, model: str) -> None:
    assert_same(small(name, model, **EQUAL_STEPS), "stock-terms")


@pytest.mark.parametrize("assembly", ["fipy", "stock-terms"])
@pytest.mark.parametrize("model", MODELS)
def test_held_piston(model: str, assembly: str) -> None:
    """A ramp of the piston, whose pressure is found, in another bath."""
    ramp = {"phase.0.piston.displacement": {"ramp_to": -0.03, "over": 50.0}, "phase.0.bath_concentration": 1e-4}
    assert_same(small("confined_compression", model, **ramp, **EQUAL_STEPS), assembly)


def test_steps_chosen_by_the_error_in_stock_terms() -> None:
    changes = CHOSEN_STEPS | {"geometry.cells": 3, "time.tolerance": 0.1, "output.per_phase": 2}
    assert_same(small("free_swelling", "biphasic-swelling", **changes), "stock-terms")


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("name", ["plane_strain", "unconfined_disc"])
@pytest.mark.parametrize("steps", [EQUAL_STEPS, CHOSEN_STEPS], ids=["equal-steps", "chosen-steps"])
def test_blocks_by_our_term_and_fipys_solver(name: str, model: str, steps: dict[str, Any]) -> None:
    case = fvswell.load_case(CASES / f"{name}.toml")
    assert_same(case.with_changes({"geometry.cells": [4, 3], "model": model} | steps), "fipy")
