"""The coupled term: its grid, its exact Jacobian, FiPy's view of it, and Newton's method on it."""

from __future__ import annotations

from types import SimpleNamespace

import fipy
import numpy as np
import pytest
from columns import compression, moved, single_phase, stage_of

import fvswell
import fvswell.column.grid
from fvswell.column.grid import column_grid
from fvswell.column.linearisation import band_storage, cell_blocks
from fvswell.column.newton import ColumnSystem
from fvswell.column.transport_term import CoupledTransportTerm, Interval
from fvswell.physics.models import MODELS
from fvswell.physics.tissue import Array
from fvswell.simulation.column_batch import ColumnBatch

STIFFENING = {
    "tissue.solid": "holmes-mow", "tissue.stiffening_coefficient": 0.7, "tissue.permeability_exponent": 2.0,
    "tissue.activity_ratio": 0.8, "open_circuit_permeability": "state",
}  # fmt: skip


# ---- the grid --------------------------------------------------------------------------------------------


def test_grid_is_fipys() -> None:
    """What is read from FiPy's private arrays, against its public ones and plain arithmetic."""
    grid = column_grid(0.5, 7, 5.0)
    np.testing.assert_allclose(grid.nodes, grid.mesh.faceCenters.value[0], rtol=1e-15)
    np.testing.assert_allclose(np.diff(grid.nodes), grid.widths, rtol=1e-12)
    np.testing.assert_allclose(grid.centres, 0.5 * (grid.nodes[1:] + grid.nodes[:-1]), rtol=1e-12)
    points = np.append(grid.nodes[0], grid.centres)  # the filter, then the cells
    np.testing.assert_allclose(grid.distances, np.diff(points), rtol=1e-12)
    assert grid.nodes[[0, -1]] == pytest.approx([0.0, 0.5], abs=1e-15)
    assert grid.widths[-1] / grid.widths[0] == pytest.approx(5.0)
    np.testing.assert_allclose(grid.widths[1:] / grid.widths[:-1], 5.0 ** (1 / 6), rtol=1e-12)


def test_stretch_of_the_faces_is_the_moved_distance_between_points() -> None:
    grid = column_grid(0.5, 9, 8.0)
    J = np.random.default_rng(1).uniform(0.5, 1.5, (3, 9))
    nodes = np.concatenate([np.zeros((3, 1)), np.cumsum(J * grid.widths, axis=1)], axis=1)
    points = np.concatenate([nodes[:, :1], 0.5 * (nodes[:, 1:] + nodes[:, :-1])], axis=1)
    np.testing.assert_allclose(grid.face_stretch(J), np.diff(points, axis=1) / grid.distances, rtol=1e-12)


def test_another_order_of_fipys_faces_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def reordered(dx: Array) -> SimpleNamespace:
        mesh = fipy.Grid1D(dx=dx)
        return SimpleNamespace(_adjacentCellIDs=tuple(ids[::-1] for ids in mesh._adjacentCellIDs))

    monkeypatch.setattr(fvswell.column.grid, "Grid1D", reordered)
    with pytest.raises(RuntimeError, match="orders the faces of a Grid1D differently"):
        column_grid(0.5, 5, 2.0)


# ---- the Jacobian ----------------------------------------------------------------------------------------


def dense(term: CoupledTransportTerm, unknowns: Array, interval: Interval) -> Array:
    """Jacobian of one row, (balances, cells, balances, cells), from the blocks."""
    blocks = cell_blocks(term.grid.widths, interval.duration, term.linearise(term.balance(unknowns, interval)))
    V, _, _, n = blocks[0].shape
    matrix, cells = np.zeros((V, n, V, n)), np.arange(n)
    for block, shift in zip(blocks, (0, -1, 1), strict=True):
        own = cells[max(0, -shift) : n - max(0, shift)]
        matrix[:, own, :, own + shift] += np.moveaxis(block[:, :, 0], -1, 0)
    return matrix


@pytest.mark.parametrize("changes", [{}, STIFFENING], ids=["reference", "stiffening"])
@pytest.mark.parametrize("model", MODELS)
def test_jacobian_is_the_derivative_of_the_residual(model: str, changes: dict[str, object]) -> None:
    """Central differences of fourth order, extrapolated: good to 1e-9 of each balance's largest entry."""
    term, unknowns, interval = moved(model, seed=1, **changes)
    matrix = dense(term, unknowns, interval)

    def slope(step: Array) -> Array:
        one, two = (
            term.balance(unknowns + k * step, interval).residual - term.balance(unknowns - k * step, interval).residual
            for k in (1, 2)
        )
        return ((8 * one - two) / 12)[:, 0]

    h = 2e-3
    for variable in range(len(unknowns)):
        for cell in range(unknowns.shape[2]):
            step = np.zeros_like(unknowns)
            step[variable, 0, cell] = h
            expected = (16 * slope(step / 2) * 2 - slope(step)) / 15 / h
            scale = np.abs(matrix[:, :, variable]).max(axis=(1, 2))[:, None]
            assert np.all(np.abs(matrix[:, :, variable, cell] - expected) < 1e-9 * scale)


