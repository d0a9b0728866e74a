"""Currents and potentials of columns against the exact linear solution, and Onsager's relation."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from integrations import HEIGHT, first_step, integrate, loads, make_column, make_control, parts_with
from tissues import BATH, reference_tissue

from fvswell.column.fields import column_fields
from fvswell.exact.linear_swelling import LinearColumn
from fvswell.numerics.loads import Load, make_protocol
from fvswell.physics.constants import FARADAY
from fvswell.physics.models import MODELS
from fvswell.physics.tissue import Array

TIMES = (20.0, 100.0, 400.0, 4000.0)
# strain of the linear column by an electrode in the wall at .1 mA/cm2 (1e-6 A/mm2), the bath at x = 0
EXACT = {
    "cation": np.array([5.6049e-4, 2.25321e-3, 3.71997e-3, 3.74470e-3]),
    "anion": np.array([5.6220e-4, 2.67782e-3, 6.41237e-3, 7.48019e-3]),
}
J0 = 1.054503  # of the reference tissue in its bath
FLOATING = parts_with((True, True))
DRIVEN = parts_with((True, True), ("grounded", "current"))


def fields(
    parts: Any, times: tuple[float, ...], cells: int = 50, tolerance: float = 1e-6, strain: float = 1e-3,
    grading: float = 20.0, **given: Any,
) -> dict[str, Array]:  # fmt: skip
    """Fields of the reference column under constant loads."""
    column = make_column(cells=cells, grading=grading, parts=parts)
    control = make_control(tolerance=tolerance, expected_strain=strain, first_step=first_step(column))
    done = integrate(column, make_protocol([loads(**given)], [times[-1]], list(times)), control)
    assert done.complete
    return column_fields(column, done.volume_ratio, done.record)


@cache
def electrode_strain(kind: str, cells: int, current: float) -> Array:
    parts = parts_with((True, False), ("grounded", "current"), ("bath", kind))
    return fields(parts, TIMES, cells, strain=4e3 * current, filter_current=current)["global_strain"]


# ---- an electrode in the wall ------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", EXACT)
def test_strain_by_an_electrode_in_the_wall(kind: str) -> None:
    """At a thousandth of the current of the numbers, where the column is linear."""
    np.testing.assert_allclose(1e3 * electrode_strain(kind, 50, 1e-9), EXACT[kind], rtol=1e-3)


@pytest.mark.parametrize("kind", EXACT)
def test_second_order_in_the_grid(kind: str) -> None:
    """Of the largest error, from 100 s on."""
    errors = [np.abs(1e3 * electrode_strain(kind, cells, 1e-9) / EXACT[kind] - 1.0)[1:].max() for cells in (12, 24, 48)]
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(2.0, abs=0.25)


def test_large_current_into_a_cation_electrode() -> None:
    """.1 mA/cm2: a nonlinear solver of another kind ends at 3.7891e-3."""
    assert electrode_strain("cation", 100, 1e-6)[-1] == pytest.approx(3.7891e-3, rel=1e-4)


# ---- what a current carries, what a pressure makes ----------------------------------------------------------


def steady(**given: Any) -> dict[str, float]:
    """Fluxes through a column with the same salt on both sides in the end, and the potential of its piston.

    Odd part in the loads: the second-order part of small signals falls out.
    """
    names = ("water_flux", "anion_flux", "current_density")
    parts = DRIVEN if "filter_current" in given else FLOATING
    one, other = (
        fields(parts, (2e4,), 10, strain=1e-6, grading=1.0, **{name: sign * value for name, value in given.items()})
        for sign in (1.0, -1.0)
    )
    odd = {name: 0.5 * (one[name] - other[name])[0] for name in (*names, "piston_potential")}
    for name in names:
        assert np.ptp(odd[name]) < 1e-6 * np.abs(odd["water_flux" if name == "current_density" else name]).max()
    return {name: float(np.mean(value)) for name, value in odd.items()}


def test_coefficients_of_a_current() -> None:
    """Water dragged along, conductivity, and share of the anions where no water flows."""
    current, pressure = 1e-9, 1e-6
    driven, pressed = steady(filter_current=current), steady(filter_bath_pressure=pressure)
    assert driven["water_flux"] / current == pytest.approx(14.81, rel=1e-3)
    back = -driven["water_flux"] / pressed["water_flux"]  # of the pressure, that stops the water
    still = {name: driven[name] + back * pressed[name] for name in driven}
    conductivity = -current * J0 * HEIGHT / still["piston_potential"]
    assert conductivity == pytest.approx(6.14e-7, rel=1e-3)  # C2/(N mm2 s): .614 S/m
    assert -still["anion_flux"] * FARADAY / current == pytest.approx(0.330, abs=5e-4)


def test_onsager() -> None:
    """Water per charge is the potential per pressure of the bath, to 1e-6."""
    current, pressure = 1e-9, 1e-6
    electro_osmosis = steady(filter_current=current)["water_flux"] / current
    streaming = steady(filter_bath_pressure=pressure)["piston_potential"] / pressure
    assert streaming == pytest.approx(electro_osmosis, rel=1e-6)
    assert streaming == pytest.approx(14.81, rel=1e-3)  # mV/MPa


def potential_slopes() -> tuple[float, float]:
    """Potential by mu_f (mV/MPa) and by ln a~ (mV) where no current flows, from the equations of the ions."""
    tissue, J = reference_tissue(), J0
    w, RT, n_f = 1.0 - tissue.hindrance_factor, tissue.thermal_energy, (J - 1.0 + tissue.fluid_fraction) / J
    charge = tissue.fixed_charge_density * tissue.fluid_fraction / (J - 1.0 + tissue.fluid_fraction)
    cation, anion = (0.5 * (np.hypot(charge, 2.0 * BATH) + sign * charge) for sign in (1.0, -1.0))
    by_cation, by_anion = cation * tissue.cation_diffusivity, anion * tissue.anion_diffusivity
    both, less = by_cation + by_anion, by_cation - by_anion
    k = tissue.permeability.hydraulic_permeability
    k_open = k / (1.0 + k * RT * (w * charge) ** 2 / (n_f * both))
    dragged = w * charge * RT / (n_f * both) / FARADAY  # mV per length, of a unit flux of water
    against_salt = k_open * w * RT * (cation + anion - charge * less / both)
    return -dragged * k_open, -dragged * against_salt - RT / FARADAY * less / both


def test_streaming_potential_in_confined_compression() -> None:
    """Of the wall above the bath, under a small load: psi~ follows mu_f and ln a~ there."""
    times, load = (5.0, 20.0, 100.0, 400.0), 1e-5
    found = fields(parts_with(), times, 50, strain=2e-5, pressure=load)["piston_potential"]
    column = LinearColumn.at_equilibrium(MODELS["electrochemical"], reference_tissue(), HEIGHT, 0.0, BATH)
    wall = column.profile(column.current_height[:, None], np.array(times), delta_pressure=load)
    by_water, by_salt = potential_slopes()
    exact = by_water * wall.water_potential[0, :, 0] + by_salt * wall.log_activity[0, :, 0]
    np.testing.assert_allclose(found, exact, rtol=0, atol=2e-3 * np.abs(exact).max())
    assert np.ptp(exact) > 0.5 * np.abs(exact).max()


def test_ramped_potential_charges_as_it_says() -> None:
    """The charge that has crossed is the integral of the current, cations less anions."""
    parts = parts_with((True, True), ("grounded", "potential"))
    times = tuple(np.linspace(0.5, 100.0, 400))
    found = fields(
        parts, times, 20, filter_current=None, filter_potential=0.0, piston_potential=Load(5.0, 100.0), strain=1e-2
    )
    charge = FARADAY * (found["filter_cation_amount"] - found["filter_anion_amount"])
    current = found["filter_current"]
    steps = np.diff(times) * 0.5 * (current[1:] + current[:-1])
    np.testing.assert_allclose(np.diff(charge), steps, rtol=1e-3, atol=1e-6 * np.abs(charge).max())
