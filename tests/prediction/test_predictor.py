"""The predictor: the linear histories of both models, their R^2, and what it says where it cannot say."""

from __future__ import annotations

import numpy as np
import pytest
from tissues import point_of, random_tissue, reference_tissue

from fvswell.exact.linear_swelling import LinearColumn
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import BIPHASIC_SWELLING, ELECTROCHEMICAL
from fvswell.physics.osmotic import ion_concentrations
from fvswell.physics.permeability import open_circuit_ratio
from fvswell.physics.tissue import Array, Tissue, fixed_charge_density
from fvswell.prediction.conditions import Conditions, ramp_to
from fvswell.prediction.determination import coefficient_of_determination
from fvswell.prediction.predictor import Prediction, predict

START = Conditions(piston_pressure=0.0, bath_concentration=1.5e-4)
COMPRESSED = Conditions(piston_pressure=0.25, bath_concentration=1.5e-4)
INITIAL = np.array([0.0, 1.0])  # linearised about the first equilibrium in both phases
DILUTED = Conditions(piston_pressure=0.0, bath_concentration=1e-4)
PROTOCOLS = pytest.mark.parametrize("loaded", [COMPRESSED, DILUTED], ids=["compression", "swelling"])


def prediction(tissue: Tissue, loaded: Conditions, **options: Array | float) -> Prediction:
    return predict(tissue, 0.5, [START, loaded, START], **options)


def test_r_squared_by_hand() -> None:
    """Data 1, 2, 3 about 2 have the sum of squares 2; residuals 0, 1, 0."""
    assert coefficient_of_determination(np.array([1.0, 2, 3]), np.array([1.0, 3, 3])) == pytest.approx(0.5)
    data = np.array([[1.0, 2, 3], [1, 2, 3], [1, 2, 3], [2, 2, 2]])
    model = np.array([[1.0, 2, 3], [2, 2, 2], [3, 2, 1], [2, 2, 2]])
    np.testing.assert_allclose(coefficient_of_determination(data, model), [1.0, 0.0, -3.0, np.nan])


@pytest.mark.parametrize(("pressure", "concentration"), [(1e-6, 0.0), (0.0, -1e-9)])
def test_small_steps_follow_the_linear_solution(pressure: float, concentration: float) -> None:
    tissue = random_tissue(20, seed=21)
    loaded = Conditions(pressure, 1.5e-4 + concentration)
    predicted = prediction(tissue, loaded, linearised_at=INITIAL, steps_per_phase=8)
    time = predicted.phase_duration[:, :1] * np.arange(1, 9) / 8
    models = (BIPHASIC_SWELLING, predicted.reduced), (ELECTROCHEMICAL, predicted.full)
    for model, strain in models:
        column = LinearColumn.at_equilibrium(model, tissue, 0.5, 0.0, 1.5e-4)
        loading = column.global_strain(time, pressure, concentration)
        np.testing.assert_allclose(strain[:, 0], loading, rtol=1e-4, atol=1e-5 * np.abs(loading).max())
        later = column.global_strain(time + predicted.phase_duration[:, :1], pressure, concentration)
        np.testing.assert_allclose(strain[:, 1], later - loading, rtol=1e-4, atol=1e-5 * np.abs(loading).max())


@PROTOCOLS
def test_both_models_come_to_the_equilibrium_of_the_finite_step(loaded: Conditions) -> None:
    tissue = random_tissue(50, seed=22)
    first, last = (equilibrium_volume_ratio(tissue, *c[:2]) for c in (START, loaded))
    long = prediction(tissue, loaded, phase_duration=1e8, steps_per_phase=4)
    for strain in (long.reduced, long.full):
        np.testing.assert_allclose(strain[:, 0, -1], last / first - 1, rtol=1e-9)
        np.testing.assert_allclose(strain[:, 1, -1], 0.0, atol=1e-12)