@pytest.mark.parametrize("model", MODELS)
def test_bands_hold_the_same_matrix(model: str) -> None:
    term, unknowns, interval = moved(model, seed=2)
    linear = term.linearise(term.balance(unknowns, interval))
    bands = band_storage(cell_blocks(term.grid.widths, interval.duration, linear))
    size, bandwidth = len(bands), 2 * len(unknowns) - 1
    column, place = np.nonzero(bands)
    matrix = np.zeros((size, size))
    matrix[column + place - 2 * bandwidth, column] = bands[column, place]
    cell_major = np.moveaxis(dense(term, unknowns, interval), (0, 2), (1, 3)).reshape(size, size)
    np.testing.assert_array_equal(matrix, cell_major)


@pytest.mark.parametrize("with_pressure", [False, True])
@pytest.mark.parametrize("model", MODELS)
def test_newton_step_solves_the_whole_system(model: str, with_pressure: bool) -> None:
    """The electric potential condensed face by face, against the dense system in all unknowns."""
    term, unknowns, interval = moved(model, seed=3)
    balance = term.balance(unknowns, interval)
    step = term.newton_step(unknowns, interval, balance, with_pressure)
    shape, size = unknowns.shape, unknowns.size
    matrix = dense(term, unknowns, interval).reshape(size, size)
    expected = np.linalg.solve(matrix, -balance.residual.ravel()).reshape(shape)
    for variable in range(len(unknowns)):
        scale = np.abs(expected[variable]).max()
        np.testing.assert_allclose(step.step[variable], expected[variable], atol=1e-12 * scale, rtol=0)
    if not with_pressure:
        assert step.by_pressure is None
        return
    pressed = interval._replace(loads=interval.loads._replace(applied_pressure=interval.loads.applied_pressure + 1.0))
    rise = term.balance(unknowns, pressed).residual - balance.residual  # linear in the pressure
    expected = np.linalg.solve(matrix, -rise.ravel()).reshape(shape)
    np.testing.assert_allclose(step.by_pressure, expected, atol=1e-11 * np.abs(expected).max(), rtol=0)


# ---- as a FiPy Term --------------------------------------------------------------------------------------


def bound(
    model: str, seed: int
) -> tuple[CoupledTransportTerm, Array, Interval, fipy.CellVariable, CoupledTransportTerm]:
    term, unknowns, interval = moved(model, seed)
    variable = fipy.CellVariable(mesh=term.grid.mesh, value=unknowns[:, 0], elementshape=(len(unknowns),))
    return term, unknowns, interval, variable, term.bind(variable, interval)


@pytest.mark.parametrize("model", MODELS)
def test_fipy_sees_matrix_and_residual(model: str) -> None:
    term, unknowns, interval, _, equation = bound(model, seed=4)
    equation.cacheMatrix()
    residual = np.array(equation.justResidualVector())
    matrix = np.array(equation.matrix.numpyArray)
    np.testing.assert_array_equal(matrix, dense(term, unknowns, interval).reshape(matrix.shape))
    expected = term.balance(unknowns, interval).residual
    np.testing.assert_allclose(residual.ravel(), expected.ravel(), rtol=0, atol=1e-13 * np.abs(matrix).max())


@pytest.mark.parametrize("model", MODELS)
def test_sweep_of_fipy_is_the_newton_step(model: str) -> None:
    term, unknowns, interval, variable, equation = bound(model, seed=5)
    step = term.newton_step(unknowns, interval, term.balance(unknowns, interval), False).step
    equation.sweep(variable)
    np.testing.assert_allclose(variable.value, (unknowns + step)[:, 0], rtol=1e-11, atol=1e-11)


def test_sweeps_of_fipy_converge_to_the_solution() -> None:
    """The term is an equation in FiPy's sense: a loop of FiPy's own reaches what the solver finds."""
    batch = ColumnBatch.of([compression(geometry__cells=8)])
    start = batch.start()
    _, _, interval = moved("electrochemical", seed=1)
    interval = interval._replace(base=start.contents)
    variable = fipy.CellVariable(mesh=batch.grid.mesh, value=start.unknowns[:, 0], elementshape=(3,))
    equation = batch.system.term.bind(variable, interval)
    for _ in range(8):
        equation.sweep(variable)
    solution = batch.system.solve(start.unknowns, start.loads, stage_of(interval))
    assert solution.converged.all()
    np.testing.assert_allclose(variable.value, solution.unknowns[:, 0], rtol=1e-11, atol=1e-12)


