"""Result files: netCDF by the CF conventions. Each is written whole, so a reader never meets half of one.

The ``run_status`` of a file is "complete" or says when and why the run stopped. The case is in it, whole, so it can be
run again from the file alone; and the state that the run ended with, so it can be continued.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fvswell.case.case import Case
from fvswell.errors import OutputError
from fvswell.physics.tissue import Array
from fvswell.results.layout import COMPLETE, SAME_TIME, TIME_ATTRIBUTES, Content, Layout
from fvswell.results.part_file import NETCDF, PartFile

if TYPE_CHECKING:
    import netCDF4
    import xarray as xr

__all__ = [
    "COMPLETE",
    "SAME_TIME",
    "in_memory",
    "read_case",
    "read_dataset",
    "read_result",
    "read_state",
    "refuse_existing",
    "write_result",
]

STATE = "state"  # group of a file with all that the run needs to be continued
_NEEDED = ("time", "global_strain", "phase_end", "step_time")  # variables without which nothing can be done


def write_result(path: Path, layout: Layout, content: Content, status: str, state: Mapping[str, Array]) -> None:
    """Write a result file, in place of one that is there.

    Parameters
    ----------
    path
        The file.
    layout, content
        What it looks like and what it holds.
    status
        "complete", or why it is not.
    state
        What the run needs to be continued, by name.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    with PartFile(path, layout.define) as part:
        with part.writing() as file:
            file.run_status = status
            layout.fill(file, content)
            group = file.createGroup(STATE)
            for name, values in state.items():
                dimensions = tuple(f"{name}_{axis}" for axis in range(np.ndim(values)))
                for dimension, size in zip(dimensions, np.shape(values), strict=True):
                    group.createDimension(dimension, size)
                group.createVariable(name, np.asarray(values).dtype, dimensions)[...] = values
        part.finish()


def in_memory(layout: Layout, content: Content, status: str) -> xr.Dataset:
    """The result as a dataset, without a file; what `read_result` would give."""
    import xarray as xr

    variables: dict[str, Any] = {"time": ("time", content.times, TIME_ATTRIBUTES)}
    for name, values in (*content.fields.items(), *content.history.items()):
        variables[name] = (layout.field_dimensions(name), values, layout.field_attributes(name))
    coordinates = {
        name: (dimensions, values, dict(attributes))
        for name, (dimensions, values, attributes) in layout.coordinates.items()
    }
    return xr.Dataset(variables, coordinates, layout.attributes | {"run_status": status})


def read_result(path: str | Path) -> xr.Dataset:
    """Open a result file, whole in memory.

    Raises
    ------
    OutputError
        If there is no such file, it cannot be read, or it is not a result of fvswell.
    """
    dataset = read_dataset(path)
    if "case_toml" not in dataset.attrs:
        raise OutputError(f"{path}: is not a result of fvswell (it holds no case)")
    missing = [name for name in _NEEDED if name not in dataset.variables]
    missing += [name for name in ("model", "run_status") if name not in dataset.attrs]
    if missing:
        raise OutputError(f"{path}: is no whole result of fvswell: it has no {' and no '.join(missing)}")
    return dataset.set_coords(
        [name for name, variable in dataset.variables.items() if not {"time", "step"} & set(variable.dims)]
    )


def read_dataset(path: str | Path) -> xr.Dataset:
    """Open any netCDF file, whole in memory.

    Raises
    ------
    OutputError
        If there is no such file, or it cannot be read.
    """
    import xarray as xr

    with _reading(Path(path)), xr.open_dataset(path, engine="netcdf4", decode_times=False) as file:
        return file.load()


def read_case(path: str | Path) -> Case:
    """The case that a result file was computed from.

    Raises
    ------
    OutputError
        As for `read_result`.
    CaseError
        If it is a case of another version of fvswell, which this one cannot read.
    """
    with _open(Path(path)) as file:
        if "case_toml" not in file.ncattrs():
            raise OutputError(f"{path}: is not a result of fvswell (it holds no case)")
        text = str(file.case_toml)
        folder = Path(file.load_folder) if "load_folder" in file.ncattrs() else None
    return Case.from_toml(text, source=str(path), folder=folder)


def read_state(path: Path) -> dict[str, Array]:
    """What a run needs to be continued from its result file, or from one that is still being written.

    Raises
    ------
    OutputError
        If there is no such file, it cannot be read, or there is nothing to continue from in it.
    """
    with _open(path) as file:
        if STATE not in file.groups:
            raise OutputError(f"{path}: holds no state to continue from")
        return {name: np.array(variable[...]) for name, variable in file.groups[STATE].variables.items()}


def refuse_existing(paths: Sequence[Path], replace: bool) -> None:
    """Raise OutputError if any of the files exists and may not be replaced."""
    there = [path for path in paths if path.exists()]
    if there and not replace:
        raise OutputError("\n".join(f"{path}: exists already; use --force to replace it" for path in there))


@contextmanager
def _open(path: Path) -> Iterator[netCDF4.Dataset]:
    """Context of a file that is read bit by bit."""
    import netCDF4

    with _reading(path), netCDF4.Dataset(path) as file:
        yield file


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Context of reading a file; what goes wrong is reported with its name."""
    if not path.exists():
        raise OutputError(f"{path}: no such file")
    try:
        with NETCDF:
            yield
    # the netCDF library, and xarray for it, answer damaged files with any of these
    except (OSError, RuntimeError, ValueError, KeyError, IndexError, AttributeError, TypeError) as error:
        if not _begins_as_netcdf(path):
            raise OutputError(f"{path}: is not a netCDF file") from None
        raise OutputError(f"{path}: is damaged or not closed, and cannot be read ({error})") from None


def _begins_as_netcdf(path: Path) -> bool:
    """Whether a file begins as one of the netCDF library's formats does."""
    try:
        with path.open("rb") as file:
            return file.read(8).startswith((b"\x89HDF\r\n\x1a\n", b"CDF"))
    except OSError:
        return False
