"""The linear solution of a column, against numbers known before, the full laws and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tissues import point_of, random_tissue, reference_tissue

from fvswell.exact.linear_swelling import LinearColumn, salt_outdraws_osmosis
from fvswell.exact.slab import mean_uptake, profile_uptake, ramp_influx, ramp_uptake, relaxation_time
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.fluxes import mixture_fluxes
from fvswell.physics.models import BIPHASIC, BIPHASIC_SWELLING, ELECTROCHEMICAL, MODELS, Model
from fvswell.physics.osmotic import ion_concentrations
from fvswell.physics.solids import aggregate_modulus
from fvswell.physics.tissue import Array, Tissue, fixed_charge_density

TIMES = np.array([20.0, 100.0, 400.0, 1e6])


def column(model: Model, tissue: Tissue | None = None, pressure: float = 0.0) -> LinearColumn:
    tissue = reference_tissue() if tissue is None else tissue
    return LinearColumn.at_equilibrium(model, tissue, 0.5, pressure, 1.5e-4)


def slab_time(linear: LinearColumn, scaled: float) -> Array:
    """Time in s after which the fastest diffusion has come a given way; shape (rows, 1)."""
    return scaled * (linear.current_height**2 / linear.diffusivities.real.max(axis=1))[:, None]


def every_model() -> list[LinearColumn]:
    """Random tissues; one of them has complex eigenvalues, as about one in a hundred has."""
    return [column(model, random_tissue(300, seed=3), pressure=0.05) for model in MODELS.values()]


# ---- kernels ---------------------------------------------------------------------------------------------


def slow_series(wave_numbers: Array, amplitude: Array, time: Array) -> Array:
    return (amplitude * np.exp(-(wave_numbers**2) * time[..., None])).sum(axis=-1)


@pytest.mark.parametrize("turn", [0.0, 0.8])
def test_kernels_equal_their_full_series(turn: float) -> None:
    """Ten thousand exponentials, at real times and at times turned into the complex plane."""
    time = np.array([1e-6, 1e-3, 0.05, 0.1499, 0.1501, 0.5, 3.0]) * np.exp(1j * turn)
    time = time.real if turn == 0.0 else time
    odd, even = (np.arange(10_000) + 0.5) * np.pi, np.arange(1, 10_000) * np.pi
    x = np.array([[0.001], [0.3], [1.0]])
    np.testing.assert_allclose(mean_uptake(time), 1 - slow_series(odd, 2 / odd**2, time), rtol=1e-11)
    np.testing.assert_allclose(
        profile_uptake(x, time), 1 - slow_series(odd, 2 / odd * np.sin(odd * x[..., None]), time), atol=2e-14
    )
    np.testing.assert_allclose(
        ramp_uptake(time), time - 1 / 3 + slow_series(odd, 2 / odd**4, time), rtol=1e-11, atol=1e-15
    )
    np.testing.assert_allclose(
        ramp_influx(time), time + 1 / 3 - slow_series(even, 2 / even**2, time), rtol=1e-11, atol=2e-15
    )


def test_kernels_have_no_gap_where_the_forms_change_over() -> None:
    around = np.array([np.nextafter(0.15, 0.0), 0.15])
    for kernel in (mean_uptake, ramp_influx, ramp_uptake, lambda t: profile_uptake(np.array(0.4), t)):
        assert abs(np.diff(kernel(around)).item()) < 5e-16


def test_kernels_at_and_before_the_step() -> None:
    time = np.array([-1.0, 0.0])
    np.testing.assert_array_equal(mean_uptake(time), 0.0)
    np.testing.assert_array_equal(ramp_influx(time), 0.0)
    np.testing.assert_array_equal(ramp_uptake(time), 0.0)
    np.testing.assert_array_equal(profile_uptake(np.array([0.0, 1e-6, 0.5]), np.array(0.0)), [1.0, 0.0, 0.0])


@pytest.mark.parametrize("fraction", [1e-3, 0.5, 0.99, 0.999999])
def test_relaxation_time(fraction: float) -> None:
    assert mean_uptake(np.array(relaxation_time(fraction))) == pytest.approx(fraction, rel=1e-13)


def test_nothing_relaxes_fully() -> None:
    with pytest.raises(ValueError, match="between 0 and 1, not 1"):
        relaxation_time(1)


# ---- the reference tissue --------------------------------------------------------------------------------


def test_reference_state() -> None:
    reference = column(ELECTROCHEMICAL)
    assert reference.volume_ratio.item() == pytest.approx(1.054503, abs=1e-6)
    np.testing.assert_allclose(reference.diffusivities, [[9.1437e-4, 6.0153e-4]], atol=5e-9)
    assert reference.mobility[0, 0, 0] == pytest.approx(8.3945e-4, abs=5e-9)


def test_reference_creep() -> None:
    strain = column(ELECTROCHEMICAL).global_strain(TIMES, delta_pressure=1e-3)
    np.testing.assert_allclose(strain, [[-2.8538e-4, -6.3322e-4, -1.00768e-3, -1.069947e-3]], atol=5.1e-9)


def test_reference_swelling_overshoots() -> None:
    strain = column(ELECTROCHEMICAL).global_strain(TIMES, delta_concentration=-1e-6)
    np.testing.assert_allclose(strain, [[4.0979e-4, 9.0033e-4, 1.23413e-3, 1.197687e-3]], atol=5.1e-9)


def test_biphasic_is_terzaghi() -> None:
    tissue, time = reference_tissue(), np.array([5.0, 50.0, 500.0])
    H = aggregate_modulus(tissue.solid, tissue.fluid_fraction)
    strain = column(BIPHASIC, tissue).global_strain(time, delta_pressure=1e-3)
    np.testing.assert_allclose(strain, [-1e-3 / H * mean_uptake(H * 1e-3 * time / 0.25)], rtol=1e-13)
    assert not column(BIPHASIC, tissue).global_strain(time, delta_concentration=1e-5).any()


# ---- over random tissues ---------------------------------------------------------------------------------


def test_swelling_models_reach_one_equilibrium() -> None:
    tissue = random_tissue(100, seed=5)
    strains = [
        column(model, tissue).global_strain(np.array([1e7]), 1e-3, -1e-6)
        for model in (BIPHASIC_SWELLING, ELECTROCHEMICAL)
    ]
    np.testing.assert_allclose(*strains, rtol=1e-8)


@pytest.mark.parametrize("model", [BIPHASIC, BIPHASIC_SWELLING, ELECTROCHEMICAL])
def test_final_change_is_the_derivative_of_the_equilibrium(model: Model) -> None:
    tissue, step = random_tissue(50, seed=6), 1e-4

    def ratio(share: float) -> Array:
        return equilibrium_volume_ratio(model.tissue(tissue), 0.05 + share * 0.1, 1.5e-4 * (1 - share))

    slope = (ratio(step) - ratio(-step)) / (2 * step)
    change = column(model, tissue, pressure=0.05).boundary_change(0.1, -1.5e-4)[:, 0]
    np.testing.assert_allclose(change, slope, rtol=1e-5)


def test_mobility_is_the_transport_law_without_current() -> None:
    """Solve q, j+, j- with the current set to zero for the potential's gradient, here numerically."""
    linear = column(ELECTROCHEMICAL, random_tissue(300, seed=7))
    tissue, J = linear.tissue, linear.volume_ratio
    ions = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), linear.log_activity)

    def full(*gradients: float) -> Array:
        fluxes = mixture_fluxes(tissue, J, *ions, *(np.array(gradients)[:, None] * np.ones_like(J)))
        return np.stack([fluxes.water, fluxes.anion, fluxes.cation - fluxes.anion])

    laws = np.stack([full(1, 0, 0), full(0, 1, 0), full(0, 0, 1)], axis=-1)  # (q, j-, i), rows, gradients
    for gradient in range(2):
        potential = -laws[2, :, gradient] / laws[2, :, 2]
        fluxes = laws[:2, :, gradient] + potential * laws[:2, :, 2]
        np.testing.assert_allclose(-linear.mobility[:, :, gradient].T, fluxes, rtol=1e-12, atol=1e-25)