def test_unbound_term_says_what_is_missing() -> None:
    term, unknowns, _ = moved("electrochemical", seed=1)
    variable = fipy.CellVariable(mesh=term.grid.mesh, value=unknowns[:, 0], elementshape=(3,))
    with pytest.raises(ValueError, match="bind the term to a variable and an interval"):
        term.justResidualVector(variable)


# ---- Newton's method -------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", MODELS)
def test_newton_converges_quadratically(model: str) -> None:
    """What is left after a step is a constant times the square of the error before."""
    case = compression(geometry__cells=12).with_changes(STIFFENING)
    batch = ColumnBatch.of([case], MODELS[model])
    start = batch.start()
    _, _, interval = moved(model, seed=1)
    loads = interval.loads._replace(applied_pressure=np.array([[0.25]]))
    interval = interval._replace(base=start.contents, duration=np.array([[100.0]]), loads=loads)
    term, unknowns, iterates = batch.system.term, start.unknowns, [start.unknowns]
    for _ in range(10):
        unknowns = unknowns + term.newton_step(unknowns, interval, term.balance(unknowns, interval), False).step
        iterates.append(unknowns)
    error = np.array([np.abs(iterate - iterates[-1]).max() for iterate in iterates[:-1]])
    assert error[-2] < 1e-13
    before, last = error[error > 1e-12][-3:-1], error[error > 1e-12][-2:]
    order = np.diff(np.log(last)) / np.diff(np.log(before))
    assert order.item() > 1.75


@pytest.mark.parametrize("model", MODELS)
def test_rows_iterate_as_they_would_alone(model: str) -> None:
    """Three columns with their own steps, loads and baths: as many iterations, the same result to rounding."""
    cases = [compression(geometry__cells=10, tissue__youngs_modulus=E) for E in (0.1, 0.3, 0.5)]
    batch = ColumnBatch.of(cases, MODELS[model])
    start = batch.start()
    _, _, one = moved(model, seed=1)
    prescribed = {
        "pressure": np.array([1e-6, 0.1, np.nan]), "bath": np.array([1.5e-4, 1e-4, 2e-4]),
        "height": np.array([np.nan, np.nan, 0.51]),
    }  # fmt: skip
    stage = stage_of(one)._replace(base=start.contents, duration=np.array([1e-3, 30.0, 200.0]), prescribed=prescribed)
    together = batch.system.solve(start.unknowns, start.loads, stage)
    assert together.converged.all()
    assert len(set(together.iterations)) > 1
    for row in range(3):
        index = np.array([row])
        system: ColumnSystem = batch.system.rows(index)
        own = stage._replace(
            base=stage.base[:, index], duration=stage.duration[index],
            prescribed={name: value[index] for name, value in prescribed.items()},
        )  # fmt: skip
        alone = system.solve(start.unknowns[:, index], {k: v[index] for k, v in start.loads.items()}, own)
        assert alone.iterations[0] == together.iterations[row]
        np.testing.assert_allclose(alone.unknowns[:, 0], together.unknowns[:, row], rtol=1e-12, atol=1e-13)
        assert alone.loads["pressure"][0] == pytest.approx(together.loads["pressure"][row], rel=1e-11)


@pytest.mark.parametrize("model", MODELS)
def test_moving_piston_takes_no_smaller_steps(model: str) -> None:
    """The piston's pressure is found from a sample at rest: a hundred seconds of a ramp in one step."""
    ramp = {"piston_displacement": {"ramp_to": -0.03, "over": 100.0}}
    result = fvswell.run(single_phase(compression(geometry__cells=5, time__steps_per_phase=1), 100.0, **ramp), model)
    assert result.sizes["step"] == 1
    assert result["step_iterations"][0] <= 6


def test_fast_ions_take_no_smaller_steps() -> None:
    """Rounding of large fluxes keeps the residual up; the unknowns are as good as they can be all the same."""
    fast = {"tissue.cation_diffusivity": 5.0, "tissue.anion_diffusivity": 8.0}
    case = compression(geometry__cells=20, time__steps_per_phase=15).with_changes(fast)
    result = fvswell.run(case)
    assert result.sizes["step"] == 30


def test_next_to_no_load_is_no_trouble() -> None:
    case = compression(geometry__cells=5, time__steps_per_phase=3, phase__loading__piston_pressure=1e-290)
    assert np.abs(fvswell.run(case)["global_strain"]).max() < 1e-14
