"""A solute of the user's own on the mesh of a column that moves: FiPy's stock terms, against exact solutions."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fipy import CellVariable, CentralDifferenceConvectionTerm, DiffusionTerm, ImplicitSourceTerm, TransientTerm
from fipy_columns import setup
from integrations import equal_steps, make_column, make_control, parts_with
from tissues import reference_tissue

import fvswell
from fvswell.fipy import MovingColumn, direct_solver
from fvswell.numerics.loads import Load
from fvswell.physics.tissue import Array
from fvswell.simulation.setup import make_setup

ROOT = Path(__file__).parents[2]


def equation(column: MovingColumn, c: Any, drag: float, diffusivity: float, rate: float, at_ends: Array) -> Any:
    """The balance of a solute that has given concentrations at both ends."""
    inner = CentralDifferenceConvectionTerm(coeff=drag * column.water_flux * column.mesh.interiorFaces, var=c)
    at_end = drag * column.water_flux * at_ends
    return (
        TransientTerm(coeff=column.fluid_fraction, var=c)
        + inner
        + at_end.divergence
        - DiffusionTerm(coeff=diffusivity * column.fluid_fraction.faceValue, var=c)
        + ImplicitSourceTerm(coeff=rate * column.fluid_fraction, var=c)
    )


@pytest.mark.parametrize("control", [equal_steps(5), make_control(tolerance=1e-2)], ids=["equal", "chosen"])
@pytest.mark.parametrize("model", ["biphasic", "electrochemical"])
def test_uniform_concentration_stays_uniform_under_compression(model: str, control: Any) -> None:
    """Carried by the water without hindrance, and by nothing else: exact, however large the deformation."""
    column = MovingColumn(setup(make_column(model, cells=7), 300.0, control, pressure=0.25))
    c = CellVariable(mesh=column.mesh, value=3.0, hasOld=True)
    for step in column:
        c.updateOld()
        equation(column, c, 1.0, 0.0, 0.0, 3.0 * column.mesh.facesLeft).solve(dt=step.dt, solver=direct_solver())
    assert column.volume_ratio.value.mean() < 0.9
    np.testing.assert_allclose(c.value, 3.0, rtol=1e-13)


def test_decay_is_that_of_backward_euler_exactly() -> None:
    column = MovingColumn(setup(make_column("biphasic", cells=5), 100.0, equal_steps(5)))
    c = CellVariable(mesh=column.mesh, value=np.linspace(1.0, 2.0, 5), hasOld=True)
    expected = np.array(c.value)
    for step in column:
        c.updateOld()
        equation(column, c, 1.0, 0.0, 0.03, 0.0 * column.mesh.facesLeft).solve(dt=step.dt, solver=direct_solver())
        expected /= 1.0 + 0.03 * step.dt
    np.testing.assert_allclose(c.value, expected, rtol=1e-13)


def _permeation_error(cells: int) -> float:
    """Largest error of the steady concentration in a stiff column that water is pressed through."""
    stiff = reference_tissue(youngs_modulus=1e5)
    made = make_column("biphasic", stiff, cells, 1.0, parts=parts_with((True, True)))
    column = MovingColumn(setup(made, 1e7, equal_steps(2), filter_bath_pressure=0.4))
    mesh, drag, diffusivity = column.mesh, 0.6, 4e-4
    c = CellVariable(mesh=mesh, value=1.0, hasOld=True)
    c.constrain(1.0, mesh.facesLeft)
    c.constrain(0.2, mesh.facesRight)
    for step in column:
        c.updateOld()
        at_ends = 1.0 * mesh.facesLeft + 0.2 * mesh.facesRight
        equation(column, c, drag, diffusivity, 0.0, at_ends).solve(dt=step.dt, solver=direct_solver())
    q = 1e-3 * 0.4 / 0.5  # permeability times pressure over height
    np.testing.assert_allclose(column.water_flux.value, q, rtol=1e-4)
    peclet = drag * q / (diffusivity * 0.8)  # over the height, in 1/mm
    x = mesh.cellCenters.value[0]
    exact = 1.0 - 0.8 * np.expm1(peclet * x) / np.expm1(peclet * 0.5)
    return float(np.abs(c.value - exact).max())


def test_steady_advection_and_diffusion() -> None:
    """c = a + b exp(w q x/(n_f D)), at second order in the cells."""
    errors = [_permeation_error(cells) for cells in (10, 20, 40)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 3e-4, errors
    assert (orders > 1.8).all(), (errors, orders)


def test_mesh_and_fields_are_those_of_the_run() -> None:
    """Geometry, J, water flux and output fields at the end against the same case run as a whole."""
    case = fvswell.load_case(ROOT / "cases" / "confined_compression.toml").with_changes(
        {"geometry.cells": 8, "phase.0.duration": 200.0, "phase.1.duration": 100.0, "time.scheme": "backward-euler",
         "time.steps_per_phase": 4}
    )  # fmt: skip
    column, result = MovingColumn(make_setup(case)), fvswell.run(case)
    filter_flux = []
    for step in column:
        filter_flux.append(float(column.water_flux.value[0, 0]))
        now = result.sel(time=step.time, method="nearest")
        assert float(now["time"]) == pytest.approx(step.time)
        np.testing.assert_allclose(column.volume_ratio.value, now["volume_ratio"], rtol=1e-12)
        assert float(column.mesh.cellVolumes.sum()) == pytest.approx(float(now["height"]), rel=1e-12)
        np.testing.assert_allclose(column.fluid_fraction.value, now["fluid_fraction"], rtol=1e-12)
        np.testing.assert_allclose(column.water_flux.value[0], now["water_flux"], rtol=0, atol=1e-9)
        fields = column.fields()
        np.testing.assert_allclose(fields["electric_potential"], now["electric_potential"], rtol=1e-9, atol=1e-9)
    assert len(filter_flux) == 8
    assert min(filter_flux) < 0.0 < max(filter_flux)


def test_column_that_cannot_go_on_says_so() -> None:
    ramp = {"pressure": None, "height": Load(0.1, 5.0)}  # no room for the solid
    column = MovingColumn(setup(make_column("biphasic", cells=5), 10.0, equal_steps(4), **ramp))
    with pytest.raises(fvswell.SolverError, match="no step could be made after t = "):
        list(column)


def test_a_phase_that_ends_on_a_rate_has_to_be_given_its_duration() -> None:
    case = fvswell.load_case(ROOT / "cases" / "confined_compression.toml").with_changes(
        {"geometry.cells": 8, "phase.0.duration": 200.0, "phase.1.duration": 200.0, "phase.0.until": "1e-4 /min"}
    )
    with pytest.raises(fvswell.SolverError, match="phase loading ends on a rate: give its duration"):
        next(iter(MovingColumn(make_setup(case))))


def test_example_conserves_the_solute() -> None:
    """What is in the column, has been consumed and has entered: equal to 1e-10 after every step."""
    example = runpy.run_path(str(ROOT / "examples" / "solute_in_a_column.py"))
    case = fvswell.load_case(ROOT / "cases" / "confined_compression.toml").with_changes(
        {"geometry.cells": 8, "phase.0.duration": 200.0, "phase.1.duration": 200.0, "time.tolerance": 1e-2}
    )
    concentration, history = example["solute"](MovingColumn(make_setup(case)))
    _, amount, entered, consumed = history.T
    np.testing.assert_allclose(amount - amount[0], entered - consumed, rtol=0, atol=1e-12)
    assert consumed[-1] > 0.05
    assert np.abs(entered).max() > 0.01
    assert (np.diff(concentration) < 0.0).all()  # it is consumed on its way from the filter
