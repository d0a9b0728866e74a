"""The result of a study: one netCDF file with a ``run`` dimension, put together from the finished batches."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fvswell.errors import OutputError
from fvswell.physics.tissue import Array
from fvswell.results.file import COMPLETE, read_dataset
from fvswell.results.part_file import PartFile
from fvswell.results.provenance import provenance
from fvswell.study.batches import Batch, BatchResult
from fvswell.study.fields import COORDINATES, STRAIN_CURVES, STUDY_FIELDS
from fvswell.study.schema import Parameter, varied_quantity
from fvswell.study.study import Study
from fvswell.units import DIMENSIONS

if TYPE_CHECKING:
    import netCDF4
    import xarray as xr

__all__ = ["read_study", "write_study"]

_COMMENT = (
    "Each run is a parameter set of a design in a protocol, simulated with both models; the parameters are "
    "coordinates along run. Values that could not be computed are nan, and run_status says why. Strains are relative "
    "to the height of the sample equilibrated in the first bath without a load."
)


def write_study(
    path: Path, study: Study, batches: Iterable[Batch], results: Iterable[tuple[int, BatchResult]]
) -> tuple[int, int]:
    """Write the result of a study, holding one batch in memory at a time.

    Parameters
    ----------
    path
        The file; it gets its name when it is whole.
    study
        What was studied.
    batches
        All batches.
    results
        Index and result of every batch.

    Returns
    -------
    tuple of int
        How many runs are complete, and how many there are.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    runs_of = {batch.index: np.array(batch.runs) for batch in batches}
    status = np.array([""] * len(study.runs), dtype=object)
    for run, reason in study.impossible.items():
        status[run] = f"not run: {reason}"
    try:
        with PartFile(path, lambda new: _define(new, study)) as part:
            for index, result in results:
                status[runs_of[index]] = result.pop("run_status")
                with part.writing() as file:
                    for name, values in result.items():
                        file[name][runs_of[index]] = values
            with part.writing() as file:
                file["run_status"][:] = status
            part.finish()
    except OutputError as error:
        raise OutputError(f"{error}; the finished batches are kept, and the same command puts them together") from None
    return int(np.sum(status == COMPLETE)), len(status)


def read_study(path: str | Path) -> xr.Dataset:
    """Open the result of a study, whole in memory.

    Raises
    ------
    OutputError
        If there is no such file, it cannot be read, or it is not the result of a study.
    """
    dataset = read_dataset(path)
    if "study_toml" not in dataset.attrs:
        raise OutputError(f"{path}: is not the result of a study")
    return dataset


def _define(file: netCDF4.Dataset, study: Study) -> None:
    """Dimensions, attributes, coordinates, and empty variables."""
    models = f"{study.table.model} model judged by the {study.table.reference_model} model"
    samples = study.cases[0].time.samples_per_phase
    file.setncatts(
        provenance(study.table.title, models, _COMMENT) | {"study_toml": study.to_toml(), "study_sha256": study.sha256}
    )
    sizes = {"run": len(study.runs), "phase": len(study.phases), "model": 2, "sample": samples}
    if not study.table.strain_curves:
        del sizes["sample"]
    for name, size in sizes.items():
        file.createDimension(name, size)
    names = [parameter.name for parameter in study.table.parameter]
    along_run = " ".join(["protocol", "design", "run_status", *names])
    for name, values in _labels(study).items():
        variable = file.createVariable(name, str, COORDINATES[name].dimensions)
        variable.setncatts(COORDINATES[name].attributes)
        if values is not None:
            variable[:] = np.array(values, dtype=object)
    for parameter, values in zip(study.table.parameter, study.parameter_values().T, strict=True):
        _number_variable(file, parameter.name, ("run",), _parameter_attributes(parameter))[:] = values
    if study.table.strain_curves:
        _number_variable(file, "fraction", ("sample",), COORDINATES["fraction"].attributes)[:] = (
            np.arange(1, samples + 1) / samples
        )
    for name, field in STUDY_FIELDS.items():
        if name != STRAIN_CURVES or study.table.strain_curves:
            also = " fraction" if name == STRAIN_CURVES else ""
            _number_variable(file, name, field.dimensions, field.attributes | {"coordinates": along_run + also})


def _labels(study: Study) -> dict[str, list[str] | None]:
    """Texts along run, phase and model; None for what is known in the end only."""
    table, runs = study.table, study.runs
    return {
        "protocol": [table.protocol[p].name for p in runs.protocol],
        "design": [table.design[d].name for d in runs.design],
        "run_status": None,
        "phase": list(study.phases),
        "model": list(study.models),
    }


def _number_variable(
    file: netCDF4.Dataset, name: str, dimensions: tuple[str, ...], attributes: Mapping[str, Any]
) -> netCDF4.Variable:
    variable: netCDF4.Variable[Array] = file.createVariable(name, "f8", dimensions, fill_value=np.nan)
    variable.setncatts(attributes)
    return variable


def _parameter_attributes(parameter: Parameter) -> dict[str, str]:
    unit = DIMENSIONS[varied_quantity(parameter.key[0]).dimension].unit
    return {
        "units": _UDUNITS.get(unit, unit), "long_name": f"parameter {parameter.name}", "location": "run",
        "cell_methods": "run: point", "case_keys": " ".join(parameter.key),
    }  # fmt: skip


_UDUNITS = {
    "": "1", "MPa": "N mm-2", "mm^4/(N s)": "mm4 N-1 s-1", "mmol/mm^3": "mmol mm-3", "mm^2/s": "mm2 s-1",
    "mm^3/mmol": "mm3 mmol-1",
}  # fmt: skip
