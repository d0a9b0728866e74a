"""Every law of every registry, on whatever kind of number it is called with."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from tissues import point_of, random_tissue

from fvswell.compiled.dual import slope_of, value_of, variables
from fvswell.physics.fluxes import mixture_fluxes, potential_gradient_of_current
from fvswell.physics.osmotic import (
    OSMOTIC_LAWS,
    bath_log_activity,
    bath_osmotic_pressure,
    ion_concentrations,
    log_activity,
    osmotic_pressure,
    osmotic_pressure_difference,
    virtual_concentration,
)
from fvswell.physics.permeability import PERMEABILITIES, hydraulic_permeability, open_circuit_ratio
from fvswell.physics.solids import SOLIDS, cauchy_stress, isotropic_stress, piola_stress, uniaxial_stress
from fvswell.physics.tissue import Array, Tissue, fixed_charge_density, fluid_fraction

POINTS = 30
STEP = 1e-40
RANGES = {
    "J": (0.5, 1.6), "stretch": (0.8, 1.3), "shear": (-0.2, 0.2), "charge": (5e-5, 5e-4), "ion": (1e-5, 5e-4),
    "activity": (-11.0, -7.0), "gradient": (-2.0, 2.0),
}  # fmt: skip


class Law(NamedTuple):
    """A function of a tissue and of numbers from the ranges above."""

    function: Callable[..., Any]
    arguments: tuple[str, ...]
    registry: str = ""  # whose laws it goes through


LAWS = {
    "uniaxial stress": Law(lambda t, J: uniaxial_stress(t.solid, J, t.fluid_fraction), ("J",), "solid"),
    "isotropic stress": Law(lambda t, J: isotropic_stress(t.solid, J, t.fluid_fraction), ("J",), "solid"),
    "stress": Law(
        lambda t, *F: tuple(cauchy_stress(t.solid, t.fluid_fraction, F)),
        ("stretch", "shear", "shear", "stretch", "stretch"), "solid",
    ),
    "piola stress": Law(
        lambda t, *F: piola_stress(t.solid, t.fluid_fraction, F),
        ("stretch", "shear", "shear", "stretch", "stretch"), "solid",
    ),
    "permeability": Law(hydraulic_permeability, ("J",), "permeability"),
    "open-circuit ratio": Law(open_circuit_ratio, ("J", "ion", "ion"), "permeability"),
    "fluid fraction": Law(fluid_fraction, ("J",)),
    "fixed charge": Law(fixed_charge_density, ("J",)),
    "osmotic pressure": Law(
        lambda t, charge, cation, anion: osmotic_pressure(t.osmotic, t.thermal_energy, charge, cation, anion),
        ("charge", "ion", "ion"), "osmotic",
    ),
    "bath": Law(lambda t, c: bath_osmotic_pressure(t.osmotic, t.thermal_energy, c), ("ion",), "osmotic"),
    "ions": Law(
        lambda t, charge, activity: ion_concentrations(t.osmotic, charge, activity), ("charge", "activity"), "osmotic"
    ),
    "activity of ions": Law(lambda t, *values: log_activity(t.osmotic, *values), ("charge", "ion", "ion"), "osmotic"),
    "activity of a bath": Law(lambda t, c: bath_log_activity(t.osmotic, c), ("ion",), "osmotic"),
    "virtual bath": Law(lambda t, activity: virtual_concentration(t.osmotic, activity), ("activity",), "osmotic"),
    "swelling": Law(osmotic_pressure_difference, ("J", "ion"), "osmotic"),
    "fluxes": Law(mixture_fluxes, ("J", "ion", "ion", "gradient", "gradient", "gradient"), "permeability"),
    "potential": Law(
        potential_gradient_of_current, ("J", "ion", "ion", "gradient", "gradient", "gradient"), "permeability"
    ),
}  # fmt: skip
REGISTRIES = {"": ("",), "solid": tuple(SOLIDS), "permeability": tuple(PERMEABILITIES), "osmotic": tuple(OSMOTIC_LAWS)}
CASES = [(name, chosen) for name, law in LAWS.items() for chosen in REGISTRIES[law.registry]]


def setting(name: str, chosen: str) -> tuple[Tissue, list[Array]]:
    """Random tissue with the chosen law, and random arguments."""
    law, draw = LAWS[name], np.random.default_rng(len(name))
    changes = {law.registry: chosen} if law.registry else {}
    tissue = random_tissue(POINTS, 17, **changes)  # type: ignore[arg-type]
    return tissue, [draw.uniform(*RANGES[argument], POINTS) for argument in law.arguments]


def parts(value: Any) -> list[Any]:
    return list(value) if isinstance(value, tuple) else [value]


@pytest.mark.parametrize(("name", "chosen"), CASES)
def test_floats_arrays_complex_and_dual_numbers_give_the_same(name: str, chosen: str) -> None:
    tissue, arguments = setting(name, chosen)
    function = LAWS[name].function
    arrays = parts(function(tissue, *arguments))
    complex_ = parts(function(tissue, *(value.astype(complex) for value in arguments)))
    duals = parts(function(tissue, *variables(*arguments)))
    for index in range(POINTS):
        single = parts(function(point_of(tissue, index), *(float(value[index]) for value in arguments)))
        for part, array in zip(single, arrays, strict=True):
            assert np.broadcast_to(array, POINTS)[index] == pytest.approx(float(part), rel=1e-14, abs=1e-300)
    for array, other, dual in zip(arrays, complex_, duals, strict=True):
        scale = np.abs(array).max()
        np.testing.assert_allclose(np.real(other), array, rtol=1e-14, atol=1e-14 * scale)
        np.testing.assert_array_equal(value_of(dual), array)


@pytest.mark.parametrize(("name", "chosen"), CASES)
def test_dual_numbers_give_the_derivatives_of_complex_step(name: str, chosen: str) -> None:
    tissue, arguments = setting(name, chosen)
    function = LAWS[name].function
    found = parts(function(tissue, *variables(*arguments)))
    for direction in range(len(arguments)):
        shifted = [value + 1j * STEP * (direction == i) for i, value in enumerate(arguments)]
        for dual, value in zip(found, parts(function(tissue, *shifted)), strict=True):
            expected = np.imag(value) / STEP
            slope = slope_of(dual, direction) if hasattr(dual, "slopes") else 0.0
            np.testing.assert_allclose(slope, expected, rtol=1e-13, atol=1e-14 * np.abs(expected).max())


@pytest.mark.parametrize(
    "registry", [SOLIDS, PERMEABILITIES, OSMOTIC_LAWS], ids=["solids", "permeabilities", "osmotic"]
)
def test_laws_hold_nothing_but_their_own_parameters(registry: dict[str, type]) -> None:
    for law in registry.values():
        assert issubclass(law, tuple)
        assert law.__doc__
        assert len(set(law._fields)) == len(law._fields)  # type: ignore[attr-defined]
