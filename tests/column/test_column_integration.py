"""Columns under the time integrator: orders, what lies within steps, balances, stops, held pistons, failures."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from integrations import (
    HEIGHT,
    Integration,
    compression,
    equal_steps,
    first_step,
    integrate,
    loads,
    make_column,
    make_control,
    parts_with,
    swelling,
)
from tissues import BATH, random_tissue, reference_tissue

from fvswell.column.balances import COLUMN_LOADS
from fvswell.exact.confined_compression import relaxation_pressure
from fvswell.numerics.loads import AMPLITUDE, FREQUENCY, Load, Protocol, make_protocol
from fvswell.numerics.state import COMPLETE, FAILED, LOSS, NO_WATER, POINT, REASON, STATUS, Control
from fvswell.numerics.tableaux import BACKWARD_EULER, ESDIRK43
from fvswell.physics.models import MODELS
from fvswell.physics.solids import aggregate_modulus

SECONDS = 300.0
LAYERED = {"fixed_charge_density": np.linspace(1e-4, 3e-4, 20), "youngs_modulus": np.linspace(0.25, 0.8, 20)}


def forced(steps: int) -> Control:
    """Steps of one length, whatever their error; Newton's method to rounding."""
    size = SECONDS / steps
    return make_control(
        tolerance=1e-9, error_weights=0.0 * ESDIRK43.error_weights, max_step=size, first_step=size * (1.0 - 1e-9)
    )


def swinging() -> Protocol:
    """A pressure about 0.1 MPa that begins as a sine does, and a bath that swings beside it."""
    protocol = make_protocol([loads(0.0)], [SECONDS])
    for load, amplitude in (("pressure", 0.1), ("filter_bath_concentration", 0.4 * BATH)):
        row = protocol.table[0, COLUMN_LOADS.index(load)]
        row[AMPLITUDE], row[FREQUENCY] = amplitude, 2.0 * np.pi / 250.0
    return protocol


# ---- order and accuracy in time ---------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "order"), [("backward Euler", 1.0), ("ESDIRK43", 4.0)])
@pytest.mark.parametrize("model", MODELS)
def test_order_under_smooth_loads(model: str, name: str, order: float) -> None:
    """Global strain and all contents, from successive halvings of the step."""
    column = make_column(model, cells=3, grading=1.0)
    strain, contents = [], []
    counts = (160, 320, 640)
    for steps in counts:
        control = equal_steps(steps, 1e-13)._replace(every=0) if name == "backward Euler" else forced(steps)
        run = integrate(column, swinging(), control)
        assert run.complete
        contents.append(run.state.contents.copy())
        strain.append(run.state.contents[0] @ column.grid.widths)
    for values in (np.array(strain)[:, None], np.array(contents).reshape(len(counts), -1)):
        change = [np.abs(b - a).max() for a, b in pairwise(values)]
        assert np.log2(change[-2] / change[-1]) == pytest.approx(order, abs=0.2)


@pytest.mark.parametrize("protocol", [compression, swelling])
@pytest.mark.parametrize("model", ["biphasic-swelling", "electrochemical"])
def test_outputs_within_steps_are_those_of_finer_steps(model: str, protocol: type) -> None:
    times = np.concatenate([start + np.geomspace(0.02, 599.0, 40) for start in (0.0, 600.0)])
    column = make_column(model)
    found, exact = (
        integrate(column, protocol(output_times=times), make_control(tolerance=tolerance, expected_strain=0.1))
        for tolerance in (1e-4, 1e-8)
    )
    np.testing.assert_allclose(found.time, times, rtol=1e-14)
    scale = np.abs(exact.strain).max()
    assert np.abs(found.strain - exact.strain).max() < 1e-4 * scale
    assert np.abs(found.filled("contents")[:, 0] - exact.filled("contents")[:, 0]).max() < 2e-3  # cell by cell
    assert len(found.filled("steps")) < len(times)