def test_mobility_is_reciprocal_and_dissipates() -> None:
    """Onsager: symmetric and positive for the gradients of mu_f and of the salt, 2 R T ln a~."""
    linear = column(ELECTROCHEMICAL, random_tissue(300, seed=8))
    L = linear.mobility / np.stack([1.0, 2.0 * linear.tissue.thermal_energy])
    np.testing.assert_allclose(L[:, 0, 1], L[:, 1, 0], rtol=1e-13)
    assert np.all(L[:, 0, 0] > 0)
    assert np.all(np.linalg.det(L) > 0)


def test_stiffness_derives_from_a_free_energy_where_osmosis_is_ideal() -> None:
    """Maxwell: d mu_f/dM = 2 R T d ln a~/dJ when the osmotic coefficient inside is 1."""
    linear = column(ELECTROCHEMICAL, random_tissue(50, seed=9, osmotic_coefficient=1.0))
    energy = 2.0 * linear.tissue.thermal_energy
    np.testing.assert_allclose(linear.stiffness[:, 0, 1], energy * linear.stiffness[:, 1, 0], rtol=1e-12)
    assert not np.iscomplexobj(linear.diffusivities)


@pytest.mark.parametrize("linear", every_model(), ids=list(MODELS))
def test_shares_rebuild_functions_of_the_matrix(linear: LinearColumn) -> None:
    change = linear.boundary_change(1e-3, -1e-6)
    share = linear.response(change)
    np.testing.assert_allclose(share.sum(axis=1), change, rtol=1e-12, atol=1e-18)
    once = (linear.diffusivities[..., None] * share).sum(axis=1)
    expected = (linear.diffusion @ change[..., None])[..., 0]
    np.testing.assert_allclose(once, expected, rtol=1e-10, atol=1e-22)


