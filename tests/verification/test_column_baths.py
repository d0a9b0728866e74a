"""Columns between two baths: permeation, diffusion of salt, and a bath step under a piston that is held."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from integrations import HEIGHT, Integration, first_step, integrate, loads, make_column, make_control, parts_with
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq, root
from tissues import BATH, reference_tissue

from fvswell.column.fields import column_fields
from fvswell.exact.linear_swelling import LinearColumn
from fvswell.numerics.loads import make_protocol
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import MODELS
from fvswell.physics.tissue import Array, Tissue

LONG = 1e5
BETWEEN = parts_with((True, True))


def steady(
    tissue: Tissue, model: str, cells: int, concentration: float = BATH, **given: Any
) -> tuple[Integration, dict[str, Array]]:
    """A column of uniform cells between two baths, in the end."""
    column = make_column(model, tissue, cells, 1.0, concentration=concentration, parts=BETWEEN)
    control = make_control(tolerance=1e-7, expected_strain=1e-2, first_step=first_step(column))
    done = integrate(column, make_protocol([loads(**given)], [LONG], [LONG]), control)
    assert done.complete
    return done, column_fields(column, done.volume_ratio, done.record)


# ---- permeation -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["biphasic", "biphasic-swelling"])
def test_permeation_at_a_small_pressure(model: str) -> None:
    """k (p1 - p2)/h, of the model's permeability and the height in the bath."""
    pressure = 1e-7
    done, fields = steady(reference_tissue(), model, 10, filter_bath_pressure=pressure)
    height = float(done.volume_ratio @ done.column.grid.widths)
    k = 1e-3 if model == "biphasic" else 8.3945e-4  # k_open at J = 1.0545
    np.testing.assert_allclose(fields["water_flux"], k * pressure / height, rtol=2e-5)
    kept = fields["filter_water_volume"] + fields["piston_water_volume"]
    np.testing.assert_allclose(kept, fields["piston_displacement"], rtol=0, atol=1e-12 * height)
    assert fields["filter_pressure"] == pytest.approx(-pressure, rel=1e-12)  # the filter is pushed towards the bath


@cache
def permeation(cells: int, pressure: float = 0.1) -> tuple[float, Array]:
    """Flux and J of a soft biphasic column whose permeability falls with its water, the piston unloaded."""
    done, fields = steady(reference_tissue(permeability_exponent=4.0), "biphasic", cells, filter_bath_pressure=pressure)
    return float(fields["water_flux"][0, 0]), done.filled("contents")[0, 0]


def stress(J: float) -> float:
    """Neo-Hookean column of E = .5, nu = .3."""
    bulk, shear = 0.5 / 1.2, 0.5 / 2.6
    return 0.5 * bulk * (J - 1.0 / J) + shear * (J - J ** (-1.0 / 3.0))


def test_finite_permeation_is_darcy_with_the_permeability_of_the_state() -> None:
    """The integral of k(J) dp/J from one bath to the other: q h, and from it the profile; second order in the cells.

    The pressure of the fluid is that of the bath at the filter, and the stress there carries it.
    """
    pressure = 0.1
    at_filter = brentq(lambda J: stress(J) - pressure, 1.0, 2.0)

    def darcy(J: float) -> float:
        step = 1e-6
        return float(1e-3 * np.exp(4.0 * (J - 1.0)) / J * (stress(J + step) - stress(J - step)) / (2.0 * step))

    flux = quad(darcy, 1.0, at_filter, epsabs=1e-14)[0] / HEIGHT
    assert flux > 1.2e-3 * pressure / HEIGHT  # far from what small pressures do
    errors = []
    for cells in (8, 16, 32):
        found, J = permeation(cells, pressure)
        x = (np.arange(cells) + 0.5) * HEIGHT / cells
        exact = [brentq(lambda J, at=at: quad(darcy, J, at_filter)[0] - flux * at, 1.0, at_filter) for at in x]
        errors.append([abs(found / flux - 1.0), np.abs(J - exact).max()])
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert orders == pytest.approx(2.0, abs=0.25)
    assert errors[-1][0] < 2e-4


# ---- diffusion of salt ------------------------------------------------------------------------------------


