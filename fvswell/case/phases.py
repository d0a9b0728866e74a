"""The phases of a case file: what acts on the parts of the boundary, and for how long."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar

from pydantic import ConfigDict, Field

from fvswell.case.loads import AnyLoad, Load
from fvswell.case.tables import Table
from fvswell.case.values import Duration, Name, Quantity, Rate, RateReader, RelaxationTimes

__all__ = ["BlockPartLoads", "BlockPhase", "ColumnPartLoads", "ColumnPhase", "PartLoads", "Phase"]


class PartLoads(Table):
    """What acts on a part of the boundary, whatever the geometry; what is not given goes on as it is."""

    alternatives: ClassVar[tuple[str, ...]] = ("pressure", "force", "displacement")
    needs_alternative: ClassVar[bool] = False

    pressure: Annotated[AnyLoad | None, Load(Quantity("pressure"))] = Field(
        default=None,
        description="Pressure normal to the part as it moves, positive in compression, of a part that is free, "
        "straight or a glued plate; the pressure of a bath acts besides.",
    )
    force: Annotated[AnyLoad | None, Load(Quantity("force"))] = Field(
        default=None,
        description="Total force on a straight part or a glued plate, positive in compression: of a disc, of a block "
        "1 mm thick, or of a column whose area is given.",
    )
    displacement: Annotated[AnyLoad | None, Load(Quantity("length"), strain=True)] = Field(
        default=None,
        description="Displacement of a straight part or a glued plate from the equilibrated sample along its normal, "
        "positive along x or y, so that a piston or a top edge that compresses moves by a negative one; or in % of the "
        "height or width of the equilibrated sample. A jump would need infinite pressure, so a plain value can only "
        "hold what the previous phase left (0 in the first).",
    )
    bath_concentration: Annotated[AnyLoad | None, Load(Quantity("concentration", above=0.0))] = Field(
        default=None, description="Concentration of the bath of this part, in place of the phase's."
    )
    bath_pressure: Annotated[AnyLoad | None, Load(Quantity("pressure"))] = Field(
        default=None, description="Hydrostatic pressure of the bath of this part; 0 before the first phase."
    )
    potential: Annotated[AnyLoad | None, Load(Quantity("electric potential"))] = Field(
        default=None, description="Electric potential of a part that is given for it, relative to the reference."
    )


class ColumnPartLoads(PartLoads):
    """What acts on an end of a column; what is not given goes on as it is."""

    current: Annotated[AnyLoad | None, Load(Quantity("current density"))] = Field(
        default=None, description="Electric current per area through an end that is given for it, into the tissue."
    )


class BlockPartLoads(PartLoads):
    """What acts on a part of the boundary of a block; what is not given goes on as it is."""

    tangential_displacement: Annotated[AnyLoad | None, Load(Quantity("length"), strain=True)] = Field(
        default=None, description="Displacement of a glued plate along itself, positive along x or y."
    )
    current: Annotated[AnyLoad | None, Load(Quantity("electric current"))] = Field(
        default=None,
        description="Electric current through a part that is given for it, into the tissue: of a disc, or of a block "
        "1 mm thick.",
    )


class Phase(Table):
    """A stretch of time in which loads act; what every geometry has. A load that is not given goes on as it is."""

    name: Annotated[str, Name()] = Field(description="Name of the phase; no two are alike.")
    duration: Annotated[float | RelaxationTimes, Duration()] = Field(
        description="How long the phase lasts. A relaxation time is that of the biphasic-swelling model of a column "
        "in this phase, see relaxation_fraction."
    )
    until: Annotated[Rate | None, RateReader()] = Field(
        default=None,
        description="The phase ends when, once its loads are constant, what is measured changes more slowly than this: "
        "the pressure of the first part that is moved by a displacement, or the global strain where none is. The "
        "duration is then the longest, in s.",
    )
    bath_concentration: Annotated[AnyLoad | None, Load(Quantity("concentration", above=0.0))] = Field(
        default=None, description="Concentration of the baths of all open parts; without it, as it was."
    )

    def part_loads(self) -> Iterator[tuple[str, PartLoads]]:
        """Parts that the phase names, each with what acts on it."""
        for name in (*type(self).model_fields, *(self.__pydantic_extra__ or {})):
            loads = getattr(self, name)
            if isinstance(loads, PartLoads):
                yield name, loads

    def all_loads(self) -> Iterator[tuple[tuple[str, ...], AnyLoad]]:
        """All loads that the phase gives, each with its place in it: those of parts, and the common bath."""
        if self.bath_concentration is not None:
            yield ("bath_concentration",), self.bath_concentration
        for name, load in self.loads().items():
            yield tuple(name.split(".")), load

    def loads(self) -> dict[str, AnyLoad]:
        """Loads on parts that the phase names: "PART.KIND"."""
        return {f"{name}.{kind}": load for name, given in self.part_loads() for kind, load in given if load is not None}


class ColumnPhase(Phase):
    """What acts on the ends of a column from the end of the previous phase on."""

    variant_label = "of a column"

    former: ClassVar[Mapping[str, str]] = {
        "piston_pressure": "piston.pressure",
        "piston_displacement": "piston.displacement",
    }

    filter: ColumnPartLoads | None = None
    piston: ColumnPartLoads | None = None


class BlockPhase(Phase):
    """What acts on the parts of the boundary of a block from the end of the previous phase on.

    Durations are in s: relaxation times are of columns.
    """

    model_config = ConfigDict(extra="allow")
    variant_label = "of a block"
    named_tables: ClassVar[type[Table]] = BlockPartLoads
    __pydantic_extra__: dict[str, BlockPartLoads]
