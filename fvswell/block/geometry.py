"""Volumes, areas and gradients on a plane grid that stands for a slab of unit thickness or for rings about an axis.

Everything follows from one function of an edge from a point i to a point j, with x the abscissa or the radius:

    mean(x_i, x_j)    mean over the edge of the volume per height between it and x = 0: x, or pi x^2
    share(x_i, x_j)   its derivative by x_i: the part of the edge's area per length that belongs to i

so that a polygon has the volume sum over edges of mean * (y_j - y_i), exact for straight edges, and a pressure on an
edge with outward normal n has the resultant share * length * n on i. All functions accept complex numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fvswell.physics.tissue import Array

__all__ = [
    "SECTIONS",
    "Section",
    "diamond_metric",
    "edge_area_vectors",
    "edge_pressure_forces",
    "polygon_volume",
    "polygon_volume_gradient",
]


@dataclass(frozen=True)
class Section:
    """What the plane grid is a section of."""

    name: str
    mean: Callable[[Array, Array], Array]
    share: Callable[[Array, Array], Array]
    thickness: Callable[[Array], Array]  # volume per area of the section
    rings: bool  # whether there are hoop strains


def _plane_mean(x_i: Array, x_j: Array) -> Array:
    return 0.5 * (x_i + x_j)


def _plane_share(x_i: Array, x_j: Array) -> Array:
    return 0.5 * np.ones_like(x_i)


def _ring_mean(x_i: Array, x_j: Array) -> Array:
    return np.pi / 3.0 * (x_i * x_i + x_i * x_j + x_j * x_j)


def _ring_share(x_i: Array, x_j: Array) -> Array:
    return np.pi / 3.0 * (2.0 * x_i + x_j)


SECTIONS = {
    "plane-strain": Section("plane-strain", _plane_mean, _plane_share, np.ones_like, rings=False),
    "axisymmetric": Section("axisymmetric", _ring_mean, _ring_share, lambda x: 2.0 * np.pi * x, rings=True),
}


def polygon_volume(section: Section, x: Array, y: Array) -> Array:
    """Volume of polygons with corners ``(corners, ...)`` in counterclockwise order."""
    return (section.mean(x, np.roll(x, -1, axis=0)) * (np.roll(y, -1, axis=0) - y)).sum(axis=0)


def polygon_volume_gradient(section: Section, x: Array, y: Array) -> Array:
    """Derivative of the volume by the coordinates of the corners, ``(2, corners, ...)``."""
    x_next, x_last = np.roll(x, -1, axis=0), np.roll(x, 1, axis=0)
    rise, rise_last = np.roll(y, -1, axis=0) - y, y - np.roll(y, 1, axis=0)
    by_x = section.share(x, x_next) * rise + section.share(x, x_last) * rise_last
    return np.stack([by_x, section.mean(x_last, x) - section.mean(x, x_next)])


def edge_pressure_forces(section: Section, ends: Array) -> Array:
    """Forces at the ends of edges under unit pressure from outside; ends and result ``(2, 2 ends, ...)``.

    The body lies on the left of the way from the first end to the second.
    """
    x = ends[0]
    span = ends[:, 1] - ends[:, 0]
    share = section.share(x, x[::-1])
    return np.stack([-share * span[1], share * span[0]])


def edge_area_vectors(section: Section, ends: Array) -> Array:
    """Area times outward normal of edges, ``(2, ...)``."""
    return -edge_pressure_forces(section, ends).sum(axis=1)


def diamond_metric(section: Section, points: Array) -> Array:
    """Volume of a face's diamond, and how the flux of a gradient through the face follows from differences.

    Parameters
    ----------
    section
        Of the grid.
    points
        ``(2, 6, ...)``: the points on either side of the face (1, 2), its ends (3, 4), so that the way 1, 3, 2, 4 is
        counterclockwise, and the points 5, 6 near its ends at which the potential is known by interpolation.

    Returns
    -------
    array
        ``(3, ...)``: the volume of 1, 3, 2, 4, and a, b in

            area * normal . grad phi = a (phi_2 - phi_1) + b (phi_6 - phi_5)

        which is exact for linear phi.
    """
    volume = polygon_volume(section, points[0][[0, 2, 1, 3]], points[1][[0, 2, 1, 3]])
    area = edge_area_vectors(section, points[:, 2:4])
    across, along = points[:, 1] - points[:, 0], points[:, 5] - points[:, 4]
    determinant = _cross(across, along)
    return np.stack([volume, _cross(area, along) / determinant, _cross(across, area) / determinant])


def _cross(first: Array, second: Array) -> Array:
    return first[0] * second[1] - first[1] * second[0]
