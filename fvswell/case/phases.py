"""The phases of a case file: what drives the sample, and for how long."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import Field, ValidationInfo, field_validator

from fvswell.boundary.sides import EDGES
from fvswell.case.loads import AnyLoad, Load, Ramp
from fvswell.case.tables import Table
from fvswell.case.values import Duration, Name, Quantity, RelaxationTimes

__all__ = ["BlockPhase", "ColumnPhase", "EdgeLoad", "Phase"]


class Phase(Table):
    """A stretch of time with one set of boundary conditions; what every geometry has."""

    name: Annotated[str, Name()] = Field(description="Name of the phase; no two are alike.")
    duration: Annotated[float | RelaxationTimes, Duration()] = Field(
        description="How long the phase lasts. A relaxation time is that of the biphasic-swelling model of a column "
        "in this phase, see relaxation_fraction."
    )
    bath_concentration: Annotated[AnyLoad | None, Load(Quantity("concentration", above=0.0))] = Field(
        default=None, description="Concentration of the bath; without it, as the previous phase left it."
    )

    def loads(self) -> dict[str, AnyLoad]:
        """Loads that the phase gives, by name: "bath", and "PART.QUANTITY" for what acts on a part of the boundary."""
        return {} if self.bath_concentration is None else {"bath": self.bath_concentration}

    @field_validator("*")
    @classmethod
    def _ramp_within_phase(cls, value: Any, info: ValidationInfo) -> Any:
        duration = info.data.get("duration")
        if isinstance(value, Ramp) and isinstance(duration, float) and value.over > duration:
            raise ValueError(value.longer_than(duration))
        return value


class ColumnPhase(Phase):
    """What the piston and the bath do from the end of the previous phase on."""

    alternatives = ("piston_pressure", "piston_displacement")
    variant_label = "of a column"

    piston_pressure: Annotated[AnyLoad | None, Load(Quantity("pressure"))] = Field(
        default=None, description="Pressure of the piston, positive in compression. Either this or the next."
    )
    piston_displacement: Annotated[AnyLoad | None, Load(Quantity("length"))] = Field(
        default=None,
        description="Displacement of the piston from the equilibrated sample, negative in compression. A "
        "jump would need infinite pressure, so a plain value can only hold the piston where the previous "
        "phase left it (at 0 in the first).",
    )

    def loads(self) -> dict[str, AnyLoad]:
        """As for every phase: "piston.pressure" or "piston.displacement"."""
        given = {"piston.pressure": self.piston_pressure, "piston.displacement": self.piston_displacement}
        return super().loads() | {name: load for name, load in given.items() if load is not None}


class EdgeLoad(Table):
    """What drives a free or tied edge from the end of the previous phase on."""

    alternatives: ClassVar[tuple[str, ...]] = ("pressure", "force", "displacement")

    pressure: Annotated[AnyLoad | None, Load(Quantity("pressure"))] = Field(
        default=None, description="Pressure normal to the edge as it moves, positive in compression."
    )
    force: Annotated[AnyLoad | None, Load(Quantity("force"))] = Field(
        default=None,
        description="Total force on a tied edge, positive in compression: of a disc, or of a block 1 mm thick.",
    )
    displacement: Annotated[AnyLoad | None, Load(Quantity("length"))] = Field(
        default=None,
        description="Displacement of a tied edge from the equilibrated sample, positive along x or y. A jump would "
        "need infinite pressure, so a plain value can only hold what the previous phase left.",
    )


class BlockPhase(Phase):
    """What the edges and the bath do from the end of the previous phase on; an edge that is not named goes on.

    Durations are in s: relaxation times are of columns.
    """

    variant_label = "of a block"

    left: EdgeLoad | None = None
    right: EdgeLoad | None = None
    bottom: EdgeLoad | None = None
    top: EdgeLoad | None = None

    def loads(self) -> dict[str, AnyLoad]:
        """As for every phase: "EDGE.pressure", "EDGE.force" or "EDGE.displacement" of the edges that are named."""
        loads = super().loads()
        for edge in EDGES:
            given: EdgeLoad | None = getattr(self, edge)
            loads |= {} if given is None else {f"{edge}.{kind}": load for kind, load in given if load is not None}
        return loads
