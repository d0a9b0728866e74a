"""The grid of a block as it is at a time: a result holds the stress-free grid and what moves it."""

from __future__ import annotations

import numpy as np
import xarray as xr

from fvswell.errors import OutputError
from fvswell.physics.tissue import Array
from fvswell.results.file import SAME_TIME

__all__ = ["AXES", "is_block", "moved_nodes", "quadrilaterals"]

AXES = ("x", "y")


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
