"""A block under the time integrator: the column as a special case, conservation, equilibrium, jumps, failures."""

from __future__ import annotations

from itertools import pairwise

import integrations
import numpy as np
import pytest
from blocks import (
    CONFINED,
    GLUED,
    UNCONFINED,
    Integration,
    Parts,
    acting,
    distorted_vertices,
    integrate,
    make_control,
    make_protocol,
    one_stage,
    part,
    phase,
    rough_grid,
    uniform_block,
)
from tissues import BATH, reference_tissue

from fvswell.block.block import Block
from fvswell.block.body import BlockBody
from fvswell.block.equilibrium import equilibrated_body, initial_open_circuit_ratio, start_of
from fvswell.block.fields import fields_at
from fvswell.block.grid import block_grid, shaped_block_grid
from fvswell.block.make_block import make_block
from fvswell.block.mechanics import integration_points
from fvswell.numerics.body import find_rate
from fvswell.numerics.graded_grid import graded_nodes
from fvswell.numerics.loads import Load
from fvswell.numerics.state import NO_WATER, REASON, State, workspace
from fvswell.numerics.tableaux import BACKWARD_EULER, ESDIRK43, Tableau
from fvswell.physics.models import BIPHASIC, BIPHASIC_SWELLING, ELECTROCHEMICAL, MODELS, Model
from fvswell.physics.tissue import Array, Tissue

by_model = pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)
by_kind = pytest.mark.parametrize("kind", ["plane-strain", "axisymmetric"])


def equal_steps(steps: int) -> object:
    return make_control(BACKWARD_EULER, 1e-12, fixed_steps=steps, every=1)


@by_model
@pytest.mark.parametrize("open_circuit", ["initial", "state"])
def test_one_cell_wide_block_is_the_column(model: Model, open_circuit: str) -> None:
    tissue = reference_tissue(permeability_exponent=2.0)
    column = integrations.make_column(model.name, tissue, cells=20, grading=10.0, open_circuit=open_circuit)
    pressures, baths = (Load(0.25), Load(0.0, 100.0)), (Load(BATH), Load(8e-5))
    expected = integrations.integrate(
        column,
        make_protocol([integrations.loads(*each) for each in zip(pressures, baths, strict=True)], [300.0] * 2),
        integrations.equal_steps(10),
    )
    edges = CONFINED | part("bottom", "roller", open=True)
    block = uniform_block(block_grid("plane-strain", np.array([0.0, 0.3]), column.grid.nodes), edges, model, tissue)
    body, state = equilibrated_body(block)
    if model.open_circuit and open_circuit == "initial":
        ratio = initial_open_circuit_ratio(block, state.unknowns)
        body, state = start_of(block.with_open_circuit_ratio(ratio), state.unknowns)
    phases = [phase(body, top__pressure=p, bath=b) for p, b in zip(pressures, baths, strict=True)]
    found = integrate(body, state, make_protocol(phases, [300.0] * 2), equal_steps(10))
    np.testing.assert_allclose(found.filled("time"), expected.time, rtol=1e-14)
    assert np.ptp(expected.strain) > 0.05
    height = 0.5 + found.load("top.displacement")
    np.testing.assert_allclose(height / body.initial_height - 1.0, expected.strain, rtol=0, atol=1e-8)
    contents = expected.filled("contents")
    np.testing.assert_allclose(found.filled("contents")[:, : contents.shape[1]], contents, rtol=1e-8, atol=1e-14)
    crossed = expected.filled("crossed")[:, 0]
    np.testing.assert_allclose(found.filled("crossed")[:, 0] / 0.3, crossed, rtol=1e-7, atol=1e-12)


