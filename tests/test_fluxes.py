"""Transport laws at a point: against the friction matrix they stem from, their symmetry, parts and derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from tissues import random_tissue, reference_tissue

from fvswell.physics.electrochemistry import electric_potential, fluid_fraction, ion_concentrations
from fvswell.physics.fluxes import ion_flux_parts, mixture_flux_derivatives, mixture_fluxes
from fvswell.physics.models import ELECTROCHEMICAL, MODELS, Mixture
from fvswell.physics.permeability import hydraulic_permeability
from fvswell.physics.tissue import Array, Tissue

ROWS = 60


def random_point(seed: int) -> tuple[Tissue, Array, Array, Array]:
    """A tissue, J, ln c~ and the gradients (3, rows, 1) of mu_f, ln c~ and F psi~/RT."""
    draw = np.random.default_rng(seed)
    J, log_c = draw.uniform(0.6, 1.4, (ROWS, 1)), draw.uniform(-11, -7, (ROWS, 1))
    return random_tissue(ROWS, seed), J, log_c, draw.uniform(-2, 2, (3, ROWS, 1))


def test_fluxes_solve_the_friction_equations() -> None:
    """Huyghe & Janssen: B (v_f, v+, v-) = -(n_f grad mu_f, n_f c+ grad mu+, n_f c- grad mu-), solved numerically."""
    tissue, J, log_c, (water, salt, psi) = random_point(1)
    cation, anion = ion_concentrations(tissue, J, log_c)
    n_f, RT, w = fluid_fraction(tissue, J), tissue.thermal_energy, tissue.convection_factor
    frictions = (RT * n_f * cation / tissue.cation_diffusivity, RT * n_f * anion / tissue.anion_diffusivity)
    B = np.zeros((ROWS, 3, 3))
    B[:, 0, 0] = (n_f**2 / hydraulic_permeability(tissue, J) + w**2 * (frictions[0] + frictions[1]))[:, 0]
    for ion, friction in enumerate(frictions, start=1):
        B[:, ion, ion] = friction[:, 0]
        B[:, 0, ion] = B[:, ion, 0] = -(w * friction)[:, 0]
    forces = -np.concatenate([n_f * water, n_f * cation * RT * (salt + psi), n_f * anion * RT * (salt - psi)], axis=1)
    velocity = np.linalg.solve(B, forces[:, :, None])[:, :, 0]
    flux = mixture_fluxes(tissue, J, cation, anion, water, salt, psi)
    for value, velocities, content in zip(flux, velocity.T, (n_f, n_f * cation, n_f * anion), strict=True):
        expected = content[:, 0] * velocities
        np.testing.assert_allclose(value[:, 0], expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())


def test_fluxes_are_reciprocal_and_dissipate() -> None:
    """Onsager's symmetry in the forces (mu_f, mu+, mu-), and no flow uphill on the whole."""
    tissue, J, log_c, _ = random_point(2)
    ions, RT = ion_concentrations(tissue, J, log_c), tissue.thermal_energy
    zero = np.zeros_like(J)
    unit = ((zero + 1, zero, zero), (zero, 0.5 / RT, 0.5 / RT), (zero, 0.5 / RT, -0.5 / RT))  # of mu_f, mu+, mu-
    L = -np.stack([np.stack(mixture_fluxes(tissue, J, *ions, *gradients)) for gradients in unit], axis=1)[..., 0]
    L = np.moveaxis(L, -1, 0)
    scale = np.sqrt(np.einsum("raa->ra", L))
    normalised = L / scale[:, :, None] / scale[:, None, :]
    np.testing.assert_allclose(normalised, np.swapaxes(normalised, 1, 2), atol=1e-13)
    assert np.linalg.eigvalsh(normalised).min() > 0.0


