"""The tables of a case file that are of blocks: geometry in two dimensions, its edges and what is done to them."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from fvswell.block.sides import EDGES
from fvswell.case.schema import LARGEST_GRADING, Phase, Table
from fvswell.case.values import Choice, Counts, Flag, Load, Names, Point, Quantity, Ramp

__all__ = [
    "AxisymmetricGeometry",
    "BlockGeometry",
    "BlockPhase",
    "Edge",
    "EdgeLoad",
    "Edges",
    "PlaneStrainGeometry",
]


class Edge(Table):
    """An edge of a block."""

    displacement: Annotated[str, Choice(("fixed", "roller", "free", "tied"))] = Field(
        description="fixed: held in both directions; roller: no displacement along the normal; free; tied: free to "
        "move along the normal, but as one straight line."
    )
    permeable: Annotated[bool, Flag()] = Field(default=False, description="Whether the edge is open to the bath.")


class Edges(Table):
    """The edges of a block; of a disc, the left one is the axis: a roller, impermeable."""

    left: Edge
    right: Edge
    bottom: Edge
    top: Edge


class _BlockGeometry(Table):
    height: Annotated[float, Quantity("length", above=0.0)] = Field(
        description="Height of the stress-free solid (J = 1)."
    )
    cells: Annotated[tuple[int, int], Counts(1, 1000)] = Field(description="Number of cells along x and along y.")
    grading: Annotated[float, Quantity(at_least=1.0, at_most=LARGEST_GRADING)] = Field(
        default=1.0, description="Largest cell over smallest, along each axis that is graded."
    )
    finest_at: Annotated[tuple[str, ...], Names(EDGES)] = Field(
        default=(), description="Edges at which the smallest cells lie."
    )
    probe: Annotated[tuple[float, float] | None, Point()] = Field(
        default=None,
        description="Where the displacement is compared between models; the nearest vertex is taken. Without it the "
        "top right corner.",
    )
    edges: Edges


class PlaneStrainGeometry(_BlockGeometry):
    """A rectangle in plane strain."""

    kind: Literal["plane-strain"] = Field(description="A rectangular block in plane strain.")
    width: Annotated[float, Quantity("length", above=0.0)] = Field(
        description="Width of the stress-free solid (J = 1)."
    )


class AxisymmetricGeometry(_BlockGeometry):
    """A disc; x is the radius."""

    kind: Literal["axisymmetric"] = Field(description="A disc, of which half a cross-section is solved.")
    radius: Annotated[float, Quantity("length", above=0.0)] = Field(
        description="Radius of the stress-free solid (J = 1)."
    )

    @property
    def width(self) -> float:
        """Extent along x: the radius."""
        return self.radius


class EdgeLoad(Table):
    """What drives a free or tied edge from the end of the previous phase on."""

    alternatives: ClassVar[tuple[str, ...]] = ("pressure", "force", "displacement")

    pressure: Annotated[float | Ramp | None, Load(Quantity("pressure"))] = Field(
        default=None, description="Pressure normal to the edge as it moves, positive in compression."
    )
    force: Annotated[float | Ramp | None, Load(Quantity("force"))] = Field(
        default=None,
        description="Total force on a tied edge, positive in compression: of a disc, or of a block 1 mm thick.",
    )
    displacement: Annotated[float | Ramp | None, Load(Quantity("length"))] = Field(
        default=None,
        description="Displacement of a tied edge from the equilibrated sample, positive along x or y. A jump would "
        "need infinite pressure, so a plain value can only hold what the previous phase left.",
    )


class BlockPhase(Phase):
    """What the edges and the bath do from the end of the previous phase on; an edge that is not named goes on.

    Durations are in s: relaxation times are of columns.
    """

    left: EdgeLoad | None = None
    right: EdgeLoad | None = None
    bottom: EdgeLoad | None = None
    top: EdgeLoad | None = None


BlockGeometry = Annotated[PlaneStrainGeometry | AxisymmetricGeometry, Field(discriminator="kind")]
