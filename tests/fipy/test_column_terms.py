"""The balances of a column as FiPy Terms: ours from the kernels, and FiPy's own."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from fipy import CellVariable, TransientTerm
from fipy_columns import Moved, dense, moved, setup, values
from integrations import equal_steps, make_column, parts_with

from fvswell.column.column import compiled_march
from fvswell.fipy import ColumnFluxTerm, StockTerms, column_mesh, contents_variable, direct_solver
from fvswell.fipy.body import FluxTermEquation
from fvswell.fipy.terms import call_balances
from fvswell.numerics.state import record_room, workspace
from fvswell.physics.models import MODELS
from fvswell.physics.tissue import Array

ENDS = {
    "filter": parts_with(), "both": parts_with((True, True)), "piston": parts_with((False, True), ("insulating", "")),
    "cation electrode": parts_with((True, False), ("grounded", "current"), ("bath", "cation")),
    "anion electrode": parts_with((True, False), ("grounded", "current"), ("bath", "anion")),
    "electrode at the filter": parts_with((False, True), ("current", "grounded"), ("anion", "bath")),
}  # fmt: skip
DURATION = 2.0


def outflow(state: Moved, body: Any, contents: Array) -> Array:
    """Rate of storage and outflow of every quantity, from the kernels."""
    call_balances(
        body.evaluate, body.cells, body.faces, body.metric, np.ascontiguousarray(contents), state.loads,
        body.ends, body.fluxes, body.by_lower, body.by_upper, body.by_pressure, body.by_current, body.potentials,
    )  # fmt: skip
    storage = body.widths * (contents - state.base) / DURATION
    return (storage + np.diff(body.fluxes[: len(contents)], axis=1)).ravel()


def condensed(matrix: Array, residual: Array, widths: Array, unknowns: int) -> tuple[Array, Array]:
    """Matrix and residual of the contents alone, the potentials eliminated; FiPy's first unknown is the width."""
    scaled = matrix.copy()
    scaled[:, : len(widths)] *= widths
    kept, gone = slice(unknowns), slice(unknowns, None)
    share = scaled[kept, gone] @ np.linalg.inv(scaled[gone, gone])
    return scaled[kept, kept] - share @ scaled[gone, kept], residual[kept] - share @ residual[gone]


@pytest.mark.parametrize("ends", ENDS)
@pytest.mark.parametrize("model", MODELS)
def test_matrix_of_the_term_is_the_derivative_of_the_balances(model: str, ends: str) -> None:
    """Central differences of fourth order, each balance against its largest entry."""
    state = moved(model, seed=1, parts=ENDS[ends])
    body = state.column.body(state.J)
    equation = FluxTermEquation(state.column, body)
    equation.set_iterate(state.contents, state.base, state.loads)
    matrix, residual = dense(equation.equation, DURATION)
    np.testing.assert_allclose(residual, outflow(state, body, state.contents), rtol=0, atol=1e-14)
    n = len(body.widths)
    for place in range(state.contents.size):
        step = np.zeros(state.contents.size)
        h = step[place] = 1e-3 * state.contents.flat[place]
        one, two = (
            outflow(state, body, state.contents + k * step.reshape(-1, n))
            - outflow(state, body, state.contents - k * step.reshape(-1, n))
            for k in (1, 2)
        )
        error = np.abs(matrix[:, place] - (8.0 * one - two) / (12.0 * h)).reshape(-1, n).max(axis=1)
        scale = np.abs(matrix[:, place]).reshape(-1, n).max(axis=1)
        assert (error < 1e-8 * scale + 1e-13).all()