def test_some_eigenvalues_are_complex() -> None:
    """So that the tests over these tissues do cover them."""
    imaginary = np.abs(every_model()[2].diffusivities.imag)
    assert 0.0 < np.mean(imaginary > 1e-3 * imaginary.max()) < 0.1


def nearly_equal_eigenvalues(relative_gap: float) -> tuple[LinearColumn, LinearColumn]:
    """The reference tissue with D scaled apart by as little as wanted, and the same with a clear gap."""
    linear = column(ELECTROCHEMICAL)
    d, vectors = np.linalg.eig(linear.diffusion[0])
    columns = []
    for gap in (relative_gap, 1e-3):
        changed = column(ELECTROCHEMICAL)
        D = vectors @ np.diag(d[0] * np.array([1.0, 1.0 - gap])) @ np.linalg.inv(vectors)
        changed.__dict__["diffusion"] = D[None]
        columns.append(changed)
    return columns[0], columns[1]


@pytest.mark.parametrize("gap", [0.0, 1e-12, 1e-6, 1e-4])
def test_nearly_equal_eigenvalues(gap: float) -> None:
    """Against the exact answer for equal eigenvalues, the second diffusivity differing by ``gap`` only."""
    near, apart = nearly_equal_eigenvalues(gap)
    time, change = np.array([10.0, 100.0]), near.boundary_change(1e-3)
    value = near.mean_volume_change(time, change)
    single = mean_uptake(near.diffusivities.mean() / near.current_height**2 * time) * change[0, 0]
    np.testing.assert_allclose(value[0], single, rtol=1e-9 + gap)
    np.testing.assert_allclose(apart.mean_volume_change(time, change), value, rtol=2e-3)


# ---- against finite differences --------------------------------------------------------------------------


def finite_differences(linear: LinearColumn, change: Array, time: Array, cells: int) -> Array:
    """Contents (rows of one column) integrated on a grid graded toward the filter: times, contents, cells."""
    faces = linear.current_height[0] * np.linspace(0, 1, cells + 1) ** 2
    centres = 0.5 * (faces[1:] + faces[:-1])
    D, distances = linear.diffusion[0], np.diff(np.concatenate([faces[:1], centres]))

    def rate(_: float, m: Array) -> Array:
        m = m.reshape(-1, cells)
        gradient = np.diff(np.concatenate([change[0][:, None], m], axis=1), axis=1) / distances
        flux = np.concatenate([-D @ gradient, np.zeros((len(m), 1))], axis=1)
        return (-np.diff(flux, axis=1) / np.diff(faces)).ravel()

    size = change.shape[1] * cells
    banded = np.abs(np.arange(size)[:, None] % cells - np.arange(size) % cells) <= 1
    solution = solve_ivp(
        rate,
        (0, time[-1]),
        np.zeros(size),
        method="BDF",
        t_eval=time,
        rtol=1e-8,
        atol=1e-14,
        jac_sparsity=banded,
    )
    mean = (solution.y.T.reshape(len(time), -1, cells) * np.diff(faces)).sum(axis=-1) / faces[-1]
    return mean[:, 0]


@pytest.mark.parametrize("steps", [(1e-3, 0.0), (0.0, -1e-6)])
@pytest.mark.parametrize("row", range(3))
def test_mean_against_finite_differences(row: int, steps: tuple[float, float]) -> None:
    linear = column(ELECTROCHEMICAL, point_of(random_tissue(3, seed=11), row))
    change = linear.boundary_change(*steps)
    time = np.array([0.01, 0.1, 1.0]) * linear.current_height**2 / linear.diffusivities.real.min()
    values = [finite_differences(linear, change, time, cells) for cells in (60, 120)]
    finest = values[1] + (values[1] - values[0]) / 3  # second order in space
    exact = linear.mean_volume_change(time, change)[0]
    np.testing.assert_allclose(finest, exact, rtol=2e-5, atol=1e-6 * np.abs(exact).max())


def test_ramp_is_the_integral_of_steps() -> None:
    for linear in every_model():
        time = slab_time(linear, 0.4)
        nodes, weights = np.polynomial.legendre.leggauss(40)
        early = time * (0.5 * (nodes + 1)) ** 2  # the answer to a step is smooth in the root of time
        change = linear.boundary_change(1e-3, -1e-6)
        steps = linear.mean_volume_change(early, change)
        integral = (steps * weights * time * 0.5 * (nodes + 1)).sum(axis=1)
        np.testing.assert_allclose(linear.ramped_volume_change(time, change)[:, 0], integral, rtol=1e-8, atol=1e-12)


