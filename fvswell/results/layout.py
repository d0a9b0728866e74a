"""What a result looks like, before there is any record of it: dimensions, coordinates and attributes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fvswell.case.case import Case
from fvswell.physics.tissue import Array
from fvswell.results.fields import field
from fvswell.results.provenance import provenance

if TYPE_CHECKING:
    import netCDF4

__all__ = ["COMPLETE", "SAME_TIME", "TIME_ATTRIBUTES", "Content", "Fields", "Layout"]

TIME_ATTRIBUTES = {"units": "s", "long_name": "time since the load first changed", "axis": "T"}

COMPLETE = "complete"  # run_status of a result that is all there
SAME_TIME = 1e-9  # relative: times of results that are closer are one
Fields = dict[str, Array]


class Content(NamedTuple):
    """What a run has recorded."""

    times: Array  # (outputs,) s
    fields: Fields  # by name; the first axis is that of the outputs
    history: Fields  # by name, (steps,)


class Layout:
    """Dimensions, coordinates and attributes of a result.

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
        per_area: bool = False,
    ) -> None:
        self.dimensions, self.coordinates = dimensions, coordinates
        self.location_dimensions, self.mesh, self.per_area = location_dimensions, mesh, per_area
        self.attributes: dict[str, Any] = provenance(case.title, f"{case.model} model", comment, conventions) | {
            "model": case.model,
            "case_toml": case.to_toml(),
            "case_sha256": case.sha256,
        }
        if case.load_files:
            self.attributes["load_folder"] = str(case.folder.resolve())

    def field_dimensions(self, name: str) -> tuple[str, ...]:
        """Dimensions of a field."""
        location = field(name, self.per_area).location
        if location == "step":
            return ("step",)
        return ("time",) if location == "global" else ("time", self.location_dimensions[location])

    def field_attributes(self, name: str) -> dict[str, str]:
        """Attributes of a field."""
        attributes = field(name, self.per_area).attributes
        dimension = self.location_dimensions.get(field(name, self.per_area).location)
        if dimension is not None:
            attributes["location"] = dimension
            if self.mesh:
                attributes |= {"mesh": self.mesh}
        return attributes

    def define(self, file: netCDF4.Dataset) -> None:
        """Write attributes, dimensions and coordinates to a new file."""
        file.setncatts(self.attributes)
        for name, size in (*self.dimensions.items(), ("time", None), ("step", None)):
            file.createDimension(name, size)
        for name, (dimensions, values, attributes) in self.coordinates.items():
            fill = attributes.get("_FillValue")
            variable: Any = file.createVariable(name, np.asarray(values).dtype, dimensions, fill_value=fill)
            variable.setncatts({key: value for key, value in attributes.items() if key != "_FillValue"})
            variable[...] = values

    def fill(self, file: netCDF4.Dataset, content: Content) -> None:
        """Write what a run has recorded to a file that is defined."""
        time: Any = file.createVariable("time", "f8", ("time",))
        time.setncatts(TIME_ATTRIBUTES)
        time[:] = content.times
        for name, values in (*content.fields.items(), *content.history.items()):
            variable: Any = file.createVariable(name, "f8", self.field_dimensions(name))
            variable.setncatts(self.field_attributes(name))
            variable[:] = values
