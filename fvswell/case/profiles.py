"""Quantities that vary from place to place, and how a case file gives them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fvswell.case.lists import read_increasing, read_list, read_table
from fvswell.physics.tissue import Array

__all__ = ["Coordinates", "DepthProfile", "PlaneProfile", "Profile", "read_profile"]

_Reader = Callable[[Any], float]
Coordinates = Mapping[str, Array]  # of the points, by name: "depth" in columns, "x" and "y" in blocks, mm


@dataclass(frozen=True)
class DepthProfile:
    """A quantity that varies along a column: linear between the knots, constant outside them."""

    depth: tuple[float, ...]  # mm from the filter, in the stress-free solid
    value: tuple[float, ...]

    def at(self, coordinates: Coordinates) -> Array:
        """Values at the points, shape of ``coordinates["depth"]``."""
        return np.interp(coordinates["depth"], self.depth, self.value)


@dataclass(frozen=True)
class PlaneProfile:
    """A quantity that varies over a block: linear between the knots, constant outside them.

    ``value`` has a row for each y and a column for each x; an axis along which nothing varies has a single knot.
    """

    x: tuple[float, ...]  # mm, in the stress-free solid; the radius of a disc
    y: tuple[float, ...]  # mm
    value: tuple[tuple[float, ...], ...]

    def at(self, coordinates: Coordinates) -> Array:
        """Values at the points, shape of ``coordinates["x"]``."""
        columns = np.stack([np.interp(coordinates["x"], self.x, row) for row in self.value])
        above = np.clip(np.searchsorted(self.y, coordinates["y"]), 1, max(len(self.y) - 1, 1))
        if len(self.y) == 1:
            return columns[0]
        low, high = np.array(self.y)[above - 1], np.array(self.y)[above]
        share = np.clip((coordinates["y"] - low) / (high - low), 0.0, 1.0)
        points = np.arange(columns.shape[1])
        return (1.0 - share) * columns[above - 1, points] + share * columns[above, points]


Profile = DepthProfile | PlaneProfile


def _read_depth_profile(value: Mapping[str, Any], read_number: _Reader, read_length: _Reader) -> DepthProfile:
    readers = {
        "depth": lambda item: read_increasing(item, read_length),
        "value": lambda item: read_list(item, read_number),
    }
    profile = DepthProfile(**read_table(value, readers))
    if len(profile.depth) != len(profile.value):
        counts = f"{len(profile.depth)} depths and {len(profile.value)} values"
        raise ValueError(f"has {counts}: must be as many of each")
    return profile


def _read_plane_profile(value: Mapping[str, Any], read_number: _Reader, read_length: _Reader) -> PlaneProfile:
    """Knots along x, along y, or both; values in a list along the one axis, or in a list of rows, one for each y."""

    def knots(item: Any) -> tuple[float, ...]:
        return read_increasing(item, read_length)

    axes = [axis for axis in ("x", "y") if axis in value]
    if len(axes) == 1:
        read = read_table(value, {axes[0]: knots, "value": lambda item: read_list(item, read_number)})
        along, values = read[axes[0]], read["value"]
        if len(along) != len(values):
            raise ValueError(f"has {len(along)} knots and {len(values)} values: must be as many of each")
        rows = (values,) if axes == ["x"] else tuple((item,) for item in values)
        return PlaneProfile(along, (0.0,), rows) if axes == ["x"] else PlaneProfile((0.0,), along, rows)

    def table(item: Any) -> tuple[tuple[float, ...], ...]:
        if not isinstance(item, list | tuple):
            raise ValueError("must be a list of rows, one for each y")
        return tuple(read_list(row, read_number) for row in item)

    profile = PlaneProfile(**read_table(value, {"x": knots, "y": knots, "value": table}))
    if len(profile.value) != len(profile.y) or any(len(row) != len(profile.x) for row in profile.value):
        raise ValueError(f"must have {len(profile.y)} rows of {len(profile.x)} values: one for each y, and for each x")
    return profile


def read_profile(value: Mapping[str, Any], read_number: _Reader, read_length: _Reader) -> Profile:
    """Read a profile from an inline table; raises ValueError with all that is wrong with it."""
    if "x" in value or "y" in value:
        return _read_plane_profile(value, read_number, read_length)
    return _read_depth_profile(value, read_number, read_length)
