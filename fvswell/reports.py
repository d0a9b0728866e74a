"""What the commands say of cases, results and comparisons, in lines and tables of text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fvswell.case import Case
from fvswell.case_reading import value_type
from fvswell.case_values import DepthProfile, Ramp, RelaxationTimes
from fvswell.console import TextTable, percent
from fvswell.fields import FIELDS
from fvswell.results import COMPLETE

if TYPE_CHECKING:
    import xarray as xr
    from pydantic import BaseModel

    from fvswell.characteristics import Characteristics
    from fvswell.comparison import Comparison

__all__ = [
    "case_lines",
    "characteristics_table",
    "comparison_tables",
    "content_table",
    "duration_line",
    "effort_lines",
    "phase_table",
    "result_lines",
]

_HANDY_UNITS = {"mmol/mm^3": (1e3, "M")}  # that people read more easily than the internal ones
_TISSUE_IN_SHORT = (
    "youngs_modulus",
    "poisson_ratio",
    "hydraulic_permeability",
    "fluid_fraction",
    "fixed_charge_density",
    "hindrance_factor",
)
_SAME_TIME = 1e-9  # relative


def case_lines(case: Case, models: str | None = None) -> list[str]:
    """A case in short, with its own model or the names of those that are run."""
    tissue = ", ".join(f"{_words(key)} {_value(case.tissue, key)}" for key in _TISSUE_IN_SHORT)
    return [
        case.title,
        f"  model     {models or case.model}",
        f"  geometry  {_table(case.geometry)}",
        f"  tissue    {case.tissue.solid}, {tissue}",
        f"  bath      {_table(case.bath)}",
        *(f"  phase     {phase.name}: {_table(phase, without='name')}" for phase in case.phase),
        f"  time      {_table(case.time, without='relaxation_fraction')}",
    ]


def duration_line(case: Case, phase_ends: Sequence[float]) -> str:
    """How long the phases last, once it is known."""
    durations = np.diff(phase_ends, prepend=0.0)
    told = [f"{phase.name} {seconds:.5g} s" for phase, seconds in zip(case.phase, durations, strict=True)]
    return f"  durations {', '.join(told)}"


def characteristics_table(case: Case, numbers: Characteristics) -> tuple[TextTable, list[str]]:
    """Derived numbers of a case: states at rest of the models, and what is the same for all."""
    rows = [
        [model, "-" if np.isnan(rest.initial_stretch) else f"{rest.initial_stretch:.6f}"]
        + [percent(strain) for strain in rest.equilibrium_strain]
        for model, rest in numbers.rest.items()
    ]
    header = ["model at rest", "J0", *(f"strain, {phase.name}" for phase in case.phase)]
    low, high = numbers.open_circuit_ratio
    ratio = f"{low:.4f}" if high - low < 1e-9 else f"{low:.4f} to {high:.4f}"
    lines = [
        f"open-circuit permeability of the equilibrated sample: k_open/k = {ratio}",
        f"consolidation time h^2/(k H): {numbers.consolidation_time:.4g} s",
        f"diffusion time of the salt h^2/D: {numbers.diffusion_time:.4g} s",
    ]
    title = "States at rest (J0: height of the equilibrated sample over that of the stress-free solid)"
    return TextTable(title, header, rows), lines


def phase_table(result: xr.Dataset, case: Case) -> TextTable:
    """Strain at the end of each phase and at rest; of a stopped run as far as it came."""
    rows = []
    time, strain = result["time"].values, result["global_strain"].values
    ends = result["phase_end"].values
    for phase, end, rest in zip(case.phase, ends, result["equilibrium_strain"].values, strict=True):
        within = np.flatnonzero((time <= end * (1.0 + _SAME_TIME)) & (time > 0.0))
        last = within[-1] if within.size else 0
        began = end == ends[0] or time[last] > ends[np.searchsorted(ends, end) - 1] * (1.0 + _SAME_TIME)
        told = percent(strain[last]) if began else "-"
        if began and time[last] < end * (1.0 - _SAME_TIME):
            told += f" at {time[last]:.5g} s"
        rows.append([phase.name, f"{end:.5g}", told, percent(rest)])
    title = f"Global strain, {result.attrs['model']}"
    return TextTable(title, ["phase", "end (s)", "strain at the end", "strain at rest"], rows)


def effort_lines(result: xr.Dataset) -> list[str]:
    """Steps, iterations and conservation errors of a run."""
    iterations = int(result["step_iterations"].sum())
    errors = [
        f"{name.removesuffix('_balance_error')} {float(result[name].max()):.1e}"
        for name in map(str, result.data_vars)
        if name.endswith("_balance_error")
    ]
    return [
        f"{result.sizes['step']} steps, {iterations} Newton iterations",
        f"largest balance errors, of what crossed the boundary: {', '.join(errors)}",
    ]


def result_lines(result: xr.Dataset) -> list[str]:
    """What a result is: where it comes from, its status, times and sizes."""
    attributes = result.attrs
    time = result["time"].values
    sizes = ", ".join(f"{size} {name}" for name, size in result.sizes.items() if name != "bound")
    status = attributes["run_status"]
    return [
        f"  status    {status}" + ("" if status == COMPLETE else " (partial result)"),
        f"  times     {len(time)} from {time[0]:.5g} to {time[-1]:.5g} s",
        f"  sizes     {sizes}",
        f"  source    {attributes['source']}",
        f"  history   {attributes['history']}",
        f"  packages  {attributes['package_versions']}",
        f"  case      sha256 {attributes['case_sha256']}",
    ]


def content_table(result: xr.Dataset) -> TextTable:
    """The fields in a result."""
    rows = [
        [str(name), _dimensions(variable), variable.attrs["units"], variable.attrs["long_name"]]
        for name, variable in result.variables.items()
        if name in FIELDS
    ]
    return TextTable("Fields", ["name", "dimensions", "units", "meaning"], rows)


def comparison_tables(comparison: Comparison) -> list[TextTable]:
    """Differences of the models in each phase, and where they come to rest."""
    tables = []
    for phase in comparison.phases:
        rows = [
            [
                difference.model,
                "-" if np.isnan(difference.r_squared) else f"{difference.r_squared:.5f}",
                _amount(difference.largest, difference.quantity),
                f"{difference.time_in_phase:.4g}",
                percent(difference.local_strain),
                f"{100.0 * difference.local_strain_ratio:.2f} %",
                f"{difference.depth:.3g}",
                percent(difference.equilibrium_strain),
            ]
            for difference in comparison.of_phase(phase)
        ]
        first = comparison.of_phase(phase)[0]
        rest = percent(first.reference_equilibrium_strain)
        rows.append([f"{comparison.reference} (reference)", *["" for _ in range(6)], rest])
        header = ["model", "R^2", "largest", "after (s)", "local", "of local", "depth (mm)", "at rest"]
        tables.append(TextTable(f"Phase {phase}: difference of the {_words(first.quantity)}", header, rows))
    return tables


def _amount(value: float, quantity: str) -> str:
    return percent(value) if FIELDS[quantity].units == "1" else f"{value:+.4g} MPa"


def _dimensions(variable: Any) -> str:
    return ", ".join(map(str, variable.dims))


def _table(table: BaseModel, without: str = "") -> str:
    """All keys of a table that are given, on a line."""
    keys = [key for key in type(table).model_fields if key != without and getattr(table, key) is not None]
    return ", ".join(
        _value(table, key) if key in ("kind", "scheme") else f"{_words(key)} {_value(table, key)}" for key in keys
    )


def _words(key: str) -> str:
    return key.replace("_", " ")


def _value(table: BaseModel, key: str) -> str:
    """The value of a key as people write it."""
    value = getattr(table, key)
    reader = value_type(type(table).model_fields[key])
    unit = reader.unit if reader is not None else ""
    if isinstance(value, DepthProfile):
        return f"{_quantity(min(value.value), unit)} to {_quantity(max(value.value), unit)} over the depth"
    if isinstance(value, Ramp):
        return f"to {_quantity(value.ramp_to, unit)} within {value.over:g} s"
    if isinstance(value, float) and not isinstance(value, RelaxationTimes):
        return _quantity(value, unit)
    return str(value)


def _quantity(value: float, unit: str) -> str:
    factor, handy = _HANDY_UNITS.get(unit, (1.0, unit))
    return f"{factor * value:.6g} {handy}".rstrip()
