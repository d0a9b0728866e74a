"""Transport laws at a point: against the friction matrix they stem from, their symmetry, and their parts."""

from __future__ import annotations

import numpy as np
from tissues import BATH, random_tissue, reference_tissue

from fvswell.compiled.dual import slope_of, variables
from fvswell.physics.fluxes import ion_flux_parts, mixture_fluxes, potential_gradient_of_current
from fvswell.physics.osmotic import ion_concentrations
from fvswell.physics.permeability import hydraulic_permeability, open_circuit_ratio
from fvswell.physics.tissue import Array, Tissue, convection_factor, fixed_charge_density, fluid_fraction

POINTS = 60
STEP = 1e-40


def ions(tissue: Tissue, J: Array, activity: Array) -> tuple[Array, Array]:
    found: tuple[Array, Array] = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), activity)
    return found


def random_point(seed: int) -> tuple[Tissue, Array, Array, Array]:
    """A tissue, J, ln a~ and the gradients (3, points) of mu_f, ln a~ and F psi~/RT."""
    draw = np.random.default_rng(seed)
    J, activity = draw.uniform(0.6, 1.4, POINTS), draw.uniform(-11, -7, POINTS)
    return random_tissue(POINTS, seed), J, activity, draw.uniform(-2, 2, (3, POINTS))


def test_fluxes_solve_the_friction_equations() -> None:
    """Huyghe & Janssen: B (v_f, v+, v-) = -(n_f grad mu_f, n_f c+ grad mu+, n_f c- grad mu-), solved numerically."""
    tissue, J, activity, (water, salt, psi) = random_point(1)
    cation, anion = ions(tissue, J, activity)
    n_f, RT, w = fluid_fraction(tissue, J), tissue.thermal_energy, convection_factor(tissue)
    frictions = (RT * n_f * cation / tissue.cation_diffusivity, RT * n_f * anion / tissue.anion_diffusivity)
    B = np.zeros((POINTS, 3, 3))
    B[:, 0, 0] = n_f**2 / hydraulic_permeability(tissue, J) + w**2 * (frictions[0] + frictions[1])
    for ion, friction in enumerate(frictions, start=1):
        B[:, ion, ion] = friction
        B[:, 0, ion] = B[:, ion, 0] = -w * friction
    forces = -np.stack([n_f * water, n_f * cation * RT * (salt + psi), n_f * anion * RT * (salt - psi)], axis=1)
    velocity = np.linalg.solve(B, forces[:, :, None])[:, :, 0]
    flux = mixture_fluxes(tissue, J, cation, anion, water, salt, psi)
    for value, velocities, content in zip(flux, velocity.T, (n_f, n_f * cation, n_f * anion), strict=True):
        expected = content * velocities
        np.testing.assert_allclose(value, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())


def test_fluxes_are_reciprocal_and_dissipate() -> None:
    """Onsager's symmetry in the forces (mu_f, mu+, mu-), and no flow uphill on the whole."""
    tissue, J, activity, _ = random_point(2)
    at, RT = ions(tissue, J, activity), tissue.thermal_energy
    zero = np.zeros_like(J)
    half = zero + 0.5 / RT
    unit = ((zero + 1, zero, zero), (zero, half, half), (zero, half, -half))  # of mu_f, mu+, mu-
    L = -np.stack([np.stack(mixture_fluxes(tissue, J, *at, *gradients)) for gradients in unit], axis=1)
    L = np.moveaxis(L, -1, 0)
    scale = np.sqrt(np.einsum("raa->ra", L))
    normalised = L / scale[:, :, None] / scale[:, None, :]
    np.testing.assert_allclose(normalised, np.swapaxes(normalised, 1, 2), atol=1e-13)
    assert np.linalg.eigvalsh(normalised).min() > 0.0


