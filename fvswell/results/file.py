"""Result files: netCDF by the CF conventions, written as the run goes on, never half written.

The ``run_status`` of a file is "complete" or tells when and why the run stopped. The case is in it, whole, so it can be
run again from the file alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr

from fvswell.case.case import Case
from fvswell.errors import OutputError
from fvswell.physics.tissue import Array
from fvswell.results.fields import FIELDS
from fvswell.results.part_file import PartFile
from fvswell.results.provenance import provenance

__all__ = [
    "COMPLETE",
    "SAME_TIME",
    "Layout",
    "ResultFile",
    "in_memory",
    "read_case",
    "read_result",
    "refuse_existing",
]

_TIME_ATTRIBUTES = {"units": "s", "long_name": "time since the load first changed", "axis": "T"}

COMPLETE = "complete"
SAME_TIME = 1e-9  # relative: times of results that are closer are one
Record = Mapping[str, Array]


class Layout:
    """Dimensions, coordinates and attributes of a result, before there is any record of it.

    Parameters
    ----------
    dimensions
        Size of every dimension but time and step.
    coordinates
        Variables without time: name to (dimensions, values, attributes).
    location_dimensions
        Dimension of each location that a field may have (see `fvswell.results.fields`).
    case
        The case, resolved.
    comment
        What else a reader should know.
    conventions
        That the file follows.
    mesh
        Name of the variable that describes the grid, where the UGRID conventions need one.
    """

    def __init__(
        self,
        dimensions: Mapping[str, int],
        coordinates: Mapping[str, tuple[tuple[str, ...], Array, Mapping[str, Any]]],
        location_dimensions: Mapping[str, str],
        case: Case,
        comment: str,
        conventions: str = "CF-1.11",
        mesh: str = "",
    ) -> None:
        self.dimensions, self.coordinates = dimensions, coordinates
        self.location_dimensions, self.mesh = location_dimensions, mesh
        self.attributes = provenance(case.title, f"{case.model} model", comment, conventions) | {
            "model": case.model,
            "case_toml": case.to_toml(),
            "case_sha256": case.sha256,
        }

    def field_dimensions(self, name: str) -> tuple[str, ...]:
        """Dimensions of a field."""
        location = FIELDS[name].location
        if location == "step":
            return ("step",)
        return ("time",) if location == "global" else ("time", self.location_dimensions[location])

    def field_attributes(self, name: str) -> dict[str, str]:
        """Attributes of a field."""
        attributes = FIELDS[name].attributes
        dimension = self.location_dimensions.get(FIELDS[name].location)
        if dimension is not None:
            attributes["location"] = dimension
            if self.mesh:
                attributes |= {"mesh": self.mesh}
        return attributes

    def define(self, file: netCDF4.Dataset) -> None:
        """Write attributes, dimensions and coordinates to a new file."""
        file.setncatts(self.attributes | {"run_status": "running"})
        for name, size in (*self.dimensions.items(), ("time", None), ("step", None)):
            file.createDimension(name, size)
        for name, (dimensions, values, attributes) in self.coordinates.items():
            fill = attributes.get("_FillValue")
            variable: Any = file.createVariable(name, np.asarray(values).dtype, dimensions, fill_value=fill)
            variable.setncatts({key: value for key, value in attributes.items() if key != "_FillValue"})
            variable[...] = values
        file.createVariable("time", "f8", ("time",)).setncatts(_TIME_ATTRIBUTES)


class ResultFile(PartFile):
    """A result file that grows with the run.

    Raises
    ------
    OutputError
        If the file is there already and may not be replaced, or cannot be written.
    """

    def __init__(self, path: Path, layout: Layout, replace: bool = False) -> None:
        refuse_existing([path], replace)
        super().__init__(path, layout.define)
        self.layout = layout

    def append(self, time: float, record: Record) -> None:
        """Add a record at the end of the time axis."""
        with self.writing() as file:
            index = len(file.dimensions["time"])
            file["time"][index] = time
            for name, value in record.items():
                self._variable(file, name)[index] = value

    def append_steps(self, history: Mapping[str, Sequence[float]]) -> None:
        """Add the solver's history of some steps."""
        with self.writing() as file:
            start = len(file.dimensions["step"])
            for name, values in history.items():
                self._variable(file, name)[start : start + len(values)] = values

    def close(self, status: str) -> None:
        """Finish the file and give it its name."""
        with self.writing() as file:
            file.run_status = status
        self.finish()

    def _variable(self, file: netCDF4.Dataset, name: str) -> netCDF4.Variable:
        if name not in file.variables:
            variable: netCDF4.Variable[Array] = file.createVariable(name, "f8", self.layout.field_dimensions(name))
            variable.setncatts(self.layout.field_attributes(name))
        return file[name]


def in_memory(
    layout: Layout,
    times: Sequence[float],
    records: Sequence[Record],
    history: Mapping[str, Sequence[float]],
    status: str,
) -> xr.Dataset:
    """The result as a dataset, without a file; what `read_result` would give."""
    dataset = xr.Dataset(attrs=layout.attributes | {"run_status": status})
    for name, (dimensions, values, attributes) in layout.coordinates.items():
        dataset[name] = (dimensions, values, dict(attributes))
    dataset["time"] = ("time", np.array(times), _TIME_ATTRIBUTES)
    for name in records[0]:
        series = np.array([record[name] for record in records])
        dataset[name] = (layout.field_dimensions(name), series, layout.field_attributes(name))
    for name, steps in history.items():
        dataset[name] = (layout.field_dimensions(name), np.array(steps), layout.field_attributes(name))
    return dataset.set_coords([name for name in layout.coordinates if name in dataset])


def refuse_existing(paths: Sequence[Path], replace: bool) -> None:
    """Raise OutputError if any of the files is there and may not be replaced."""
    there = [path for path in paths if path.exists()]
    if there and not replace:
        raise OutputError("\n".join(f"{path}: is there already; use --force to replace it" for path in there))


def read_result(path: str | Path) -> xr.Dataset:
    """Open a result file, whole in memory.

    Raises
    ------
    OutputError
        If there is no such file, or it is not a result of fvswell.
    """
    path = Path(path)
    if not path.exists():
        raise OutputError(f"{path}: no such file")
    try:
        with xr.open_dataset(path, decode_times=False) as file:
            dataset = file.load()
    except (OSError, ValueError):
        raise OutputError(f"{path}: is not a netCDF file") from None
    if "case_toml" not in dataset.attrs:
        raise OutputError(f"{path}: is not a result of fvswell (it holds no case)")
    return dataset.set_coords(
        [name for name, variable in dataset.variables.items() if not {"time", "step"} & set(variable.dims)]
    )


def read_case(path: str | Path) -> Case:
    """The case that a result file was computed from."""
    return Case.from_toml(read_result(path).attrs["case_toml"], source=str(path))
