"""Columns under any loads: numbers known before, series, and an integration of the balances on a fine grid."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from tissues import point_of, random_tissue, reference_tissue

from fvswell.exact.confined_compression import relaxation_pressure
from fvswell.exact.driven_column import DrivenColumn
from fvswell.exact.electrical import electrical_coefficients, wall_anion_flux
from fvswell.exact.histories import PiecewiseLinear, Sine, ramp, step
from fvswell.exact.linear_swelling import LinearColumn
from fvswell.physics.constants import FARADAY
from fvswell.physics.models import BIPHASIC, BIPHASIC_SWELLING, ELECTROCHEMICAL, MODELS, Model
from fvswell.physics.osmotic import ion_concentrations
from fvswell.physics.tissue import Array, Tissue, fixed_charge_density, fluid_fraction

BATH = 1.5e-4


def column(model: Model, tissue: Tissue | None = None) -> LinearColumn:
    return LinearColumn.at_equilibrium(model, tissue or reference_tissue(), 0.5, 0.0, BATH)


def tissues() -> list[Tissue]:
    """A real pair of diffusivities, and a complex one."""
    many = random_tissue(300, seed=3)
    imaginary = np.abs(column(ELECTROCHEMICAL, many).diffusivities.imag).max(axis=1)
    return [point_of(many, 5), point_of(many, int(np.argmax(imaginary)))]


TISSUES = tissues()


def slowest_time(linear: LinearColumn) -> float:
    return float((linear.current_height[:, None] ** 2 / np.abs(linear.diffusivities)).max())


# ---- what others have computed ---------------------------------------------------------------------------


def test_current_through_the_reference_tissue() -> None:
    """0.1 mA/cm2 through an electrode in the wall: strains by an independent linear solver."""
    time, current = np.array([20.0, 100.0, 400.0, 4000.0]), {"filter.current": step(1e-6)}
    cation, anion = (
        DrivenColumn(column(ELECTROCHEMICAL), electrode=electrode).history("strain", current, time)
        for electrode in ("cation", "anion")
    )
    np.testing.assert_allclose(cation, [[5.6049e-4, 2.25321e-3, 3.71997e-3, 3.74470e-3]], atol=6e-9)
    np.testing.assert_allclose(anion, [[5.6220e-4, 2.67782e-3, 6.41237e-3, 7.48019e-3]], atol=6e-9)


@pytest.mark.parametrize("electrode", ["cation", "anion"])
def test_strain_by_a_current_is_the_series_in_the_matrix(electrode: Any) -> None:
    """h0 (L H)^-1 [1/2 - sum 2 (-1)^n/lambda_n^3 exp(-J0 L H lambda_n^2 t/h0^2)] s by matrix exponentials."""
    linear = column(ELECTROCHEMICAL, TISSUES[0])
    h0, D = linear.current_height[0], linear.diffusion[0]
    flux = electrical_coefficients(linear.tissue, linear.volume_ratio, linear.log_activity).flux_per_charge[0]
    source = flux - np.array([0.0, wall_anion_flux(electrode)])
    time = np.array([0.02, 0.2, 2.0]) * slowest_time(linear)
    wave = (np.arange(60) + 0.5) * np.pi
    expected = []
    for t in time:
        sums = sum(2 * (-1) ** n / k**3 * expm(-D * k**2 * t / h0**2) for n, k in enumerate(wave))
        mean = h0 * np.linalg.solve(D / linear.volume_ratio[0], (0.5 * np.eye(2) - sums) @ source)
        expected.append(mean[0] / linear.volume_ratio[0])
    strain = DrivenColumn(linear, electrode=electrode).history("strain", {"filter.current": step(1.0)}, time)
    np.testing.assert_allclose(strain[0], expected, rtol=1e-9)


@pytest.mark.parametrize("model", MODELS.values(), ids=list(MODELS))
def test_free_piston_is_the_closed_solution(model: Model) -> None:
    """Complex diffusivities too; steps of pressure, bath and hydrostatic pressure."""
    linear = column(model, random_tissue(100, seed=31))
    time = np.array([1e-4, 0.01, 0.3, 5.0]) * slowest_time(linear)
    loads = {
        "piston.pressure": step(1e-3),
        "filter.bath_concentration": step(-1e-6),
        "filter.bath_pressure": step(4e-4),
    }
    strain = DrivenColumn(linear).history("strain", loads, time)
    expected = linear.global_strain(time, 6e-4, -1e-6)
    np.testing.assert_allclose(strain, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("model", [BIPHASIC, BIPHASIC_SWELLING])
def test_stress_relaxation_of_one_content_is_the_classical_series(model: Model) -> None:
    linear = column(model, random_tissue(20, seed=32))
    modulus = linear.stiffness[:, 0, 0] * linear.volume_ratio  # of the height in the state linearised about
    height, k = linear.current_height, linear.mobility[:, 0, 0]
    time = np.array([[0.01], [0.3], [1.0], [1.3], [9.0]]) * 60.0
    series = relaxation_pressure(modulus, k, height, 0.01, 60.0, time)
    found = DrivenColumn(linear, held=True).history("pressure", {"piston.displacement": ramp(-0.01, 60.0)}, time[:, 0])
    np.testing.assert_allclose(found.T, series, rtol=1e-9)


# ---- an integration of the balances ----------------------------------------------------------------------


def on_a_grid(driven: DrivenColumn, load: str, cells: int) -> tuple[Array, Array, Array, Array]:
    """Matrices of the balances on a graded grid: dm/dt = A m + B u, (strain, pressure, wall_potential) = C m + E u.

    u is the load, but the speed of a displacement.
    """
    linear, drive = driven.column, driven.drive(load)
    h0, D, J0 = linear.current_height[0], linear.diffusion[0], linear.volume_ratio[0]
    even = np.linspace(0, 1, cells + 1)
    faces = h0 * (even - 0.7 / (2 * np.pi) * np.sin(2 * np.pi * even))  # crowded at both ends
    widths, n = np.diff(faces), len(D)
    centres = faces[:-1] + 0.5 * widths
    A, B = np.zeros((n * cells, n * cells)), np.zeros((n * cells, 1))
    for i in range(cells - 1):
        exchange = D / (centres[i + 1] - centres[i])
        for row, sign in ((i, 1.0), (i + 1, -1.0)):
            block = slice(row * n, row * n + n)
            A[block, (i + 1) * n : (i + 2) * n] += sign * exchange / widths[row]
            A[block, i * n : (i + 1) * n] -= sign * exchange / widths[row]
    at_filter, wall = 2.0 / widths[0] * D, slice((cells - 1) * n, cells * n)  # flux in for a unit difference
    # at the filter the contents are drive + by_pressure P
    by_pressure = linear.boundary_change(1.0)[0]
    P_of_m, P_of_u = np.zeros((1, n * cells)), drive.pressure[:, None].copy()
    if driven.held:  # what enters at the filter is what the piston moves, less what comes in through the wall
        P_of_m[0, :n] = at_filter[0] / (at_filter[0] @ by_pressure)
        speed = drive.volume[0] * h0 - (D @ drive.wall[0])[0] / h0
        P_of_u[0, 0] = (speed - at_filter[0] @ drive.contents[0]) / (at_filter[0] @ by_pressure)
    filter_of_m = np.outer(by_pressure, P_of_m) if driven.held else np.zeros((n, n * cells))
    filter_of_u = drive.contents[0] + (by_pressure * P_of_u[0, 0] if driven.held else 0.0)
    A[:n] += at_filter @ filter_of_m / widths[0]
    A[:n, :n] -= at_filter / widths[0]
    B[:n, 0] += at_filter @ filter_of_u / widths[0]
    B[wall, 0] += D @ drive.wall[0] / h0 / widths[-1]
    mean = np.zeros((1, n * cells))
    mean[0, ::n] = widths / h0
    C, E = [mean / J0, P_of_m], [np.zeros((1, 1)), P_of_u]
    if linear.model.transports_ions:
        coefficients = electrical_coefficients(linear.tissue, linear.volume_ratio, linear.log_activity)
        slopes = coefficients.potential_per_potential[0] @ linear.stiffness[0]
        far = np.zeros((n, n * cells))
        # quadratic through the last two centres with the known slope at the wall
        near, away = h0 - centres[-1], h0 - centres[-2]
        share = away**2 / (away**2 - near**2)
        far[:, wall] = share * np.eye(n)
        far[:, (cells - 2) * n : (cells - 1) * n] = (1 - share) * np.eye(n)
        far_of_u = drive.wall[0] / h0 * (share * near + (1 - share) * away)
        C.append((slopes @ (far - filter_of_m))[None])
        ohmic = drive.current * h0 / coefficients.conductivity[0]
        E.append(np.array([[slopes @ (far_of_u - filter_of_u) - ohmic]]))
    return A, B, np.concatenate(C), np.concatenate(E)


def integrated(driven: DrivenColumn, load: str, shape: str, time: Array, cells: int) -> Array:
    """Histories (measured, times) under a step, a ramp or a sine of the load, exactly in time."""
    A, B, C, E = on_a_grid(driven, load, cells)
    rate = 2 * np.pi / (0.2 * time[-1])
    generator, start = {
        "step": (np.zeros((1, 1)), [1.0]),
        "ramp": (np.array([[0.0, 1.0], [0.0, 0.0]]), [0.0, 1.0]),
        "sine": (rate * np.array([[0.0, 1.0], [-1.0, 0.0]]), [0.0, 1.0]),
    }[shape]
    select = np.zeros((1, len(generator)))
    select[0, 0] = 1.0
    if load == "piston.displacement":  # driven by the speed of the load
        select = select @ generator
    whole = np.block([[A, B @ select], [np.zeros((len(generator), len(A))), generator]])
    state = np.concatenate([np.zeros(len(A)), start])
    values = []
    for span in np.diff(time, prepend=0.0):
        state = expm(whole * span) @ state
        values.append(C @ state[: len(A)] + E[:, 0] * (select @ state[len(A) :]))
    return np.array(values).T


CASES = [
    (held, load, shape)
    for held, load in [
        (False, "piston.pressure"), (False, "filter.bath_concentration"), (False, "filter.current"),
        (True, "piston.displacement"), (True, "filter.bath_concentration"), (True, "filter.bath_pressure"),
        (True, "filter.current"),
    ]
    for shape in ("step", "ramp", "sine")
    if (load, shape) != ("piston.displacement", "step")
]  # fmt: skip


@pytest.mark.parametrize(("held", "load", "shape"), CASES, ids=["-".join(map(str, case)) for case in CASES])
@pytest.mark.parametrize("tissue", TISSUES, ids=["real", "complex"])
def test_against_an_integration_of_the_balances(tissue: Tissue, held: bool, load: str, shape: str) -> None:
    driven = DrivenColumn(column(ELECTROCHEMICAL, tissue), held, "anion")
    time = np.array([0.02, 0.1, 0.4, 1.0]) * slowest_time(driven.column)
    history = {"step": step(1.0), "ramp": ramp(1e9, 1e9), "sine": Sine(1.0, 0.2 * time[-1])}[shape]
    coarse, fine = (integrated(driven, load, shape, time, cells) for cells in (40, 80))
    finest = fine + (fine - coarse) / 3  # second order in space
    for i, measured in ((int(held), ("strain", "pressure")[held]), (2, "wall_potential")):
        exact = driven.history(measured, {load: history}, time)[0]
        scale = np.abs(exact).max()
        np.testing.assert_allclose(exact, finest[i], rtol=2e-5, atol=2e-5 * scale + 1e-10)


# ---- limits ----------------------------------------------------------------------------------------------


def test_isometric_bath_step() -> None:
    """The stress follows the bath at once where ions do, never without swelling, and with the salt in between."""
    time = np.array([1e-3, 50.0, 1e5])
    pressure = {
        name: DrivenColumn(column(model), held=True).history(
            "pressure", {"filter.bath_concentration": step(-1e-6)}, time
        )
        for name, model in MODELS.items()
    }
    assert not pressure["biphasic"].any()
    reduced, full = pressure["biphasic-swelling"][0], pressure["electrochemical"][0]
    np.testing.assert_allclose(reduced, reduced[-1], rtol=1e-12)
    np.testing.assert_allclose(full[-1], reduced[-1], rtol=1e-6)
    assert abs(full[0] / full[-1] - 1) > abs(full[1] / full[-1] - 1) > 0.05


def test_first_stress_of_an_isometric_bath_step_is_the_reflected_osmotic_pressure() -> None:
    """No volume may enter the first layer: (sqrt(D) m_b)_1 = 0, by the root of the matrix."""
    linear = column(ELECTROCHEMICAL, random_tissue(20, seed=33))
    driven = DrivenColumn(linear, held=True)
    first = driven.history("pressure", {"filter.bath_concentration": step(1e-6)}, np.array([1e-9]))[:, 0]
    for row in range(20):
        values, vectors = np.linalg.eig(linear.diffusion[row].astype(complex))
        root = (vectors * np.sqrt(values)) @ np.linalg.inv(vectors)
        bath, pressed = linear.boundary_change(0.0, 1e-6)[row], linear.boundary_change(1.0)[row]
        assert first[row] == pytest.approx((-(root @ bath)[0] / (root @ pressed)[0]).real, rel=1e-6)


def test_displacement_held_for_long_needs_the_equilibrium_pressure() -> None:
    """The drained stiffness: what pressure that strain takes with a free piston."""
    linear = column(ELECTROCHEMICAL, random_tissue(50, seed=34))
    late = np.array([1e8])
    strain = DrivenColumn(linear).history("strain", {"piston.pressure": step(1.0)}, late)
    pressed = DrivenColumn(linear, held=True).history(
        "pressure", {"piston.displacement": ramp(linear.current_height * strain[:, 0], 1e6)}, late
    )
    np.testing.assert_allclose(pressed, 1.0, rtol=1e-6)


def test_histories_superpose() -> None:
    """A table by its integration piece by piece; times before, at and after its points."""
    driven = DrivenColumn(column(ELECTROCHEMICAL, TISSUES[0]), held=True)
    span = slowest_time(driven.column)
    times, values = np.array([0.0, 0.05, 0.05, 0.2, 0.5]) * span, np.array([0.0, 1.0, 1.0, -0.5, 0.25])
    table = PiecewiseLinear(times, values)
    time = np.array([0.0, 0.02, 0.05, 0.1, 0.3, 0.9]) * span
    parts = [ramp(b - a, e - s, s) for s, e, a, b in zip(times, times[1:], values, values[1:], strict=False) if e > s]
    whole = driven.history("pressure", {"piston.displacement": table}, time)
    pieces = sum(driven.history("pressure", {"piston.displacement": part}, time) for part in parts)
    np.testing.assert_allclose(whole, pieces, rtol=1e-9, atol=1e-12 * np.abs(whole).max())
    np.testing.assert_allclose(table.value(time), np.interp(time, times, values)[None], atol=1e-12)


def test_rows_may_have_ramps_and_steps() -> None:
    linear = column(ELECTROCHEMICAL, random_tissue(2, seed=35))
    time = np.array([5.0, 30.0, 200.0])
    both = DrivenColumn(linear).history("strain", {"piston.pressure": ramp(1e-3, np.array([0.0, 40.0]))}, time)
    for row, over in enumerate((0.0, 40.0)):
        alone = DrivenColumn(linear).history("strain", {"piston.pressure": ramp(1e-3, over)}, time)
        np.testing.assert_allclose(both[row], alone[row], rtol=1e-10)


@pytest.mark.parametrize("held", [False, True])
def test_a_sine_that_ends_keeps_its_value(held: bool) -> None:
    """A quarter of a slow sine is nearly the table through many of its points."""
    driven = DrivenColumn(column(ELECTROCHEMICAL), held)
    load, measured = ("piston.displacement", "pressure") if held else ("piston.pressure", "strain")
    sine = Sine(1e-3, 400.0, start=10.0, end=150.0)
    points = np.linspace(10.0, 150.0, 401)
    table = PiecewiseLinear(points, 1e-3 * np.sin(2 * np.pi * (points - 10.0) / 400.0))
    time = np.array([5.0, 60.0, 149.0, 151.0, 300.0, 5000.0])
    a, b = (driven.history(measured, {load: history}, time) for history in (sine, table))  # type: ignore[dict-item]
    np.testing.assert_allclose(a, b, rtol=2e-4, atol=1e-4 * np.abs(b).max())
    np.testing.assert_allclose(sine.value(time), table.value(time[None])[0], atol=1e-7)


def test_loads_that_contradict() -> None:
    for held, load in ((True, "piston.pressure"), (False, "piston.displacement")):
        with pytest.raises(ValueError, match=f"{load} cannot be given"):
            DrivenColumn(column(BIPHASIC), held).history("strain", {load: step(1.0)}, np.array([1.0]))
    with pytest.raises(ValueError, match="no load 'pressure'"):
        DrivenColumn(column(BIPHASIC)).history("strain", {"pressure": step(1.0)}, np.array([1.0]))
    with pytest.raises(ValueError, match="has no ions to carry a current"):
        DrivenColumn(column(BIPHASIC)).history("strain", {"filter.current": step(1.0)}, np.array([1.0]))


# ---- electrical coefficients and potentials --------------------------------------------------------------


def test_coefficients_of_the_reference_tissue() -> None:
    linear = column(ELECTROCHEMICAL)
    found = electrical_coefficients(linear.tissue, linear.volume_ratio, linear.log_activity)
    assert found.water_per_charge.item() == pytest.approx(14.81, abs=5e-3)
    assert found.anion_transport_number.item() == pytest.approx(0.330, abs=5e-4)
    assert found.still_conductivity.item() == pytest.approx(6.14e-7, abs=5e-10)


def test_coefficients_are_their_closed_forms() -> None:
    """Theory of the linear column with a, b = c+ D+ -+ c- D-."""
    linear = column(ELECTROCHEMICAL, random_tissue(100, seed=36))
    tissue, J = linear.tissue, linear.volume_ratio
    found = electrical_coefficients(tissue, J, linear.log_activity)
    charge, RT, w = fixed_charge_density(tissue, J), tissue.thermal_energy, 1 - tissue.hindrance_factor
    cation, anion = ion_concentrations(tissue.osmotic, charge, linear.log_activity)
    n_f, from_anion = fluid_fraction(tissue, J), anion * tissue.anion_diffusivity
    b = cation * tissue.cation_diffusivity + from_anion
    a = b - 2 * from_anion
    k_open = linear.mobility[:, 0, 0]
    tau_q = k_open * w * charge * RT / (FARADAY * n_f * b)
    tau_a = anion * w * (1 + tissue.anion_diffusivity * charge / b) * tau_q - from_anion / (b * FARADAY)
    by_flow = w * charge * RT / (n_f * FARADAY * b)
    by_water, by_activity = linear.mobility[:, 0].T
    for value, expected in (
        (found.water_per_charge, tau_q),
        (found.anion_per_charge, tau_a),
        (found.potential_per_water_potential, -by_flow * by_water),
        (found.potential_per_log_activity, -by_flow * by_activity - RT * a / (FARADAY * b)),
        (1 / found.conductivity, RT / (n_f * FARADAY**2 * b) - by_flow * tau_q),
        (found.still_conductivity, n_f * FARADAY**2 * b / RT),
        (found.anion_transport_number, from_anion / b),
    ):
        np.testing.assert_allclose(value, expected, rtol=1e-9)


def test_onsager() -> None:
    """Electro-osmosis is the streaming potential; what a current does to the salt, its diffusion potential."""
    linear = column(ELECTROCHEMICAL, random_tissue(100, seed=37))
    found = electrical_coefficients(linear.tissue, linear.volume_ratio, linear.log_activity)
    np.testing.assert_allclose(found.water_per_charge, -found.potential_per_water_potential, rtol=1e-12)
    # conjugate to the flux of anions at no current is 2 R T ln a~ (less the potential, for which j- = j_salt - i/(2 F))
    salt = found.anion_per_charge + 0.5 / FARADAY
    np.testing.assert_allclose(
        -found.potential_per_log_activity / (2 * linear.tissue.thermal_energy), salt, rtol=1e-9, atol=1e-12
    )


def test_streaming_potential_in_compression() -> None:
    """At first the water at the wall carries the load, so the potential there is tau_q times it; in the end none."""
    linear = column(ELECTROCHEMICAL, random_tissue(20, seed=38))
    driven, time = DrivenColumn(linear), np.array([1e-7, 1e6])
    wall, tissue = (
        driven.history(measured, {"piston.pressure": step(1e-3)}, time)
        for measured in ("wall_potential", "tissue_potential")
    )
    coefficients = electrical_coefficients(linear.tissue, linear.volume_ratio, linear.log_activity)
    np.testing.assert_allclose(wall[:, 0], -1e-3 * coefficients.water_per_charge, rtol=1e-9)
    np.testing.assert_allclose(tissue[:, 0], wall[:, 0], rtol=1e-6)
    np.testing.assert_allclose(wall[:, 1], 0.0, atol=1e-6)


def test_donnan_potential_in_equilibrium() -> None:
    """After a bath step the potential in the tissue has changed as the Donnan potential of the new equilibrium."""
    linear = column(ELECTROCHEMICAL, random_tissue(20, seed=39))
    tissue, J, late = linear.tissue, linear.volume_ratio, np.array([1e7])
    change = DrivenColumn(linear).history("tissue_potential", {"filter.bath_concentration": step(1e-9)}, late)[:, 0]
    strain = DrivenColumn(linear).history("strain", {"filter.bath_concentration": step(1e-9)}, late)[:, 0]

    def donnan(share: float) -> Array:
        ratio = J * (1 + share * strain)
        ions = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, ratio), np.log(BATH + share * 1e-9))
        return -0.5 * tissue.thermal_energy / FARADAY * np.log(ions[0] / ions[1])

    np.testing.assert_allclose(change, donnan(0.5) - donnan(-0.5), rtol=1e-5)


def test_electrode_potential_without_current_is_that_of_its_ion() -> None:
    """Two electrodes see ln a~ +- F psi~/(R T): half their sum is psi~."""
    linear = column(ELECTROCHEMICAL)
    time, loads = np.array([1.0, 100.0]), {"filter.bath_concentration": step(-1e-6)}
    cation, anion = (
        DrivenColumn(linear, electrode=e).history("electrode_potential", loads, time) for e in ("cation", "anion")
    )
    wall = DrivenColumn(linear).history("wall_potential", loads, time)
    np.testing.assert_allclose(0.5 * (cation + anion), wall, rtol=1e-12)
    behind = linear.profile(linear.current_height, time, 0.0, -1e-6).log_activity[:, :, 0] + 1e-6 / BATH
    np.testing.assert_allclose(0.5 * (cation - anion), linear.tissue.thermal_energy / FARADAY * behind, rtol=1e-9)
