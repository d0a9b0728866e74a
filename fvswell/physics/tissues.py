"""Sets of properties from the literature, by the keys of the ``[tissue]`` table of a case.

Numbers are in internal units (mm, N, s, mmol: MPa, mm4/(N s), mmol/mm3). What a source does not give is assumed, and
every set says what that is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["TISSUES", "TissueSet", "TissueSets"]

_SALT = {"cation_diffusivity": 5e-4, "anion_diffusivity": 8e-4}
_SALT_ASSUMED = "diffusivities of the ions as in Wilson et al. (2005)"
_DISC_MODEL = "Disc model of UPF Barcelona and TU Eindhoven; permeability of Schroeder et al. (2008)"
_DISC_ASSUMED = (
    "volume fraction of the water from its mass fraction with a solid of 1.43 times the density of water; water and "
    f"charge taken as those of the stress-free tissue; no hindrance; {_SALT_ASSUMED}"
)


@dataclass(frozen=True)
class TissueSet:
    """Properties of a tissue, and where they are from.

    Parameters
    ----------
    title
        Which tissue it is.
    source
        Publication of the values.
    assumed
        What the source does not give.
    properties
        Keys and values of the ``[tissue]`` table.
    fibres
        Keys and values of each ``[[tissue.fibres]]`` table.
    """

    title: str
    source: str
    assumed: str
    properties: dict[str, Any]
    fibres: tuple[dict[str, Any], ...] = ()

    def __str__(self) -> str:
        """The set for people to read."""
        numbers = [f"  {key} = {value}" for key, value in self.properties.items()]
        families = [
            f"  fibres: {', '.join(f'{key} = {value}' for key, value in family.items())}" for family in self.fibres
        ]
        return "\n".join([self.title, *numbers, *families, f"Source: {self.source}", f"Assumed: {self.assumed}"])


class TissueSets(Mapping[str, TissueSet]):
    """Sets of properties by name, such as ``tissues["reference-cartilage"]``."""

    def __init__(self, sets: dict[str, TissueSet]) -> None:
        self._sets = sets

    def __getitem__(self, name: str) -> TissueSet:
        """The set of that name."""
        return self._sets[name]

    def __iter__(self) -> Iterator[str]:
        """Names of the sets."""
        return iter(self._sets)

    def __len__(self) -> int:
        """How many there are."""
        return len(self._sets)

    def __repr__(self) -> str:
        """Names and titles, one in a line."""
        return "\n".join(f"{name}: {chosen.title}" for name, chosen in self._sets.items())


def _disc(title: str, shear_modulus: float, water: float, charge: float) -> TissueSet:
    """A part of the intervertebral disc; ``water`` is its fraction of the mass."""
    fluid_fraction = round(water / (water + (1.0 - water) / 1.43), 3)
    return TissueSet(
        title, _DISC_MODEL, _DISC_ASSUMED,
        {
            "solid": "solid-fraction", "shear_modulus": shear_modulus, "permeability": "solid-fraction",
            "permeability_coefficient": 1.6e-4, "permeability_exponent": 1.2, "osmotic": "activity",
            "fluid_fraction": fluid_fraction, "fixed_charge_density": charge, "hindrance_factor": 0.0, **_SALT,
        },
    )  # fmt: skip


TISSUES = TissueSets({
    "reference-cartilage": TissueSet(
        "Cartilage, the reference set of the paper",
        "Wilson, van Donkelaar & Huyghe (2005), J. Biomech. Eng. 127, 158-165, Table 1",
        "Poisson's ratio",
        {
            "solid": "neo-hookean", "youngs_modulus": 0.5, "poisson_ratio": 0.3, "permeability": "constant",
            "hydraulic_permeability": 1e-3, "osmotic": "charge-dependent", "osmotic_coefficient_per_charge": 500.0,
            "activity_ratio": 1.0, "fluid_fraction": 0.8, "fixed_charge_density": 2e-4, "hindrance_factor": 0.4,
            **_SALT,
        },
    ),
    "bovine-humeral-cartilage": TissueSet(
        "Bovine humeral head cartilage, stiffer in tension than in compression",
        "Soltz & Ateshian (2000), J. Biomech. Eng. 122, 576-586: H_A 0.64 MPa, k 3.62e-4 mm4/(N s), E+ 12.75 MPa",
        "Poisson's ratio; water; fibres along three normal directions for the difference of the moduli. The modulus "
        f"was measured with the swelling in it, so there is no charge; {_SALT_ASSUMED}",
        {
            "solid": "neo-hookean", "youngs_modulus": 0.576, "poisson_ratio": 0.2, "permeability": "constant",
            "hydraulic_permeability": 3.62e-4, "osmotic": "activity", "fluid_fraction": 0.8,
            "fixed_charge_density": 0.0, "hindrance_factor": 0.0, **_SALT,
        },
        tuple(
            {
                "directions": "along", "angle": angle, "tilt": tilt,
                "law": "power", "modulus": 3.03, "exponent": 0.0, "power": 2.0,
            }
            for angle, tilt in ((0.0, 0.0), (90.0, 0.0), (0.0, 90.0))
        ),
    ),
    "annulus-fibrosus": _disc("Annulus fibrosus, without its fibres", 0.84, 0.704, 1.8e-4),
    "nucleus-pulposus": _disc("Nucleus pulposus", 1.0, 0.745, 2.9e-4),
    "endplate": _disc("Cartilaginous endplate", 1.0, 0.589, 1.66e-4),
    "human-annulus-axial": TissueSet(
        "Human annulus fibrosus in confined compression",
        "Iatridis, Setton, Foster, Rawlins, Weidenbaum & Mow (1998), J. Biomech. 31, 535-544: H_A0 0.56 MPa, beta 2.13",
        "Poisson's ratio; permeability 2e-4 mm4/(N s) and its exponent 1.18; water. The modulus was measured with the "
        f"swelling in it, so there is no charge; {_SALT_ASSUMED}",
        {
            "solid": "holmes-mow", "youngs_modulus": 0.504, "poisson_ratio": 0.2, "stiffening_coefficient": 2.13,
            "permeability": "exponential", "hydraulic_permeability": 2e-4, "permeability_exponent": 1.18,
            "osmotic": "activity", "fluid_fraction": 0.75, "fixed_charge_density": 0.0, "hindrance_factor": 0.0,
            **_SALT,
        },
    ),
})  # fmt: skip
