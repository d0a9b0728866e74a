"""What a result holds: name, unit and meaning of every field, in one table, and one of what parts of the boundary have.

Locations: ``global`` (one value a time), ``cell``, ``node`` (the nodes of a column are its faces), ``face``
(cells of a 2D grid), ``edge`` (faces between them), ``phase`` (one value a phase) and ``step`` (history of
the solver). Histories of parts of the boundary are named "PART_KIND".
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

__all__ = ["FIELDS", "Field", "field", "is_field", "part_fields"]


@dataclass(frozen=True)
class Field:
    """Metadata of a field; units as UDUNITS reads them."""

    units: str
    long_name: str
    location: str
    cell_methods: str = "time: point"

    @property
    def attributes(self) -> dict[str, str]:
        """Attributes of the variable in a file."""
        return {
            "units": self.units, "long_name": self.long_name, "location": self.location,
            "cell_methods": self.cell_methods,
        }  # fmt: skip


_CONCENTRATION, _ION_FLUX, _STRESS = "mmol mm-3", "mmol mm-2 s-1", "N mm-2"
_PARTS = ("convection", "diffusion", "migration")


def _ion_fluxes(ion: str) -> dict[str, Field]:
    total = {f"{ion}_flux": Field(_ION_FLUX, f"{ion} flux relative to the solid, positive along +x", "node")}
    parts = {f"{ion}_flux_{part}": Field(_ION_FLUX, f"part of the {ion} flux by {part}", "node") for part in _PARTS}
    return total | parts


FIELDS: dict[str, Field] = {
    "global_strain": Field("1", "height over height of the equilibrated sample, less one", "global"),
    "global_strain_from_stress_free": Field("1", "height over height of the stress-free solid, less one", "global"),
    "height": Field("mm", "height of the sample", "global"),
    "bath_concentration": Field(_CONCENTRATION, "salt concentration of the bath", "global"),
    "volume_ratio": Field("1", "current over stress-free volume, J", "cell"),
    "fluid_fraction": Field("1", "volume fraction of the fluid", "cell"),
    "fluid_pressure": Field(_STRESS, "pressure of the fluid", "cell"),
    "water_potential": Field(_STRESS, "electrochemical potential of the water per volume", "cell"),
    "effective_stress": Field(_STRESS, "axial Cauchy stress of the solid, tension positive", "cell"),
    "osmotic_pressure": Field(_STRESS, "osmotic pressure in the tissue", "cell"),
    "fixed_charge_density": Field(_CONCENTRATION, "fixed negative charge per volume of fluid", "cell"),
    "cation_concentration": Field(_CONCENTRATION, "cations per volume of fluid", "cell"),
    "anion_concentration": Field(_CONCENTRATION, "anions per volume of fluid", "cell"),
    "virtual_concentration": Field(
        _CONCENTRATION, "concentration of the solution that would be in equilibrium with the tissue", "cell"
    ),
    "electric_potential": Field("mV", "electric potential in the tissue relative to the grounded bath", "cell"),
    "displacement": Field("mm", "displacement from the stress-free position, positive along +x", "node"),
    "water_flux": Field("mm s-1", "volume flux of water relative to the solid, positive along +x", "node"),
    **_ion_fluxes("cation"),
    **_ion_fluxes("anion"),
    "current_density": Field("A mm-2", "electric current density, positive along +x", "node"),
    **{
        f"{balance}_balance_error": Field(
            "1",
            f"largest mismatch of the {balance} balance in a step since the last output, relative to what "
            "crossed the boundary",
            "global",
            "time: maximum",
        )
        for balance in ("volume", "anion", "cation", "charge")
    },
    # blocks
    **{
        f"probe_displacement_{axis}": Field("mm", f"displacement of the probe from equilibrium along {axis}", "global")
        for axis in ("x", "y")
    },
    **{
        f"displacement_{axis}": Field("mm", f"displacement from the stress-free position along {axis}", "node")
        for axis in ("x", "y")
    },
    **{
        f"effective_stress_{component}": Field(
            _STRESS, f"Cauchy stress of the solid, {component}, tension positive", "cell"
        )
        for component in ("xx", "yy", "zz", "xy")
    },
    **{
        f"{flux}_{axis}": Field(units, f"{flux.replace('_', ' ')} relative to the solid along {axis}", "cell")
        for flux, units in (
            ("water_flux", "mm s-1"),
            ("cation_flux", _ION_FLUX),
            ("anion_flux", _ION_FLUX),
            ("current_density", "A mm-2"),
        )
        for axis in ("x", "y")
    },
    **{
        f"{ion}_flux_{part}_{axis}": Field(_ION_FLUX, f"part of the {ion} flux by {part}, along {axis}", "cell")
        for ion in ("cation", "anion")
        for part in _PARTS
        for axis in ("x", "y")
    },
    "phase_end": Field("s", "time at which the phase ends", "phase", "phase: point"),
    "equilibrium_strain": Field(
        "1", "global strain in equilibrium under the loads that the phase ends with", "phase", "phase: point"
    ),
    "step_time": Field("s", "end of the step", "step", "step: point"),
    "step_size": Field("s", "length of the step", "step", "step: point"),
    "step_iterations": Field("1", "Newton iterations in all stages of the step", "step", "step: sum"),
    "step_update": Field("1", "last update of Newton's method, relative to the contents", "step", "step: point"),
}

# kinds of histories of parts: units, and meaning of which the name of the part takes its place; in a column what is
# divided by its area
_PART_KINDS: dict[str, tuple[str, str]] = {
    "pressure": (_STRESS, "mean normal pressure on the {}, without its bath's, compression positive"),
    "force": ("N", "normal force on the {} (of a disc, or 1 mm thick), compression positive"),
    "displacement": ("mm", "mean normal displacement of the {} from the equilibrated sample, positive along the axis"),
    "tangential_displacement": ("mm", "displacement of the {} along itself from the equilibrated sample"),
    "bath_concentration": (_CONCENTRATION, "salt concentration of the bath at the {}"),
    "bath_pressure": (_STRESS, "hydrostatic pressure of the bath at the {}"),
    "water_volume": ("mm3", "volume of water that has entered through the {}"),
    "cation_amount": ("mmol", "amount of cations that has entered through the {}"),
    "anion_amount": ("mmol", "amount of anions that has entered through the {}"),
    "current": ("A", "electric current into the tissue through the {}"),
    "potential": ("mV", "electric potential at the {}, relative to the reference"),
}
_PER_AREA = {"mm3": "mm", "mmol": "mmol mm-2", "A": "A mm-2"}


def part_fields(names: Iterable[str], per_area: bool) -> dict[str, Field]:
    """Histories that parts of the boundary may have.

    Parameters
    ----------
    names
        Of the parts.
    per_area
        Whether amounts and currents are per area, as they are in columns.
    """
    fields = {}
    for name in names:
        for kind, (units, meaning) in _PART_KINDS.items():
            divided = per_area and units in _PER_AREA
            fields[f"{name}_{kind}"] = Field(
                _PER_AREA[units] if divided else units,
                meaning.format(name.replace("_", " ")) + (", per area" if divided else ""), "global",
            )  # fmt: skip
    return fields


def _part_of(name: str) -> str | None:
    """The part of a history "PART_KIND"; None if there is no such kind."""
    kinds = sorted(_PART_KINDS, key=len, reverse=True)
    return next((part for kind in kinds if (part := name.removesuffix(f"_{kind}")) not in ("", name)), None)


def is_field(name: str) -> bool:
    """Whether a name is that of a field, be it of the table or of a part."""
    return name in FIELDS or _part_of(name) is not None


def field(name: str, per_area: bool = False) -> Field:
    """Metadata of a field of the table, or of a history of a part.

    Parameters
    ----------
    name
        Of the field.
    per_area
        As for `part_fields`.

    Raises
    ------
    KeyError
        If there is no such field.
    """
    if name in FIELDS:
        return FIELDS[name]
    part = _part_of(name)
    if part is None:
        raise KeyError(name)
    return part_fields([part], per_area)[name]
