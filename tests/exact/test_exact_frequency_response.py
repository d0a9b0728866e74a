"""The dynamic modulus: limits, the work of a cycle by its history, and sines that start from rest."""

from __future__ import annotations

import numpy as np
import pytest
from tissues import random_tissue, reference_tissue

from fvswell.exact.driven_column import DrivenColumn
from fvswell.exact.frequency_response import dynamic_modulus
from fvswell.exact.histories import PiecewiseLinear, Sine
from fvswell.exact.linear_swelling import LinearColumn
from fvswell.physics.models import MODELS, Model
from fvswell.physics.tissue import Array

BATH = 1.5e-4
EVERY_MODEL = pytest.mark.parametrize("model", MODELS.values(), ids=list(MODELS))


def column(model: Model, rows: int = 50) -> LinearColumn:
    return LinearColumn.at_equilibrium(model, random_tissue(rows, seed=41), 0.5, 0.0, BATH)


def diffusion_time(linear: LinearColumn) -> Array:
    return linear.current_height**2 / np.abs(linear.diffusivities).min(axis=1)


@EVERY_MODEL
def test_slow_loads_meet_the_drained_modulus(model: Model) -> None:
    """What a lasting pressure comes to, without lag; to first order it lags by a third of the diffusion times."""
    linear = column(model)
    modulus = dynamic_modulus(linear, np.array([1e-9]))
    drained = -1 / (linear.boundary_change(1.0)[:, 0] / linear.volume_ratio)
    np.testing.assert_allclose(modulus.storage[:, 0], drained, rtol=1e-6)
    by_pressure = linear.boundary_change(1.0)
    times = linear.current_height[:, None] ** 2 / 3 * np.linalg.solve(linear.diffusion, by_pressure[..., None])[..., 0]
    lag = 2 * np.pi * 1e-9 * times[:, 0] / by_pressure[:, 0]
    np.testing.assert_allclose(modulus.phase_lag[:, 0], lag, rtol=1e-5)


@EVERY_MODEL
def test_fast_loads_lag_by_an_eighth(model: Model) -> None:
    """A boundary layer: 45 degrees, and the modulus grows as the root of the frequency."""
    modulus = dynamic_modulus(column(model), np.array([1e3, 4e3]))
    np.testing.assert_allclose(modulus.phase_lag, np.pi / 4, rtol=1e-6)
    np.testing.assert_allclose(modulus.magnitude[:, 1] / modulus.magnitude[:, 0], 2.0, rtol=1e-6)


@EVERY_MODEL
def test_displacement_and_pressure_meet_one_modulus(model: Model) -> None:
    linear, frequency = column(model), np.array([1e-4, 1e-2, 1.0])
    modulus = dynamic_modulus(linear, frequency)
    held = DrivenColumn(linear, held=True).frequency_response("pressure", "piston.displacement", frequency)
    np.testing.assert_allclose(-held * linear.current_height[:, None], modulus.storage + 1j * modulus.loss, rtol=1e-10)


def test_modulus_of_a_biphasic_layer() -> None:
    """H z coth z with z = sqrt(i omega h^2/(H k)); Mow et al. (1980) in the frequency domain."""
    linear, frequency = column(MODELS["biphasic"]), np.geomspace(1e-5, 10.0, 13)
    H, k = linear.stiffness[:, :, 0], linear.mobility[:, :, 0]
    z = np.sqrt(2j * np.pi * frequency * 0.25 / (H * k))
    modulus = dynamic_modulus(linear, frequency)
    np.testing.assert_allclose(modulus.storage + 1j * modulus.loss, H * z / np.tanh(z), rtol=1e-10)


@EVERY_MODEL
def test_passive_tissue_loses_energy_at_every_frequency(model: Model) -> None:
    modulus = dynamic_modulus(column(model, 300), np.geomspace(1e-6, 10.0, 29))
    assert np.all(modulus.loss > 0)
    assert np.all(np.diff(modulus.magnitude, axis=1) > 0)
    assert np.all((modulus.phase_lag > 0) & (modulus.phase_lag < 0.5 * np.pi))


@pytest.mark.parametrize("held", [False, True])
@EVERY_MODEL
def test_work_of_a_cycle(model: Model, held: bool) -> None:
    """The area of the loop of stress and strain, long after the start from rest, is pi E'' strain^2."""
    linear = LinearColumn.at_equilibrium(model, reference_tissue(), 0.5, 0.0, BATH)
    period = 0.3 * float(diffusion_time(linear)[0])
    driven = DrivenColumn(linear, held)
    load, answer = ("piston.displacement", "pressure") if held else ("piston.pressure", "strain")
    time = (20 + np.arange(400) / 400) * period
    given = np.sin(2 * np.pi * time / period) * 1e-3
    found = driven.history(answer, {load: Sine(1e-3, period)}, time)[0]
    strain, pressure = (given / linear.current_height[0], found) if held else (found, given)
    by_mode = 2j * np.pi * np.fft.fftfreq(400, 1 / 400)  # the rate of a periodic history, exact
    work = -(pressure * np.fft.ifft(by_mode * np.fft.fft(strain)).real).mean()
    amplitude = np.hypot(*(2 * (strain * turn(2 * np.pi * time / period)).mean() for turn in (np.sin, np.cos)))
    loss = dynamic_modulus(linear, np.array([1 / period])).energy_loss(amplitude).item()
    assert work == pytest.approx(loss, rel=1e-6)


@pytest.mark.parametrize("held", [False, True])
def test_a_sine_from_rest_is_the_table_of_its_points(held: bool) -> None:
    """Chords of 800 to a period leave an error of about their square, at early times and in the steady state."""
    linear = column(MODELS["electrochemical"], 5)
    driven = DrivenColumn(linear, held)
    load, measured = ("piston.displacement", "pressure") if held else ("piston.pressure", "strain")
    points = np.linspace(0.0, 100.0, 1601)
    table = PiecewiseLinear(points, np.sin(2 * np.pi * points / 50.0))
    time = np.array([0.01, 1.03, 12.03, 49.03, 77.03, 99.03])  # between points: at them the speed jumps
    sine, chords = (driven.history(measured, {load: history}, time) for history in (Sine(1.0, 50.0), table))
    np.testing.assert_allclose(sine, chords, rtol=1e-4, atol=1e-4 * np.abs(sine).max())


def test_bath_that_oscillates_fast_changes_nothing() -> None:
    """Salt and osmosis come no further than a layer as thin as the frequency is high."""
    driven = DrivenColumn(column(MODELS["electrochemical"]))
    slow, fast, faster = np.abs(
        driven.frequency_response("strain", "filter.bath_concentration", np.array([1e-9, 1e3, 4e3]))
    ).T
    np.testing.assert_allclose(faster / fast, 0.5, rtol=1e-6)
    assert np.all(fast < 1e-2 * slow)
