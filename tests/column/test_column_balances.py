"""Fluxes of a column and their exact derivatives, in plain Python; compiled code is made from the same function."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pytest
from tissues import BATH, random_tissue

from fvswell.column.balances import COLUMN_LOADS, DIMENSIONS, full_balances, reduced_balances
from fvswell.column.grid import column_grid
from fvswell.compiled import law_kernel
from fvswell.fipy.terms import call_balances
from fvswell.physics.constants import FARADAY
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import MODELS
from fvswell.physics.permeability import PERMEABILITIES
from fvswell.physics.solids import SOLIDS
from fvswell.physics.tissue import Array, fixed_charge_density, tissue_parameters

CELLS = 4
STEP = 1e-40
FULL, REDUCED = "electrochemical", "biphasic-swelling"
LAWS = [("neo-hookean", law) for law in PERMEABILITIES] + [(law, "exponential") for law in list(SOLIDS)[1:]]
# open or not, and the signs of the ions that electrodes in closed ends exchange
ENDS = {
    "filter": ((1.0, 0.0), (0.0, 0.0)), "both": ((1.0, 1.0), (0.0, 0.0)), "piston side": ((0.0, 1.0), (0.0, 0.0)),
    "cation electrode": ((1.0, 0.0), (0.0, 1.0)), "anion electrode": ((1.0, 0.0), (0.0, -1.0)),
    "electrodes": ((0.0, 0.0), (-1.0, 1.0)),
}  # fmt: skip
CONDUCTING = ("both", "cation electrode", "anion electrode", "electrodes")
PASSED = ("filter", "both", "piston side")


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
    model: str, solid: str = "neo-hookean", permeability: str = "exponential", ends: str = "filter",
    of_state: bool = False, compiled: bool = False, found: bool = False,
) -> Setting:  # fmt: skip
    draw = np.random.default_rng(3)
    cells = MODELS[model].tissue(random_tissue(CELLS, 1, solid, permeability=permeability))
    faces = MODELS[model].tissue(random_tissue(CELLS + 1, 2, solid, permeability=permeability))
    J = draw.uniform(0.7, 1.3, CELLS)
    anion = BATH * draw.uniform(0.5, 2.0, CELLS)
    contents = np.stack([J, (J - 1.0 + cells.fluid_fraction) * anion])[: 2 if model == FULL else 1]
    laws = (type(cells.solid), type(cells.permeability), type(cells.osmotic))
    make: Any = full_balances if model == FULL else reduced_balances
    parts = (*laws, found if model == FULL else of_state)
    ratio = draw.uniform(0.7, 1.0, CELLS + 1)
    values = {
        "pressure": 0.1, "filter_bath_concentration": 1.2e-4, "filter_bath_pressure": 0.02,
        "piston_bath_concentration": 2e-4, "piston_bath_pressure": -0.01, "filter_current": 1e-6,
    }  # fmt: skip
    return Setting(
        law_kernel(make, DIMENSIONS, *parts) if compiled else make(*parts), tissue_parameters(cells, CELLS),
        np.vstack([tissue_parameters(faces, CELLS + 1), ratio]), column_grid(0.5, CELLS, 3.0).metric, contents,
        np.array([values.get(name, np.nan) for name in COLUMN_LOADS]), np.array(ENDS[ends]),
    )  # fmt: skip


def evaluated(own: Setting, contents: Array | None = None, rows: int = 0, **changed: complex) -> tuple[Array, ...]:
    """Fluxes, by_lower, by_upper, by_pressure, by_current and potentials; complex where contents or loads are."""
    contents = own.contents if contents is None else contents
    loads = own.loads.astype(complex) if changed else own.loads
    for name, value in changed.items():
        loads[COLUMN_LOADS.index(name)] = value
    kind = np.result_type(contents, loads)
    count = len(contents)
    rows = rows or count
    outputs = (
        np.zeros((4, CELLS + 1), kind), np.zeros((rows, count, CELLS + 1), kind),
        np.zeros((rows, count, CELLS + 1), kind), np.zeros((rows, 2), kind), np.zeros((rows, CELLS + 1), kind),
        np.zeros((6, CELLS), kind),
    )  # fmt: skip
    own.evaluate(own.cells, own.faces, own.metric, contents, loads, own.ends, *outputs)
    return outputs


CASES = [
    *((FULL, *laws, "both", False) for laws in LAWS), *((REDUCED, *laws, "both", False) for laws in LAWS),
    *((FULL, *LAWS[0], ends, False) for ends in ENDS), *((REDUCED, *LAWS[0], ends, True) for ends in PASSED),
    ("biphasic", *LAWS[0], "both", False),
]  # fmt: skip


def assert_close(found: Array, expected: Array) -> None:
    """Each row against its largest entry."""
    scale = np.abs(expected).max(axis=1, keepdims=True)
    assert np.all(np.abs(found - expected) <= 1e-12 * np.abs(expected) + 1e-13 * scale)


@pytest.mark.parametrize(("model", "solid", "permeability", "ends", "of_state"), CASES)
def test_derivatives_equal_complex_step(model: str, solid: str, permeability: str, ends: str, of_state: bool) -> None:
    """By the contents of the cells below and above every face, and by the pressure; by no others."""
    own = setting(model, solid, permeability, ends, of_state)
    check_derivatives(own, len(own.contents))


@pytest.mark.parametrize("ends", CONDUCTING)
def test_derivatives_of_the_potential_and_by_the_current(ends: str) -> None:
    """Of a column that finds its current: those of the fluxes, and of the rise of the potential across every face."""
    own = setting(FULL, ends=ends, found=True)
    check_derivatives(own, 3)
    *_, by_current, _ = evaluated(own, rows=3)
    fluxes, *_ = evaluated(own, own.contents.astype(complex), 3, filter_current=own.loads[6] + 1j * STEP)
    assert_close(by_current, fluxes[[0, 1, 3]].imag / STEP)
    plain, *_ = evaluated(setting(FULL, ends=ends))
    np.testing.assert_array_equal(plain[:3], evaluated(own, rows=3)[0][:3])


def check_derivatives(own: Setting, rows: int) -> None:
    count = len(own.contents)
    of_row = [0, 1, 3][:rows]
    _, by_lower, by_upper, by_pressure, _, potentials = evaluated(own, rows=rows)
    for unknown in range(count):
        for cell in range(CELLS):
            shifted = own.contents.astype(complex)
            shifted[unknown, cell] += 1j * STEP
            fluxes, *_, moved = evaluated(own, shifted, rows)
            expected = fluxes.imag[of_row] / STEP
            found = np.zeros_like(expected)
            found[:, cell] = by_upper[:, unknown, cell]
            found[:, cell + 1] = by_lower[:, unknown, cell + 1]
            assert_close(found, expected)
            for first in (0, 3)[:count]:
                slope = potentials[first + 1 + unknown, cell]
                assert slope == pytest.approx(moved[first, cell].imag / STEP, rel=1e-13, abs=1e-300)
    fluxes, *_ = evaluated(own, own.contents.astype(complex), rows, pressure=own.loads[0] + 1j * STEP)
    assert_close(by_pressure, fluxes.imag[of_row][:, [0, -1]] / STEP)
    assert not by_lower[:, :, 0].any()
    assert not by_upper[:, :, -1].any()


@pytest.mark.parametrize("ends", PASSED)
@pytest.mark.parametrize("model", [FULL, REDUCED])
def test_closed_ends_let_nothing_pass(model: str, ends: str) -> None:
    own = setting(model, ends=ends)
    fluxes, _, _, by_pressure, *_ = evaluated(own)
    for end, face in enumerate((0, -1)):
        passes = ENDS[ends][0][end] == 1.0
        assert np.all((fluxes[: len(own.contents), face] != 0.0) == passes)
        assert np.all((by_pressure[:, end] != 0.0) == passes)


@pytest.mark.parametrize("ends", ENDS)
def test_the_given_current_flows_through_every_face(ends: str) -> None:
    own = setting(FULL, ends=ends)
    fluxes, *_ = evaluated(own)
    current = own.loads[COLUMN_LOADS.index("filter_current")] / FARADAY
    np.testing.assert_allclose(fluxes[2], current, rtol=1e-9, atol=1e-12 * np.abs(fluxes[1]).max())


@pytest.mark.parametrize(("ends", "anions"), [("cation electrode", 0.0), ("anion electrode", -1.0)])
def test_electrode_passes_its_ions_and_no_water(ends: str, anions: float) -> None:
    own = setting(FULL, ends=ends)
    fluxes, *_ = evaluated(own)
    current = own.loads[COLUMN_LOADS.index("filter_current")] / FARADAY
    np.testing.assert_allclose(fluxes[:3, -1], [0.0, anions * current, current], rtol=1e-14)


def test_current_given_at_the_piston_is_the_opposite() -> None:
    """Into the tissue at either end."""
    own = setting(FULL, ends="both")
    one, *_ = evaluated(own)
    own.loads[COLUMN_LOADS.index("piston_current")] = -own.loads[COLUMN_LOADS.index("filter_current")]
    own.loads[COLUMN_LOADS.index("filter_current")] = np.nan
    np.testing.assert_array_equal(evaluated(own)[0], one)


@pytest.mark.parametrize("model", MODELS)
def test_pressure_of_the_bath_at_an_open_piston_presses_on_the_tissue(model: str) -> None:
    """The same pressure in both baths moves nothing but the pressure of the fluid; at a closed piston it is nothing."""
    for ends, rise in (("both", 0.3), ("filter", 0.0)):
        one, other = setting(model, ends=ends), setting(model, ends=ends)
        names = ("filter_bath_pressure", "piston_bath_pressure") if rise else ("piston_bath_pressure",)
        other.loads[[COLUMN_LOADS.index(name) for name in names]] += 0.3
        before, after = evaluated(one), evaluated(other)
        np.testing.assert_allclose(after[0], before[0], rtol=1e-9, atol=1e-12 * np.abs(before[0]).max())
        np.testing.assert_allclose(after[-1][0] - before[-1][0], rise, rtol=0, atol=1e-14)


@pytest.mark.parametrize("model", MODELS)
def test_nothing_flows_in_equilibrium(model: str) -> None:
    """Contents that are in equilibrium with both baths, which are one; the tissue differs from cell to cell."""
    own = setting(model, ends="both")
    cells = MODELS[model].tissue(random_tissue(CELLS, 1))
    J = np.broadcast_to(equilibrium_volume_ratio(cells, 0.1, BATH), CELLS)
    contents = J[None].copy()
    if model == FULL:
        charge = fixed_charge_density(cells, J)
        square = cells.osmotic.activity_ratio * BATH**2
        anion = square / (0.5 * (charge + np.sqrt(charge**2 + 4 * square)))
        contents = np.stack([J, (J - 1.0 + cells.fluid_fraction) * anion])
    own.loads[:] = 0.0
    for name, value in {
        "pressure": 0.1, "filter_bath_concentration": BATH, "piston_bath_concentration": BATH,
    }.items():  # fmt: skip
        own.loads[COLUMN_LOADS.index(name)] = value
    fluxes, by_lower, by_upper, *_ = evaluated(own, contents)
    for balance in range(len(contents)):  # rounding of the potentials times what they drive
        scale = np.abs(by_lower[balance]).max(axis=0) + np.abs(by_upper[balance]).max(axis=0)
        assert np.all(np.abs(fluxes[balance]) <= 1e-13 * scale)


@pytest.mark.parametrize(
    ("model", "of_state", "ends", "found"),
    [(FULL, False, "filter", False), (FULL, False, "anion electrode", True), (REDUCED, False, "filter", False),
     (REDUCED, True, "filter", False)],
)  # fmt: skip
def test_compiled_is_the_same(model: str, of_state: bool, ends: str, found: bool) -> None:
    """One source; equal but for the order of roundings."""
    own, compiled = (setting(model, ends=ends, of_state=of_state, compiled=kind, found=found) for kind in (False, True))
    called = compiled._replace(evaluate=partial(call_balances, compiled.evaluate))
    rows = 3 if found else 0
    for value, expected in zip(evaluated(called, rows=rows), evaluated(own, rows=rows), strict=True):
        np.testing.assert_allclose(value, expected, rtol=1e-12, atol=1e-13 * np.abs(expected).max())
