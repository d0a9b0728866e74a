"""Predictions for pistons that are held, loads that turn, sines and currents: small ones are the linear solution."""

from __future__ import annotations

import numpy as np
import pytest
from tissues import point_of, random_tissue, reference_tissue

from fvswell.exact.driven_column import DrivenColumn
from fvswell.exact.histories import History, PiecewiseLinear, Sine, ramp, step
from fvswell.exact.linear_swelling import LinearColumn
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import BIPHASIC_SWELLING, ELECTROCHEMICAL
from fvswell.physics.osmotic import osmotic_pressure_difference
from fvswell.physics.solids import uniaxial_stress
from fvswell.physics.tissue import Array, Tissue
from fvswell.prediction.conditions import Conditions, Course, kind_of_change, ramp_to
from fvswell.prediction.predictor import predict

BATH, SMALL = 1.5e-4, 1e-6
START = Conditions(0.0, BATH)
TABLE = Course(np.array([0.0, 20.0, 50.0]), np.array([0.0, SMALL, -0.5 * SMALL]))
STEPS = np.arange(1, 9) / 8


def linear(tissue: Tissue, measured: str, held: bool, loads: dict[str, History], time: Array) -> list[Array]:
    """Histories of both models, biphasic-swelling first."""
    columns = [LinearColumn.at_equilibrium(m, tissue, 0.5, 0.0, BATH) for m in (BIPHASIC_SWELLING, ELECTROCHEMICAL)]
    return [DrivenColumn(column, held, "anion").history(measured, loads, time) for column in columns]  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("conditions", "held", "loads"),
    [
        (Conditions(0.0, BATH, ramp_to(-SMALL, 30.0)), True, {"piston.displacement": ramp(-SMALL, 30.0)}),
        (Conditions(0.0, BATH - 1e-10, 0.0), True, {"filter.bath_concentration": step(-1e-10)}),
        (Conditions(0.0, ramp_to(BATH + 1e-10, 40.0), 0.0), True, {"filter.bath_concentration": ramp(1e-10, 40.0)}),
        (Conditions(0.0, BATH, TABLE), True, {"piston.displacement": PiecewiseLinear(TABLE.times, TABLE.values)}),
        (Conditions(TABLE, BATH), False, {"piston.pressure": PiecewiseLinear(TABLE.times, TABLE.values)}),
        (
            Conditions(Course(np.zeros(1), np.full(1, SMALL), SMALL, 60.0), BATH),
            False,
            {"piston.pressure": step(SMALL), "sine": Sine(SMALL, 60.0)},
        ),
        (
            Conditions(0.0, BATH, Course(np.zeros(1), np.zeros(1), SMALL, 60.0)),
            True,
            {"piston.displacement": Sine(SMALL, 60.0)},
        ),
    ],
    ids=["ramp", "isometric", "isometric ramp", "table held", "table", "sine", "sine held"],
)
def test_small_loads_follow_the_linear_solution(conditions: Conditions, held: bool, loads: dict[str, History]) -> None:
    tissue, time = random_tissue(6, seed=61), 100.0 * STEPS
    predicted = predict(tissue, 0.5, [START, conditions], 0.0, phase_duration=100.0, steps_per_phase=8)
    measured = "pressure" if held else "strain"
    loads = dict(loads)
    sine = loads.pop("sine", None)
    exact = linear(tissue, measured, held, loads, time)
    if sine is not None:
        exact = [
            a + b for a, b in zip(exact, linear(tissue, measured, held, {"piston.pressure": sine}, time), strict=True)
        ]
    start = 0.0
    if held:
        J = equilibrium_volume_ratio(tissue, 0.0, BATH)
        stress = uniaxial_stress(tissue.solid, J, tissue.fluid_fraction)
        start = (osmotic_pressure_difference(tissue, J, BATH) - stress)[:, None]
    assert predicted.measured == (measured,)
    for found, expected in zip((predicted.reduced, predicted.full), exact, strict=True):
        np.testing.assert_allclose(found[:, 0] - start, expected, rtol=2e-3, atol=2e-4 * np.abs(expected).max() + 1e-15)


