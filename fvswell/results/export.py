"""Results in formats of other programs: a time series of blocks for ParaView."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np
import xarray as xr

from fvswell.errors import OutputError
from fvswell.physics.tissue import Array
from fvswell.results.fields import field, is_field
from fvswell.results.file import read_result, refuse_existing
from fvswell.results.moved_grid import AXES, is_block, moved_nodes, quadrilaterals

if TYPE_CHECKING:
    import pyvista

__all__ = ["FORMATS", "block_mesh", "export_result"]

FORMATS = ("vtu",)


def export_result(path: Path, kind: str = "vtu", directory: Path | None = None, replace: bool = False) -> Path:
    """Write the result of a block as ``NAME.pvd``, which names a ``NAME_INDEX.vtu`` for each output.

    Parameters
    ----------
    path
        Of the result.
    kind
        Of `FORMATS`.
    directory
        To write to; the result's own without it.
    replace
        Whether files may be replaced.

    Returns
    -------
    pathlib.Path
        The file to open.

    Raises
    ------
    OutputError
        If the format is unknown, pyvista is missing, the result is of a column, or a file exists already or cannot
        be written.
    """
    if kind not in FORMATS:
        raise OutputError(f'format "{kind}": must be {" or ".join(FORMATS)}')
    result = read_result(path)
    if not is_block(result):
        raise OutputError(
            f"{path}: is of a column, which has no grid to show in ParaView; its netCDF opens in any program that "
            "reads CF, and fvswell plot draws it"
        )
    directory = directory or path.parent
    times = result["time"].values
    series = directory / f"{path.stem}.pvd"
    digits = len(str(len(times) - 1))
    files = [directory / f"{path.stem}_{index:0{digits}d}.vtu" for index in range(len(times))]
    refuse_existing([series, *files], replace)
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for index, file in enumerate(files):
            block_mesh(result, index).save(file)
        _write_series(series, files, times)
    except OSError as error:
        raise OutputError(f"{directory}: cannot be written: {error.strerror or error}") from None
    return series


def block_mesh(result: xr.Dataset, index: int) -> pyvista.UnstructuredGrid:
    """The moved grid at an output, with fields in cells and at points; quantities of the whole block are field data.

    Components go together as vectors with three components, of which the last is 0.

    Raises
    ------
    OutputError
        If pyvista is missing.
    """
    try:
        import pyvista
    except ImportError:
        raise OutputError('needs pyvista: pip install "fvswell[viz]"') from None
    cells, at = quadrilaterals(result), float(result["time"][index])
    points = np.zeros((result.sizes["node"], 3))
    points[:, :2] = moved_nodes(result, at).T
    connectivity = np.column_stack([np.full(len(cells), 4), cells]).ravel()
    mesh = pyvista.UnstructuredGrid(connectivity, np.full(len(cells), pyvista.CellType.QUAD), points)
    data: dict[str, Any] = {"cell": mesh.cell_data, "node": mesh.point_data, "global": mesh.field_data}
    for name, values in _fields(result, index).items():
        component = name if name in result else f"{name}_x"  # of a vector
        data[field(component).location][name] = values
    mesh.field_data["TimeValue"] = np.array([at])
    return mesh


def _fields(result: xr.Dataset, index: int) -> dict[str, Array]:
    """Fields at an output by name, vectors without the name of their component."""
    fields: dict[str, Array] = {}
    for key in result.data_vars:
        name = str(key)
        if not is_field(name) or "time" not in result[name].dims:
            continue
        values = np.atleast_1d(result[name].values[index])
        stem, _, axis = name.rpartition("_")
        if axis in AXES and all(f"{stem}_{each}" in result for each in AXES):
            vector = fields.setdefault(stem, np.zeros((len(values), 3)))
            vector[:, AXES.index(axis)] = values
        else:
            fields[name] = values
    return fields


def _write_series(path: Path, files: list[Path], times: Array) -> None:
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    collection = ElementTree.SubElement(root, "Collection")
    for file, at in zip(files, times, strict=True):
        ElementTree.SubElement(collection, "DataSet", timestep=repr(float(at)), part="0", file=file.name)
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
