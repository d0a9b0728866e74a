"""Electrical conditions at both ends of a column: what they say of the current, and what the integrator makes of it."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from integrations import (
    Integration,
    equal_steps,
    first_step,
    integrate,
    loads,
    make_column,
    make_control,
    parts_with,
)
from tissues import BATH, reference_tissue

from fvswell.column.balances import COLUMN_LOADS
from fvswell.column.column import FILTER_AND_PISTON
from fvswell.column.electrical import (
    Parts,
    current_is_found,
    electrical_loads,
    electrode_sign,
    potentials_of_parts,
)
from fvswell.column.fields import column_fields
from fvswell.fipy.body import fipy_body
from fvswell.fipy.terms import call_balances
from fvswell.numerics.integrator import march
from fvswell.numerics.loads import AMPLITUDE, FREQUENCY, Load, make_protocol
from fvswell.numerics.state import CONVERGED, LOSS, NOT_CONVERGED, REASON, STATUS, record_room, workspace
from fvswell.numerics.tableaux import ESDIRK43
from fvswell.physics.constants import FARADAY
from fvswell.physics.models import MODELS
from fvswell.physics.tissue import Array

CURRENT = 1e-6  # A/mm2
FOUND = {"filter_current": None, "piston_current": None, "filter_potential": 0.0}
BOTH_OPEN, WALL = (True, True), (True, False)


def baths(piston: Any = "potential", filter_: Any = "grounded") -> Parts:
    return parts_with(BOTH_OPEN, (filter_, piston))


def electrode(kind: str, condition: str = "current") -> Parts:
    return parts_with(WALL, ("grounded", condition), ("bath", kind))


def run(
    parts: Parts, phases: list[list[Load | None]], durations: list[float], times: list[float],
    model: str = "electrochemical", tolerance: float = 1e-5, cells: int = 20, grading: float = 20.0, **changes: Any,
) -> tuple[Integration, dict[str, Array]]:  # fmt: skip
    """A run of the reference tissue, and its fields."""
    column = make_column(model, reference_tissue(**changes), cells, grading, parts=parts)
    control = make_control(tolerance=tolerance, expected_strain=1e-2, first_step=first_step(column))
    done = integrate(column, make_protocol(phases, durations, times), control)
    return done, column_fields(column, done.volume_ratio, done.record)


# ---- what the conditions say ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("parts", "given", "expected"),
    [
        (FILTER_AND_PISTON, {}, {"filter_current": 0.0, "filter_potential": 0.0}),
        (baths("floating"), {}, {"filter_current": 0.0, "filter_potential": 0.0}),
        (baths("floating", "potential"), {"filter.potential": Load(2.0)},
         {"filter_current": 0.0, "filter_potential": 2.0}),
        (baths("insulating", "current"), {"filter.current": Load(2e-6)}, {"filter_current": 0.0}),
        (baths("grounded"), {}, {"filter_potential": 0.0, "piston_potential": 0.0}),
        (baths(), {"piston.potential": Load(3.0)}, {"filter_potential": 0.0, "piston_potential": 3.0}),
        (baths("grounded", "potential"), {"filter.potential": Load(3.0)},
         {"filter_potential": 3.0, "piston_potential": 0.0}),
        (electrode("cation"), {"piston.current": Load(2e-6), "bath": Load(1.0)},
         {"piston_current": 2e-6, "filter_potential": 0.0}),
        (baths("grounded", "current"), {"filter.current": Load(2e-6)},
         {"filter_current": 2e-6, "piston_potential": 0.0}),
        (electrode("anion", "potential"), {"piston.potential": Load(1.0)},
         {"filter_potential": 0.0, "piston_potential": 1.0}),
    ],
)  # fmt: skip
def test_loads_by_the_conditions_of_both_parts(
    parts: Parts, given: dict[str, Load], expected: dict[str, float]
) -> None:
    """One of current and potential difference is given, the rest is found."""
    found = electrical_loads(parts, given)
    assert set(found) < set(COLUMN_LOADS)
    assert {name: load.target for name, load in found.items() if load is not None} == expected
    assert current_is_found(parts) == (not any("current" in name for name in expected))


def test_signs_of_electrodes() -> None:
    """Of closed parts that conduct; the ions of an open part are those of its bath."""
    assert [electrode_sign(electrode(kind)[1]) for kind in ("cation", "anion")] == [1.0, -1.0]
    assert electrode_sign(parts_with(BOTH_OPEN, electrode=("bath", "cation"))[1]) == 0.0
    assert electrode_sign(parts_with(WALL, electrode=("bath", "cation"))[1]) == 0.0  # an insulator


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        (FILTER_AND_PISTON, (0.0, 5.0)),
        (baths("grounded", "current"), (-5.0, 0.0)),
        (baths("floating", "floating"), (0.0, 5.0)),
        (parts_with((False, True), ("insulating", "floating")), (-5.0, 0.0)),
        (baths("current", "potential"), (2.0, 7.0)),
        (baths("potential", "current"), (-2.0, 3.0)),
    ],
)
def test_potentials_are_relative_to_the_reference(parts: Parts, expected: tuple[float, float]) -> None:
    """A potential that is given, else the bath of the first open part; the piston is 5 mV above the filter."""
    found = potentials_of_parts(parts, np.array([5.0]), (np.array([2.0]), np.array([3.0])))
    assert (found[0].item(), found[1].item()) == expected


# ---- potential given, current found -----------------------------------------------------------------------

HELD = {"height": Load(0.5, 50.0)}
GIVEN: dict[str, tuple[Parts, dict[str, Any]]] = {
    "short circuit under a load": (baths("grounded"), {"pressure": 0.1, "piston_potential": 0.0}),
    "ramp": (baths(), {"pressure": 0.0, "piston_potential": Load(5.0, 30.0)}),
    "held": (baths(), HELD | {"piston_potential": 5.0}),
    "two baths": (baths(), {"piston_bath_concentration": 1e-4, "filter_bath_pressure": 0.02, "piston_potential": 3.0}),
    "cation electrode": (electrode("cation", "potential"), {"piston_potential": -2.0}),
    "anion electrode, held": (electrode("anion", "potential"), HELD | {"piston_potential": Load(2.0, 30.0)}),
    "electrode at the filter": (
        parts_with((False, True), ("potential", "grounded"), ("cation", "bath")),
        {"filter_potential": 2.0, "piston_potential": 0.0, "pressure": 0.05},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", GIVEN)
def test_the_current_that_is_found_gives_the_potential(name: str) -> None:
    """At outputs within steps and at their ends, and whatever it carries is conserved."""
    parts, given = GIVEN[name]
    times = [1e-3, 1.0, 10.0, 30.0, 47.0, 200.0]
    done, fields = run(parts, [loads(**(FOUND | given))], [200.0], times, tolerance=1e-4)
    assert done.complete
    driven = "filter" if name == "electrode at the filter" else "piston"
    load = given[f"{driven}_potential"]
    load = load if isinstance(load, Load) else Load(load)
    expected = load.target * np.minimum(np.array(times) / load.over, 1.0) if load.over else load.target
    np.testing.assert_allclose(fields[f"{driven}_potential"], expected, rtol=1e-10, atol=1e-12)
    other = "piston" if driven == "filter" else "filter"
    np.testing.assert_allclose(fields[f"{other}_potential"], 0.0, rtol=0, atol=1e-9)
    assert np.abs(fields["piston_current"]).max() > 1e-9
    np.testing.assert_array_equal(fields["piston_current"], -fields["filter_current"])
    assert done.state.clock[LOSS] < 1e-12
    assert done.filled("errors").max() < 1e-10
    if "height" in given:
        assert fields["height"][-1] == pytest.approx(0.5, rel=1e-13)


def test_order_in_time_where_current_and_pressure_are_found() -> None:
    """A potential that swings, with a piston that is held: fourth order, of the contents and of the charge."""
    column = make_column(cells=3, grading=1.0, parts=baths())
    height = float(column.initial_volume_ratio() @ column.grid.widths)
    contents = []
    for steps in (80, 160, 320):
        protocol = make_protocol([loads(height=height, piston_potential=0.0, **FOUND)], [300.0])
        row = protocol.table[0, COLUMN_LOADS.index("piston_potential")]
        row[AMPLITUDE], row[FREQUENCY] = 5.0, 2.0 * np.pi / 250.0
        size = 300.0 / steps
        done = integrate(
            column, protocol,
            make_control(ESDIRK43, 1e-9, error_weights=0.0 * ESDIRK43.error_weights, max_step=size,
                         first_step=size * (1.0 - 1e-9)),
        )  # fmt: skip
        assert done.complete
        scale = np.array([1.0, BATH])[:, None]
        contents.append(np.append((done.state.contents / scale).ravel(), done.state.crossed[:, 2] / 1e-4))
    change = [np.abs(b - a).max() for a, b in pairwise(contents)]
    assert np.log2(change[0] / change[1]) == pytest.approx(4.0, abs=0.2)


@pytest.mark.parametrize("given", [{"pressure": 0.0}, {"height": "start"}])
def test_equal_baths_that_are_grounded_exchange_nothing(given: dict[str, Any]) -> None:
    column = make_column(parts=baths("grounded"))
    if "height" in given:
        given = {"height": float(column.initial_volume_ratio() @ column.grid.widths)}
    done, fields = run(baths("grounded"), [loads(piston_potential=0.0, **given, **FOUND)], [1e3], [1.0, 1e3])
    assert np.abs(fields["filter_current"]).max() < 1e-15
    assert np.abs(done.strain).max() < 1e-13


def test_given_current_and_given_potential_are_one_thing() -> None:
    """The potential that a current leads to, given instead, leads to that current; at large currents too."""
    given, fields = run(electrode("cation"), [loads(filter_current=None, piston_current=-CURRENT)], [2e4], [1.0, 2e4])
    assert fields["piston_current"] == pytest.approx([-CURRENT, -CURRENT], rel=1e-15)
    potential = fields["piston_potential"][-1]
    found, other = run(
        electrode("cation", "potential"), [loads(piston_potential=potential, **FOUND)], [2e4], [1.0, 2e4]
    )
    assert other["filter_current"][-1] == pytest.approx(CURRENT, rel=1e-7)
    assert abs(other["filter_current"][0] / CURRENT - 1.0) > 0.1  # it took its time
    np.testing.assert_allclose(found.filled("contents")[-1], given.filled("contents")[-1], rtol=1e-7)


def test_current_that_is_not_given_and_cannot_be_found_is_a_failure() -> None:
    """Not a silent something: the column was not made for it."""
    done, _ = run(FILTER_AND_PISTON, [loads(filter_current=None)], [10.0], [10.0])
    assert not done.complete
    assert done.work.report[REASON] in (NOT_CONVERGED, CONVERGED)


# ---- no current -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "parts", [baths("floating"), baths("floating", "floating"), baths("insulating"), FILTER_AND_PISTON]
)
def test_what_floats_or_insulates_carries_no_net_current(parts: Parts) -> None:
    """Though salt and water cross: cations as anions, to rounding."""
    given: dict[str, Any] = {"pressure": 0.1, "filter_bath_concentration": 1e-4, "filter_bath_pressure": 0.02}
    done, fields = run(parts, [loads(**given)], [300.0], [3.0, 300.0])
    assert not fields["filter_current"].any()
    assert not fields["piston_current"].any()
    assert np.abs(fields["current_density"]).max() < 1e-12 * FARADAY * np.abs(fields["cation_flux"]).max()
    crossed = done.filled("crossed")
    np.testing.assert_allclose(crossed[:, :, 2], crossed[:, :, 1], rtol=1e-12)
    assert np.abs(crossed[-1, 0, 2]) > 1e-7
    assert np.abs(fields["piston_potential"]).min() > 0.01


# ---- conservation and symmetry ----------------------------------------------------------------------------

EVERY: dict[str, tuple[Parts, dict[str, Any]]] = GIVEN | {
    "current between baths": (baths("current"), {"piston_current": CURRENT, "filter_current": None}),
    "current into a cation electrode": (electrode("cation"), {"filter_current": CURRENT, "pressure": 0.1}),
    "current out of an anion electrode": (electrode("anion"), {"filter_current": -CURRENT} | HELD),
    "permeation": (baths("floating"), {"filter_bath_pressure": 0.1, "piston_bath_concentration": 1e-4}),
}


@pytest.mark.parametrize("name", EVERY)
def test_what_is_inside_is_what_has_crossed(name: str) -> None:
    """Water, anions and cations, at outputs within steps; the currents of both parts are one."""
    parts, given = EVERY[name]
    found = FOUND if "piston_potential" in given else {}
    column = make_column(parts=parts)
    times = np.geomspace(0.02, 300.0, 30)
    done, fields = run(parts, [loads(**(found | given))], [300.0], list(times), tolerance=1e-3)
    start = column.contents(done.volume_ratio, BATH)
    for quantity, amount in enumerate(("water_volume", "anion_amount", "cation_amount")):
        row = min(quantity, 1)
        gained = (done.filled("contents")[:, row] - start[row]) @ column.grid.widths
        entered = sum(fields.get(f"{part.name}_{amount}", np.zeros(30)) for part in parts)
        held = np.abs(start[row]) @ column.grid.widths
        assert np.abs(gained - entered).max() <= 1e-10 * (done.state.traffic[quantity] + 1e-4 * held)
    assert done.filled("errors").max() < 1e-10


def mirrored(parts: Parts, given: dict[str, Any]) -> tuple[Parts, dict[str, Any]]:
    """The column upside down: each end has what the other had; the pressure on the tissue is the same."""
    turned = {
        name.replace("filter", "-").replace("piston", "filter").replace("-", "piston"): value
        for name, value in given.items()
    }
    before, after = (values.get("piston_bath_pressure", 0.0) for values in (given, turned))
    turned["pressure"] = given.get("pressure", 0.0) + before - after
    other = parts_with(
        (parts[1].open, parts[0].open), (parts[1].electrical, parts[0].electrical),
        (parts[1].electrode, parts[0].electrode),
    )  # fmt: skip
    return other, turned


MIRRORED = [
    (name, model)
    for name, (_, given) in EVERY.items()
    for model in MODELS
    # the ions of biphasic swelling are in equilibrium with the bath of the first open part, which is another one then
    if "height" not in given and not (model == "biphasic-swelling" and "piston_bath_concentration" in given)
]


@pytest.mark.parametrize(("name", "model"), MIRRORED)
def test_either_end_may_be_either(name: str, model: str) -> None:
    """Ends exchanged, everything is mirrored to rounding: equal steps, uniform cells."""
    states = []
    given = EVERY[name][1]
    found = {"filter_current": None, "piston_current": None} if "piston_potential" in given else {}
    given = {"filter_potential": 0.0, "filter_current": 0.0} | given | found if found else given
    for parts, values in ((EVERY[name][0], given), mirrored(EVERY[name][0], given)):
        if "piston_current" in values and "filter_current" not in values:
            values["filter_current"] = None
        column = make_column(model, cells=12, grading=1.0, parts=parts)
        protocol = make_protocol([loads(**values)], [300.0])
        states.append(integrate(column, protocol, equal_steps(10)))
    one, other = states
    assert one.complete
    assert other.complete
    assert np.abs(one.state.crossed).max() > 1e-9 or model != "electrochemical"
    np.testing.assert_allclose(one.state.contents, other.state.contents[:, ::-1], rtol=1e-10)
    scale = np.abs(one.state.crossed).max(axis=0) + 1e-12
    assert np.all(np.abs(one.state.crossed - other.state.crossed[::-1]) < 1e-9 * scale)


@pytest.mark.parametrize("model", ["biphasic", "biphasic-swelling"])
@pytest.mark.parametrize("name", ["short circuit under a load", "current into a cation electrode", "two baths"])
def test_models_without_ions_know_of_no_electricity(name: str, model: str) -> None:
    """The same mechanics as with floating parts, and no histories of currents or amounts of ions."""
    parts, given = EVERY[name]
    electrical = {key: value for key, value in given.items() if "current" in key or "potential" in key}
    plain = {key: value for key, value in given.items() if key not in electrical}
    found = FOUND if "piston_potential" in given else {}
    done, fields = run(parts, [loads(**(found | given))], [100.0], [10.0, 100.0], model)
    bare = parts_with((parts[0].open, parts[1].open))
    other, _ = run(bare, [loads(**plain)], [100.0], [10.0, 100.0], model)
    np.testing.assert_array_equal(done.filled("contents"), other.filled("contents"))
    kinds = ("current", "potential", "cation_amount", "anion_amount")
    assert not {f"{part.name}_{kind}" for part in parts for kind in kinds} & fields.keys()


@pytest.mark.parametrize("name", EVERY)
def test_fields_are_what_the_balances_have(name: str) -> None:
    """Fluxes at the nodes, electrodes included, and what the parts of those of the ions add up to."""
    parts, given = EVERY[name]
    done, fields = run(parts, [loads(**((FOUND if "piston_potential" in given else {}) | given))], [50.0], [50.0])
    body, columns = done.body, done.filled("loads")[0].copy()
    call_balances(
        body.evaluate, body.cells, body.faces, body.metric, done.filled("contents")[0].copy(), columns, body.ends,
        body.fluxes, body.by_lower, body.by_upper, body.by_pressure, body.by_current, body.potentials,
    )  # fmt: skip
    np.testing.assert_allclose(fields["water_flux"][0], body.fluxes[0], rtol=1e-9, atol=1e-18)
    np.testing.assert_allclose(fields["anion_flux"][0], body.fluxes[1], rtol=1e-9, atol=1e-20)
    np.testing.assert_allclose(fields["current_density"][0], fields["filter_current"][0], rtol=1e-9, atol=1e-16)
    for ion in ("cation", "anion"):
        total = sum(fields[f"{ion}_flux_{part}"] for part in ("convection", "diffusion", "migration"))
        np.testing.assert_allclose(total, fields[f"{ion}_flux"], rtol=1e-9, atol=1e-20)
    np.testing.assert_allclose(fields["water_potential"][0], body.potentials[0], rtol=1e-12)
    if done.column.current_is_found:
        difference = fields["piston_potential"] - fields["filter_potential"]
        assert body.fluxes[3].sum() == pytest.approx(difference.item(), rel=1e-9, abs=1e-12)


def test_potential_in_the_tissue_is_relative_to_the_reference() -> None:
    """In equilibrium it is the Donnan potential everywhere, whichever end is open, grounded or not."""
    donnan = None
    for parts in (FILTER_AND_PISTON, baths("floating"), parts_with((False, True), ("insulating", "grounded"))):
        _, fields = run(parts, [loads()], [10.0], [10.0])
        donnan = fields["electric_potential"] if donnan is None else donnan
        np.testing.assert_allclose(fields["electric_potential"], donnan, rtol=1e-9)
        assert donnan.max() < -10.0
    parts = parts_with(BOTH_OPEN, ("floating", "potential"))
    _, fields = run(parts, [loads(filter_potential=None, piston_potential=3.0)], [10.0], [10.0])
    np.testing.assert_allclose(fields["electric_potential"], donnan + 3.0, rtol=1e-9)


def test_closed_part_that_conducts_needs_an_electrode() -> None:
    with pytest.raises(ValueError, match="piston: a closed part that conducts needs an electrode"):
        make_column(parts=parts_with(WALL, ("grounded", "current")))


# ---- the same with FiPy -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["held", "anion electrode, held", "two baths"])
def test_fipy_finds_the_same_current(name: str) -> None:
    parts, given = GIVEN[name]
    column = make_column(cells=6, parts=parts)
    J = column.initial_volume_ratio()
    protocol, control = make_protocol([loads(**(FOUND | given))], [100.0]), equal_steps(2, 1e-10)
    compiled, state = integrate(column, protocol, control).state, column.start(J)
    march(
        fipy_body("fipy", column, J), column.grid.widths, column.scale, protocol, control, state,
        record_room(state, 3, 3), workspace(state, 1),
    )  # fmt: skip
    assert state.counts[STATUS] == 1
    np.testing.assert_allclose(state.contents, compiled.contents, rtol=1e-10)
    np.testing.assert_allclose(state.unknowns[-1], compiled.unknowns[-1], rtol=1e-8)


def test_stock_terms_say_that_they_cannot_find_a_current() -> None:
    column = make_column(cells=6, parts=baths())
    with pytest.raises(ValueError, match="stock terms cannot find a current from the potentials of both ends"):
        fipy_body("stock-terms", column, column.initial_volume_ratio())