def test_salt_through_uncharged_tissue() -> None:
    """Ideal and unhindered, no water moves: n_f D (c1 - c2)/h, D = 2 D+ D-/(D+ + D-) as no current flows."""
    ideal = {"osmotic_coefficient": 1.0, "bath_osmotic_coefficient": 1.0, "hindrance_factor": 0.0}
    tissue = reference_tissue(fixed_charge_density=0.0, **ideal)
    low, high = 1e-4, 2e-4
    errors = []
    for cells in (8, 16, 32):
        done, fields = steady(
            tissue, "electrochemical", cells, 1.5e-4, filter_bath_concentration=high, piston_bath_concentration=low
        )
        exact = 0.8 * (2.0 * 5e-4 * 8e-4 / 13e-4) * (high - low) / HEIGHT
        np.testing.assert_allclose(fields["anion_flux"], fields["anion_flux"][0, 0], rtol=1e-6)
        np.testing.assert_allclose(fields["cation_flux"], fields["anion_flux"], rtol=1e-9)
        # what salt pushes away and what it draws on are not exactly one on a grid
        drawn = fields["water_flux"][0, 0] * HEIGHT / (1e-3 * 2.0 * 8.314462618 * 298.0 * (high - low))
        errors.append([abs(fields["anion_flux"][0, 0] / exact - 1.0), abs(drawn)])
        np.testing.assert_allclose(done.filled("contents")[0, 0], 1.0, atol=0.1 / cells**2)
        x = (np.arange(cells) + 0.5) / cells
        np.testing.assert_allclose(fields["anion_concentration"][0], high + (low - high) * x, rtol=0.3 / cells**2)
        drift = 8.314462618 * 298.0 / 96.48533212 * (8e-4 - 5e-4) / 13e-4 * np.log(low / high)
        assert fields["piston_potential"] == pytest.approx(drift, rel=2.0 / cells**2)  # of the anions that run ahead
    assert np.log2(np.array(errors[:-1]) / np.array(errors[1:])) == pytest.approx(2.0, abs=0.1)
    assert np.all(np.array(errors[-1]) < 5e-4)


def exact_steady(tissue: Tissue, low: float, high: float) -> tuple[float, float]:
    """Fluxes of water and anions between baths of high salt (x = 0) and low, by shooting; nothing of finite volumes.

    At given fluxes the gradients follow from two linear equations at each point, the current being none.
    """
    w, RT = 1.0 - tissue.hindrance_factor, tissue.thermal_energy
    phi, phi_bath = tissue.osmotic.osmotic_coefficient, tissue.osmotic.bath_osmotic_coefficient
    n0, D_cation, D_anion = tissue.fluid_fraction, tissue.cation_diffusivity, tissue.anion_diffusivity

    def state(mu: float, log_a: float) -> tuple[float, float, float]:
        def ions(J: float) -> tuple[float, float]:
            charge = tissue.fixed_charge_density * n0 / (J - 1.0 + n0)
            total = np.hypot(charge, 2.0 * np.exp(log_a))
            return 0.5 * (total + charge), 0.5 * (total - charge)

        J = brentq(lambda J: stress(J) - phi * RT * sum(ions(J)) - mu, 0.3, 3.0, xtol=1e-14)
        return J, *ions(J)

    def rates(_: float, y: Array, q: float, j: float) -> list[float]:
        J, cation, anion = state(*y)
        n_f = (J - 1.0 + n0) / J
        # j+- = w c+- q - n_f D+- c+- g+-,   and both ion fluxes are j
        up, down = (w * c * q - j for c in (cation, anion))
        g_cation, g_anion = up / (n_f * D_cation * cation), down / (n_f * D_anion * anion)
        mu = -q / tissue.permeability.hydraulic_permeability - w * RT * (cation * g_cation + anion * g_anion)
        return [mu * J, 0.5 * (g_cation + g_anion) * J]

    def missed(scaled: Array) -> Array:
        start = [-2.0 * phi_bath * RT * high, np.log(high)]
        end = solve_ivp(rates, (0.0, HEIGHT), start, args=tuple(scaled * scale), rtol=1e-10, atol=1e-12).y[:, -1]
        return np.array([end[0] + 2.0 * phi_bath * RT * low, end[1] - np.log(low)])

    scale = np.array([1e-5, 1e-7])
    found = root(missed, [0.0, 0.5], tol=1e-11)
    assert found.success
    q, j = found.x * scale
    return float(q), float(j)