def test_potential_of_a_given_current_drives_that_current() -> None:
    tissue, J, activity, (water, salt, _) = random_point(3)
    at, current = ions(tissue, J, activity), np.linspace(-1e-6, 1e-6, POINTS)
    psi = potential_gradient_of_current(tissue, J, *at, water, salt, current)
    flux = mixture_fluxes(tissue, J, *at, water, salt, psi)
    scale = np.abs(flux.cation) + np.abs(flux.anion) + np.abs(at[0] * water * tissue.permeability[0])
    assert np.all(np.abs(flux.cation - flux.anion - current) < 1e-12 * scale)
    unsalted = potential_gradient_of_current(tissue, J, *at, water, 0.0 * salt, 0.0)
    expected = -hydraulic_permeability(tissue, J) * open_circuit_ratio(tissue, J, *at) * water
    np.testing.assert_allclose(mixture_fluxes(tissue, J, *at, water, 0.0 * salt, unsalted).water, expected, rtol=1e-12)


def test_derivatives_equal_complex_step() -> None:
    """By J, ln a~ and the gradients of mu_f and ln a~, through the ions and the potential at which no current flows."""
    tissue, J, activity, (water, salt, _) = random_point(4)

    def fluxes(J: Array, activity: Array, water: Array, salt: Array) -> tuple[Array, Array, Array]:
        at = ions(tissue, J, activity)
        psi = potential_gradient_of_current(tissue, J, *at, water, salt, 1e-7)
        found: tuple[Array, Array, Array] = mixture_fluxes(tissue, J, *at, water, salt, psi)
        return found

    arguments = (J, activity, water, salt)
    found = fluxes(*variables(*arguments))  # type: ignore[arg-type]
    for direction in range(4):
        shifted = [value + 1j * STEP * (direction == i) for i, value in enumerate(arguments)]
        for value, exact in zip(found, fluxes(*shifted), strict=True):
            expected = exact.imag / STEP
            # where large contributions cancel, rounding is relative to the largest of them
            np.testing.assert_allclose(
                slope_of(value, direction), expected, rtol=1e-13, atol=1e-14 * np.abs(expected).max()
            )


def test_parts_add_up_to_the_flux() -> None:
    """Convection, diffusion and migration, by what is found in the tissue: c and xi instead of a~ and psi~."""
    tissue, J, activity, (water, salt, psi) = random_point(5)
    # a state that varies along x: value + gradient * x, differentiated by complex step
    x = 1e-30j
    varying = ions(tissue, J + 0.3 * x, activity + salt * x)
    # F xi/(R T) = F psi~/(R T) - ln(gamma c+/a~)
    potential = 0.1 + psi * x - np.log(varying[0]) + activity + salt * x
    at = (varying[0].real, varying[1].real)
    flux = mixture_fluxes(tissue, J, *at, water, salt, psi)
    diffusivities = (tissue.cation_diffusivity, tissue.anion_diffusivity)
    for ion, (c, D, total, valence) in enumerate(zip(at, diffusivities, flux[1:], (1, -1), strict=True)):
        parts = ion_flux_parts(tissue, J, c, D, total, flux.water, varying[ion].imag / 1e-30)
        migration = -fluid_fraction(tissue, J) * D * c * valence * potential.imag / 1e-30
        np.testing.assert_allclose(parts.migration, migration, rtol=1e-10, atol=1e-12 * np.abs(parts.diffusion).max())
        np.testing.assert_allclose(sum(parts), total, rtol=1e-12, atol=1e-15 * np.abs(parts.diffusion).max())


def test_ions_left_behind_by_the_water_do_not_feel_it() -> None:
    tissue = reference_tissue(hindrance_factor=1.0)
    at = ions(tissue, np.array(1.0), np.log(np.array(BATH)))
    driven = mixture_fluxes(tissue, 1.0, *at, 1.0, 0.0, 0.0)
    assert (driven.water, driven.cation, driven.anion) == (-1e-3, 0.0, 0.0)
    assert mixture_fluxes(tissue, 1.0, *at, 0.0, 1.0, 1.0).water == 0.0
