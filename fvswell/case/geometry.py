"""The geometries of a case file: a column, and blocks in plane strain or axisymmetry.

Whatever depends on the geometry asks it: which phases it has, what its parts are, where tissue is looked up.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag

from fvswell.boundary.parts import Part
from fvswell.boundary.sides import EDGES
from fvswell.case.boundary import BlockBoundary, Boundary, ColumnBoundary
from fvswell.case.phases import BlockPhase, ColumnPhase, Phase
from fvswell.case.profiles import Coordinates, DepthProfile, PlaneProfile, Profile
from fvswell.case.tables import Table, variant
from fvswell.case.values import Count, Counts, Names, Point, Quantity
from fvswell.numerics.graded_grid import graded_nodes
from fvswell.physics.tissue import Array

__all__ = [
    "AnyGeometry",
    "AxisymmetricGeometry",
    "BlockGeometry",
    "ColumnGeometry",
    "Geometry",
    "PlaneStrainGeometry",
]

_LARGEST_GRADING = 1e6
_EVEN_POINTS = 50  # along each axis of a block at which its tissue is checked


class Geometry(Table):
    """What every geometry has."""

    kind: str
    phases: ClassVar[type[Phase]]
    boundary: ClassVar[type[Boundary]]
    profile: ClassVar[type[DepthProfile | PlaneProfile]]  # how properties of the tissue may vary
    profile_example: ClassVar[str]
    histories: ClassVar[tuple[str, ...]]  # fields that say how far the sample has gone; the largest counts

    @abstractmethod
    def coordinates(self, points: Array) -> Coordinates:
        """Coordinates by the names that profiles use.

        Parameters
        ----------
        points
            Of the stress-free solid, mm: depths ``(points,)`` in a column, ``(2, points)`` in a block.
        """

    @abstractmethod
    def parts(self, boundary: Any) -> tuple[Part, ...]:
        """Parts of the boundary, from the table that the geometry has for it."""

    @abstractmethod
    def sample_points(self, profiles: list[Profile]) -> Array:
        """Points at which to check the tissue: an even grid and the knots of all profiles."""


class ColumnGeometry(Geometry):
    """A column between a filter (bottom) and a piston (top), deforming along its axis only."""

    phases = ColumnPhase
    boundary = ColumnBoundary
    profile = DepthProfile
    profile_example = "in a column give {depth = [...], value = [...]}"
    histories = ("global_strain",)

    kind: Literal["column"] = Field(description="A column under a piston, on a filter open to the bath.")
    height: Annotated[float, Quantity("length", above=0.0)] = Field(
        description="Height of the stress-free solid (J = 1)."
    )
    area: Annotated[float | None, Quantity("area", above=0.0)] = Field(
        default=None, description="Area of the cross-section; where it is given, the result has forces."
    )
    cells: Annotated[int, Count(2, 10_000)] = Field(default=50, description="Number of cells over the height.")
    grading: Annotated[float, Quantity(at_least=1.0, at_most=_LARGEST_GRADING)] = Field(
        default=1.0, description="Largest cell over smallest; the finest lies at the filter."
    )

    def coordinates(self, points: Array) -> Coordinates:
        """Depths, mm from the filter."""
        return {"depth": points}

    def parts(self, boundary: ColumnBoundary) -> tuple[Part, ...]:
        """The filter and the piston."""
        return boundary.parts()

    def sample_points(self, profiles: list[Profile]) -> Array:
        """Depths: the nodes of an even grid and the knots; one is enough where nothing varies."""
        if not profiles:
            return np.zeros(1)
        knots = np.concatenate([profile.depth for profile in profiles if isinstance(profile, DepthProfile)])
        return np.union1d(np.linspace(0.0, self.height, self.cells + 1), knots[knots <= self.height])


class BlockGeometry(Geometry):
    """What plane strain and axisymmetry share."""

    phases = BlockPhase
    boundary = BlockBoundary
    profile = PlaneProfile
    profile_example = "in a block give {x = [...], y = [...], value = [[...]]}"
    histories = ("probe_displacement_x", "probe_displacement_y")

    height: Annotated[float, Quantity("length", above=0.0)] = Field(
        description="Height of the stress-free solid (J = 1)."
    )
    cells: Annotated[tuple[int, int], Counts(1, 1000)] = Field(description="Number of cells along x and along y.")
    grading: Annotated[float, Quantity(at_least=1.0, at_most=_LARGEST_GRADING)] = Field(
        default=1.0, description="Largest cell over smallest, along each axis that is graded."
    )
    finest_at: Annotated[tuple[str, ...], Names(EDGES)] = Field(
        default=(), description="Edges at which the smallest cells lie; they also do where parts of an edge meet."
    )
    former: ClassVar[Mapping[str, str]] = {"edges": "the heading [boundary]"}

    probe: Annotated[tuple[float, float] | None, Point()] = Field(
        default=None,
        description="Where the displacement is compared between models; the nearest vertex is taken. Without it the "
        "top right corner.",
    )

    @property
    @abstractmethod
    def extent(self) -> tuple[float, float]:
        """Size along x and y, mm."""

    def coordinates(self, points: Array) -> Coordinates:
        """Positions along x and y, mm."""
        return {"x": points[0], "y": points[1]}

    def parts(self, boundary: BlockBoundary) -> tuple[Part, ...]:
        """Edges, or pieces of them, in the order of the file."""
        return boundary.parts(self.extent, axis=isinstance(self, AxisymmetricGeometry))

    def sample_points(self, profiles: list[Profile]) -> Array:
        """The crossings of lines through an even grid and through all knots."""
        plane = [profile for profile in profiles if isinstance(profile, PlaneProfile)]
        width, height = self.extent
        x, y = (
            np.unique(np.concatenate([np.linspace(0.0, length, _EVEN_POINTS), *(k[k <= length] for k in knots)]))
            for length, knots in (
                (width, [np.asarray(profile.x) for profile in plane]),
                (height, [np.asarray(profile.y) for profile in plane]),
            )
        )
        return np.stack(np.meshgrid(x, y)).reshape(2, -1)

    def grid_nodes(self, parts: Sequence[Part]) -> tuple[Array, Array]:
        """Coordinates of the grid's nodes along x and along y, mm; parts of an edge meet at nodes.

        Raises
        ------
        ValueError
            If there are too few cells for the parts.
        """
        ends = {"left": "start", "right": "end", "bottom": "start", "top": "end"}
        sides = (("left", "right"), ("bottom", "top"))
        nodes = []
        for axis, (length, cells) in enumerate(zip(self.extent, self.cells, strict=True)):
            along = [part for part in parts if part.edge in sides[1 - axis]]
            inside = sorted({end for part in along for end in (part.start, part.end) if 0.0 < end < length})
            finest: list[str | float] = [ends[edge] for edge in sides[axis] if edge in self.finest_at]
            nodes.append(graded_nodes(length, cells, self.grading, [*finest, *inside]))
        return nodes[0], nodes[1]


class PlaneStrainGeometry(BlockGeometry):
    """A rectangle in plane strain."""

    kind: Literal["plane-strain"] = Field(description="A rectangular block in plane strain.")
    width: Annotated[float, Quantity("length", above=0.0)] = Field(
        description="Width of the stress-free solid (J = 1)."
    )

    @property
    def extent(self) -> tuple[float, float]:
        """Size along x and y, mm."""
        return self.width, self.height


class AxisymmetricGeometry(BlockGeometry):
    """A disc; x is the radius."""

    kind: Literal["axisymmetric"] = Field(description="A disc, of which half a cross-section is solved.")
    radius: Annotated[float, Quantity("length", above=0.0)] = Field(
        description="Radius of the stress-free solid (J = 1)."
    )

    @property
    def extent(self) -> tuple[float, float]:
        """Size along the radius and the axis, mm."""
        return self.radius, self.height


def _kind(content: Any) -> str | None:
    """Name of the geometry that raw content, or a geometry, is of; the nearest one if it is misspelt."""
    if isinstance(content, Geometry):
        return content.kind
    table = variant([ColumnGeometry, PlaneStrainGeometry, AxisymmetricGeometry], content)
    return None if table is None else str(table.model_fields["kind"].annotation.__args__[0])  # type: ignore[union-attr]


AnyGeometry = Annotated[
    Annotated[ColumnGeometry, Tag("column")]
    | Annotated[PlaneStrainGeometry, Tag("plane-strain")]
    | Annotated[AxisymmetricGeometry, Tag("axisymmetric")],
    Discriminator(_kind),
]