def test_salt_through_charged_tissue() -> None:
    """Donnan partition, osmosis and drag, the reference tissue: against an integration of the steady equations."""
    low, high = 1e-4, 2e-4
    water, anion = exact_steady(reference_tissue(), low, high)
    errors = []
    for cells in (10, 20, 40):
        _, fields = steady(
            reference_tissue(), "electrochemical", cells, filter_bath_concentration=high, piston_bath_concentration=low
        )
        errors.append([abs(fields["water_flux"][0, 0] / water - 1.0), abs(fields["anion_flux"][0, 0] / anion - 1.0)])
    assert np.log2(np.array(errors[:-1]) / np.array(errors[1:])) == pytest.approx(2.0, abs=0.25)
    assert np.all(np.array(errors[-1]) < 1e-3)


# ---- the isometric bath step ------------------------------------------------------------------------------


TIMES = np.array([2.0, 20.0, 100.0, 300.0, 1e5])


def isometric(model: str, bath: float = 1e-4, hindrance: float = 0.4) -> tuple[Array, Array, Array]:
    """Piston held where it is in equilibrium, a weaker bath: its pressure, the concentration at the wall, and J."""
    column = make_column(model, reference_tissue(hindrance_factor=hindrance), cells=80)
    height = float(column.initial_volume_ratio() @ column.grid.widths)
    control = make_control(tolerance=1e-6, expected_strain=abs(bath / BATH - 1.0) * 0.1, first_step=first_step(column))
    done = integrate(column, make_protocol([loads(height=height, bath=bath)], [1e5], list(TIMES)), control)
    fields = column_fields(column, done.volume_ratio, done.record)
    np.testing.assert_allclose(fields["height"], height, rtol=1e-13)
    np.testing.assert_array_equal(fields["filter_pressure"], fields["piston_pressure"])
    salt = fields["virtual_concentration"][:, -1] if model != "biphasic" else np.zeros(len(TIMES))
    return fields["piston_pressure"], salt, done.filled("contents")[:, 0]


def test_isometric_bath_step_moves_nothing_without_fixed_charge() -> None:
    assert np.abs(isometric("biphasic")[0]).max() < 1e-12


def test_isometric_stress_jumps_with_the_bath_where_ions_are_in_equilibrium() -> None:
    """At once to where it stays: tissue of one kind stays as it is, and the piston takes the osmotic pressure."""
    pressure, _, J = isometric("biphasic-swelling")
    column = make_column("biphasic-swelling", cells=80)
    start = column.initial_volume_ratio()
    np.testing.assert_allclose(J, np.broadcast_to(start, J.shape), rtol=1e-6)
    np.testing.assert_allclose(pressure, pressure[-1], rtol=1e-5)
    assert equilibrium_volume_ratio(column.cells, pressure[-1], 1e-4) == pytest.approx(start[0], rel=1e-9)
    assert pressure[-1] > 0.06


@pytest.mark.parametrize(("hindrance", "early"), [(0.0, 0.507), (0.4, 1.201)])
def test_isometric_stress_follows_the_salt(hindrance: float, early: float) -> None:
    """Until the salt that diffuses out is felt at the wall the stress is what the linear solution says.

    Water that cannot leave makes the piston take a pressure at once, such that none is drawn: less than in the end
    without hindrance, more with it. From there the stress goes to the equilibrium that both models share.
    """
    bath = BATH * (1.0 - 1e-4)
    small, _, _ = isometric("electrochemical", bath, hindrance)
    tissue = reference_tissue(hindrance_factor=hindrance)
    column = LinearColumn.at_equilibrium(MODELS["electrochemical"], tissue, HEIGHT, 0.0, BATH)
    drawn, pressed = (
        column.early_strain(column.boundary_change(*change)).item() for change in ((0.0, bath - BATH), (1.0, 0.0))
    )
    np.testing.assert_allclose(small[:2], -drawn / pressed, rtol=2e-3)

    pressure, wall, _ = isometric("electrochemical", 1e-4, hindrance)
    final = isometric("biphasic-swelling")[0][-1]
    assert pressure[-1] == pytest.approx(final, rel=1e-6)
    assert pressure[0] / final == pytest.approx(early, abs=2e-3)
    way, gone = (pressure - pressure[0]) / (final - pressure[0]), (wall - BATH) / (1e-4 - BATH)
    assert max(way[1], gone[1]) < 0.01  # neither has begun
    assert np.all(np.diff(way[1:]) > 0.0)
    np.testing.assert_allclose(way, gone, rtol=0, atol=0.25)