@by_kind
@pytest.mark.parametrize("scheme", [BACKWARD_EULER, ESDIRK43], ids=["backward-euler", "esdirk43"])
def test_volume_anions_and_cations_are_conserved_in_every_step(kind: str, scheme: Tableau) -> None:
    block = uniform_block(shaped_block_grid(kind, distorted_vertices(6, 5)), GLUED, ELECTROCHEMICAL)
    body, state = equilibrated_body(block)
    volumes = block.grid.volumes

    def held(unknowns: Array) -> Array:
        """Volume, anions and cations in the block."""
        transport = block.transport_at(unknowns, block.unloaded)
        fields = fields_at(block, unknowns, block.unloaded)
        water = volumes * (transport.volume_ratio - 1.0 + block.cells.fluid_fraction)
        ions = [water @ fields[f"{ion}_concentration"] for ion in ("anion", "cation")]
        return np.array([volumes @ transport.volume_ratio, *ions])

    before = held(state.unknowns)
    loads = [phase(body, bath=8e-5), phase(body, bath=8e-5, top__pressure=Load(0.2, 50.0))]
    settings = {"tolerance": 1e-3, "first_step": 1.0} if scheme is ESDIRK43 else {"fixed_steps": 8}
    tolerance = 1e-12 if scheme is BACKWARD_EULER else 1e-3
    control = make_control(scheme, **{"tolerance": tolerance, "every": 1} | settings)
    run = integrate(body, state, make_protocol(loads, [400.0, 400.0]), control)
    assert run.complete
    assert len(run.filled("steps")) >= 10
    assert run.filled("errors").max() < 1e-10
    # what is in the block at the end is what the records say has come, to the tolerance of Newton's method
    change, crossed = held(state.unknowns) - before, run.filled("crossed")[-1].sum(axis=0)
    assert abs(change[0] / before[0]) > 0.01
    newton = 1e-9 if scheme is BACKWARD_EULER else 1e-4
    np.testing.assert_allclose(change, crossed, rtol=0, atol=newton * np.abs(change).max())
    np.testing.assert_allclose(change[1:], crossed[1:], rtol=10 * newton)


def test_outputs_within_steps_are_those_of_shorter_steps() -> None:
    """Fields between steps are as accurate as at their ends, mechanics and potentials included."""
    block = uniform_block(rough_grid("plane-strain"), GLUED, ELECTROCHEMICAL)
    times = np.geomspace(5.0, 800.0, 12)
    records = []
    for tolerance in (1e-3, 1e-7):
        body, state = equilibrated_body(block)
        protocol = make_protocol([phase(body, bath=8e-5, top__force=Load(0.2, 20.0))], [800.0], times)
        run = integrate(body, state, protocol, make_control(tolerance=tolerance, expected_strain=0.1, first_step=0.1))
        assert len(run.filled("time")) == 12
        records.append(run)
    coarse, fine = records
    assert len(coarse.filled("steps")) < 0.5 * len(fine.filled("steps"))
    np.testing.assert_allclose(coarse.load("top.displacement"), fine.load("top.displacement"), atol=1e-3 * 0.1)
    np.testing.assert_allclose(coarse.load("top.force")[-6:], 0.2, rtol=1e-12)
    size = np.abs(fine.filled("contents")[:, 0] - 1.0).max()
    assert np.abs(coarse.filled("contents")[:, 0] - fine.filled("contents")[:, 0]).max() < 5e-3 * size


@by_model
def test_outputs_within_steps_are_in_balance(model: Model) -> None:
    """Forces, contents and charge are, to the tolerance, though no equation is solved for an output."""
    block = uniform_block(rough_grid("plane-strain"), GLUED, model)
    first, volumes, tolerance = block.degrees_of_freedom.number, block.grid.volumes, 1e-4
    body, state = equilibrated_body(block)
    protocol = make_protocol([phase(body, bath=8e-5, top__pressure=0.2)], [800.0], np.geomspace(1.0, 790.0, 25))
    run = integrate(body, state, protocol, make_control(tolerance=tolerance, expected_strain=0.1, first_step=0.1))
    assert len(run.filled("steps")) < 25
    only = [name.endswith(("pressure", "bath_concentration")) for name in body.load_names]
    for unknowns, contents, loads in zip(*map(run.filled, ("unknowns", "contents", "loads")), strict=True):
        found = block.evaluate(unknowns, body.interval(contents, 0.0, np.where(only, loads, np.nan)))
        forces = np.abs(found.residual[:first] / block.momentum_scale)
        gap = np.abs(found.transport.contents - contents) @ volumes / volumes.sum() / block.content_scale
        assert forces.mean() < 0.1 * tolerance
        assert gap.max() < tolerance
        if model.transports_ions:
            anions, current = found.transport.fluxes[1:]
            assert np.abs(found.transport.outflow[2]).sum() < 10.0 * tolerance * np.abs(anions + current).sum()


