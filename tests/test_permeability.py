"""Permeability, and what is left of it where no current can flow."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from tissues import random_tissue, reference_tissue

from fvswell.physics.electrochemistry import ion_concentrations
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.fluxes import mixture_fluxes
from fvswell.physics.permeability import (
    hydraulic_permeability,
    open_circuit_permeability,
    open_circuit_permeability_with_ion_volumes,
)
from fvswell.physics.tissue import Array, Tissue

ONE, LOG_BATH = np.ones((1, 1)), np.log(np.full((1, 1), 1.5e-4))
CATION_VOLUME, ANION_VOLUME = 2.33, 15.17  # mm3/mmol


def ions(tissue: Tissue, J: Array) -> tuple[Array, Array]:
    return ion_concentrations(tissue, J, LOG_BATH)


def test_reference_values() -> None:
    tissue = reference_tissue()
    assert open_circuit_permeability(tissue, ONE, *ions(tissue, ONE)).item() / 1e-3 == pytest.approx(0.821, abs=5e-4)
    full = open_circuit_permeability_with_ion_volumes(tissue, ONE, *ions(tissue, ONE), CATION_VOLUME, ANION_VOLUME)
    assert full.item() / 1e-3 == pytest.approx(0.823, abs=5e-4)


def test_value_in_the_equilibrated_sample() -> None:
    tissue = reference_tissue()
    J = equilibrium_volume_ratio(tissue, 0.0, 1.5e-4, 0.93, swelling=True)
    assert open_circuit_permeability(tissue, J, *ions(tissue, J)).item() == pytest.approx(8.3945e-4, abs=5e-9)


def test_full_form_tends_to_the_closed_form_as_the_ions_lose_their_volume() -> None:
    tissue, J = random_tissue(60, seed=1, hindrance_factor=np.linspace(0, 1, 60)), np.full((60, 1), 1.05)
    closed = open_circuit_permeability(tissue, J, *ions(tissue, J))
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
    for row in range(10):
        tissue = random_tissue(10, seed=2).rows(np.array([row]))
        J = np.array([[0.9]])
        at = ions(tissue, J)

        def current(potential: float, tissue: Tissue = tissue, J: Array = J, at: tuple[Array, Array] = at) -> float:
            flux = mixture_fluxes(tissue, J, *at, ONE, 0 * ONE, potential * ONE)
            return (flux.cation - flux.anion).item()

        potential = brentq(current, -1e4, 1e4, xtol=1e-14, rtol=1e-14)
        flux = mixture_fluxes(tissue, J, *at, ONE, 0 * ONE, potential * ONE)
        assert -flux.water.item() == pytest.approx(open_circuit_permeability(tissue, J, *at).item(), rel=1e-9)


def test_streaming_potential_only_ever_slows_the_water() -> None:
    tissue, J = random_tissue(200, seed=3), np.full((200, 1), 0.9)
    ratio = open_circuit_permeability(tissue, J, *ions(tissue, J)) / hydraulic_permeability(tissue, J)
    assert np.all((ratio > 0.0) & (ratio < 1.0))


@pytest.mark.parametrize("changes", [{"fixed_charge_density": 0.0}, {"hindrance_factor": 1.0}])
def test_nothing_to_drag_leaves_the_permeability(changes: dict[str, float]) -> None:
    tissue = reference_tissue(**changes)
    assert open_circuit_permeability(tissue, ONE, *ions(tissue, ONE)).item() == pytest.approx(1e-3, rel=1e-14)


def test_permeability_falls_exponentially_with_compression() -> None:
    tissue = reference_tissue(permeability_exponent=np.array([0.0, 2.0]))
    np.testing.assert_allclose(hydraulic_permeability(tissue, 0.5 * ONE)[:, 0], [1e-3, 1e-3 * np.exp(-1.0)], rtol=1e-14)
    np.testing.assert_allclose(hydraulic_permeability(tissue, ONE), 1e-3, rtol=1e-14)
