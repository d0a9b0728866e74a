"""The grid of a block as it is at a time: a result holds the stress-free grid and what moves it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fvswell.errors import OutputError
from fvswell.physics.tissue import Array
from fvswell.results.layout import SAME_TIME

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["AXES", "Fold", "first_fold", "is_block", "moved_nodes", "quadrilaterals"]

AXES = ("x", "y")


class Fold(NamedTuple):
    """Where and when a cell has a corner inside out."""

    time: float  # s
    x: float  # mm, in the stress-free solid
    y: float


def is_block(result: xr.Dataset) -> bool:
    """Whether a result is of a block; else it is of a column."""
    return "mesh" in result.variables


def moved_nodes(result: xr.Dataset, time: float) -> Array:
    """Where the nodes of a block are at a time.

    Parameters
    ----------
    result
        Of a block.
    time
        In s; between two outputs the displacement is interpolated linearly.

    Returns
    -------
    numpy.ndarray
        Coordinates in mm, ``(2, nodes)``.

    Raises
    ------
    OutputError
        If the result is of a column, or the time is beyond it.
    """
    if not is_block(result):
        raise OutputError("only the results of blocks have a grid with nodes in two dimensions")
    times = result["time"].values
    slack = SAME_TIME * abs(times[-1])
    if not times[0] - slack <= time <= times[-1] + slack:
        raise OutputError(f"time {time:.6g} s: must be from {times[0]:.6g} to {times[-1]:.6g} s")
    at = float(np.clip(time, times[0], times[-1]))
    upper = int(np.clip(np.searchsorted(times, at), min(1, len(times) - 1), len(times) - 1))
    lower = max(upper - 1, 0)
    share = (at - times[lower]) / (times[upper] - times[lower]) if upper > lower else 0.0
    moved = []
    for axis in AXES:
        displacement = result[f"displacement_{axis}"].values
        shift = (1.0 - share) * displacement[lower] + share * displacement[upper]
        moved.append(result[f"node_{axis}"].values + shift)
    return np.stack(moved)


def quadrilaterals(result: xr.Dataset) -> Array:
    """Nodes of the cells of a block, anticlockwise, ``(cells, 4)``, whatever type they were read as."""
    return np.asarray(result["face_nodes"].values).astype(int)


def first_fold(result: Mapping[Any, Any]) -> Fold | None:
    """The first fold in the outputs of a block, None if there is none; a column has no corners to fold.

    A run goes on while the solid is upright where its stress is taken, inside the cells. At the end of a glued edge a
    corner may fold over all the same: a free edge that would come to lie on what it is glued to, were there contact.
    """
    if "face_nodes" not in result:
        return None
    nodes = np.stack([np.asarray(result[f"node_{axis}"]) + np.asarray(result[f"displacement_{axis}"]) for axis in AXES])
    corners = nodes[:, :, np.asarray(result["face_nodes"]).astype(int)]
    ahead, back = np.roll(corners, -1, axis=-1) - corners, np.roll(corners, 1, axis=-1) - corners
    folded = (ahead[0] * back[1] <= ahead[1] * back[0]).any(axis=-1)
    if not folded.any():
        return None
    output = int(folded.any(axis=1).argmax())
    cell = int(folded[output].argmax())
    return Fold(*(float(result[name][at]) for name, at in (("time", output), ("face_x", cell), ("face_y", cell))))