def rate_after(body: BlockBody, state: State, loads: Array, slopes: Array) -> tuple[Array, Array, Array]:
    """Unknowns, rates of the contents and rates of entering, just after loads have come to act."""
    work, unknowns, rate = workspace(state, 2), state.unknowns.copy(), np.zeros_like(state.contents)
    assert find_rate(body, unknowns, state.contents, loads, slopes, rate, work.crossing, state.clock, work.report)
    return unknowns, rate, work.crossing


@by_model
@by_kind
def test_a_load_that_jumps_finds_the_block_undrained(kind: str, model: Model) -> None:
    block = uniform_block(rough_grid(kind), UNCONFINED, model)
    body, state = equilibrated_body(block)
    loads = np.array([np.nan if load is None else load.target for load in phase(body, top__pressure=0.1)])
    unknowns, rate, crossing = rate_after(body, state, loads, 0.0 * loads)
    transport = block.transport_at(unknowns, block.unloaded)
    gap = np.abs(transport.contents - state.contents) / block.content_scale[:, None]
    assert gap.max() < 1e-6
    moved = np.abs(unknowns - state.unknowns)[: block.degrees_of_freedom.number].max()
    assert moved > 0.005  # it has given way, without a change of volume
    # the rates are those of the fluxes, and short steps find the same
    np.testing.assert_allclose(block.grid.volumes @ rate[0], crossing[:, 0].sum(), rtol=1e-12)
    _, result = one_stage(block, 10.0 * body.moment, top__pressure=0.1)
    assert result.step is not None
    slow = (result.step.contents - state.contents) / (10.0 * body.moment)
    assert np.abs(slow - rate)[0].max() < 0.02 * np.abs(rate[0]).max()


@by_model
def test_a_block_held_all_around_has_the_pressure_that_makes_water_flow_as_its_edges_move(model: Model) -> None:
    """Confined, under a plate of given speed: contents and loads alone do not say what the pressure is."""
    edges = CONFINED | part("right", "roller", open=True) | part("bottom", "roller")
    block = uniform_block(rough_grid("plane-strain"), edges, model)
    body, state = equilibrated_body(block)
    loads = np.array([np.nan if load is None else load.target for load in phase(body, top__displacement=0.0)])
    place = body.load_names.index("top.displacement")
    loads[place] = state.loads[place]
    slopes = np.zeros_like(loads)
    slopes[place] = -1e-4
    contents = state.contents.copy()
    state.contents[0] += 1e-7  # what a tolerance may leave
    _, rate, crossing = rate_after(body, state, loads, slopes)
    assert crossing[0, 0] == pytest.approx(-1e-4 * 2.0, rel=1e-6)  # of the width of 2 mm
    assert block.grid.volumes @ rate[0] == pytest.approx(-2e-4, rel=1e-6)
    state.contents[:] = contents
    target = float(loads[place]) - 0.1
    protocol = make_protocol([phase(body, top__displacement=Load(target, 1e3))], [2e3], np.linspace(50.0, 2e3, 40))
    run = integrate(body, state, protocol, make_control(tolerance=1e-4, expected_strain=0.1, first_step=1.0))
    assert run.complete
    assert run.filled("errors").max() < 1e-10
    np.testing.assert_allclose(run.filled("crossed")[:20, 0, 0], -2e-4 * run.filled("time")[:20], rtol=1e-5)


