"""The boundary of a case file: its parts, each with a mechanical, a bath and an electrical condition."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, cast

from pydantic import ConfigDict, Field, create_model

from fvswell.boundary.parts import ELECTRICAL, MECHANICAL, Mechanical, Part
from fvswell.boundary.sides import EDGES
from fvswell.case.tables import Table
from fvswell.case.values import Choice, Quantity

__all__ = ["BlockBoundary", "BlockPart", "Boundary", "ColumnBoundary", "FilterEnd", "PistonEnd"]

_OPEN = {"open": True, "closed": False}
_WALL_ELECTRODES = ("cation", "anion")


class _Conditions(Table):
    """Conditions that the parts of every geometry have."""

    bath: Annotated[str, Choice(tuple(_OPEN))] = Field(
        default="closed", description="Whether the part is open to a bath, or closed: neither water nor ions pass."
    )
    electrical: Annotated[str | None, Choice(ELECTRICAL)] = Field(
        default=None,
        description="insulating: no current passes; grounded: the potential is 0; floating: no net current passes; "
        "current or potential: it is given in the phases. By default an open part is grounded, as parts in one common "
        "bath are, and a closed part insulating. Only the electrochemical model has currents.",
    )
    electrode: Annotated[str | None, Choice(_WALL_ELECTRODES)] = Field(
        default=None,
        description="Of a closed part that conducts: an electrode in the wall at which only cations, or only anions "
        "(Ag/AgCl in a chloride), are exchanged.",
    )

    def conditions(self) -> dict[str, Any]:
        """Bath and electrical conditions as `Part` has them."""
        is_open = _OPEN[self.bath]
        return {
            "open": is_open,
            "electrical": self.electrical or ("grounded" if is_open else "insulating"),
            "electrode": self.electrode or "bath",
        }


class FilterEnd(_Conditions):
    """The end of a column at x = 0, which is fixed."""

    bath: Annotated[str, Choice(tuple(_OPEN))] = Field(
        default="open", description="Whether the end is open to a bath, or closed: neither water nor ions pass."
    )


class PistonEnd(_Conditions):
    """The end of a column at x = h."""

    mechanical: Annotated[str, Choice(("straight", "fixed"))] = Field(
        default="straight",
        description="straight: moved by a pressure, a force or a displacement; fixed: stays where it is in equilibrium "
        "before the first phase.",
    )


class Boundary(Table):
    """What the boundaries of all geometries have."""


class ColumnBoundary(Boundary):
    """The two ends of a column."""

    variant_label = "of a column"

    filter: FilterEnd = FilterEnd()
    piston: PistonEnd = PistonEnd()

    def parts(self) -> tuple[Part, Part]:
        """The filter and the piston."""
        mechanical = cast(Mechanical, self.piston.mechanical)
        return (
            Part("filter", "fixed", **self.filter.conditions()),
            Part("piston", mechanical, **self.piston.conditions()),
        )


class _BlockConditions(_Conditions):
    """An edge of a block, or a piece of one; a table that has the name of an edge is the whole edge."""

    mechanical: Annotated[str, Choice(MECHANICAL)] = Field(
        description="fixed: held in both directions; roller: no displacement along the normal; free; straight: one "
        "displacement along the normal, sliding without friction, as under a smooth plate; glued-plate: moves as one "
        "and does not slide, as under a rough plate."
    )
    edge: Annotated[str | None, Choice(EDGES)] = Field(
        default=None, description="The edge that the part is a piece of, for a part that is not named as an edge."
    )


_ALONG_EDGE: dict[str, Any] = {  # "from" cannot be written as an attribute
    "from": (
        Annotated[float, Quantity("length", at_least=0.0)],
        Field(
            default=0.0,
            description="Where the piece begins, along the edge of the stress-free solid from its left or lower end.",
        ),
    ),
    "to": (
        Annotated[float | None, Quantity("length", above=0.0)],
        Field(default=None, description="Where the piece ends; without it, at the end of the edge."),
    ),
}
BlockPart: type[_BlockConditions] = create_model(
    "BlockPart", __base__=_BlockConditions, __module__=__name__, __doc__=_BlockConditions.__doc__, **_ALONG_EDGE
)


class BlockBoundary(Boundary):
    """The edges of a block, or pieces of them that together make up all four; of a disc, the left edge is the axis.

    The part that is open to a bath and comes first has the bath that is the reference of the electric potential.
    """

    model_config = ConfigDict(extra="allow")
    variant_label = "of a block"
    named_tables: ClassVar[type[Table]] = BlockPart
    __pydantic_extra__: dict[str, BlockPart]

    def parts(self, extent: tuple[float, float], axis: bool) -> tuple[Part, ...]:
        """The parts in the order of the file.

        Parameters
        ----------
        extent
            Size of the block along x and y, mm.
        axis
            Whether the left edge is the axis of a disc, which need not be said.
        """
        tables = dict(self.__pydantic_extra__ or {})
        parts = [_block_part(name, table, extent) for name, table in tables.items()]
        if axis and not any(part.edge == "left" for part in parts):
            parts.append(Part("left", "roller", edge="left", end=extent[1]))
        return tuple(parts)


def _block_part(name: str, table: _BlockConditions, extent: tuple[float, float]) -> Part:
    edge, mechanical = table.edge or name, cast(Mechanical, table.mechanical)
    start, end = getattr(table, "from"), table.to  # type: ignore[attr-defined]
    length = extent[1] if edge in ("left", "right") else extent[0]
    return Part(name, mechanical, **table.conditions(), edge=edge, start=start, end=length if end is None else end)
