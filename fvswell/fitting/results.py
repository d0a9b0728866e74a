"""What a fit leaves behind: a netCDF file with everything, JSON for people and programs, tables, and the best cases."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fvswell.errors import OutputError
from fvswell.fitting.fit import FitResult
from fvswell.fitting.measurement import history_unit
from fvswell.fitting.model_comparison import ModelFit
from fvswell.results.part_file import PartFile
from fvswell.results.provenance import provenance
from fvswell.results.table import write_table
from fvswell.version import __version__

if TYPE_CHECKING:
    import netCDF4

__all__ = ["FILES", "best_case_paths", "summary", "write_fit", "write_text"]

FILES = ("fit.nc", "fit.json", "parameters.csv", "curves.csv", "profiles.csv")
_COMMENT = (
    "Measured curves and those of the best parameters, one measurement after the other along point; profiles of the "
    "likelihood, one parameter after the other along profile_point. Values of parameters are in the internal units mm, "
    "N, s, mmol, K."
)


def best_case_paths(directory: Path, result: FitResult) -> dict[str, Path]:
    """Files of the best cases by measurement: one for each different case."""
    names = list(result.cases)
    same = len({case.sha256 for case in result.cases.values()}) == 1
    return {name: directory / ("best.toml" if same else f"best_{name.replace(' ', '_')}.toml") for name in names}


def write_fit(directory: Path, result: FitResult, models: tuple[ModelFit, ...] = ()) -> list[Path]:
    """Write all files of a fit; gives their paths.

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    paths = [directory / name for name in FILES]
    with PartFile(paths[0], lambda file: _define(file, result)) as part:
        with part.writing():
            pass
        part.finish()
    write_text(paths[1], json.dumps(summary(result, models), indent=2, ensure_ascii=False) + "\n")
    write_table(paths[2], _PARAMETER_HEADER, parameter_rows(result))
    write_table(paths[3], _CURVE_HEADER, _curve_rows(result))
    header = ["parameter", "value", "ratio", "quantile", *result.problem.parameters.names]
    write_table(paths[4], header, _profile_rows(result))
    cases = best_case_paths(directory, result)
    for name, path in cases.items():
        write_text(path, result.cases[name].to_toml())
    return [*paths, *dict.fromkeys(cases.values())]


def summary(result: FitResult, models: tuple[ModelFit, ...] = ()) -> dict[str, Any]:
    """Everything in short, as JSON holds it; null where there is no number."""
    best, problem = result.best, result.problem
    rows = [dict(zip(_PARAMETER_HEADER, row, strict=True)) for row in parameter_rows(result)]
    measurements = [
        {
            "name": measurement.name, "quantity": measurement.quantity, "unit": history_unit(measurement.units),
            "points": len(measurement), "noise": level, "noise_given": measurement.noise is not None,
            "weight": measurement.weight, "source": measurement.source, "runs": test.runs,
            "expected_runs": test.expected_runs, "probability_of_so_few_runs": test.probability,
            "autocorrelation": test.autocorrelation, "systematic_misfit": test.systematic,
            "systematic_misfit_over_size": test.relative, "time_of_systematic_misfit_s": test.time,
            "misfit_is_structured": test.structured,
        }
        for measurement, level, test in zip(problem.measurements, best.noise, result.residual_tests, strict=True)
    ]  # fmt: skip
    content = {
        "title": problem.title,
        "fvswell": __version__,
        "confidence": problem.settings.confidence,
        "interval": "profile likelihood, " + ("chi-squared" if problem.noise_is_known else "F"),
        "parameters": rows,
        "correlations": best.correlations.tolist(),
        "sum_of_squares": best.squares,
        "degrees_of_freedom": problem.degrees_of_freedom,
        "measurements": measurements,
        "identifiability_at_start": {
            "half_interval_alone": dict(zip(result.before.names, result.before.alone.tolist(), strict=True)),
            "half_interval_together": dict(zip(result.before.names, result.before.together.tolist(), strict=True)),
            "collinearity": result.before.collinearity,
        },
        "searches": [
            {"start": problem.parameters.values(each.start).tolist(), "end":
            problem.parameters.values(each.end).tolist(),
             "sum_of_squares": each.squares, "evaluations": each.evaluations, "converged": each.converged}
            for each in best.searches
        ],
        "runs": result.runs,
        "failed_runs": result.failed,
        "seconds": result.seconds,
        "models": [each.row for each in models],
    }  # fmt: skip
    finite: dict[str, Any] = _finite(content)
    return finite


_PARAMETER_HEADER = [
    "name", "unit", "value", "low", "high", "standard_error", "fixed", "start", "lower_bound", "upper_bound",
    "at_bound", "keys", "measurements",
]  # fmt: skip


_CURVE_HEADER = ["measurement", "quantity", "unit", "time_s", "data", "curve", "residual"]


