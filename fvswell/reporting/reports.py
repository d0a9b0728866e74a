"""What the commands say of cases and results, in lines and tables of text."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np

from fvswell.analysis.cycles import Cycles
from fvswell.boundary.parts import Part
from fvswell.case.case import Case
from fvswell.case.geometry import BlockGeometry, Geometry
from fvswell.case.loads import Ramp, Shape, Sine, StrainLoad, TableLoad
from fvswell.case.phases import PartLoads
from fvswell.case.profiles import DepthProfile, PlaneProfile
from fvswell.case.reading import value_type
from fvswell.case.values import Rate, RelaxationTimes
from fvswell.reporting.console import TextTable, percent
from fvswell.results.fields import is_field
from fvswell.results.layout import COMPLETE, SAME_TIME
from fvswell.results.moved_grid import AXES, first_fold
from fvswell.units import DIMENSIONS

if TYPE_CHECKING:
    import xarray as xr
    from pydantic import BaseModel

    from fvswell.analysis.characteristics import Characteristics
    from fvswell.simulation.sample_states import SampleState

__all__ = [
    "case_lines",
    "characteristics_table",
    "content_table",
    "cycle_lines",
    "duration_line",
    "effort_lines",
    "phase_table",
    "quantity_text",
    "result_lines",
    "states_table",
    "words",
]

Values = Mapping[Any, Any]  # a result: a dataset, or arrays by name

_HANDY_UNITS = {"mmol/mm^3": (1e3, "M")}  # that people read more easily than the internal ones
_TISSUE_IN_SHORT = (
    "youngs_modulus",
    "poisson_ratio",
    "shear_modulus",
    "hydraulic_permeability",
    "permeability_coefficient",
    "fluid_fraction",
    "fixed_charge_density",
    "hindrance_factor",
)


def case_lines(case: Case, models: str | None = None) -> list[str]:
    """A case in short, with its own model or the names of those that are run."""
    tissue = ", ".join(
        f"{words(key)} {_value(case.tissue, key)}" for key in _TISSUE_IN_SHORT if getattr(case.tissue, key) is not None
    )
    return [
        case.title,
        f"  model     {models or case.model}",
        f"  geometry  {_table(case.geometry)}",
        f"  boundary  {'; '.join(map(_part_text, case.parts))}",
        f"  tissue    {case.tissue.solid}, {tissue}",
        *(f"  fibres    {_table(family)}" for family in case.tissue.fibres),
        f"  ions      {case.tissue.osmotic} law; numbers of the {case.tissue.reference_state} sample",
        f"  bath      {_table(case.bath)}",
        *(f"  phase     {phase.name}: {_table(phase, without='name')}" for phase in case.phase),
        f"  time      {_table(case.time, without='relaxation_fraction')}",
    ]


def _part_text(part: Part) -> str:
    """A part of the boundary and its conditions."""
    place = "" if part.name == part.edge or not part.edge else f" ({part.edge}, {part.start:g} to {part.end:g} mm)"
    conditions = [part.mechanical.replace("-", " "), *(["open to the bath"] if part.open else [])]
    if part.electrical != ("grounded" if part.open else "insulating"):
        conditions.append(part.electrical)
    if part.electrode != "bath":
        conditions.append(f"{part.electrode} electrode")
    return f"{part.name}{place} {', '.join(conditions)}"


def duration_line(case: Case, phase_ends: Sequence[float]) -> str:
    """How long the phases last, once it is known."""
    durations = np.diff(phase_ends, prepend=0.0)
    found = [f"{phase.name} {seconds:.5g} s" for phase, seconds in zip(case.phase, durations, strict=True)]
    return f"  durations {', '.join(found)}"


def characteristics_table(case: Case, numbers: Characteristics) -> tuple[TextTable, list[str]]:
    """Derived numbers of a case: equilibria of the models, and what is the same for all."""
    low, high = numbers.open_circuit_ratio
    ratio = f"{low:.4f}" if high - low < 1e-9 else f"{low:.4f} to {high:.4f}"
    lines = [
        f"open-circuit permeability of the equilibrated sample: k_open/k = {ratio}",
        f"consolidation time h^2/(k H): {numbers.consolidation_time:.4g} s",
        f"diffusion time of the salt h^2/D: {numbers.diffusion_time:.4g} s",
        f"h: the farthest way to the bath in the equilibrated sample, {numbers.drainage_length:.4g} mm",
    ]
    phases = case.phase if any(each.strain for each in numbers.equilibria.values()) else ()
    header = ["model", "mean height", "volume", *(f"strain, {phase.name}" for phase in phases)]
    rows = [
        [model, *map(_ratio, (each.initial_stretch, each.initial_volume_ratio)), *map(percent, each.strain)]
        for model, each in numbers.equilibria.items()
    ]
    title = "In equilibrium with the first bath, without load, over the stress-free solid"
    return TextTable(title + ("; strains with the loads of each phase" if phases else ""), header, rows), lines


def states_table(states: Mapping[str, SampleState]) -> TextTable:
    """Height, water, charge and permeability of the stress-free and of the equilibrated sample."""
    rows = [
        [
            words(name).replace("stress free", "stress-free"),
            f"{state.height:.6g}",
            f"{state.fluid_fraction:.5f}",
            quantity_text(state.fixed_charge_density, "mmol/mm^3"),
            f"{state.hydraulic_permeability:.5g}",
        ]
        for name, state in states.items()
    ]
    header = ["", "height (mm)", "fluid fraction", "fixed charge density", "permeability (mm^4/(N s))"]
    return TextTable("The sample without stress, and in equilibrium with the first bath", header, rows)


def _ratio(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.6f}"


def phase_table(result: Values, case: Case) -> TextTable:
    """Strain at the end of each phase, of a stopped run as far as it came.

    Beside it of columns the strain in equilibrium, of blocks the displacement of the probe.
    """
    strain, ends = np.asarray(result["global_strain"]), np.asarray(result["phase_end"])
    place, header, cells = _beside_the_strain(case.geometry, result)
    rows = []
    for index, (phase, end) in enumerate(zip(case.phase, ends, strict=True)):
        last, stopped = _last_output(result, index)
        reached = "-" if last is None else percent(strain[last]) + stopped
        rows.append([phase.name, f"{end:.5g}", reached, *cells(index, last)])
    title = f"Global strain{place}, {case.model}"
    return TextTable(title, ["phase", "end (s)", "strain at the end", *header], rows)


_Cells = Callable[[int, int | None], list[str]]  # from the index of a phase and that of its last output


@singledispatch
def _beside_the_strain(geometry: Geometry, result: Values) -> tuple[str, list[str], _Cells]:
    """What a title adds, and header and cells of further columns."""
    equilibrium = np.asarray(result["equilibrium_strain"])
    return "", ["in equilibrium"], lambda phase, _: [percent(equilibrium[phase])]


@_beside_the_strain.register(BlockGeometry)
def _(geometry: BlockGeometry, result: Values) -> tuple[str, list[str], _Cells]:
    x, y = np.asarray(result["probe"])
    moved = [np.asarray(result[f"probe_displacement_{axis}"]) for axis in AXES]

    def cells(_: int, last: int | None) -> list[str]:
        return ["-" if last is None else f"{round(float(values[last]), 12) + 0.0:+.5g}" for values in moved]

    place = f" and displacement of the probe at x = {x:.4g} mm, y = {y:.4g} mm"
    return place, ["probe x (mm)", "probe y (mm)"], cells


def _last_output(result: Values, phase: int) -> tuple[int | None, str]:
    """Index of the last output in a phase, None if the phase did not begin, and where the run stopped in it."""
    time, ends = np.asarray(result["time"]), np.asarray(result["phase_end"])
    within = np.flatnonzero((time <= ends[phase] * (1.0 + SAME_TIME)) & (time > 0.0))
    last = int(within[-1]) if within.size else 0
    if phase > 0 and time[last] <= ends[phase - 1] * (1.0 + SAME_TIME):
        return None, ""
    return last, f" at {time[last]:.5g} s" if time[last] < ends[phase] * (1.0 - SAME_TIME) else ""


def effort_lines(result: Values) -> list[str]:
    """Steps, iterations and conservation errors of a run, and a fold of the grid of a block."""
    iterations = np.asarray(result["step_iterations"])
    errors = [
        f"{name.removesuffix('_balance_error')} {float(np.max(result[name])):.1e}"
        for name in map(str, result)
        if name.endswith("_balance_error")
    ]
    lines = [
        f"{len(iterations)} steps, {int(iterations.sum())} Newton iterations",
        f"largest balance errors, of what crossed the boundary: {', '.join(errors)}",
    ]
    fold = first_fold(result)
    if fold is not None:
        lines.append(
            f"the cell at x = {fold.x:.3g} mm, y = {fold.y:.3g} mm is folded over from t = {fold.time:.5g} s on: what "
            "comes of it there is not to be trusted"
        )
    return lines


def cycle_lines(found: Sequence[Cycles]) -> list[str]:
    """What the last cycle of each cyclic phase says."""
    return [
        f"cycles of {each.phase}: {each.pressure:.4g} MPa on the {each.part} against a strain of "
        f"{percent(each.strain)}, dynamic modulus {each.dynamic_modulus:.4g} MPa, the strain lags by "
        f"{each.lag:.1f} degrees, a cycle dissipates {1e3 * each.loss:.4g} kJ/m^3"
        for each in found
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
        if is_field(str(name))
    ]
    return TextTable("Fields", ["name", "dimensions", "units", "meaning"], rows)


def _dimensions(variable: Any) -> str:
    return ", ".join(map(str, variable.dims))


def _table(table: BaseModel, without: str = "") -> str:
    """All keys of a table that are given, on a line."""
    keys = [key for key in (*type(table).model_fields, *(table.__pydantic_extra__ or {}))
            if key != without and getattr(table, key) is not None]  # fmt: skip
    parts = []
    for key in keys:
        value = getattr(table, key)
        if isinstance(value, PartLoads):
            parts.append(f"{key} {_table(value)}")
        else:
            parts.append(_value(table, key) if key in ("kind", "scheme") else f"{words(key)} {_value(table, key)}")
    return ", ".join(parts)


def words(key: str) -> str:
    """A key as people read it."""
    return key.replace("_", " ")


def _value(table: BaseModel, key: str) -> str:
    """The value of a key as people write it."""
    value = getattr(table, key)
    reader = value_type(type(table).model_fields[key])
    unit = reader.unit if reader is not None else ""
    if isinstance(value, DepthProfile):
        return f"{quantity_text(min(value.value), unit)} to {quantity_text(max(value.value), unit)} over the depth"
    if isinstance(value, PlaneProfile):
        values = [item for row in value.value for item in row]
        return f"{quantity_text(min(values), unit)} to {quantity_text(max(values), unit)} in the block"
    if isinstance(value, Rate):
        return f"it changes by less than {value.value:.3g} {DIMENSIONS[value.dimension].unit}"
    if isinstance(value, StrainLoad):
        return _load_text(value.of(100.0), "%")
    if isinstance(value, Ramp | TableLoad | Sine):
        return _load_text(value, unit)
    if isinstance(value, float) and not isinstance(value, RelaxationTimes):
        return quantity_text(value, unit)
    if isinstance(value, tuple) and not isinstance(value, RelaxationTimes):
        return " x ".join(quantity_text(item, unit) if isinstance(item, float) else str(item) for item in value) or "-"
    return str(value)


def _load_text(load: Shape, unit: str) -> str:
    """How a load goes, in words."""
    if isinstance(load, Ramp):
        return f"to {quantity_text(load.ramp_to, unit)} within {load.over:g} s"
    if isinstance(load, TableLoad):
        source = "" if load.source is None else f" of {load.source.file}"
        ends = f"{quantity_text(min(load.values), unit)} to {quantity_text(max(load.values), unit)}"
        return f"{len(load.times)} points{source}, {ends}, until {load.times[-1]:g} s"
    if isinstance(load, Sine):
        mean, amplitude = quantity_text(load.mean, unit), quantity_text(load.amplitude, unit)
        return f"{mean} +- {amplitude} with a period of {load.period:g} s"
    return quantity_text(load, unit)


def quantity_text(value: float, unit: str) -> str:
    """A value with its unit, in one that people read easily."""
    factor, handy = _HANDY_UNITS.get(unit, (1.0, unit))
    return f"{factor * value:.6g} {handy}".rstrip()
