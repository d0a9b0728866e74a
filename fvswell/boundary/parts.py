"""Parts of the boundary of a body, and what may be driven and measured there.

Columns have two parts, ``filter`` at x = 0 and ``piston`` at x = h. Blocks have their edges, or pieces of them. A part
has a mechanical, a bath and an electrical condition:

    mechanical      fixed           no displacement
                    roller          no displacement along the normal
                    free            whatever balances the pressure on it
                    straight        one displacement along its normal, free to slide: a smooth plate
                    glued-plate     moves as one and does not slide: a rough plate
    bath            open to a bath of its own, which has a salt concentration and a hydrostatic pressure, or closed
    electrical      insulating      no current
                    grounded        at the potential of the reference, 0
                    floating        at the potential at which no net current passes
                    current         at the potential at which a given current passes
                    potential       at a given potential
    electrode       what carries the current through a part that conducts: the ions of the bath of an open part; of a
                    closed one an electrode in the wall, at which only cations or only anions are exchanged

The reference of the potential is the bath of the first open part, but for wall electrodes of the first one grounded.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

__all__ = [
    "CONDUCTING",
    "ELECTRICAL",
    "ELECTRODES",
    "HELD",
    "LOADED",
    "MEASURED",
    "MECHANICAL",
    "RESERVED",
    "Part",
    "load_names",
]

Mechanical = Literal["fixed", "roller", "free", "straight", "glued-plate"]
Electrical = Literal["insulating", "grounded", "floating", "current", "potential"]
Electrode = Literal["bath", "cation", "anion"]

MECHANICAL: tuple[Mechanical, ...] = ("fixed", "roller", "free", "straight", "glued-plate")
ELECTRICAL: tuple[Electrical, ...] = ("insulating", "grounded", "floating", "current", "potential")
ELECTRODES: tuple[Electrode, ...] = ("bath", "cation", "anion")
CONDUCTING = ("grounded", "floating", "current", "potential")
HELD = ("fixed", "roller")  # nothing drives them, and their reactions are results
# histories that a result has of a part, named "PART_KIND"
MEASURED = (
    "pressure", "force", "displacement", "tangential_displacement", "bath_concentration", "bath_pressure",
    "water_volume", "cation_amount", "anion_amount", "current", "potential",
)  # fmt: skip
# names that parts cannot have, as histories "PART_KIND" would be called like other fields
RESERVED = (
    "cation",
    "anion",
    "electric",
    "fluid",
    "mesh",
    "node",
    "osmotic",
    "phase",
    "probe",
    "step",
    "time",
    "water",
)
# loads that each mechanical condition takes; at most one at a time, but for the tangential displacement
LOADED: Mapping[str, tuple[str, ...]] = {
    "fixed": (),
    "roller": (),
    "free": ("pressure",),
    "straight": ("pressure", "force", "displacement"),
    "glued-plate": ("pressure", "force", "displacement", "tangential_displacement"),
}


@dataclass(frozen=True)
class Part:
    """A part of the boundary of a body.

    Parameters
    ----------
    name
        Of the part; no two of a body are alike.
    mechanical, electrical, electrode
        Conditions, see the head of this module.
    open
        Whether the part is open to a bath.
    edge
        Of a block, on which the part lies; "" in a column.
    start, end
        Where it begins and ends along the edge of the stress-free body, mm; the whole edge by default.
    """

    name: str
    mechanical: Mechanical = "free"
    open: bool = False
    electrical: Electrical = "insulating"
    electrode: Electrode = "bath"
    edge: str = ""
    start: float = 0.0
    end: float = float("inf")

    @property
    def loads(self) -> tuple[str, ...]:
        """Kinds of loads that the part takes, in the order of `load_names`."""
        kinds = LOADED[self.mechanical]
        kinds += ("bath_concentration", "bath_pressure") if self.open else ()
        return kinds + ((self.electrical,) if self.electrical in ("current", "potential") else ())


def load_names(parts: Iterable[Part]) -> tuple[str, ...]:
    """Names of all loads on the parts of a body, "PART.KIND".

    The kinds are

        pressure                    MPa, positive in compression, normal to the part as it moves; on top of the
                                    hydrostatic pressure of the bath, which presses on an open part as well
        force                       N, positive in compression, of a disc, or of a block 1 mm thick
        displacement                mm, along the normal axis, positive along +x or +y; of a body from the equilibrated
                                    sample in a case, from the stress-free solid inside a block
        tangential_displacement     mm, along the other axis, of a glued plate
        bath_concentration          mmol/mm3
        bath_pressure               MPa
        current                     positive into the tissue: A in a block, A/mm2 in a column
        potential                   mV, relative to the reference
    """
    return tuple(f"{part.name}.{kind}" for part in parts for kind in part.loads)