def test_derivatives_equal_complex_step() -> None:
    tissue, J, log_c, gradients = random_point(3)
    step = 1e-30j

    def by_step(dJ: complex, dlog: complex, dgradient: int | None = None) -> Array:
        shifted = gradients.astype(complex)
        if dgradient is not None:
            shifted[dgradient] += step
        ions = ion_concentrations(tissue, J + dJ, log_c + dlog)
        flux = mixture_fluxes(tissue, J + dJ, *ions, *shifted)
        return np.stack([flux.water, flux.anion, flux.cation - flux.anion]).imag / 1e-30

    derivatives = mixture_flux_derivatives(tissue, J, *ion_concentrations(tissue, J, log_c), *gradients)
    expected = np.stack([by_step(step, 0.0), by_step(0.0, step)], axis=1)
    tolerance = 1e-12 * np.abs(expected).max(axis=(1, 2, 3), keepdims=True)
    assert np.all(np.abs(derivatives.by_state - expected) <= 1e-12 * np.abs(expected) + tolerance)
    expected = np.stack([by_step(0.0, 0.0, g) for g in range(3)], axis=1)
    tolerance = 1e-12 * np.abs(expected).max(axis=(1, 2, 3), keepdims=True)
    assert np.all(np.abs(derivatives.by_gradient - expected) <= 1e-12 * np.abs(expected) + tolerance)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("ratio", [None, np.array([[0.8]])])
def test_derivatives_of_every_model(model: str, ratio: Array | None) -> None:
    """Fluxes, contents and osmotic pressure of the three models, by complex step of J and ln c~."""
    tissue, J, log_c, gradients = random_point(4)
    mixture = Mixture(MODELS[model], tissue, np.array([[0.93]]), open_circuit_ratio=ratio)
    balances, own = len(mixture.model.balances), 2 if mixture.model is ELECTROCHEMICAL else 1
    now = mixture.at(J, log_c)
    steps = [(1e-30j, 0.0), (0.0, 1e-30j)][:own]
    shifted = [mixture.at(J + dJ, log_c + dlog) for dJ, dlog in steps]
    cases = [
        (mixture.flux_derivatives(now, gradients[:balances]).by_state,
         [mixture.fluxes(state, gradients[:balances]) for state in shifted]),
        (mixture.content_derivatives(now), [mixture.contents(state) for state in shifted]),
        (np.stack(np.broadcast_arrays(*mixture.osmotic_pressure_derivatives(now), J))[:-1][None],
         [np.asarray(mixture.osmotic_pressure(state) + 0 * state.J)[None] for state in shifted]),
    ]  # fmt: skip
    for given, values in cases:
        expected = np.stack([value.imag for value in values], axis=1) / 1e-30
        np.testing.assert_allclose(given, expected, rtol=1e-11, atol=1e-12 * np.abs(expected).max())


def test_parts_add_up_to_the_flux() -> None:
    """Convection, diffusion and migration, told by what is found in the tissue: c and xi instead of c~ and psi~."""
    tissue, J, log_c, (water, salt, psi) = random_point(5)
    # a state that varies along x: value + gradient * x, differentiated by complex step
    x = 1e-30j
    J_here, log_here = J + 0.3 * x, log_c + salt * x
    ions = ion_concentrations(tissue, J_here, log_here)
    xi = electric_potential(tissue, ions[0], log_here, 0.1 + psi * x)
    grad_xi = xi.imag / 1e-30 * 96.48533212 / tissue.thermal_energy
    at = tuple(ion.real for ion in ions)
    flux = mixture_fluxes(tissue, J, *at, water, salt, psi)
    diffusivities = (tissue.cation_diffusivity, tissue.anion_diffusivity)
    for ion, (c, D, total, valence) in enumerate(zip(at, diffusivities, flux[1:], (1, -1), strict=True)):
        parts = ion_flux_parts(tissue, J, c, D, total, flux.water, ions[ion].imag / 1e-30)
        migration = -fluid_fraction(tissue, J) * D * c * valence * grad_xi
        np.testing.assert_allclose(parts.migration, migration, rtol=1e-10, atol=1e-12 * np.abs(parts.diffusion).max())
        np.testing.assert_allclose(sum(parts), total, rtol=1e-12, atol=1e-15 * np.abs(parts.diffusion).max())


def test_ions_left_behind_by_the_water_do_not_feel_it() -> None:
    tissue, one, zero = reference_tissue(hindrance_factor=1.0), np.ones((1, 1)), np.zeros((1, 1))
    ions = ion_concentrations(tissue, one, np.log(1.5e-4 * one))
    driven = mixture_fluxes(tissue, one, *ions, one, zero, zero)
    assert (driven.water.item(), driven.cation.item(), driven.anion.item()) == (-1e-3, 0.0, 0.0)
    assert mixture_fluxes(tissue, one, *ions, zero, one, one).water.item() == 0.0
