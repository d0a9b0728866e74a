"""Volumes, areas and gradients on a plane grid that stands for a slab of unit thickness or for rings about an axis.

Everything follows from one function of an edge from a point i to a point j, with x the abscissa or the radius:

    mean(x_i, x_j)    mean over the edge of the volume per height between it and x = 0: x, or pi x^2
    share(x_i, x_j)   its derivative by x_i: the part of the edge's area per length that belongs to i

so that a polygon has the volume sum over edges of mean * (y_j - y_i), exact for straight edges, and a pressure on an
edge with outward normal n has the resultant share * length * n on i. The functions are of points: coordinates are
floats, arrays, complex or dual numbers, several points a tuple or the first axis of an array.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fvswell.compiled import point
from fvswell.physics.tissue import Array

__all__ = [
    "SECTIONS",
    "Section",
    "diamond_metric",
    "edge_area_vectors",
    "edge_pressure_forces",
    "quadrilateral_gradient",
    "quadrilateral_volume",
]


class Section(NamedTuple):
    """What the plane grid is a section of: its thickness in z, or the factor of the circles about the axis."""

    slab: float  # 1 in plane strain, else 0
    circle: float  # pi of rings, else 0

    @property
    def rings(self) -> bool:
        """Whether the grid stands for rings about an axis, with hoop strains."""
        return self.circle > 0.0

    def thickness(self, x: Array) -> Array:
        """Volume per area of the section."""
        return self.slab + 2.0 * self.circle * x


SECTIONS = {"plane-strain": Section(1.0, 0.0), "axisymmetric": Section(0.0, np.pi)}


@point
def edge_mean(section: Any, x_i: Any, x_j: Any) -> Any:
    """Mean over an edge of the volume per height between it and x = 0."""
    return 0.5 * section.slab * (x_i + x_j) + section.circle / 3.0 * (x_i * x_i + x_i * x_j + x_j * x_j)


@point
def edge_share(section: Any, x_i: Any, x_j: Any) -> Any:
    """Derivative of `edge_mean` by ``x_i``."""
    return 0.5 * section.slab + section.circle / 3.0 * (2.0 * x_i + x_j)


@point
def quadrilateral_volume(section: Any, x: Any, y: Any) -> Any:
    """Volume of a quadrilateral with corners in counterclockwise order."""
    return (
        edge_mean(section, x[0], x[1]) * (y[1] - y[0]) + edge_mean(section, x[1], x[2]) * (y[2] - y[1])
        + edge_mean(section, x[2], x[3]) * (y[3] - y[2]) + edge_mean(section, x[3], x[0]) * (y[0] - y[3])
    )  # fmt: skip


@point
def quadrilateral_gradient(section: Any, x: Any, y: Any) -> Any:
    """Derivatives of the volume by the coordinates of the corners, eight values: all x before all y."""
    rise_0, rise_1, rise_2, rise_3 = y[1] - y[0], y[2] - y[1], y[3] - y[2], y[0] - y[3]
    mean_0, mean_1 = edge_mean(section, x[0], x[1]), edge_mean(section, x[1], x[2])
    mean_2, mean_3 = edge_mean(section, x[2], x[3]), edge_mean(section, x[3], x[0])
    return (
        edge_share(section, x[0], x[1]) * rise_0 + edge_share(section, x[0], x[3]) * rise_3,
        edge_share(section, x[1], x[2]) * rise_1 + edge_share(section, x[1], x[0]) * rise_0,
        edge_share(section, x[2], x[3]) * rise_2 + edge_share(section, x[2], x[1]) * rise_1,
        edge_share(section, x[3], x[0]) * rise_3 + edge_share(section, x[3], x[2]) * rise_2,
        mean_3 - mean_0,
        mean_0 - mean_1,
        mean_1 - mean_2,
        mean_2 - mean_3,
    )


@point
def edge_pressure_forces(section: Any, x: Any, y: Any) -> Any:
    """Forces at the two ends of an edge under unit pressure from outside: both x before both y.

    The body lies on the left of the way from the first end to the second.
    """
    first, second = edge_share(section, x[0], x[1]), edge_share(section, x[1], x[0])
    run, rise = x[1] - x[0], y[1] - y[0]
    return -first * rise, -second * rise, first * run, second * run


@point
def edge_area_vectors(section: Any, x: Any, y: Any) -> Any:
    """Area times outward normal of an edge with two ends, its two components."""
    first_x, second_x, first_y, second_y = edge_pressure_forces(section, x, y)
    return -(first_x + second_x), -(first_y + second_y)


@point
def diamond_metric(section: Any, x: Any, y: Any) -> Any:
    """Volume of a face's diamond, and how the flux of a gradient through the face follows from differences.

    Parameters
    ----------
    section
        Of the grid.
    x, y
        Coordinates of six points: those on either side of the face (1, 2), its ends (3, 4), so that the way 1, 3, 2, 4
        is counterclockwise, and the points 5, 6 near its ends at which the potential is known by interpolation.

    Returns
    -------
    tuple
        The volume of 1, 3, 2, 4, and a, b in

            area * normal . grad phi = a (phi_2 - phi_1) + b (phi_6 - phi_5)

        which is exact for linear phi.
    """
    volume = quadrilateral_volume(section, (x[0], x[2], x[1], x[3]), (y[0], y[2], y[1], y[3]))
    area_x, area_y = edge_area_vectors(section, (x[2], x[3]), (y[2], y[3]))
    across_x, across_y = x[1] - x[0], y[1] - y[0]
    along_x, along_y = x[5] - x[4], y[5] - y[4]
    determinant = across_x * along_y - across_y * along_x
    return (
        volume,
        (area_x * along_y - area_y * along_x) / determinant,
        (across_x * area_y - across_y * area_x) / determinant,
    )
