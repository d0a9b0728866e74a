"""The balances in FiPy's stock terms, the readable specification, against the coupled term that is used."""

from __future__ import annotations

import numpy as np
import pytest
from columns import compression, moved, single_phase
from test_transport_term import STIFFENING, dense

import fvswell
from fvswell.column.stock_terms import StockTermsTransport
from fvswell.physics.models import MODELS


@pytest.mark.parametrize(("changes", "seed"), [({}, 1), (STIFFENING, 2)], ids=["reference", "stiffening"])
@pytest.mark.parametrize("model", MODELS)
def test_matrix_residual_and_step_are_the_same(model: str, changes: dict[str, object], seed: int) -> None:
    """On a graded grid moved at random, each balance against its own largest entry."""
    term, unknowns, interval = moved(model, seed, **changes)
    stock = StockTermsTransport(term.grid, term.laws)
    coupled, stock_balance = term.balance(unknowns, interval), stock.balance(unknowns, interval)
    matrix = dense(term, unknowns, interval)
    stock_matrix, stock_by_pressure = stock.matrix(unknowns, interval, coupled)
    stock_matrix = stock_matrix.reshape(matrix.shape)
    for balance in range(len(unknowns)):
        scale = np.abs(matrix[balance]).max()
        assert np.abs(stock_matrix[balance] - matrix[balance]).max() < 1e-12 * scale
        residual, stock_residual = coupled.residual[balance], stock_balance.residual[balance]
        assert np.abs(stock_residual - residual).max() < 1e-12 * np.abs(residual).max()
    ours, theirs = (each.newton_step(unknowns, interval, coupled, with_pressure=True) for each in (term, stock))
    for one, other in zip(ours, theirs, strict=True):
        for variable in range(len(unknowns)):
            assert np.abs(one[variable] - other[variable]).max() < 1e-11 * np.abs(one[variable]).max()
    pressed = interval._replace(loads=interval.loads._replace(applied_pressure=interval.loads.applied_pressure + 1.0))
    rise = term.balance(unknowns, pressed).residual - coupled.residual
    np.testing.assert_allclose(stock_by_pressure, rise.ravel(), rtol=0, atol=1e-12 * np.abs(rise).max())


@pytest.mark.parametrize("model", MODELS)
def test_whole_run_is_the_same(model: str) -> None:
    """A ramp of the piston, whose pressure is found, in another bath."""
    ramp = {"piston_displacement": {"ramp_to": -0.03, "over": 100.0}, "bath_concentration": 1e-4}
    case = single_phase(compression(geometry__cells=4, geometry__grading=4, time__steps_per_phase=1), 100.0, **ramp)
    ours = fvswell.run(case, model)
    stock = fvswell.run(case.with_changes({"assembly": "stock-terms"}), model)
    np.testing.assert_array_equal(stock["step_iterations"], ours["step_iterations"])
    for name in ours.data_vars:
        if name.endswith("_error") or name == "step_residual":
            continue
        scale = float(np.abs(ours[name]).max())
        if name in ("current_density",):  # nothing but rounding: open circuit
            scale = float(np.abs(ours["anion_flux"]).max()) * 96.5
        np.testing.assert_allclose(stock[name], ours[name], rtol=0, atol=1e-10 * scale + 1e-300, err_msg=name)
    assert stock["volume_balance_error"].max() < 1e-10