def test_a_current_moves_the_full_model_only() -> None:
    tissue, time = random_tissue(4, seed=62), 100.0 * STEPS
    for held in (False, True):
        each = Conditions(0.0, BATH, 0.0 if held else None, ramp_to(1e-9, 20.0))
        predicted = predict(tissue, 0.5, [START, each], 0.0, phase_duration=100.0, steps_per_phase=8, electrode="anion")
        loads: dict[str, History] = {"filter.current": ramp(1e-9, 20.0)}
        column = LinearColumn.at_equilibrium(ELECTROCHEMICAL, tissue, 0.5, 0.0, BATH)
        expected = DrivenColumn(column, held, "anion").history("pressure" if held else "strain", loads, time)
        np.testing.assert_allclose(predicted.full[:, 0], expected, rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(predicted.reduced[:, 0], 0.0, atol=1e-12)


def test_a_held_column_comes_to_the_pressure_of_its_height() -> None:
    """Finite displacements and baths, in both models: sigma_s(J) + P = pi - pi_bath."""
    tissue = random_tissue(20, seed=63)
    J = equilibrium_volume_ratio(tissue, 0.0, BATH)
    low = J - 0.06 / 0.5
    phases = [START, Conditions(0.0, BATH, ramp_to(-0.06, 50.0)), Conditions(0.0, 1e-4, -0.06)]
    predicted = predict(tissue, 0.5, phases, phase_duration=1e7, steps_per_phase=2)
    for p, bath in enumerate((BATH, 1e-4)):
        stress = uniaxial_stress(tissue.solid, low, tissue.fluid_fraction)
        pressure = osmotic_pressure_difference(tissue, low, bath) - stress
        for found in (predicted.reduced, predicted.full):
            np.testing.assert_allclose(found[:, p, -1], pressure, rtol=1e-5)
        np.testing.assert_allclose(predicted.equilibrium_pressure[:, p], pressure, rtol=1e-12)
        np.testing.assert_allclose(predicted.equilibrium_strain[:, p], low / J - 1, rtol=1e-12)


def test_piston_that_is_caught_where_its_pressure_left_it() -> None:
    """Pressed into equilibrium, held there while the bath changes, and let go: strains and pressures go on."""
    tissue = reference_tissue()
    J0, J1, J2 = (equilibrium_volume_ratio(tissue, *loads) for loads in ((0.0, BATH), (0.1, BATH), (0.1, 1.4e-4)))
    where = 0.5 * float(J1 - J0)
    phases = [START, Conditions(0.1, BATH), Conditions(0.0, 1.4e-4, where), Conditions(0.1, 1.4e-4)]
    predicted = predict(tissue, 0.5, phases, phase_duration=1e6, steps_per_phase=100)
    assert predicted.measured == ("strain", "pressure", "strain")
    assert predicted.full[0, 0, -1] == pytest.approx(float(J1 / J0) - 1, rel=1e-6)
    assert predicted.reduced[0, 1, 0] > 0.1  # a weaker bath pushes harder
    assert predicted.equilibrium_pressure[0, 1] == pytest.approx(predicted.full[0, 1, -1], rel=1e-6)
    assert predicted.full[0, 2, -1] == pytest.approx(float(J2 / J0) - 1, rel=1e-6)


def test_a_sine_leaves_what_it_ends_with() -> None:
    """A quarter of a period up, and on from there."""
    tissue = random_tissue(4, seed=64)
    quarter = Conditions(Course(np.zeros(1), np.zeros(1), SMALL, 400.0), BATH)
    after = Conditions(SMALL, BATH)
    predicted = predict(tissue, 0.5, [START, quarter, after], 0.0, phase_duration=100.0, steps_per_phase=8)
    time = np.concatenate([100.0 * STEPS, 100.0 + 100.0 * STEPS])
    exact = linear(tissue, "strain", False, {"piston.pressure": Sine(SMALL, 400.0, 0.0, 100.0)}, time)
    for found, expected in zip((predicted.reduced, predicted.full), exact, strict=True):
        np.testing.assert_allclose(found.reshape(4, -1), expected, rtol=2e-3, atol=1e-4 * np.abs(expected).max())


def test_rows_of_held_columns_equal_columns_by_themselves() -> None:
    tissue = random_tissue(30, seed=65)
    phases = [START, Conditions(0.0, 1e-4, ramp_to(-0.01, 30.0))]
    together = predict(tissue, 0.5, phases, phase_duration=200.0)
    for row in (0, 17):
        alone = predict(point_of(tissue, row), 0.5, phases, phase_duration=200.0)
        np.testing.assert_allclose(together.full[row], alone.full[0], rtol=1e-9)


def test_a_load_that_turns_needs_a_duration_and_is_of_no_kind() -> None:
    with pytest.raises(ValueError, match="needs a duration"):
        predict(reference_tissue(), 0.5, [START, Conditions(TABLE, BATH)])
    kinds = [
        kind_of_change(START, each).item()
        for each in (Conditions(TABLE, BATH), Conditions(0.0, 1e-4, 0.0), Conditions(0.1, BATH, None, 1e-9))
    ]
    assert kinds == [-1, -1, -1]


def test_mean_of_a_course() -> None:
    """A triangle after a lead, and a value that is kept."""
    course = Course(np.array([10.0, 30.0, 50.0]), np.array([0.0, 2.0, 1.0]))
    before, duration = np.zeros(1), np.array([100.0])
    assert course.mean(before, duration).item() == pytest.approx((20.0 + 30.0 + 50.0) / 100.0)
    assert course.final().item() == 1.0
    assert course.turns(before)
    assert not ramp_to(1.0, 5.0).turns(before)