@pytest.mark.parametrize("open_circuit", ["initial", "state"])
@pytest.mark.parametrize("ends", ENDS)
@pytest.mark.parametrize("model", MODELS)
def test_stock_terms_have_the_same_matrix_residual_and_step(model: str, ends: str, open_circuit: str) -> None:
    """On a graded grid moved at random, each balance against its own largest entry."""
    state = moved(model, seed=2, parts=ENDS[ends], open_circuit=open_circuit)
    ours = FluxTermEquation(state.column, state.column.body(state.J))
    stock = StockTerms(state.column, state.J)
    for equation in (ours, stock):
        equation.set_iterate(state.contents, state.base, state.loads)
    matrix, residual = dense(ours.equation, DURATION)
    n = len(state.column.grid.widths)
    stock_matrix, stock_residual = condensed(
        *dense(stock.equations, DURATION), state.column.grid.widths, state.contents.size
    )
    for first in range(0, len(residual), n):
        rows = slice(first, first + n)
        assert np.abs(stock_matrix - matrix)[rows].max() < 1e-12 * np.abs(matrix[rows]).max()
        assert np.abs(stock_residual - residual)[rows].max() < 1e-12 * np.abs(residual[rows]).max()
    for rise in (0.0, 1.0):
        one, other = (e.sweep(state.contents, state.base, DURATION, state.loads, rise) for e in (ours, stock))
        change = np.abs(one - state.contents).max(axis=1)
        assert (np.abs(other - one).max(axis=1) < 1e-11 * change).all()


@pytest.mark.parametrize("model", MODELS)
def test_sweeps_converge_quadratically_to_the_solution_of_the_integrator(model: str) -> None:
    """The term is an equation in FiPy's sense: a loop of FiPy's own finds the step that the integrator finds."""
    run = setup(make_column(model, cells=9), 100.0, equal_steps(1), pressure=0.2)
    contents = run.state.contents.copy()
    variable = contents_variable(column_mesh(run.column.grid), contents)
    flux = ColumnFluxTerm(run.column.body(run.initial_volume_ratio), variable, values(pressure=0.2))
    equation = TransientTerm(var=variable) + flux
    iterates = []
    for _ in range(8):
        equation.sweep(dt=100.0, solver=direct_solver())
        iterates.append(np.array(variable.value))
    record, work = record_room(run.state, 1, 1), workspace(run.state, 1)
    compiled_march(run.body, run.volumes, run.scale, run.protocol([100.0]), run.control(), run.state, record, work)
    scale = np.abs(run.state.contents - contents).max(axis=1, keepdims=True)
    error = [np.abs((iterate - run.state.contents) / scale).max() for iterate in iterates]
    assert error[-1] < 1e-10
    above = [value for value in error if value > 1e-8]
    assert all(after < 20.0 * before**2 for before, after in pairwise(above[1:]))


@pytest.mark.parametrize("negated", [False, True])
def test_sources_can_be_added(negated: bool) -> None:
    """Water that is injected into a shut column under a held pressure stays in its cells; on either side of ``==``."""
    column = make_column("biphasic", cells=9, parts=parts_with((False, False), ("insulating", "insulating")))
    J = column.initial_volume_ratio()
    mesh = column_mesh(column.grid)
    variable = contents_variable(mesh, column.contents(J, column.concentration))
    flux = ColumnFluxTerm(column.body(J), variable, values(pressure=0.1))
    source = CellVariable(mesh=mesh, value=2e-4 * np.linspace(1.0, 2.0, len(J)), elementshape=(1,))
    storage = TransientTerm(var=variable)
    equation = (storage == -flux + source) if negated else storage + flux - source
    for _ in range(6):
        equation.sweep(dt=50.0, solver=direct_solver())
    injected = 50.0 * 2e-4 * np.linspace(1.0, 2.0, len(J)) @ column.grid.widths
    gained = (variable.value[0] - J) @ column.grid.widths
    assert gained == pytest.approx(injected, rel=1e-12)
    assert not np.allclose(variable.value[0] - J, 50.0 * source.value[0], rtol=1e-2)  # it has flowed


def test_small_steps_are_not_left_out() -> None:
    """A load too small for the default tolerance of FiPy's solver moves the column by what the matrix says."""
    column = make_column("electrochemical", cells=9)
    J = column.initial_volume_ratio()
    equation = FluxTermEquation(column, column.body(J))
    contents = column.contents(J, column.concentration)
    large, small = (equation.sweep(contents, contents, 1.0, values(pressure=p), 0.0) - contents for p in (1e-6, 1e-12))
    np.testing.assert_allclose(small[0] * 1e6, large[0], rtol=1e-3, atol=1e-3 * np.abs(large[0]).max())
