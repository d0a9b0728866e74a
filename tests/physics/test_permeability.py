"""Permeability, and what is left of it where no current can flow."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from tissues import BATH, point_of, random_tissue, reference_tissue

from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.fluxes import mixture_fluxes
from fvswell.physics.osmotic import bath_log_activity, ion_concentrations
from fvswell.physics.permeability import (
    PERMEABILITIES,
    hydraulic_permeability,
    open_circuit_permeability_with_ion_volumes,
    open_circuit_ratio,
    permeability,
)
from fvswell.physics.tissue import Array, Tissue, fixed_charge_density

CATION_VOLUME, ANION_VOLUME = 2.33, 15.17  # mm3/mmol


def ions(tissue: Tissue, J: Array | float) -> tuple[Array, Array]:
    activity = bath_log_activity(tissue.osmotic, BATH)
    found: tuple[Array, Array] = ion_concentrations(tissue.osmotic, fixed_charge_density(tissue, J), activity)
    return found


def open_circuit_permeability(tissue: Tissue, J: Array | float) -> Array:
    value: Array = hydraulic_permeability(tissue, J) * open_circuit_ratio(tissue, J, *ions(tissue, J))
    return value


def test_reference_values() -> None:
    tissue = reference_tissue()
    assert open_circuit_permeability(tissue, 1.0) / 1e-3 == pytest.approx(0.821, abs=5e-4)
    full = open_circuit_permeability_with_ion_volumes(tissue, 1.0, *ions(tissue, 1.0), CATION_VOLUME, ANION_VOLUME)
    assert full / 1e-3 == pytest.approx(0.823, abs=5e-4)


def test_value_in_the_equilibrated_sample() -> None:
    tissue = reference_tissue()
    J = equilibrium_volume_ratio(tissue, 0.0, BATH)
    assert open_circuit_permeability(tissue, J) == pytest.approx(8.3945e-4, abs=5e-9)


def test_full_form_tends_to_the_closed_form_as_the_ions_lose_their_volume() -> None:
    tissue, J = random_tissue(60, seed=1, hindrance_factor=np.linspace(0, 1, 60)), np.full(60, 1.05)
    closed = open_circuit_permeability(tissue, J)
    difference = [
        np.abs(
            open_circuit_permeability_with_ion_volumes(
                tissue, J, *ions(tissue, J), CATION_VOLUME * scale, ANION_VOLUME * scale
            ) / closed - 1
        ).max()
        for scale in (1e-1, 1e-2, 1e-3, 1e-6)
    ]  # fmt: skip
    assert difference[1] / difference[0] == pytest.approx(0.1, rel=0.05)  # in proportion to the volumes
    assert difference[2] / difference[1] == pytest.approx(0.1, rel=0.05)
    assert difference[3] < 1e-7


def test_closed_form_is_the_flow_at_zero_current() -> None:
    """Water driven by a pressure alone, the electric potential chosen so that no current flows."""
    everywhere, J = random_tissue(10, seed=2), 0.9
    for index in range(10):
        tissue = point_of(everywhere, index)
        at = ions(tissue, J)

        def current(potential: float, tissue: Tissue = tissue, at: tuple[Array, Array] = at) -> float:
            flux = mixture_fluxes(tissue, J, *at, 1.0, 0.0, potential)
            return float(flux.cation - flux.anion)

        potential = brentq(current, -1e4, 1e4, xtol=1e-14, rtol=1e-14)
        flux = mixture_fluxes(tissue, J, *at, 1.0, 0.0, potential)
        assert -flux.water == pytest.approx(open_circuit_permeability(tissue, J), rel=1e-9)


def test_streaming_potential_only_ever_slows_the_water() -> None:
    tissue, J = random_tissue(200, seed=3), np.full(200, 0.9)
    ratio = open_circuit_ratio(tissue, J, *ions(tissue, J))
    assert np.all((ratio > 0.0) & (ratio < 1.0))


@pytest.mark.parametrize("changes", [{"fixed_charge_density": 0.0}, {"hindrance_factor": 1.0}])
def test_nothing_to_drag_leaves_the_permeability(changes: dict[str, float]) -> None:
    assert open_circuit_permeability(reference_tissue(**changes), 1.0) == pytest.approx(1e-3, rel=1e-14)


@pytest.mark.parametrize("law", PERMEABILITIES)
def test_permeability_of_the_stress_free_solid_is_the_parameter_of_that_name(law: str) -> None:
    tissue = reference_tissue(permeability=law, permeability_exponent=2.0)
    if "hydraulic_permeability" in tissue.permeability._fields:
        assert permeability(tissue.permeability, 1.0, 0.8) == pytest.approx(1e-3, rel=1e-14)


@pytest.mark.parametrize("law", PERMEABILITIES)
def test_permeability_is_positive_and_grows_with_the_water(law: str) -> None:
    tissue, J = reference_tissue(permeability=law, permeability_exponent=2.0), np.linspace(0.21, 2.0, 100)
    k = hydraulic_permeability(tissue, J)
    assert np.all(k > 0.0)
    assert np.all(np.diff(k) > 0.0) or law == "constant"


def test_permeability_laws_are_the_formulas_of_their_papers() -> None:
    J, n_f0 = np.linspace(0.3, 1.8, 12), 0.8
    n_f = 1 - (1 - n_f0) / J
    expected = {
        "constant": 1e-3 + 0 * J,
        "exponential": 1e-3 * np.exp(2.0 * (J - 1)),
        "holmes-mow": 1e-3 * ((J - 0.2) / 0.8) ** 2.0 * np.exp(2.0 * (J**2 - 1) / 2),
        "solid-fraction": 1.6e-4 * (1 - n_f) ** -2.0,
        "kozeny-carman": 1e-3 * (n_f / n_f0) ** 3 * ((1 - n_f0) / (1 - n_f)) ** 2,
    }
    assert set(expected) == set(PERMEABILITIES)
    for law, values in expected.items():
        tissue = reference_tissue(permeability=law, permeability_exponent=2.0, permeability_power=2.0)
        np.testing.assert_allclose(hydraulic_permeability(tissue, J), values, rtol=1e-13)


def test_holmes_mow_permeability_vanishes_with_the_water() -> None:
    tissue = reference_tissue(permeability="holmes-mow", permeability_exponent=4.0, permeability_power=2.0)
    assert hydraulic_permeability(tissue, 0.2 + 1e-9) < 1e-19
    expected = 1e-3 * (0.4 / 0.8) ** 2 * np.exp(2.0 * (0.36 - 1.0))
    assert hydraulic_permeability(tissue, 0.6) == pytest.approx(expected, rel=1e-14)


def test_exponential_permeability() -> None:
    k = hydraulic_permeability(reference_tissue(permeability_exponent=np.array([0.0, 2.0])), 0.5)
    np.testing.assert_allclose(k, [1e-3, 1e-3 * np.exp(-1.0)], rtol=1e-14)