def parameter_rows(result: FitResult) -> list[list[Any]]:
    """A row for each parameter, by the names of the header; of a fixed one with its value only."""
    parameters, best = result.problem.parameters, result.best
    # of a logarithm, the standard error is relative
    errors = best.standard_errors * np.where(parameters.is_log, best.values, 1.0)
    free = {name: (value, error, bound) for name, value, error, bound in zip(
        parameters.names, map(float, best.values), map(float, errors), best.at_bound, strict=True)}  # fmt: skip
    rows = []
    for each in parameters.every:
        value, error, bound = free.get(each.name, (each.start, math.nan, ""))
        low, high = result.intervals.get(each.name, (math.nan, math.nan))
        of = "all" if each.measurements is None else " ".join(each.measurements)
        rows.append([each.name, each.unit, value, low, high, error, each.fixed, each.start, each.low, each.high, bound,
                     " ".join(each.keys), of])  # fmt: skip
    return rows


def _curve_rows(result: FitResult) -> Iterator[list[Any]]:
    best = result.best
    for measurement, span in zip(result.problem.measurements, result.problem.spans, strict=True):
        curve = best.curves[span.points]
        unit = measurement.units
        for at, value, simulated in zip(measurement.times, measurement.values, curve, strict=True):
            yield [measurement.name, measurement.quantity, unit, at, value, simulated, value - simulated]


def _profile_rows(result: FitResult) -> Iterator[list[Any]]:
    for index, profile in enumerate(result.profiles):
        values = result.problem.parameters.values(profile.coordinates)
        for row, ratio in zip(values, profile.ratio, strict=True):
            yield [profile.name, row[index], ratio, profile.quantile, *row]


def _define(file: netCDF4.Dataset, result: FitResult) -> None:
    problem, best, samples = result.problem, result.best, result.samples
    file.setncatts(
        provenance(problem.title, "fit of measured curves", _COMMENT)
        | {"summary": json.dumps(summary(result), ensure_ascii=False)}
        | {f"case_toml_{name.replace(' ', '_')}": case.to_toml() for name, case in result.cases.items()}
    )
    sizes = {"point": len(problem.data), "parameter": len(best.values), "measurement": len(problem.measurements)}
    profile_rows = list(_profile_rows(result))
    sizes["profile_point"] = len(profile_rows)
    if samples is not None:
        sizes["sample"] = len(samples.values)
    for name, size in sizes.items():
        file.createDimension(name, size)
    texts: dict[str, tuple[tuple[str, ...], Any, str]] = {
        "parameter": (("parameter",), problem.parameters.names, "free parameters"),
        "measurement": (("measurement",), [each.name for each in problem.measurements], "measured curves"),
        "point_measurement": (("point",), [m.name for m in problem.measurements for _ in range(len(m))], "curve"),
        "profile_parameter": (("profile_point",), [row[0] for row in profile_rows], "parameter held in the profile"),
    }
    for name, (dimensions, content, meaning) in texts.items():
        variable = file.createVariable(name, str, dimensions)
        variable.long_name = meaning
        variable[:] = np.array(list(content), dtype=object)
    times = np.concatenate([measurement.times for measurement in problem.measurements])
    numbers: dict[str, tuple[tuple[str, ...], Any, str]] = {
        "time": (("point",), times, "s since the run began"),
        "data": (("point",), problem.data, "measured values, in the unit of the history"),
        "curve": (("point",), best.curves, "values of the best case"),
        "weight": (("point",), problem.weights, "how often the point counts"),
        "sensitivity": (
            ("point", "parameter"), best.sensitivities, "derivative of the curve by the parameter or its logarithm",
        ),
        "value": (("parameter",), best.values, "best value, internal unit"),
        "covariance": (
            ("parameter", "parameter"), best.covariance, "of the parameters or of their logarithms, linearised",
        ),
        "noise": (("measurement",), best.noise, "standard deviation, in the unit of the history"),
        "profile_value": (("profile_point", "parameter"), [row[4:] for row in profile_rows], "internal units"),
        "profile_ratio": (("profile_point",), [row[2] for row in profile_rows], "growth of the squares/variance"),
    }  # fmt: skip
    if samples is not None:
        numbers["sample"] = (("sample", "parameter"), samples.values, "samples of the posterior, internal units")
    for name, (dimensions, values, meaning) in numbers.items():
        number: Any = file.createVariable(name if name != "sample" else "posterior", "f8", dimensions)
        number.long_name = meaning
        if np.size(values):
            number[...] = np.asarray(values, dtype=float)


def _finite(content: Any) -> Any:
    """The same with None where a number is not finite: JSON knows no others."""
    if isinstance(content, dict):
        return {key: _finite(item) for key, item in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(item) for item in content]
    if isinstance(content, float | np.floating):
        return float(content) if math.isfinite(content) else None
    return content.item() if isinstance(content, np.generic) else content


def write_text(path: Path, text: str) -> None:
    """Write a text under a temporary name, and give it its own.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new = path.with_name(path.name + ".new")
        new.write_text(text, encoding="utf-8")
        new.replace(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from None