@pytest.mark.parametrize("cells", [(1, 1), (1, 4), (3, 3)])
def test_salt_of_a_block_that_cannot_move_comes_to_that_of_the_bath(cells: tuple[int, int]) -> None:
    edges = part("left", "fixed") | part("bottom", "fixed") | part("top", "fixed") | part("right", "fixed", open=True)
    grid = block_grid("plane-strain", graded_nodes(1.0, cells[0]), graded_nodes(1.0, cells[1]))
    block = uniform_block(grid, edges, ELECTROCHEMICAL)
    body, state = equilibrated_body(block)
    times = np.geomspace(1.0, 1e6, 9)
    control = make_control(tolerance=1e-4, expected_strain=1e-2, first_step=1.0)
    run = integrate(body, state, make_protocol([phase(body, bath=8e-5)], [1e6], times), control)
    assert run.complete
    fields = fields_at(block, run.filled("unknowns")[-1], acting(block, 8e-5))
    np.testing.assert_allclose(fields["virtual_concentration"], 8e-5, rtol=1e-4)
    np.testing.assert_allclose(fields["volume_ratio"], 1.0, rtol=1e-4)
    np.testing.assert_allclose(fields["water_potential"], block.bath_potentials(8e-5)[0], rtol=1e-3)


def test_swelling_models_meet_in_equilibrium_and_forces_are_found() -> None:
    grid = block_grid("plane-strain", graded_nodes(2.0, 6), graded_nodes(1.0, 4))
    ends = {}
    for model in (BIPHASIC_SWELLING, ELECTROCHEMICAL):
        block = uniform_block(grid, GLUED, model)
        body, state = equilibrated_body(block)
        if model.open_circuit:
            ratio = initial_open_circuit_ratio(block, state.unknowns)
            assert ((ratio > 0.5) & (ratio <= 1.0)).all()
            body, state = start_of(block.with_open_circuit_ratio(ratio), state.unknowns)
        loads = [
            phase(body, bath=1e-4, top__force=Load(0.2)), phase(body, bath=1e-4, top__displacement=Load(-0.1, 20.0))
        ]  # fmt: skip
        times = np.array([2e6, 2.000001e6, 4e6])
        control = make_control(tolerance=1e-4, expected_strain=0.1, first_step=1.0)
        run = integrate(body, state, make_protocol(loads, [2e6, 2e6], times), control)
        assert run.complete
        force, pressure, displacement = (run.load(f"top.{name}") for name in ("force", "pressure", "displacement"))
        assert force[0] == pytest.approx(0.2, rel=1e-12)
        assert displacement[-1] == pytest.approx(-0.1, rel=1e-12)
        assert force[1] > 0.2  # the water carries what the plate presses out at first
        width = np.ptp(block.positions(state.unknowns)[0, grid.edge_vertices("top")])
        assert force[-1] == pytest.approx(pressure[-1] * width, rel=1e-12)
        ends[model.name] = ([force[0], displacement[0]], [force[-1], displacement[-1]])
    np.testing.assert_allclose(ends["biphasic-swelling"], ends["electrochemical"], rtol=1e-5)


@by_kind
@pytest.mark.parametrize("drive", ["force", "pressure"])
def test_reaction_of_a_plate_is_its_own_beside_a_loaded_neighbour(kind: str, drive: str) -> None:
    body, state = equilibrated_body(uniform_block(rough_grid(kind), UNCONFINED, BIPHASIC))
    loads = phase(body, right__pressure=0.1, **{f"top__{drive}": 0.2})
    run = integrate(body, state, make_protocol([loads], [100.0]), equal_steps(1))
    assert run.load(f"top.{drive}")[-1] == pytest.approx(0.2, rel=1e-10)