@pytest.mark.parametrize("protocol", [compression, swelling])
@pytest.mark.parametrize("model", MODELS)
def test_balances_close_at_every_output(model: str, protocol: type) -> None:
    """Water, anions and cations: what is inside more than at the start is what has crossed, ends of steps or not."""
    uniform = make_column(model)
    column = replace(uniform, cells=MODELS[model].tissue(reference_tissue(**LAYERED)))
    times = np.concatenate([start + np.geomspace(0.02, 600.0, 40) for start in (0.0, 600.0)])
    run = integrate(column, protocol(output_times=times), make_control(tolerance=1e-3, expected_strain=0.1))
    start = column.contents(run.volume_ratio, BATH)
    traffic = run.state.traffic
    for quantity in range(3 if model == "electrochemical" else 1):
        row = min(quantity, 1)
        gained = (run.filled("contents")[:, row] - start[row]) @ column.grid.widths
        entered = run.filled("crossed")[:, :, quantity].sum(axis=1)
        held = np.abs(start[row]) @ column.grid.widths
        assert np.abs(gained - entered).max() <= 1e-12 * (traffic[quantity] + 1e-4 * held)
    assert run.filled("errors").max() < 1e-11
    assert run.state.clock[LOSS] < 1e-13


def test_nothing_happens_in_equilibrium() -> None:
    for model in MODELS:
        run = integrate(make_column(model), make_protocol([loads(0.0)], [1e4], [1.0, 1e4]), make_control())
        assert np.abs(run.strain).max() < 1e-13
        assert run.filled("errors").max() < 1e-9
        assert len(run.filled("steps")) < 30


# ---- targets ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", [BACKWARD_EULER, ESDIRK43], ids=["backward Euler", "ESDIRK43"])
def test_jumps_and_corners_are_hit(scheme: object) -> None:
    protocol = make_protocol(
        [loads(Load(0.2, 37.0)), loads(0.05, Load(1e-4, 11.0)), loads(0.1, 1e-4)], [100.0, 50.0, 60.0]
    )
    control = make_control(every=1) if scheme is ESDIRK43 else equal_steps(9)
    run = integrate(make_column(), protocol, control)
    assert run.complete
    for corner in (37.0, 100.0, 111.0, 150.0, 210.0):
        assert np.abs(run.time - corner).min() <= 1e-12 * corner
    index = np.abs(run.time - 37.0).argmin()
    assert run.filled("loads")[index, 0] == pytest.approx(0.2, rel=1e-14)
    np.testing.assert_allclose(run.filled("loads")[-1, [0, 2]], [0.1, 1e-4], rtol=1e-14)


# ---- stopping and going on --------------------------------------------------------------------------------


def pieces_of(run: Integration, chunk: int) -> Integration:
    """The same run in pieces of so many steps; between them everything but the state is made anew."""
    parts = []
    while True:
        run = run.copy().with_room(chunk, chunk)
        run.go_on()
        parts.append(run.record)
        if run.state.counts[STATUS] != 0:
            break
    joined = [
        np.concatenate([getattr(part, name)[: part.filled[1 if name == "steps" else 0]] for part in parts])
        for name in parts[0]._fields[:-1]
    ]
    filled = np.sum([part.filled for part in parts], axis=0)
    return Integration(
        run.column, run.volume_ratio, run.body, run.protocol, run.control, run.state, type(run.record)(*joined, filled),
        run.work,
    )  # fmt: skip


def assert_identical(one: Integration, other: Integration) -> None:
    for name in one.record._fields[:-1]:
        np.testing.assert_array_equal(one.filled(name), other.filled(name), err_msg=name)
    for name, values in one.state._asdict().items():
        np.testing.assert_array_equal(values, getattr(other.state, name), err_msg=name)


@pytest.mark.parametrize("chunk", [1, 7, 1000])
@pytest.mark.parametrize("control", [make_control(every=1), equal_steps(10)], ids=["ESDIRK43", "backward Euler"])
def test_a_run_in_pieces_is_the_run(control: Control, chunk: int) -> None:
    protocol = make_protocol([loads(Load(0.2, 40.0)), loads(0.0, 1e-4)], [100.0, 200.0])
    whole = integrate(make_column(), protocol, control)
    assert whole.complete
    protocol = make_protocol([loads(Load(0.2, 40.0)), loads(0.0, 1e-4)], [100.0, 200.0])
    assert_identical(pieces_of(Integration.of(make_column(), protocol, control), chunk), whole)


def test_pieces_do_not_matter_to_relaxation_times_and_outputs_within_steps() -> None:
    def start() -> Integration:
        protocol = make_protocol(
            [loads(0.25), loads(0.0)], [1e5, 1e5], multiple=[1.5, 1.5], equilibrium_strain=[-0.21990347, 0.0]
        )
        return Integration.of(make_column("biphasic-swelling"), protocol, make_control(expected_strain=0.2))

    whole, parts = start().go_on(), start()
    while parts.state.counts[STATUS] == 0:
        parts = parts.copy().with_room(0, 5).go_on()
    np.testing.assert_array_equal(whole.protocol.duration, parts.protocol.duration)
    np.testing.assert_array_equal(whole.state.contents, parts.state.contents)


