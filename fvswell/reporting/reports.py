"""What the commands say of cases, results and comparisons, in lines and tables of text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fvswell.analysis.comparison import BlockDifference, ColumnDifference
from fvswell.block.sides import EDGES
from fvswell.case.block_schema import EdgeLoad
from fvswell.case.case import BlockCase, Case
from fvswell.case.profiles import DepthProfile, PlaneProfile
from fvswell.case.reading import value_type
from fvswell.case.values import Ramp, RelaxationTimes
from fvswell.prediction.predictor import NO_VARIATION
from fvswell.reporting.console import TextTable, percent
from fvswell.results.fields import FIELDS
from fvswell.results.file import COMPLETE, SAME_TIME
from fvswell.results.moved_grid import AXES, first_fold, is_block

if TYPE_CHECKING:
    import xarray as xr
    from pydantic import BaseModel

    from fvswell.analysis.characteristics import Characteristics
    from fvswell.analysis.comparison import Comparison
    from fvswell.analysis.fit import Fit

__all__ = [
    "case_lines",
    "characteristics_table",
    "comparison_remarks",
    "comparison_tables",
    "content_table",
    "duration_line",
    "effort_lines",
    "fit_report",
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


def case_lines(case: Case, models: str | None = None) -> list[str]:
    """A case in short, with its own model or the names of those that are run."""
    tissue = ", ".join(f"{_words(key)} {_value(case.tissue, key)}" for key in _TISSUE_IN_SHORT)
    return [
        case.title,
        f"  model     {models or case.model}",
        f"  geometry  {_table(case.geometry, without='edges')}",
        *_edge_lines(case),
        f"  tissue    {case.tissue.solid}, {tissue}",
        f"  bath      {_table(case.bath)}",
        *(f"  phase     {phase.name}: {_table(phase, without='name')}" for phase in case.phase),
        f"  time      {_table(case.time, without='relaxation_fraction')}",
    ]


def _edge_lines(case: Case) -> list[str]:
    if not isinstance(case, BlockCase):
        return []
    edges = [(name, getattr(case.geometry.edges, name)) for name in EDGES]
    told = [f"{name} {edge.displacement}{', open to the bath' if edge.permeable else ''}" for name, edge in edges]
    return [f"  edges     {'; '.join(told)}"]


def duration_line(case: Case, phase_ends: Sequence[float]) -> str:
    """How long the phases last, once it is known."""
    durations = np.diff(phase_ends, prepend=0.0)
    told = [f"{phase.name} {seconds:.5g} s" for phase, seconds in zip(case.phase, durations, strict=True)]
    return f"  durations {', '.join(told)}"


def characteristics_table(case: Case, numbers: Characteristics) -> tuple[TextTable, list[str]]:
    """Derived numbers of a case: states at rest of the models, and what is the same for all."""
    block = isinstance(case, BlockCase)
    rows = []
    for model, rest in numbers.rest.items():
        ratios = [rest.initial_stretch] + ([rest.initial_volume_ratio] if block else [])
        told = ["-" if np.isnan(ratio) else f"{ratio:.6f}" for ratio in ratios]
        rows.append([model, *told, *(percent(strain) for strain in rest.equilibrium_strain)])
    low, high = numbers.open_circuit_ratio
    ratio = f"{low:.4f}" if high - low < 1e-9 else f"{low:.4f} to {high:.4f}"
    lines = [
        f"open-circuit permeability of the equilibrated sample: k_open/k = {ratio}",
        f"consolidation time h^2/(k H): {numbers.consolidation_time:.4g} s",
        f"diffusion time of the salt h^2/D: {numbers.diffusion_time:.4g} s",
    ]
    if block:
        lines.append(f"h: the farthest way to the bath in the equilibrated sample, {numbers.drainage_length:.4g} mm")
        title = "States at rest in the first bath, without load, over the stress-free solid"
        return TextTable(title, ["model at rest", "mean height", "volume"], rows), lines
    header = ["model at rest", "J0", *(f"strain, {phase.name}" for phase in case.phase)]
    title = "States at rest (J0: height of the equilibrated sample over that of the stress-free solid)"
    return TextTable(title, header, rows), lines


def phase_table(result: xr.Dataset, case: Case) -> TextTable:
    """Strain at the end of each phase, of a stopped run as far as it came.

    Beside it of columns the strain at rest, of blocks the displacement of the probe.
    """
    block = is_block(result)
    strain, ends = result["global_strain"].values, result["phase_end"].values
    rows = []
    for index, (phase, end) in enumerate(zip(case.phase, ends, strict=True)):
        last, stopped = _last_output(result, index)
        row = [phase.name, f"{end:.5g}", "-" if last is None else percent(strain[last]) + stopped]
        if block:
            probe = [result[f"probe_displacement_{axis}"].values for axis in AXES]
            row += ["-" if last is None else f"{round(float(values[last]), 12) + 0.0:+.5g}" for values in probe]
        else:
            row.append(percent(result["equilibrium_strain"].values[index]))
        rows.append(row)
    title = f"Global strain, {result.attrs['model']}"
    header = ["phase", "end (s)", "strain at the end"]
    if not block:
        return TextTable(title, [*header, "strain at rest"], rows)
    x, y = result["probe"].values
    title = f"Global strain and displacement of the probe at x = {x:.4g} mm, y = {y:.4g} mm, {result.attrs['model']}"
    return TextTable(title, [*header, "probe x (mm)", "probe y (mm)"], rows)


def _last_output(result: xr.Dataset, phase: int) -> tuple[int | None, str]:
    """Index of the last output in a phase, None if the phase did not begin, and where the run stopped in it."""
    time, ends = result["time"].values, result["phase_end"].values
    within = np.flatnonzero((time <= ends[phase] * (1.0 + SAME_TIME)) & (time > 0.0))
    last = int(within[-1]) if within.size else 0
    if phase > 0 and time[last] <= ends[phase - 1] * (1.0 + SAME_TIME):
        return None, ""
    return last, f" at {time[last]:.5g} s" if time[last] < ends[phase] * (1.0 - SAME_TIME) else ""


def effort_lines(result: xr.Dataset) -> list[str]:
    """Steps, iterations and conservation errors of a run, and a fold of the grid of a block."""
    iterations = int(result["step_iterations"].sum())
    errors = [
        f"{name.removesuffix('_balance_error')} {float(result[name].max()):.1e}"
        for name in map(str, result.data_vars)
        if name.endswith("_balance_error")
    ]
    lines = [
        f"{result.sizes['step']} steps, {iterations} Newton iterations",
        f"largest balance errors, of what crossed the boundary: {', '.join(errors)}",
    ]
    fold = first_fold(result) if is_block(result) else None
    if fold is not None:
        lines.append(
            f"the cell at x = {fold.x:.3g} mm, y = {fold.y:.3g} mm is folded over from t = {fold.time:.5g} s on: what "
            "comes of it there is not to be trusted"
        )
    return lines


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
    """Differences of the models in each phase, and where they come to rest, or are at the last output."""
    return [_comparison_table(comparison, phase) for phase in comparison.phases]


def comparison_remarks(comparison: Comparison) -> list[str]:
    """What keeps models from being compared: phases with too few outputs, a probe that is held."""
    remarks = []
    if comparison.left_out:
        names = ", ".join(comparison.left_out)
        remarks.append(f"too few outputs to compare models in {names}: give more output times, or output.every")
    base = comparison.results[comparison.reference]
    probes = {each.quantity for each in comparison.differences if each.quantity.startswith("probe_")}
    if any(np.ptp(base[quantity].values) <= NO_VARIATION for quantity in probes):
        remarks.append("the probe does not move: give another place for it, geometry.probe")
    return remarks


def _comparison_table(comparison: Comparison, phase: str) -> TextTable:
    differences = comparison.of_phase(phase)
    quantity = differences[0].quantity
    header = ["model", "R^2", "largest", "after (s)", "local", "of local"]
    rows, rest = [], ""
    for difference in differences:
        row = [
            difference.model,
            "-" if np.isnan(difference.r_squared) else f"{difference.r_squared:.5f}",
            _amount(difference.largest, quantity),
            f"{difference.time_in_phase:.4g}",
            percent(difference.local_strain),
            "-" if np.isnan(difference.local_strain_ratio) else f"{100.0 * difference.local_strain_ratio:.2f} %",
        ]
        if isinstance(difference, BlockDifference):
            places = ["at x, y (mm)", "last"]
            row += [f"{difference.x:.3g}, {difference.y:.3g}", _amount(difference.final, quantity)]
            rest = _amount(difference.reference_final, quantity)
        elif isinstance(difference, ColumnDifference):
            places = ["depth (mm)", "at rest"]
            row += [f"{difference.depth:.3g}", percent(difference.equilibrium_strain)]
            rest = percent(difference.reference_equilibrium_strain)
        rows.append(row)
    rows.append([f"{comparison.reference} (reference)", *["" for _ in header], rest])
    title = f"Phase {phase}: difference of the {_words(quantity)} at {differences[0].times} times"
    return TextTable(title, header + places, rows)


def fit_report(fit: Fit) -> tuple[list[str], TextTable]:
    """The best value with what it is to be judged by, and a table of how well the model follows."""
    from fvswell.analysis.fit import PAPER_REDUCTION

    problem, before, best = fit.problem, fit.before, fit.best
    reader = value_type(type(problem.case.tissue).model_fields[problem.parameter])
    unit = reader.unit if reader is not None else ""
    lines = [
        f"best {_words(problem.parameter)}: {_quantity(best.value, unit)}, {fit.ratio:.4f} of the case's "
        f"{_quantity(problem.present, unit)} ({percent(fit.ratio - 1.0)})",
    ]
    if fit.at_limit:
        lines.append("this is an end of where was looked: a better value may lie beyond")
    if problem.parameter == "hydraulic_permeability" and isinstance(problem.case, BlockCase):
        lines.append(
            f"for comparison: Wilson et al. (2005) found {-100.0 * PAPER_REDUCTION:.2f} % in their block; what they "
            "fitted and for how long cannot be read in full, so the same number is not to be expected"
        )
    lines.append(f"{len(fit.trials)} runs of the fitted model, 1 of {problem.reference}, {fit.seconds:.0f} s")
    rows = [
        [phase, _words(quantity), f"{old:.6f}", f"{new:.6f}"]
        for phase, quantity, old, new in zip(
            problem.phases, fit.quantities, before.r_squared, best.r_squared, strict=True
        )
    ]
    title = f"R^2 of the fitted model to {problem.reference}"
    return lines, TextTable(title, ["phase", "history", "with the case's value", "with the best"], rows)


def _amount(value: float, quantity: str) -> str:
    units = FIELDS[quantity].units
    return percent(value) if units == "1" else f"{value:+.4g} {'MPa' if units == 'N mm-2' else units}"


def _dimensions(variable: Any) -> str:
    return ", ".join(map(str, variable.dims))


def _table(table: BaseModel, without: str = "") -> str:
    """All keys of a table that are given, on a line."""
    keys = [key for key in type(table).model_fields if key != without and getattr(table, key) is not None]
    told = []
    for key in keys:
        value = getattr(table, key)
        if isinstance(value, EdgeLoad):
            told.append(f"{key} {_table(value)}")
        else:
            told.append(_value(table, key) if key in ("kind", "scheme") else f"{_words(key)} {_value(table, key)}")
    return ", ".join(told)


def _words(key: str) -> str:
    return key.replace("_", " ")


def _value(table: BaseModel, key: str) -> str:
    """The value of a key as people write it."""
    value = getattr(table, key)
    reader = value_type(type(table).model_fields[key])
    unit = reader.unit if reader is not None else ""
    if isinstance(value, DepthProfile):
        return f"{_quantity(min(value.value), unit)} to {_quantity(max(value.value), unit)} over the depth"
    if isinstance(value, PlaneProfile):
        values = [item for row in value.value for item in row]
        return f"{_quantity(min(values), unit)} to {_quantity(max(values), unit)} in the block"
    if isinstance(value, Ramp):
        return f"to {_quantity(value.ramp_to, unit)} within {value.over:g} s"
    if isinstance(value, float) and not isinstance(value, RelaxationTimes):
        return _quantity(value, unit)
    if isinstance(value, tuple) and not isinstance(value, RelaxationTimes):
        return " x ".join(_quantity(item, unit) if isinstance(item, float) else str(item) for item in value) or "-"
    return str(value)


def _quantity(value: float, unit: str) -> str:
    factor, handy = _HANDY_UNITS.get(unit, (1.0, unit))
    return f"{factor * value:.6g} {handy}".rstrip()
