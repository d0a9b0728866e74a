"""Columns with laws that the paper's tissue does not have: the activity law, fibres, pores that close."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from tissues import BATH, reference_tissue

from fvswell.column.column import Column, compiled_march
from fvswell.column.grid import column_grid
from fvswell.numerics.loads import Load, make_protocol
from fvswell.numerics.state import COMPLETE, STATUS, Control, record_room, workspace
from fvswell.numerics.tableaux import ESDIRK43
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.fibre_directions import IsotropicDirections, one_direction
from fvswell.physics.fibre_laws import LogarithmicFibres, PowerFibres
from fvswell.physics.fibres import FibreFamily, with_fibres
from fvswell.physics.models import MODELS
from fvswell.physics.tissue import Array, Tissue

ACTIVITY = reference_tissue(osmotic="activity")
LONG = 2e4  # s, after which nothing is left to happen


class Outcome(NamedTuple):
    """Global strain at the output times, and the largest errors of the balances."""

    strain: Array
    errors: Array


def run(
    tissue: Tissue, model: str, times: list[float], pressure: float = 0.25, bath: float = BATH, then: float = BATH,
    cells: int = 40, tolerance: float = 1e-6,
) -> Outcome:  # fmt: skip
    """A column in a bath, under a pressure and in another bath from 0 s, without and back from the middle on."""
    kind = MODELS[model]
    seen = kind.tissue(tissue)
    grid = column_grid(0.5, cells, 20.0)
    column = Column(grid, kind, seen, seen, bath)
    J = column.initial_volume_ratio()
    state, rest = column.start(J), [Load(0.0)]
    ends = [[Load(p), None, Load(b), *rest, Load(b), *rest, *rest] for p, b in ((pressure, then), (0.0, bath))]
    protocol = make_protocol(ends, [0.5 * times[-1]] * 2, np.array(times))
    control = Control(*ESDIRK43, tolerance, 0.3, np.inf, 1e-5, 0, 0)
    record = record_room(state, len(times) + 2, 20000)
    compiled_march(
        column.body(J), grid.widths, column.scale[: len(state.contents)], protocol, control, state, record,
        workspace(state, len(ESDIRK43.nodes)),
    )  # fmt: skip
    assert state.counts[STATUS] == COMPLETE
    outputs = record.filled[0]
    strain = record.contents[:outputs, 0] @ grid.widths / (J @ grid.widths) - 1.0
    return Outcome(strain, record.errors[:outputs].max(axis=0))


@pytest.mark.parametrize("loads", [{"pressure": 0.25}, {"pressure": 0.0, "then": 1e-3}, {"bath": 5e-4}], ids=str)
def test_swelling_models_have_equal_equilibria_with_the_activity_law(loads: dict[str, float]) -> None:
    found = [
        run(ACTIVITY, model, [LONG - 1e-3, 2 * LONG], **loads) for model in ("electrochemical", "biphasic-swelling")
    ]
    np.testing.assert_allclose(found[0].strain, found[1].strain, atol=1e-8)
    before, after = loads.get("bath", BATH), loads.get("then", loads.get("bath", BATH))
    J, pressed = (
        equilibrium_volume_ratio(ACTIVITY, load, bath)
        for load, bath in ((0.0, before), (loads.get("pressure", 0.25), after))
    )
    if "bath" not in loads:
        np.testing.assert_allclose(found[0].strain, [pressed / J - 1.0, 0.0], atol=1e-8)


@pytest.mark.parametrize("model", ["electrochemical", "biphasic-swelling"])
def test_balances_close_with_the_activity_law(model: str) -> None:
    assert np.all(run(ACTIVITY, model, [100.0, 400.0], then=1e-4).errors < 1e-12)


def test_second_order_in_space_with_the_activity_law() -> None:
    times = [50.0, 200.0, 250.0, 400.0]
    strain = [run(ACTIVITY, "electrochemical", times, cells=cells, tolerance=1e-8).strain for cells in (20, 40, 80)]
    first, second = (np.abs(a - b).max() for a, b in pairwise(strain))
    assert np.log2(first / second) == pytest.approx(2.0, abs=0.15)


def test_tolerance_is_kept_with_the_activity_law() -> None:
    times = [50.0, 200.0, 250.0, 400.0]
    exact = run(ACTIVITY, "electrochemical", times, tolerance=1e-9).strain
    for tolerance in (1e-3, 1e-5):
        error = np.abs(run(ACTIVITY, "electrochemical", times, tolerance=tolerance).strain - exact).max()
        assert error < tolerance * np.abs(exact).max()


@pytest.mark.parametrize("model", ["electrochemical", "biphasic-swelling"])
def test_fibres_limit_free_swelling(model: str) -> None:
    """Fibres along the axis and in all directions; out of tension under the load, the column is as soft as without."""
    families = [FibreFamily(one_direction(90.0), LogarithmicFibres(0.1, 10.0))]
    families += [FibreFamily(IsotropicDirections(), PowerFibres(1.0, 1.0, 2.0))]
    times = [LONG - 1e-3, 2 * LONG]
    plain = run(ACTIVITY, model, times, pressure=0.0, then=5e-5)
    for family in families:
        tissue = ACTIVITY._replace(solid=with_fibres(ACTIVITY.solid, [family]))
        held = run(tissue, model, times, pressure=0.0, then=5e-5)
        assert 0.0 < held.strain[0] < plain.strain[0]
        assert np.all(held.errors < 1e-12)
        J = [equilibrium_volume_ratio(tissue, 0.0, bath) for bath in (BATH, 5e-5)]
        np.testing.assert_allclose(held.strain, [J[1] / J[0] - 1.0, 0.0], atol=1e-8)
        pressed = [equilibrium_volume_ratio(part, 0.5, BATH) for part in (tissue, ACTIVITY)]
        assert pressed[0] == pressed[1] < 1.0


def test_column_cannot_be_pressed_past_its_water() -> None:
    """Where Poisson's ratio follows the solid fraction, and the permeability goes to nothing with the water."""
    tissue = reference_tissue("solid-fraction", "kozeny-carman", osmotic="activity")
    found = run(tissue, "electrochemical", [2e5, 4e5], pressure=20.0)
    J = [equilibrium_volume_ratio(tissue, pressure, BATH) for pressure in (0.0, 20.0)]
    assert 0.2 < J[1] < 0.3
    np.testing.assert_allclose(found.strain[0], J[1] / J[0] - 1.0, atol=1e-5)
    assert np.all(found.errors < 1e-11)