# ---- a piston whose place is given ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("control", "tolerance"),
    [(make_control(tolerance=1e-5, expected_strain=1e-5), 2e-3), (equal_steps(4000)._replace(every=0), 4e-3)],
    ids=["ESDIRK43", "backward Euler"],
)
def test_stress_relaxation_of_mow(control: Control, tolerance: float) -> None:
    """A piston that moves in by 1e-5 of the height in 50 s and stands still: its pressure is found."""
    times = np.array([2.0, 10.0, 45.0, 50.0, 60.0, 100.0, 300.0, 700.0])
    column = make_column("biphasic", cells=50)
    protocol = make_protocol([loads(height=Load(HEIGHT - 5e-6, 50.0))], [1000.0], times)
    run = integrate(column, protocol, control._replace(first_step=first_step(column)))
    modulus = float(aggregate_modulus(column.cells.solid, column.cells.fluid_fraction))
    expected = relaxation_pressure(modulus, 1e-3, HEIGHT, 5e-6, 50.0, times)
    found = run.filled("loads")[:, COLUMN_LOADS.index("pressure")]
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * expected.max())
    assert expected.max() > 2.0 * expected[-1]  # there was something to relax
    np.testing.assert_allclose(run.height[3:], HEIGHT - 5e-6, rtol=1e-14)
    np.testing.assert_allclose(run.height[:3], HEIGHT - 5e-6 * times[:3] / 50.0, rtol=1e-14)


@pytest.mark.parametrize("model", MODELS)
def test_held_piston_carries_what_a_free_one_is_loaded_with(model: str) -> None:
    """The height that a pressure leads to in the end, given instead, takes that pressure in the end."""
    column = make_column(model)
    free = integrate(column, make_protocol([loads(0.1)], [1e5], [1e5]), make_control())
    held = integrate(
        column, make_protocol([loads(height=Load(free.height[0], 100.0))], [1e5], [1e5]), make_control(tolerance=1e-6)
    )
    assert held.filled("loads")[0, 0] == pytest.approx(0.1, rel=1e-6)
    np.testing.assert_allclose(held.filled("contents")[0], free.filled("contents")[0], rtol=1e-6)


def test_a_piston_that_is_held_and_let_go() -> None:
    """Held while the bath is weakened, it carries a load; let go, it rises."""
    column = make_column()
    height = float(column.initial_volume_ratio() @ column.grid.widths)
    protocol = make_protocol([loads(height=height, bath=1e-4), loads(0.0, 1e-4)], [3000.0, 3000.0], [3000.0, 6000.0])
    run = integrate(column, protocol, make_control(expected_strain=0.05))
    assert run.height[0] == pytest.approx(height, rel=1e-14)
    assert run.filled("loads")[0, 0] > 0.03
    assert run.strain[1] == pytest.approx(1.127643 / 1.054503 - 1.0, rel=2e-3)


# ---- relaxation times -------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["biphasic", "biphasic-swelling"])
def test_relaxation_time_is_when_the_way_has_been_covered(model: str) -> None:
    column = make_column(model, cells=30)
    equilibrium = float(np.mean(integrate(column, make_protocol([loads(0.1)], [1e6], [1e6]), make_control()).strain))
    protocol = make_protocol([loads(0.1)], [1e6], multiple=[1.0], equilibrium_strain=[equilibrium])
    run = integrate(column, protocol, make_control(tolerance=1e-6, expected_strain=0.1))
    assert run.state.counts[STATUS] == COMPLETE
    found = float(protocol.duration[0])
    check = make_protocol([loads(0.1)], [2 * found], [found])
    strain = integrate(column, check, make_control(tolerance=1e-7, expected_strain=0.1)).strain[0]
    assert strain == pytest.approx(0.99 * equilibrium, abs=2e-6 * abs(equilibrium))