def test_profile_satisfies_the_balances() -> None:
    """dm/dt = J0 d/dx(L dy/dx) by central differences of the solution itself; boundary values; mean."""
    for linear in every_model():
        height, pressure, concentration = linear.current_height[:, None], 1e-3, -1e-6
        time = slab_time(linear, 0.05)
        x, dx, dt = 0.3 * height, 1e-3 * height, 1e-3 * time
        instants = np.concatenate([time - dt, time, time + dt], axis=1)
        positions = np.concatenate([x - dx, x, x + dx], axis=1)
        inside = linear.profile(positions, instants, pressure, concentration)
        rate = (inside.volume_ratio[:, 2, 1] - inside.volume_ratio[:, 0, 1]) / (2 * dt[:, 0])
        gradients = [inside.water_potential]
        if linear.model.transports_ions:
            gradients.append(inside.log_activity)
        flow = sum(
            linear.mobility[:, 0, i] * np.diff(y[:, 1, :], 2)[:, 0] / dx[:, 0] ** 2 for i, y in enumerate(gradients)
        )
        balance = linear.volume_ratio * flow
        np.testing.assert_allclose(balance, rate, rtol=1e-4, atol=1e-4 * abs(rate).max())

        at_filter = linear.profile(np.array([0.0]), time, pressure, concentration)
        water = 0.0
        if linear.model.swelling:
            water = -2 * 0.93 * linear.tissue.thermal_energy * concentration
            np.testing.assert_allclose(at_filter.log_activity, concentration / 1.5e-4, rtol=1e-9)
        np.testing.assert_allclose(at_filter.water_potential[:, 0, 0], water, rtol=1e-9, atol=1e-12)

        cells = (np.arange(4000) + 0.5) / 4000
        mean = linear.profile(cells * height, time, pressure, concentration).volume_ratio.mean(axis=-1)
        strain = linear.global_strain(time, pressure, concentration)
        np.testing.assert_allclose(mean / linear.volume_ratio[:, None], strain, rtol=1e-5, atol=1e-9)


def test_load_is_carried_by_the_water_at_first() -> None:
    """Far from the filter nothing has left yet: mu_f has risen by the whole load."""
    for linear in every_model():
        time = slab_time(linear, 1e-4)
        far = linear.profile(linear.current_height[:, None], time, 1e-3)
        np.testing.assert_allclose(far.water_potential, 1e-3, rtol=1e-9)
        np.testing.assert_allclose(far.volume_ratio, 0.0, atol=1e-12)


def test_position_outside_the_column() -> None:
    with pytest.raises(ValueError, match="must lie in the column"):
        column(BIPHASIC).profile(np.array([0.6]), np.array([1.0]), 1e-3)


# ---- negative osmosis ------------------------------------------------------------------------------------


def test_salt_that_outdraws_osmosis_moves_water_toward_the_weaker_solution() -> None:
    """The closed criterion is the sign of the volume flow that a gradient of salt alone causes, D_12 > 0."""
    linear = column(ELECTROCHEMICAL, random_tissue(2000, seed=13))
    criterion = salt_outdraws_osmosis(linear.tissue, linear.volume_ratio, linear.log_activity)
    np.testing.assert_array_equal(criterion, linear.diffusion[:, 0, 1] > 0)
    assert 0.1 < criterion.mean() < 0.9


def test_hindrance_decides_for_the_reference_tissue() -> None:
    linear = column(ELECTROCHEMICAL, reference_tissue(hindrance_factor=np.array([0.0, 0.4])))
    criterion = salt_outdraws_osmosis(linear.tissue, linear.volume_ratio, linear.log_activity)
    np.testing.assert_array_equal(criterion, [True, False])


def test_first_flow_is_the_sign_of_the_early_strain() -> None:
    linear = column(ELECTROCHEMICAL, random_tissue(2000, seed=14))
    change = linear.boundary_change(0.0, -1e-6)
    time = slab_time(linear, 1e-4)
    early = linear.mean_volume_change(time, change) / linear.volume_ratio[:, None]
    np.testing.assert_allclose(early[:, 0], linear.early_strain(change) * np.sqrt(time[:, 0]), rtol=1e-6, atol=1e-12)
    backward = linear.flows_backward_first(change)
    np.testing.assert_array_equal(backward, early[:, 0] * change[:, 0] < 0)
    assert 0.01 < backward.mean() < 0.2
    drawn = salt_outdraws_osmosis(linear.tissue, linear.volume_ratio, linear.log_activity)
    assert np.mean(drawn[backward]) > 0.9  # needed, nearly always, and not enough
    assert np.mean(backward[drawn]) < 0.5
