"""Sets of properties: complete, with a source, and tissues that work."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tissues import BATH, reference_tissue

from fvswell.physics.consistency import symmetry_error
from fvswell.physics.constants import GAS_CONSTANT
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.fibre_directions import FIBRE_DIRECTIONS
from fvswell.physics.fibre_laws import FIBRE_LAWS
from fvswell.physics.fibres import FibreFamily, with_fibres
from fvswell.physics.osmotic import OSMOTIC_LAWS
from fvswell.physics.permeability import PERMEABILITIES
from fvswell.physics.solids import SOLIDS, aggregate_modulus, uniaxial_stress
from fvswell.physics.tissue import Tissue
from fvswell.physics.tissues import TISSUES, TissueSet

REGISTRIES: dict[str, Any] = {"solid": SOLIDS, "permeability": PERMEABILITIES, "osmotic": OSMOTIC_LAWS}


def tissue_of(chosen: TissueSet) -> tuple[Tissue, set[str]]:
    """The tissue, and the keys that it took."""
    values = chosen.properties | {"bath_osmotic_coefficient": 0.93}
    laws = {kind: registry[values[kind]] for kind, registry in REGISTRIES.items()}
    used = {field for law in laws.values() for field in law._fields} | set(laws) | set(Tissue._fields[3:-1])
    made = {kind: law(*(values[field] for field in law._fields)) for kind, law in laws.items()}
    families = []
    for family in chosen.fibres:
        angles = (family["angle"], family["tilt"]) if family["directions"] == "along" else ()
        law = FIBRE_LAWS[family["law"]]
        families.append(
            FibreFamily(
                FIBRE_DIRECTIONS[family["directions"]](*angles),
                law(*(family[field] for field in law._fields)),  # type: ignore[attr-defined]
            )
        )
    solid = with_fibres(made["solid"], families)
    others = {name: values[name] for name in Tissue._fields[3:-1]}
    return Tissue(solid, made["permeability"], made["osmotic"], **others, thermal_energy=298 * GAS_CONSTANT), used


@pytest.mark.parametrize("name", TISSUES)
def test_set_is_complete_and_has_a_source(name: str) -> None:
    chosen = TISSUES[name]
    tissue, used = tissue_of(chosen)
    assert set(chosen.properties) <= used
    assert chosen.title
    assert chosen.source
    assert chosen.assumed
    J = equilibrium_volume_ratio(tissue, np.array([0.0, 0.05]), BATH)
    assert np.all((1.0 - tissue.fluid_fraction < J) & (J < 2.0))
    assert J[1] < J[0]


@pytest.mark.parametrize(("name", "modulus"), [("bovine-humeral-cartilage", 0.64), ("human-annulus-axial", 0.56)])
def test_modulus_in_compression_is_the_one_measured(name: str, modulus: float) -> None:
    tissue, _ = tissue_of(TISSUES[name])
    assert aggregate_modulus(tissue.solid, tissue.fluid_fraction) == pytest.approx(modulus, rel=1e-3)


def test_modulus_of_bovine_cartilage_in_tension_is_the_one_measured() -> None:
    tissue, _ = tissue_of(TISSUES["bovine-humeral-cartilage"])
    assert uniaxial_stress(tissue.solid, 1.0 + 1e-6, tissue.fluid_fraction) / 1e-6 == pytest.approx(12.75, rel=3e-3)


def test_symmetry_of_the_osmotic_laws() -> None:
    """The ideal law has an energy; the activity law misses it by less than the paper's in every bath."""
    baths = np.array([0.015, 0.05, 0.15, 0.5, 1.0, 2.0]) * 1e-3
    found = {name: symmetry_error(reference_tissue(osmotic=name), 1.0, baths) for name in OSMOTIC_LAWS}
    np.testing.assert_allclose(found["ideal"], 0.0, atol=1e-14)
    # -2 (1 - phi)/(1 + phi), phi .83, whatever the bath
    np.testing.assert_allclose(found["charge-dependent"], -2 * 0.17 / 1.83, rtol=1e-12)
    expected = [-0.1134, -0.0909, -0.0391, -0.0226, -0.0406, -0.0597]
    np.testing.assert_allclose(found["activity"], expected, atol=1e-4)
    assert np.all(np.abs(found["activity"]) < 0.65 * np.abs(found["charge-dependent"]))