# ---- grids and ends ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", MODELS)
def test_open_at_both_ends_is_two_columns_back_to_back(model: str) -> None:
    """Uniform cells: the upper half is the mirror image of the lower one, which is a column of half the height."""
    protocol = swelling if model != "biphasic" else compression
    control, times = make_control(tolerance=1e-6, expected_strain=0.1), [3.0, 50.0, 600.0, 650.0, 1200.0]
    half = integrate(make_column(model, cells=12, grading=1.0), protocol(output_times=times), control)
    column = make_column(model, cells=24, grading=1.0, height=2 * HEIGHT, parts=parts_with((True, True)))
    bath = Load(1e-4 if model != "biphasic" else BATH)
    phases = [loads(0.0 if model != "biphasic" else 0.25, bath), loads(0.0)]
    whole = integrate(column, make_protocol(phases, [600.0, 600.0], times), control)
    J = whole.filled("contents")
    np.testing.assert_allclose(J, J[:, :, ::-1], rtol=1e-12)
    np.testing.assert_allclose(J[:, :, :12], half.filled("contents"), rtol=1e-6)
    np.testing.assert_allclose(whole.filled("crossed")[:, 0], whole.filled("crossed")[:, 1], rtol=1e-9, atol=1e-14)


# ---- effort -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "protocol", "steps", "iterations"),
    [("electrochemical", compression, 60, 450), ("electrochemical", swelling, 60, 450),
     ("biphasic-swelling", compression, 60, 450), ("biphasic", compression, 60, 450)],
)  # fmt: skip
def test_effort_of_the_reference_cases(model: str, protocol: type, steps: int, iterations: int) -> None:
    """Steps and Newton iterations, so that a loss of speed is noticed by a count."""
    column = make_column(model, cells=50)
    control = make_control(expected_strain=0.2, first_step=first_step(column))
    run = integrate(column, protocol(), control)
    assert len(run.filled("steps")) <= steps
    assert run.iterations <= iterations
    equal = integrate(column, protocol(), equal_steps(50))
    assert equal.iterations <= 260  # of 100 steps


# ---- failures ---------------------------------------------------------------------------------------------


def squeezed(model: str, displacement: float, over: float, **changes: float) -> Integration:
    column = make_column(model, reference_tissue(**changes), cells=50)
    height = float(column.initial_volume_ratio() @ column.grid.widths)
    protocol = make_protocol([loads(height=Load(height + displacement, over))], [100.0], [100.0])
    return integrate(column, protocol, make_control(expected_strain=0.5, first_step=first_step(column)))


@pytest.mark.parametrize("model", ["biphasic", "electrochemical"])
@pytest.mark.parametrize("hindrance", [0.0, 0.4])
def test_dried_column_says_so(model: str, hindrance: float) -> None:
    """A piston so fast that the cells at the filter lose their water; whatever went before is conserved.

    Fixed charge does not help where counter-ions are transported: the drier the tissue, the stronger the streaming
    potential, and what can leave through a dry layer is limited.
    """
    run = squeezed(model, -0.39, 1.0, hindrance_factor=hindrance)
    assert run.state.counts[STATUS] == FAILED
    assert run.work.report[REASON] == NO_WATER
    assert run.work.report[POINT] <= 1
    assert run.state.clock[LOSS] < 1e-12
    assert 0.0 < run.state.contents[0].min() - 0.2 < 1e-3
    assert run.state.counts[2] < 200  # it does not creep on and on


def test_piston_at_the_same_speed_is_followed_where_water_can_pass() -> None:
    """Displaced by -0.39 mm over 1 s: refused once, with Newton's method flipping between two states."""
    run = squeezed("biphasic-swelling", -0.39, 1.0)
    assert run.complete
    assert run.state.clock[LOSS] < 1e-12
    assert run.height[0] == pytest.approx(1.054503 * HEIGHT - 0.39, rel=1e-5)
    slower = squeezed("electrochemical", -0.39, 100.0)
    assert slower.complete
    assert slower.state.clock[LOSS] < 1e-12


def test_a_load_that_nothing_can_carry_dries_the_column() -> None:
    run = integrate(make_column("biphasic"), make_protocol([loads(Load(5.0, 10.0))], [1e4]), make_control())
    assert run.state.counts[STATUS] == FAILED
    assert run.work.report[REASON] == NO_WATER


# ---- one column does not know of others -------------------------------------------------------------------


def test_the_same_run_twice_is_the_same() -> None:
    tissue = random_tissue(20, 5)
    faces = random_tissue(21, 6)

    def run() -> Integration:
        column = replace(make_column(), cells=tissue, faces=faces)
        return integrate(column, compression(output_times=[1.0, 30.0, 700.0]), make_control())

    assert_identical(run(), run())