@PROTOCOLS
def test_phase_lasts_one_and_a_half_relaxation_times(loaded: Conditions) -> None:
    """At two thirds of the phase the reduced model is 1 % short of its final strain."""
    tissue = random_tissue(10, seed=23)
    predicted = prediction(tissue, loaded, steps_per_phase=3)
    final = prediction(tissue, loaded, phase_duration=1e8).reduced[:, 0, -1]
    np.testing.assert_allclose(predicted.reduced[:, 0, 1], 0.99 * final, rtol=1e-12)


@PROTOCOLS
def test_rows_equal_columns_by_themselves(loaded: Conditions) -> None:
    tissue = random_tissue(200, seed=24)
    share = np.linspace(0, 1, 200)[:, None]
    together = prediction(tissue, loaded, linearised_at=share)
    for row in (0, 77, 199):
        alone = prediction(point_of(tissue, row), loaded, linearised_at=share[row].item())
        np.testing.assert_allclose(together.r_squared[row], alone.r_squared[0], rtol=1e-10)
        np.testing.assert_allclose(together.full[row], alone.full[0], rtol=1e-10, atol=1e-15)


def test_fast_ions_make_the_models_one() -> None:
    """Ions that diffuse at once stay in equilibrium with the bath; sluggish ones do not."""
    factor = np.array([1e-2, 1.0, 1e6])
    tissue = reference_tissue(cation_diffusivity=5e-4 * factor, anion_diffusivity=8e-4 * factor)
    for loaded in (COMPRESSED, DILUTED):
        slow, reference, fast = prediction(tissue, loaded).r_squared
        np.testing.assert_allclose(fast, 1.0, atol=1e-6)
        assert np.all(slow < reference)
        assert np.all(reference < fast)


def test_reference_tissue() -> None:
    """The reduced model serves in compression and lags in swelling, as Wilson et al. (2005) found."""
    compression, swelling = (prediction(reference_tissue(), c) for c in (COMPRESSED, DILUTED))
    assert np.all(compression.r_squared > 0.999)
    assert np.all(compression.r_squared[:, 1] > compression.r_squared[:, 0])
    assert np.all((swelling.r_squared > 0.6) & (swelling.r_squared < 0.95))
    assert swelling.largest_difference[0, 0] < 0 < swelling.largest_difference[0, 1]


def test_largest_difference_is_found_in_the_histories() -> None:
    predicted = prediction(random_tissue(30, seed=25), DILUTED)
    difference = predicted.reduced - predicted.full
    np.testing.assert_array_equal(np.abs(predicted.largest_difference), np.abs(difference).max(axis=-1))
    step = predicted.time_of_largest_difference / predicted.phase_duration * 50 - 1
    indices = np.rint(step).astype(int)
    np.testing.assert_allclose(step, indices, atol=1e-9)
    at_step = np.take_along_axis(difference, indices[..., None], axis=-1)[..., 0]
    np.testing.assert_array_equal(at_step, predicted.largest_difference)


def test_negative_osmosis_shows_in_the_first_strains() -> None:
    tissue = random_tissue(400, seed=26)
    predicted = prediction(tissue, DILUTED, phase_duration=1e-3)
    backward = predicted.full[:, 0, 0] < 0
    np.testing.assert_array_equal(predicted.flows_backward_first[:, 0], backward)
    assert 0 < backward.sum() < 100
    assert np.all(predicted.reduced[:, 0, 0] > 0)  # the reduced model cannot do it


def test_constant_open_circuit_permeability() -> None:
    tissue = random_tissue(5, seed=27)
    J = equilibrium_volume_ratio(tissue, *START[:2])
    ions = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), np.log(1.5e-4))
    ratio = open_circuit_ratio(tissue, J, *ions)
    own, given = (prediction(tissue, COMPRESSED, linearised_at=INITIAL, open_circuit_ratio=r) for r in (None, ratio))
    np.testing.assert_allclose(given.r_squared, own.r_squared, rtol=1e-12)
    halved = prediction(tissue, COMPRESSED, linearised_at=INITIAL, open_circuit_ratio=0.5 * ratio)
    np.testing.assert_allclose(halved.phase_duration, 2 * own.phase_duration, rtol=1e-12)