def test_a_block_that_cannot_follow_stops_with_a_reason_and_keeps_what_it_has() -> None:
    body, state = equilibrated_body(uniform_block(rough_grid("plane-strain"), GLUED, BIPHASIC))
    loads = phase(body, top__displacement=Load(-0.95, 100.0))
    report = workspace(state, 1).report
    run = integrate(body, state, make_protocol([loads], [100.0]), equal_steps(2))
    assert not run.complete
    assert 0.0 < run.filled("time")[-1] < 100.0
    assert run.filled("contents")[:, 0].min() > 0.2  # 1 - n_f0: never without water
    assert report[REASON] != NO_WATER


def layered_tissue(points: Array) -> Tissue:
    """The upper half is stiffer and tighter."""
    upper = points[1] > 0.5
    return reference_tissue(
        youngs_modulus=np.where(upper, 2.0, 0.5), hydraulic_permeability=np.where(upper, 1e-4, 1e-3)
    )


def varying_block(model: Model, parts: Parts) -> Block:
    grid = block_grid("plane-strain", graded_nodes(2.0, 6), graded_nodes(1.0, 6))
    tissues = [model.tissue(layered_tissue(at)) for at in (grid.centres, grid.face_centres, integration_points(grid))]
    return make_block(grid, tuple(parts.values()), model, *tissues, BATH)


def test_properties_that_vary_over_the_block() -> None:
    """The stiffer and tighter half gives less water under the same load."""
    body, state = equilibrated_body(varying_block(BIPHASIC, UNCONFINED))
    run = integrate(body, state, make_protocol([phase(body, top__pressure=0.1)], [300.0]), equal_steps(3))
    J = fields_at(body.block, run.filled("unknowns")[-1], body.block.unloaded)["volume_ratio"].reshape(6, 6)
    assert (J[:3, -1] < J[3:, -1]).all()


def test_a_run_that_is_continued_is_the_run_that_was_not_interrupted() -> None:
    """Factors and constants of convergence that a block keeps do not lead on across steps."""
    block = uniform_block(rough_grid("plane-strain"), GLUED, ELECTROCHEMICAL)

    def run(rooms: tuple[int, ...]) -> Integration:
        body, state = equilibrated_body(block)
        protocol = make_protocol([phase(body, bath=8e-5, top__pressure=Load(0.1, 20.0))], [400.0])
        control = make_control(tolerance=1e-3, expected_strain=0.1, first_step=0.5, every=1)
        for room in rooms:
            done = integrate(body, state, protocol, control, room)
            body = BlockBody(block, body.initial_height)
        return done

    whole, parts = run((1000,)), run((3, 4, 1000))
    assert whole.complete
    assert parts.complete
    np.testing.assert_array_equal(whole.state.unknowns, parts.state.unknowns)
    np.testing.assert_array_equal(whole.state.contents, parts.state.contents)


def test_error_follows_the_tolerance() -> None:
    block = uniform_block(rough_grid("plane-strain"), GLUED, ELECTROCHEMICAL)
    times = np.geomspace(2.0, 2e3, 20)

    def height(tolerance: float) -> Array:
        body, state = equilibrated_body(block)
        protocol = make_protocol([phase(body, bath=8e-5), phase(body, top__pressure=0.1)], [1e3, 1e3], times)
        control = make_control(tolerance=tolerance, expected_strain=0.05, first_step=0.1)
        run = integrate(body, state, protocol, control)
        return np.array([body.mean_height(block.positions(unknowns)) for unknowns in run.filled("unknowns")])

    exact = height(1e-7)
    size = np.abs(exact - exact[0]).max()
    errors = [np.abs(height(tolerance) - exact).max() / size for tolerance in (1e-2, 1e-3, 1e-4)]
    assert all(error < 2.0 * tolerance for error, tolerance in zip(errors, (1e-2, 1e-3, 1e-4), strict=True)), errors
    assert all(first > second for first, second in pairwise(errors))
