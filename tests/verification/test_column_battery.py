"""What every model must do in every case: one battery over models, protocols, schemes and tissues."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import xarray as xr
from columns import CONTROLLED as CONTROL
from columns import compression, swelling
from scipy.interpolate import CubicSpline

import fvswell
from fvswell.case.case import Case
from fvswell.physics.constants import FARADAY, GAS_CONSTANT
from fvswell.physics.models import MODELS
from fvswell.physics.solids import uniaxial_stress
from fvswell.physics.tissue import Array, Tissue
from fvswell.results.fields import field

SMALL = {"geometry__cells": 24, "time__steps_per_phase": 8}
CONTROLLED = {"geometry__cells": 24} | CONTROL
LAYERED = {
    "tissue__solid": "holmes-mow", "tissue__stiffening_coefficient": 0.6, "tissue__permeability_exponent": 2.0,
    "tissue__activity_ratio": 0.9,
    "tissue__fixed_charge_density": {"depth": [0.0, 0.5], "value": [1e-4, 3e-4]},
    "tissue__youngs_modulus": {"depth": [0.1, 0.4], "value": [0.3, 0.6]},
    "tissue__hydraulic_permeability": {"depth": [0.0, 0.5], "value": [2e-3, 5e-4]},
    "open_circuit_permeability": "state",
}  # fmt: skip
WEAKER = {"ramp_to": 1e-4, "over": 99.0}
PISTON = [
    {"name": "ramp", "duration": 60.0, "piston": {"displacement": {"ramp_to": -0.06, "over": 40.0}}},
    {"name": "bath", "duration": 300.0, "piston": {"displacement": -0.06}, "bath_concentration": 3e-4},
    {"name": "release", "duration": 300.0, "piston": {"pressure": 0.02}, "bath_concentration": WEAKER},
]  # fmt: skip
PROTOCOLS: dict[str, Case] = {
    "compression": compression(**SMALL),
    "swelling": swelling(**CONTROLLED),
    "piston": compression(phase=PISTON, **SMALL),
    "layered": compression(**CONTROLLED, **LAYERED),
    "no-hindrance": compression(**SMALL, tissue__hindrance_factor=0.0),
}
BATTERY = [(model, protocol) for model in MODELS for protocol in PROTOCOLS]
CHARGED = [(model, protocol) for model, protocol in BATTERY if model != "biphasic"]
FULL = [("electrochemical", protocol) for protocol in PROTOCOLS]


@cache
def run(model: str, protocol: str, cells: int = 24) -> xr.Dataset:
    return fvswell.run(PROTOCOLS[protocol].with_changes({"geometry.cells": cells}), model)


def tissue_of(result: xr.Dataset, protocol: str, at: str = "x") -> Tissue:
    return PROTOCOLS[protocol].tissue_at(result[at].values)


@pytest.mark.parametrize(("model", "protocol"), BATTERY)
def test_fields_have_their_units_and_are_finite(model: str, protocol: str) -> None:
    result = run(model, protocol)
    assert result.attrs["run_status"] == "complete"
    for name, values in result.data_vars.items():
        if name != "x_bounds":
            assert {"units": values.units, "long_name": values.long_name}.items() <= field(
                name, per_area=True
            ).attributes.items()
        assert np.isfinite(values).all(), name
    assert np.all(np.diff(result["time"]) > 0.0)
    assert ("anion_flux" in result) == (model == "electrochemical")
    assert ("osmotic_pressure" in result) == (model != "biphasic")


@pytest.mark.parametrize(("model", "protocol"), BATTERY)
def test_bounds(model: str, protocol: str) -> None:
    result = run(model, protocol)
    tissue = tissue_of(result, protocol)
    assert np.all(result["volume_ratio"] > 1.0 - tissue.fluid_fraction)
    assert np.all((result["fluid_fraction"] > 0.0) & (result["fluid_fraction"] < 1.0))
    for name in result:
        if name.endswith("_concentration") or name in ("osmotic_pressure", "fixed_charge_density"):
            assert np.all(result[name] > 0.0), name


@pytest.mark.parametrize(("model", "protocol"), BATTERY)
def test_solid_keeps_its_volume_and_height_is_the_sum_of_the_cells(model: str, protocol: str) -> None:
    result = run(model, protocol)
    widths = np.diff(result["x_bounds"])[:, 0]
    J, solid = result["volume_ratio"].values, 1.0 - tissue_of(result, protocol).fluid_fraction
    np.testing.assert_allclose(J * (1.0 - result["fluid_fraction"]), np.broadcast_to(solid, J.shape), rtol=1e-12)
    height = J @ widths
    np.testing.assert_allclose(result["height"], height, rtol=1e-13)
    np.testing.assert_allclose(result["displacement"][:, -1], height - 0.5, atol=1e-14)
    np.testing.assert_allclose(result["displacement"][:, 0], 0.0, atol=1e-15)
    np.testing.assert_allclose(np.diff(result["displacement"]), (J - 1.0) * widths, atol=1e-14)
    np.testing.assert_allclose(result["global_strain"], height / height[0] - 1.0, atol=1e-13)
    np.testing.assert_allclose(result["global_strain_from_stress_free"], height / 0.5 - 1.0, atol=1e-13)


@pytest.mark.parametrize(("model", "protocol"), BATTERY)
def test_piston_carries_the_total_stress_at_every_depth(model: str, protocol: str) -> None:
    """sigma_s - p = -P, with the stress of the law."""
    result, tissue = run(model, protocol), tissue_of(run(model, protocol), protocol)
    stress = uniaxial_stress(tissue.solid, result["volume_ratio"].values, tissue.fluid_fraction)
    np.testing.assert_allclose(result["effective_stress"], stress, rtol=1e-12, atol=1e-15)
    total = result["effective_stress"] - result["fluid_pressure"]
    np.testing.assert_allclose(total, np.broadcast_to(-result["piston_pressure"], total.T.shape).T, atol=1e-13)


@pytest.mark.parametrize(("model", "protocol"), BATTERY)
def test_water_potential_is_pressure_less_osmotic_pressure(model: str, protocol: str) -> None:
    result = run(model, protocol)
    osmotic = result["osmotic_pressure"] if model != "biphasic" else 0.0
    np.testing.assert_allclose(result["water_potential"], result["fluid_pressure"] - osmotic, atol=1e-13)


@pytest.mark.parametrize(("model", "protocol"), BATTERY)
def test_sample_starts_in_equilibrium_with_its_bath(model: str, protocol: str) -> None:
    start = run(model, protocol).isel(time=0)
    assert (start["time"], start["global_strain"], start["piston_pressure"]) == (0.0, 0.0, 0.0)
    bath = 2 * 0.93 * GAS_CONSTANT * 298.0 * 1.5e-4 if model != "biphasic" else 0.0
    np.testing.assert_allclose(start["water_potential"], -bath, rtol=1e-11, atol=1e-13)
    for name in start:
        if name.endswith("flux") and not (model == "biphasic" and protocol == "swelling"):  # where nothing ever flows
            assert np.abs(start[name]).max() < 1e-11 * np.abs(run(model, protocol)[name]).max(), name


@pytest.mark.parametrize(("model", "protocol"), BATTERY)
def test_nothing_passes_the_piston_and_no_charge_passes_anything(model: str, protocol: str) -> None:
    result = run(model, protocol)
    for name in result:
        if "_flux" in name or name == "current_density":
            assert np.all(result[name][:, -1] == 0.0), name
    if model == "electrochemical":
        scale = FARADAY * np.abs(result["anion_flux"]).max()
        assert np.abs(result["current_density"]).max() < 1e-9 * scale


@pytest.mark.parametrize(("model", "protocol"), BATTERY)
def test_balances_close(model: str, protocol: str) -> None:
    result = run(model, protocol)
    errors = {name for name in result if name.endswith("_balance_error")}
    expected = ("volume", "anion", "cation", "charge") if model == "electrochemical" else ("volume",)
    assert errors == {f"{balance}_balance_error" for balance in expected}
    for name in errors:
        assert result[name].max() < 1e-10, name


@pytest.mark.parametrize(("model", "protocol"), CHARGED)
def test_electroneutrality_and_donnan(model: str, protocol: str) -> None:
    result = run(model, protocol)
    tissue = tissue_of(result, protocol)
    cation, anion, charge = (result[name].values for name in
                             ("cation_concentration", "anion_concentration", "fixed_charge_density"))  # fmt: skip
    assert np.all(np.abs(cation - anion - charge) <= 1e-14 * cation)
    product = tissue.osmotic.activity_ratio * result["virtual_concentration"].values ** 2
    np.testing.assert_allclose(cation * anion, product, rtol=1e-13)
    per_solid = result["volume_ratio"].values * result["fluid_fraction"].values * charge
    expected = tissue.fixed_charge_density * tissue.fluid_fraction
    np.testing.assert_allclose(per_solid, np.broadcast_to(expected, per_solid.shape), rtol=1e-12)
    osmotic = tissue.osmotic.osmotic_coefficient * GAS_CONSTANT * 298.0 * (cation + anion)
    np.testing.assert_allclose(result["osmotic_pressure"], osmotic, rtol=1e-13)
    if model == "biphasic-swelling":  # the salt follows the bath
        bath = np.broadcast_to(result["bath_concentration"], cation.T.shape).T
        np.testing.assert_allclose(result["virtual_concentration"], bath, rtol=1e-13)
        donnan = -GAS_CONSTANT * 298.0 / FARADAY * np.log(cation / bath / np.sqrt(tissue.osmotic.activity_ratio))
        np.testing.assert_allclose(result["electric_potential"], donnan, rtol=1e-12, atol=1e-12)
    assert np.all(result["electric_potential"] < 0.0)


@pytest.mark.parametrize(("model", "protocol"), FULL)
def test_parts_add_up_to_the_flux(model: str, protocol: str) -> None:
    result = run(model, protocol)
    for ion in ("cation", "anion"):
        parts = [result[f"{ion}_flux_{part}"] for part in ("convection", "diffusion", "migration")]
        scale = max(float(np.abs(part).max()) for part in parts)
        assert scale > 0.0
        assert np.abs(sum(parts) - result[f"{ion}_flux"]).max() < 1e-12 * scale


# ---- against finite differences of the fields in the file --------------------------------------------------


def independent_fluxes(result: xr.Dataset, protocol: str) -> dict[str, Array]:
    """Fluxes at the inner nodes, from splines through the fields of the cells in current coordinates."""
    tissue = tissue_of(result, protocol, "x_node")
    nodes = result["x_node"].values + result["displacement"].values
    centres = 0.5 * (nodes[:, 1:] + nodes[:, :-1])
    RT, w, r = GAS_CONSTANT * 298.0, 1.0 - tissue.hindrance_factor, slice(1, -1)
    fluxes: dict[str, list[Array]] = {}
    for index in range(1, result.sizes["time"]):

        def at(name: str, index: int = index) -> tuple[Array, Array]:
            spline = CubicSpline(centres[index], result[name].values[index])
            return spline(nodes[index, r]), spline(nodes[index, r], 1)

        J, _ = at("volume_ratio")
        fluid, _ = at("fluid_fraction")
        _, water_slope = at("water_potential")
        _, xi_slope = at("electric_potential")
        salt, salt_slope = at("virtual_concentration")
        ions = {"cation": at("cation_concentration"), "anion": at("anion_concentration")}
        total, charge = (ions["cation"][0] + sign * ions["anion"][0] for sign in (1, -1))
        # F grad psi~ = F grad xi + RT grad ln(c+/c~)
        psi_slope = FARADAY * xi_slope + RT * (ions["cation"][1] / ions["cation"][0] - salt_slope / salt)

        def inner(value: Array | float) -> Array | float:
            return value[r] if isinstance(value, np.ndarray) else value

        law = tissue.permeability
        k = inner(law.hydraulic_permeability) * np.exp(inner(law.permeability_exponent) * (J - 1.0))
        water = -k * (water_slope + inner(w) * (total * RT * salt_slope / salt + charge * psi_slope))
        parts = {"water_flux": water}
        for ion, valence in (("cation", 1), ("anion", -1)):
            c, slope = ions[ion]
            mobility = fluid * inner(getattr(tissue, f"{ion}_diffusivity"))
            parts[f"{ion}_flux_convection"] = inner(w) * c * water
            parts[f"{ion}_flux_diffusion"] = -mobility * slope
            parts[f"{ion}_flux_migration"] = -mobility * c * valence * FARADAY / RT * xi_slope
        for name, value in parts.items():
            fluxes.setdefault(name, []).append(value)
    return {name: np.array(values) for name, values in fluxes.items()}


@cache
def flux_errors(protocol: str, cells: int) -> dict[str, float]:
    """Mean differences of the fluxes in the file from the independent ones, over the largest of the flux."""
    case = PROTOCOLS[protocol].with_changes(
        {"geometry.cells": cells, "geometry.grading": 4.0, "time.scheme": "backward-euler", "time.steps_per_phase": 5}
    )
    result = fvswell.run(case, "electrochemical").isel(time=slice(0, 6))
    inner = slice(2, -2)
    return {
        name: float(np.abs(result[name].values[1:, 1:-1] - values)[:, inner].mean() / np.abs(values[:, inner]).max())
        for name, values in independent_fluxes(result, protocol).items()
    }


@pytest.mark.parametrize("protocol", ["compression", "swelling", "no-hindrance"])
def test_every_flux_is_right_to_second_order(protocol: str) -> None:
    coarse, fine = flux_errors(protocol, 20), flux_errors(protocol, 40)
    assert len(fine) == 7
    for name, error in fine.items():
        assert error < 5e-3, name
        assert coarse[name] / error > 2.8, name


# ---- signs -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("protocol", ["compression", "no-hindrance", "layered"])
def test_signs_in_compression(model: str, protocol: str) -> None:
    result = run(model, protocol)
    loading = result.isel(time=result["time"] <= 600.0)
    assert np.all(np.diff(loading["global_strain"]) < 0.0)
    assert np.all(loading["water_flux"][1:, 0] < 0.0)  # out of the sample
    excess = loading["fluid_pressure"][1] - loading["fluid_pressure"][0]
    assert np.all(excess > 0.0)
    assert excess.max() - 1e-12 < excess[-1] < 0.25 + 1e-12  # the water carries the load longest at the piston
    unloading = result.isel(time=result["time"] >= 600.0)
    assert np.all(np.diff(unloading["global_strain"]) > 0.0)
    assert np.all(unloading["water_flux"][1:, 0] > 0.0)


def test_signs_in_a_weaker_bath() -> None:
    first = run("electrochemical", "swelling")
    first = first.isel(time=(first["time"] > 0.0) & (first["time"] <= 600.0))
    assert np.all(first["anion_flux"][:, 0] < 0.0)  # salt leaves
    assert np.all(first["virtual_concentration"] <= 1.5e-4 * (1 + 1e-8))  # a scheme of high order is not monotone
    assert np.all(first["virtual_concentration"] >= 1e-4)
    assert first["global_strain"][-1] > 0.05