def test_no_signal_has_no_r_squared() -> None:
    unchanged = prediction(reference_tissue(), START)
    assert not unchanged.full.any()
    assert np.isnan(unchanged.r_squared).all()


def test_row_without_equilibrium_is_nan_and_spares_the_others() -> None:
    tissue = reference_tissue(fixed_charge_density=np.array([0.0, 2e-4]))
    predicted = prediction(tissue, Conditions(5.0, 1.5e-4))
    assert np.isnan(predicted.r_squared[0]).all()
    assert np.isnan(predicted.phase_duration[0]).all()
    np.testing.assert_allclose(
        predicted.r_squared[1], prediction(reference_tissue(), Conditions(5.0, 1.5e-4)).r_squared[0]
    )


@pytest.mark.parametrize(
    ("loaded", "kind"),
    [(Conditions(1e-6, 1.5e-4), "piston_pressure"), (Conditions(0.0, 1.5e-4 - 1e-10), "bath_concentration")],
    ids=["pressure", "bath"],
)
def test_a_ramp_is_many_small_steps(loaded: Conditions, kind: str) -> None:
    """Duhamel's integral over the answer to a step, by the trapezoidal rule with many points."""
    tissue, over, time = random_tissue(5, seed=28), 80.0, np.array([20.0, 60.0, 80.0, 100.0, 240.0])
    ramped = loaded._replace(**{kind: ramp_to(getattr(loaded, kind), over)})
    ramp = predict(tissue, 0.5, [START, ramped], 0.0, phase_duration=240.0, steps_per_phase=12)
    models = (BIPHASIC_SWELLING, ramp.reduced), (ELECTROCHEMICAL, ramp.full)
    for model, strain in models:
        column = LinearColumn.at_equilibrium(model, tissue, 0.5, *START[:2])
        for at, step in zip(time, (0, 2, 3, 4, 11), strict=True):
            since = np.linspace(max(at - over, 0.0), at, 4001)
            answer = column.global_strain(since, loaded.piston_pressure, loaded.bath_concentration - 1.5e-4)
            np.testing.assert_allclose(strain[:, 0, step], np.trapezoid(answer, since) / over, rtol=1e-4)


def test_ramp_and_step_are_reported_apart_row_by_row() -> None:
    both = prediction(reference_tissue(), COMPRESSED._replace(piston_pressure=ramp_to(0.25, np.array([0.0, 50.0]))))
    for row, ramp in enumerate((0.0, 50.0)):
        alone = prediction(reference_tissue(), COMPRESSED._replace(piston_pressure=ramp_to(0.25, ramp)))
        np.testing.assert_allclose(both.full[row], alone.full[0], rtol=1e-9, atol=1e-14)


def test_phases_of_small_loads_add_up() -> None:
    """Two steps of load are one after the other what they are alone, and the first goes on in the second phase."""
    tissue = random_tissue(5, seed=29)
    loads = [START, Conditions(1e-6, 1.5e-4), Conditions(3e-6, 1.5e-4)]
    both = predict(tissue, 0.5, loads, phase_duration=30.0, steps_per_phase=4).full
    column = LinearColumn.at_equilibrium(ELECTROCHEMICAL, tissue, 0.5, 0.0, 1.5e-4)
    time = 30.0 * np.arange(1, 5) / 4
    np.testing.assert_allclose(both[:, 0], column.global_strain(time, 1e-6), rtol=1e-4)
    expected = column.global_strain(time + 30.0, 1e-6) + column.global_strain(time, 2e-6)
    np.testing.assert_allclose(both[:, 1], expected, rtol=1e-4)


def test_what_is_linearised_is_reported() -> None:
    """The diffusivities of the reference tissue about its first equilibrium, regression values of the theory."""
    predicted = prediction(reference_tissue(), COMPRESSED, linearised_at=INITIAL)
    np.testing.assert_allclose(predicted.diffusivities[0], [[9.1437e-4, 6.0153e-4]] * 2, rtol=1e-4)
    np.testing.assert_allclose(predicted.equilibrium_strain[0], [0.822614 / 1.054503 - 1.0, 0.0], atol=1e-6)
