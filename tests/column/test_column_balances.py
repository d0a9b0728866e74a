"""Fluxes of a column and their exact derivatives, in plain Python; compiled code is made from the same function."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from tissues import BATH, random_tissue

from fvswell.column.balances import COLUMN_LOADS, DIMENSIONS, full_balances, reduced_balances
from fvswell.column.grid import column_grid
from fvswell.compiled import kernel, law_kernel
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import MODELS
from fvswell.physics.permeability import PERMEABILITIES
from fvswell.physics.solids import SOLIDS
from fvswell.physics.tissue import Array, fixed_charge_density, tissue_parameters

CELLS = 4
STEP = 1e-40
FULL, REDUCED = "electrochemical", "biphasic-swelling"
LAWS = [("neo-hookean", law) for law in PERMEABILITIES] + [(law, "exponential") for law in list(SOLIDS)[1:]]
ENDS = {"filter": (1.0, 0.0), "both": (1.0, 1.0), "piston side": (0.0, 1.0)}


class Setting(NamedTuple):
    """A column in a random state, its evaluation, and what it takes."""

    evaluate: Callable[..., None]
    cells: Array
    faces: Array
    metric: Array
    contents: Array
    loads: Array
    ends: Array


def setting(
    model: str, solid: str = "neo-hookean", permeability: str = "exponential", ends: tuple[float, float] = (1.0, 0.0),
    of_state: bool = False, compiled: bool = False,
) -> Setting:  # fmt: skip
    draw = np.random.default_rng(3)
    cells = MODELS[model].tissue(random_tissue(CELLS, 1, solid, permeability=permeability))
    faces = MODELS[model].tissue(random_tissue(CELLS + 1, 2, solid, permeability=permeability))
    J = draw.uniform(0.7, 1.3, CELLS)
    anion = BATH * draw.uniform(0.5, 2.0, CELLS)
    contents = np.stack([J, (J - 1.0 + cells.fluid_fraction) * anion])[: 2 if model == FULL else 1]
    laws = (type(cells.solid), type(cells.permeability), type(cells.osmotic))
    make: Any = full_balances if model == FULL else reduced_balances
    parts = laws if model == FULL else (*laws, of_state)
    ratio = draw.uniform(0.7, 1.0, CELLS + 1)
    values = {
        "pressure": 0.1, "filter_concentration": 1.2e-4, "filter_pressure": 0.02, "piston_concentration": 2e-4,
        "piston_pressure": -0.01, "current": 1e-8,
    }  # fmt: skip
    return Setting(
        law_kernel(make, DIMENSIONS, *parts) if compiled else make(*parts), tissue_parameters(cells, CELLS),
        np.vstack([tissue_parameters(faces, CELLS + 1), ratio]), column_grid(0.5, CELLS, 3.0).metric, contents,
        np.array([values.get(name, np.nan) for name in COLUMN_LOADS]), np.array(ends),
    )  # fmt: skip


def evaluated(own: Setting, contents: Array | None = None, pressure: complex | None = None) -> tuple[Array, ...]:
    """Fluxes, by_lower, by_upper, by_pressure and potentials; complex where the contents or the pressure are."""
    contents = own.contents if contents is None else contents
    loads = own.loads if pressure is None else own.loads.astype(complex)
    if pressure is not None:
        loads[COLUMN_LOADS.index("pressure")] = pressure
    kind = np.result_type(contents, loads)
    count = len(contents)
    outputs = (
        np.zeros((3, CELLS + 1), kind), np.zeros((count, count, CELLS + 1), kind),
        np.zeros((count, count, CELLS + 1), kind), np.zeros((count, 2), kind), np.zeros((6, CELLS), kind),
    )  # fmt: skip
    arguments = (own.cells, own.faces, own.metric, contents, loads, own.ends, *outputs)
    own.evaluate(*arguments)
    return outputs


CASES = [
    *((FULL, *laws, "both", False) for laws in LAWS), *((REDUCED, *laws, "both", False) for laws in LAWS),
    *((FULL, *LAWS[0], ends, False) for ends in ENDS), *((REDUCED, *LAWS[0], ends, True) for ends in ENDS),
    ("biphasic", *LAWS[0], "both", False),
]  # fmt: skip


@pytest.mark.parametrize(("model", "solid", "permeability", "ends", "of_state"), CASES)
def test_derivatives_equal_complex_step(model: str, solid: str, permeability: str, ends: str, of_state: bool) -> None:
    """By the contents of the cells below and above every face, and by the applied pressure; by no others."""
    own = setting(model, solid, permeability, ENDS[ends], of_state)
    count = len(own.contents)
    _, by_lower, by_upper, by_pressure, potentials = evaluated(own)
    for unknown in range(count):
        for cell in range(CELLS):
            shifted = own.contents.astype(complex)
            shifted[unknown, cell] += 1j * STEP
            fluxes, _, _, _, moved = evaluated(own, shifted)
            expected = fluxes.imag[:count] / STEP
            found = np.zeros_like(expected)
            found[:, cell] = by_upper[:, unknown, cell]
            found[:, cell + 1] = by_lower[:, unknown, cell + 1]
            scale = np.abs(expected).max(axis=1, keepdims=True)
            assert np.all(np.abs(found - expected) <= 1e-12 * np.abs(expected) + 1e-13 * scale)
            for first in (0, 3)[:count]:
                slope = potentials[first + 1 + unknown, cell]
                assert slope == pytest.approx(moved[first, cell].imag / STEP, rel=1e-13, abs=1e-300)
    fluxes, *_ = evaluated(own, own.contents.astype(complex), own.loads[0] + 1j * STEP)
    expected = fluxes.imag[:count][:, [0, -1]] / STEP
    np.testing.assert_allclose(by_pressure, expected, rtol=1e-12, atol=1e-13 * np.abs(expected).max())
    assert not by_lower[:, :, 0].any()
    assert not by_upper[:, :, -1].any()


@pytest.mark.parametrize("ends", ENDS)
@pytest.mark.parametrize("model", [FULL, REDUCED])
def test_closed_ends_let_nothing_pass(model: str, ends: str) -> None:
    own = setting(model, ends=ENDS[ends])
    fluxes, _, _, by_pressure, _ = evaluated(own)
    for end, face in enumerate((0, -1)):
        passes = ENDS[ends][end] == 1.0
        assert np.all((fluxes[: len(own.contents), face] != 0.0) == passes)
        assert np.all((by_pressure[:, end] != 0.0) == passes)


@pytest.mark.parametrize("ends", ENDS)
def test_the_given_current_flows_through_every_face(ends: str) -> None:
    own = setting(FULL, ends=ENDS[ends])
    fluxes, *_ = evaluated(own)
    current = own.loads[COLUMN_LOADS.index("current")]
    np.testing.assert_allclose(fluxes[2], current, rtol=1e-9, atol=1e-12 * np.abs(fluxes[1]).max())


@pytest.mark.parametrize("model", MODELS)
def test_nothing_flows_in_equilibrium(model: str) -> None:
    """Contents that are in equilibrium with both baths, which are one; the tissue differs from cell to cell."""
    own = setting(model, ends=ENDS["both"])
    cells = MODELS[model].tissue(random_tissue(CELLS, 1))
    J = np.broadcast_to(equilibrium_volume_ratio(cells, 0.1, BATH), CELLS)
    contents = J[None].copy()
    if model == FULL:
        charge = fixed_charge_density(cells, J)
        square = cells.osmotic.activity_ratio * BATH**2
        anion = square / (0.5 * (charge + np.sqrt(charge**2 + 4 * square)))
        contents = np.stack([J, (J - 1.0 + cells.fluid_fraction) * anion])
    own.loads[:] = 0.0
    for name, value in {"pressure": 0.1, "filter_concentration": BATH, "piston_concentration": BATH}.items():
        own.loads[COLUMN_LOADS.index(name)] = value
    fluxes, by_lower, by_upper, *_ = evaluated(own, contents)
    for balance in range(len(contents)):  # rounding of the potentials times what they drive
        scale = np.abs(by_lower[balance]).max(axis=0) + np.abs(by_upper[balance]).max(axis=0)
        assert np.all(np.abs(fluxes[balance]) <= 1e-13 * scale)


@pytest.mark.parametrize(("model", "of_state"), [(FULL, False), (REDUCED, False), (REDUCED, True)])
def test_compiled_is_the_same(model: str, of_state: bool) -> None:
    """One source; equal but for the order of roundings."""
    own, compiled = setting(model, of_state=of_state), setting(model, of_state=of_state, compiled=True)

    def call(evaluate: Any, cells: Any, faces: Any, metric: Any, contents: Any, loads: Any, ends: Any, fluxes: Any,
             lower: Any, upper: Any, pressure: Any, potentials: Any) -> None:  # fmt: skip
        evaluate(cells, faces, metric, contents, loads, ends, fluxes, lower, upper, pressure, potentials)

    run = kernel(call)
    found = evaluated(compiled._replace(evaluate=lambda *arguments: run(compiled.evaluate, *arguments)))
    for value, expected in zip(found, evaluated(own), strict=True):
        np.testing.assert_allclose(value, expected, rtol=1e-12, atol=1e-13 * np.abs(expected).max())
