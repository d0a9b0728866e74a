"""The coupled system of a block: Jacobian, convergence, conservation, the column as a special case, sudden loads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from blocks import (
    BATH,
    GLUED,
    UNCONFINED,
    block_system,
    distorted_vertices,
    jacobian_matrix,
    protocol,
    random_unknowns,
    rough_grid,
)
from scipy import sparse
from tissues import reference_tissue

from fvswell.block.block import EdgeLoads, make_block
from fvswell.block.edges import EdgeCondition
from fvswell.block.equilibrium import equilibrated_state, initial_open_circuit_ratio, with_open_circuit_ratio
from fvswell.block.fields import block_fields, cell_gradients, cell_vectors
from fvswell.block.geometry import edge_area_vectors
from fvswell.block.grid import block_grid, graded_nodes, shaped_block_grid
from fvswell.block.mechanics import integration_points
from fvswell.block.system import BlockSystem, edge_loads
from fvswell.block.transport import BlockInterval
from fvswell.column.column import Column, Loads
from fvswell.column.grid import column_grid
from fvswell.column.newton import ColumnSystem
from fvswell.column.transport_term import CoupledTransportTerm
from fvswell.numerics.system import Solution, Stage
from fvswell.numerics.time_stepping import BACKWARD_EULER, SDIRK2, Marcher, Scheme, State, Step, StepControl
from fvswell.physics.constants import FARADAY
from fvswell.physics.electrochemistry import electric_potential
from fvswell.physics.models import BIPHASIC, BIPHASIC_SWELLING, ELECTROCHEMICAL, MODELS, Mixture, Model
from fvswell.physics.solid import aggregate_modulus
from fvswell.physics.tissue import Array, Tissue

by_model = pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)
by_kind = pytest.mark.parametrize("kind", ["plane-strain", "axisymmetric"])
NAN = np.nan


@by_model
@by_kind
@pytest.mark.parametrize("driven", ["force", "displacement"])
def test_jacobian_is_the_derivative_of_the_residual(kind: str, model: Model, driven: str) -> None:
    tissue = reference_tissue(permeability_exponent=2.0)
    system = block_system(rough_grid(kind), UNCONFINED | {"right": GLUED["right"]}, model, tissue)
    block = system.block
    unknowns = random_unknowns(system)
    held = np.array([NAN, NAN, NAN, -0.1 if driven == "displacement" else NAN])
    loads = EdgeLoads(np.array([0, 0.1, 0, 0.05]), np.array([0, 0, 0, 0.03]), held)
    interval = BlockInterval(np.zeros((len(model.balances), 1, block.grid.cells)), 3.0, 1.2e-4)
    state = block.evaluate(unknowns, interval, loads)
    assert state.sound.all()
    exact = jacobian_matrix(system, block.jacobian(state, interval, loads)).toarray()
    step = 3e-5 * block.unknown_scale
    scale = block.unknown_scale / block.residual_scale(1.2e-4)[:, None]

    def shifted(j: int, times: float) -> Array:
        at = unknowns.copy()
        at[j] += times * step[j]
        return block.evaluate(at, interval, loads).residual

    for j in range(len(unknowns)):
        slope = 8.0 * (shifted(j, 1) - shifted(j, -1)) - (shifted(j, 2) - shifted(j, -2))
        gap = (exact[:, j] - slope / (12.0 * step[j])) * scale[:, j]
        assert np.abs(gap).max() < 1e-8, j


@by_model
def test_newton_converges_quadratically(model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fvswell.block.newton._KEEP", 0.0)  # a Jacobian for every step
    system = block_system(rough_grid("plane-strain"), GLUED, model)
    start = equilibrated_state(system, BATH)
    loads = edge_loads({"top.pressure": np.array([0.3])})
    result = system.iterate(start.unknowns[0, 0], BlockInterval(start.contents, 20.0, 0.7e-4), loads)
    assert result.converged
    falling = np.array([norm for norm in result.norms if norm > 1e-13])
    falling = falling[falling < 0.05]
    assert len(falling) >= 2
    # each norm is about the square of the last; on the way there are 1e-2 -> 1e-4 -> 1e-8
    assert (falling[1:] < 10.0 * falling[:-1] ** 2 + 1e-14).all(), result.norms


@by_model
def test_kept_factors_lead_to_the_same_solution(model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    system = block_system(rough_grid("plane-strain"), GLUED, model)
    start = equilibrated_state(system, BATH)
    loads = edge_loads({"top.pressure": np.array([0.3])})
    results = []
    for keep in (0.1, 0.0):
        monkeypatch.setattr("fvswell.block.newton._KEEP", keep)
        results.append(system.iterate(start.unknowns[0, 0], BlockInterval(start.contents, 20.0, 0.7e-4), loads))
    kept, fresh = results
    assert kept.converged
    assert fresh.converged
    assert kept.iterations > fresh.iterations
    assert np.abs((kept.unknowns - fresh.unknowns) / system.block.unknown_scale).max() < 1e-10


@by_model
def test_one_cell_wide_block_is_the_column(model: Model) -> None:
    tissue = reference_tissue(permeability_exponent=2.0)
    grid = column_grid(0.5, 20, 10.0)
    mixture = Mixture(model, tissue, np.array([[0.93]]), np.array([[0.8]]) if model.open_circuit else None)
    laws = Column(mixture, mixture)
    block = block_system(
        block_grid("plane-strain", np.array([0.0, 0.3]), grid.nodes),
        {
            "left": EdgeCondition("roller"), "right": EdgeCondition("roller"),
            "bottom": EdgeCondition("roller", permeable=True), "top": EdgeCondition("tied"),
        },
        model, tissue, mixture.open_circuit_ratio,
    )  # fmt: skip
    start = equilibrated_state(block, BATH)
    J = start.contents[:1]
    unknowns = np.concatenate([J, np.full_like(J, np.log(BATH)), np.zeros_like(J)])[: len(model.balances)]
    bath = Loads(np.zeros((1, 1)), np.full((1, 1), BATH))
    contents = laws.cells.contents(laws.at_cells(unknowns[: laws.state_size], bath))
    one = np.array([1.0])
    column = State(
        unknowns, {"pressure": 0 * one, "bath": BATH * one, "height": J[0] @ grid.widths}, contents,
        np.zeros((len(unknowns), 1, 21)), np.zeros(1, int), np.zeros(1), np.zeros(1),
    )  # fmt: skip
    times = [np.arange(30.0, 301.0, 30.0)] * 2
    pressure, concentration = [(0.25, 0.0), (0.1, 100.0)], [(BATH, 0.0), (8e-5, 0.0)]
    strains: dict[str, list[float]] = {"column": [], "block": []}
    control = StepControl(BACKWARD_EULER)
    drives = {"pressure": pressure, "height": [(NAN, 0.0)] * 2, "bath": concentration}
    Marcher(
        ColumnSystem(CoupledTransportTerm(grid, laws)), protocol([300.0] * 2, times, **drives), control, column,
        [lambda state, step: strains["column"].append(state.loads["height"][0] / 0.5 - 1.0)],
    ).run()  # fmt: skip
    Marcher(
        block, protocol([300.0] * 2, times, top__pressure=pressure, bath=concentration), control, start,
        [lambda state, step: strains["block"].append(state.loads["top.displacement"][0] / 0.5)],
    ).run()  # fmt: skip
    assert len(strains["block"]) == 20
    assert np.ptp(strains["block"]) > 0.05
    np.testing.assert_allclose(strains["block"], strains["column"], rtol=0, atol=1e-8)
    np.testing.assert_allclose(start.contents, column.contents, rtol=1e-8, atol=1e-14)
    inner = slice(1, 20)
    np.testing.assert_allclose(start.fluxes[..., inner] / 0.3, column.fluxes[..., inner], rtol=1e-6, atol=1e-14)


class Books:
    """Largest errors of the balances in any step, relative to the contents."""

    def __init__(self, system: BlockSystem) -> None:
        self.volumes, self.steps = system.volumes, 0
        self.errors: list[Array] = []

    def __call__(self, state: State, step: Step) -> None:
        gained = (state.contents - step.contents_before)[:, 0] @ self.volumes
        scale = np.maximum(state.contents[:, 0] @ self.volumes, BATH * self.volumes.sum())
        scale[0] = self.volumes.sum()
        self.errors.append(np.abs(gained - step.inflow[:, 0] * step.size[0]) / scale)
        self.steps += 1


@by_kind
@pytest.mark.parametrize("scheme", [BACKWARD_EULER, SDIRK2], ids=["backward-euler", "sdirk2"])
def test_volume_anions_and_charge_are_conserved_in_every_step(kind: str, scheme: Scheme) -> None:
    system = block_system(shaped_block_grid(kind, distorted_vertices(6, 5)), GLUED, ELECTROCHEMICAL)
    books = Books(system)
    state = equilibrated_state(system, BATH)
    volume = system.block.volume_ratio(system.block.positions(state.unknowns[0, 0]))[0] @ system.volumes
    marcher = Marcher(
        system,
        protocol([400.0, 400.0], [[400.0] if scheme is SDIRK2 else np.arange(1, 9) * 50.0] * 2,
                 bath=[(8e-5, 0.0), (8e-5, 0.0)], top__pressure=[(0.0, 0.0), (0.2, 50.0)]),
        StepControl(scheme, np.array([1e-3]) if scheme is SDIRK2 else None, first_step=5.0),
        state, [books],
    )  # fmt: skip
    marcher.run()
    assert not marcher.failures
    assert books.steps >= 10
    assert np.max(books.errors) < 1e-10
    # and what the contents say is what the vertices enclose
    after = system.block.volume_ratio(system.block.positions(state.unknowns[0, 0]))[0] @ system.volumes
    assert state.contents[0, 0] @ system.volumes == pytest.approx(after, rel=1e-14)
    assert abs(after / volume - 1.0) > 0.01


def test_swelling_models_meet_at_equilibrium_and_forces_are_found() -> None:
    grid = block_grid("plane-strain", graded_nodes(2.0, 6), graded_nodes(1.0, 4))
    ends = {}
    for model in (BIPHASIC_SWELLING, ELECTROCHEMICAL):
        system = block_system(grid, GLUED, model)
        state = equilibrated_state(system, BATH)
        if model.open_circuit:
            ratio = initial_open_circuit_ratio(system.block, state.unknowns[0, 0], BATH)
            assert ((ratio > 0.5) & (ratio <= 1.0)).all()
            system = BlockSystem(with_open_circuit_ratio(system.block, ratio))
        loads = protocol(
            [2e6, 2e6], [np.geomspace(10.0, 2e6, 12)] * 2,
            bath=[(1e-4, 0.0)] * 2, top__force=[(0.2, 0.0), (NAN, 0.0)], top__displacement=[(NAN, 0.0), (-0.1, 20.0)],
        )  # fmt: skip
        forces: list[list[float]] = []

        def record(state: State, step: Step, out: list[list[float]] = forces) -> None:
            out.append([float(state.loads[f"top.{name}"][0]) for name in ("force", "pressure", "displacement")])

        Marcher(system, loads, StepControl(BACKWARD_EULER), state, [record]).run()
        assert forces[11][0] == pytest.approx(0.2, rel=1e-12)
        assert forces[-1][2] == pytest.approx(-0.1, rel=1e-12)
        width = np.ptp(system.block.positions(state.unknowns[0, 0])[0, grid.edge_vertices("top")])
        assert forces[-1][0] == pytest.approx(forces[-1][1] * width, rel=1e-12)
        ends[model.name] = (forces[11], forces[-1])
    np.testing.assert_allclose(ends["biphasic-swelling"], ends["electrochemical"], rtol=1e-6)


def _sudden_load(n: int, share: float, stabilised: bool) -> tuple[Array, Solution]:
    """Pressure of a glued block under 0.1 MPa after a step of a share of its consolidation time, (rows, columns)."""
    tissue = reference_tissue(youngs_modulus=1.0)
    grid = block_grid("plane-strain", graded_nodes(10.0, n), graded_nodes(5.0, n))
    system = block_system(grid, GLUED, BIPHASIC, tissue)
    if not stabilised:
        block = system.block
        nothing = sparse.csr_array(block.stabilisation)
        nothing.data[:] = 0.0
        system = BlockSystem(replace(block, stabilisation=nothing))
    state = equilibrated_state(system, BATH)
    step = share * 10.0**2 / (aggregate_modulus(tissue).item() * 1e-3)
    prescribed = {"bath": np.array([BATH]), "top.pressure": np.array([0.1])}
    solution = system.solve(state.unknowns, state.loads, Stage(state.contents, np.array([step]), prescribed))
    assert solution.converged.all()
    return system.block.potentials(solution.unknowns[0, 0])[0].reshape(n, n), solution


def _checkerboard(pressure: Array) -> float:
    """Largest alternating part around a vertex away from the right edge, whose glued corner is a singularity."""
    part = pressure[:-1, :-1] - pressure[1:, :-1] - pressure[:-1, 1:] + pressure[1:, 1:]
    return float(np.abs(part[:, : 3 * len(part) // 4]).max() / 4.0)


@pytest.mark.parametrize("share", [1e-4, 1e-6, 1e-8])
def test_no_checkerboard_after_a_sudden_load(share: float) -> None:
    smooth = _checkerboard(_sudden_load(20, share, stabilised=True)[0])
    assert smooth < 0.012 * 0.1
    if share < 1e-5:  # and there would be one
        assert _checkerboard(_sudden_load(20, share, stabilised=False)[0]) > 5.0 * smooth


def test_stabilisation_vanishes_with_the_grid() -> None:
    gaps = []
    for n in (8, 16, 32):
        with_it, without = (_sudden_load(n, 1e-2, stabilised)[1] for stabilised in (True, False))
        gaps.append(abs(with_it.loads["top.displacement"][0] - without.loads["top.displacement"][0]))
    assert gaps[0] < 1e-4
    assert (np.log2(np.array(gaps[:-1]) / gaps[1:]) > 2.0).all(), gaps


def test_two_drives_on_one_edge_are_refused() -> None:
    with pytest.raises(ValueError, match="the top edge is driven in more than one way"):
        edge_loads({"top.force": np.array([1.0]), "top.displacement": np.array([0.0])})


def test_a_block_that_cannot_follow_stops_with_a_reason_and_keeps_what_it_has() -> None:
    system = block_system(rough_grid("plane-strain"), GLUED, BIPHASIC)
    state = equilibrated_state(system, BATH)
    times: list[float] = []
    squeeze = protocol([100.0], [np.array([50.0, 100.0])], bath=[(BATH, 0.0)], top__displacement=[(-0.95, 100.0)])
    marcher = Marcher(
        system, squeeze, StepControl(BACKWARD_EULER), state, [lambda s, step: times.append(float(s.elapsed[0]))]
    )
    marcher.run()
    assert "inverted or without water at here" in marcher.failures[0].reason("here")
    assert 0.0 < times[-1] < 100.0
    assert state.contents[0].min() > 0.2  # 1 - n_f0: never without water


def test_properties_that_vary_over_the_block() -> None:
    """The upper half is stiffer and tighter, and gives less water under the same load."""
    grid = block_grid("plane-strain", graded_nodes(2.0, 6), graded_nodes(1.0, 6))

    def tissue(points: Array) -> Tissue:
        upper = points[1][None] > 0.5
        return replace(
            reference_tissue(),
            youngs_modulus=np.where(upper, 2.0, 0.5), hydraulic_permeability=np.where(upper, 1e-4, 1e-3),
        )  # fmt: skip

    cells, faces = (Mixture(BIPHASIC, tissue(at), np.array([[0.93]])) for at in (grid.centres, grid.face_centres))
    system = BlockSystem(make_block(grid, UNCONFINED, cells, faces, tissue(integration_points(grid))))
    state = equilibrated_state(system, BATH)
    prescribed = {"bath": np.array([BATH]), "top.pressure": np.array([0.1])}
    for _ in range(3):
        solution = system.solve(state.unknowns, state.loads, Stage(state.contents, np.array([100.0]), prescribed))
        assert solution.converged.all()
        state = replace(state, unknowns=solution.unknowns, contents=solution.contents)
    J = block_fields(system.block, state)["volume_ratio"].reshape(6, 6)
    assert (J[:3, -1] < J[3:, -1]).all()


@by_kind
def test_fields(kind: str) -> None:
    """Vectors in cells recover a uniform flux; charged fields obey electroneutrality and Donnan."""
    system = block_system(rough_grid(kind), GLUED, ELECTROCHEMICAL)
    state = equilibrated_state(system, BATH)
    grid = system.block.grid
    positions = system.block.positions(state.unknowns[0, 0])
    uniform = np.array([0.0 if kind == "axisymmetric" else 0.3, -0.2])
    totals = uniform @ edge_area_vectors(grid.section, positions[:, grid.face_vertices])
    vectors = cell_vectors(system.block, positions, totals)
    np.testing.assert_allclose(vectors, np.broadcast_to(uniform[:, None], vectors.shape), rtol=0, atol=1e-13)
    fields = block_fields(system.block, state)
    c_plus, c_minus = fields["cation_concentration"], fields["anion_concentration"]
    np.testing.assert_allclose(c_plus - c_minus, fields["fixed_charge_density"], rtol=1e-12)
    np.testing.assert_allclose(c_plus * c_minus, BATH**2, rtol=1e-12)
    np.testing.assert_allclose(fields["fluid_pressure"], fields["osmotic_pressure"] + fields["water_potential"])
    assert np.abs(fields["displacement_y"][grid.edge_vertices("bottom")]).max() == 0.0
    assert fields["top_displacement"] > 0.0


@by_kind
def test_gradients_are_exact_for_linear_values(kind: str) -> None:
    block = block_system(rough_grid(kind), GLUED, ELECTROCHEMICAL).block
    positions = block.grid.vertices + 0.05 * np.sin(3.0 * block.grid.vertices[::-1])
    slope = np.array([0.7, -1.3])
    centres = positions[:, block.grid.cell_vertices].mean(axis=1)
    middles = positions[:, block.grid.face_vertices[:, block.term.diamonds.faces]].mean(axis=1)
    gradients = cell_gradients(block, positions, slope @ centres, slope @ middles)
    np.testing.assert_allclose(gradients, np.broadcast_to(slope[:, None], gradients.shape), rtol=1e-12)


@by_kind
def test_parts_of_ion_fluxes(kind: str) -> None:
    """They add up, and what is called migration is that in the gradient of the electric potential; to first order."""
    gaps = []
    for n in (8, 16, 32):
        grid = shaped_block_grid(kind, distorted_vertices(2 * n, n))
        system = block_system(grid, GLUED, ELECTROCHEMICAL)
        block, start = system.block, equilibrated_state(system, BATH)
        prescribed = {"bath": np.array([0.7 * BATH]), "top.pressure": np.array([0.05])}
        done = system.solve(start.unknowns, start.loads, Stage(start.contents, np.array([400.0]), prescribed))
        loads = start.loads | {"bath": prescribed["bath"]}
        state = replace(start, unknowns=done.unknowns, contents=done.contents, fluxes=done.fluxes, loads=loads)
        fields, tissue = block_fields(block, state), block.term.cells.tissue
        positions = block.positions(state.unknowns[0, 0])
        for axis in ("x", "y"):
            for ion in ("cation", "anion"):
                parts = [fields[f"{ion}_flux_{part}_{axis}"] for part in ("convection", "diffusion", "migration")]
                total = fields[f"{ion}_flux_{axis}"]
                np.testing.assert_allclose(sum(parts), total, rtol=1e-12, atol=1e-12 * np.abs(parts[1]).max())
        log_bath = np.full((1, len(block.term.diamonds.faces)), np.log(0.7 * BATH))
        outside = block.term.faces.at(done.contents[0][:, block.term.diamonds.cells[0]], log_bath)
        xi_outside = electric_potential(block.term.faces.tissue, outside.cation, log_bath, 0.0 * log_bath)[0]
        slope = cell_gradients(block, positions, fields["electric_potential"], xi_outside)
        mobility = (fields["fluid_fraction"] * tissue.cation_diffusivity * FARADAY / tissue.thermal_energy)[0]
        expected = -mobility * fields["cation_concentration"] * slope
        found = np.stack([fields["cation_flux_migration_x"], fields["cation_flux_migration_y"]])
        scale = np.abs([fields["cation_flux_diffusion_x"], fields["cation_flux_diffusion_y"]]).max()
        gaps.append(np.sqrt(((found - expected) ** 2).mean()) / scale)
    assert gaps[0] > 1.8 * gaps[1] > 1.8**2 * gaps[2], gaps
    assert gaps[2] < 0.01


@by_kind
@pytest.mark.parametrize("drive", ["force", "pressure"])
def test_reaction_of_a_tied_edge_is_its_own_beside_a_loaded_neighbour(kind: str, drive: str) -> None:
    system = block_system(rough_grid(kind), UNCONFINED, BIPHASIC)
    start = equilibrated_state(system, BATH)
    prescribed = {"bath": np.array([BATH]), f"top.{drive}": np.array([0.2]), "right.pressure": np.array([0.1])}
    done = system.solve(start.unknowns, start.loads, Stage(start.contents, np.array([100.0]), prescribed))
    assert done.converged.all()
    assert done.loads[f"top.{drive}"] == pytest.approx(0.2, rel=1e-10)
