"""Fit files: measured curves and parameters in TOML, read into a problem and checked whole."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import tomli_w

from fvswell.case.case import Case, load_case
from fvswell.case.errors import CaseError, Finding, Problem, nearest_name, shown
from fvswell.case.reading import read_tables
from fvswell.case.toml_file import file_text, toml_content
from fvswell.fitting.data import read_data
from fvswell.fitting.measured import measurement_of
from fvswell.fitting.measurement import Measurement
from fvswell.fitting.parameters import Parameters
from fvswell.fitting.problem import FitProblem, Settings
from fvswell.fitting.schema import FitTable, ParameterTable
from fvswell.fitting.sought import parameter_of

__all__ = ["fit_problem", "load_fit"]


def load_fit(path: str | PathLike[str]) -> FitProblem:
    """Read and check a fit file with its cases and data.

    Raises
    ------
    CaseError
        If a file cannot be read, or with every problem that they have.
    """
    file = Path(path)
    return fit_problem(toml_content(file_text(file), str(file)), str(file), file.parent)


def fit_problem(content: Mapping[str, Any], source: str = "fit", directory: Path | None = None) -> FitProblem:
    """The problem that the content of a fit file describes.

    Parameters
    ----------
    content
        What the file holds.
    source
        What to call it in messages.
    directory
        Where the paths of cases and data begin; the working directory if not given.

    Raises
    ------
    CaseError
        With every problem that it has.
    """
    table = read_tables(FitTable, content, source, lambda table: _findings(table))
    directory, problems = directory or Path(), list[Problem]()
    measurements = []
    for row in table.measurement:
        place = f"measurement[{row.name}]"
        try:
            case = _case(row.case if row.case is not None else table.case, row.changes, directory, place)
            measurements.append(measurement_of(row, case, read_data(directory / row.file), place))
        except CaseError as error:
            problems += [
                Problem(each.key, each.given, each.message) if each.key.startswith(place)
                else Problem(place, "", f"{error.file}: {each}")
                for each in error.problems
            ]  # fmt: skip
    if len(measurements) < len(table.measurement):
        raise CaseError(_once(problems), source)
    parameters = []
    for sought in table.parameter:
        try:
            parameters.append(parameter_of(sought, _cases_of(sought, measurements)))
        except CaseError as error:
            problems += error.problems
    if problems:
        raise CaseError(_once(problems), source)
    settings = Settings(table.starts, table.seed, table.confidence)
    return FitProblem(measurements, Parameters(parameters), settings, table.title, source)


def _findings(table: FitTable) -> Iterator[Finding]:
    for kind in ("measurement", "parameter"):
        names = [item.name for item in getattr(table, kind)]
        for index, name in enumerate(names):
            if name in names[:index]:
                yield Finding((kind, index, "name"), f"must not be the name of an earlier {kind}")
    for index, measurement in enumerate(table.measurement):
        if measurement.case is None and table.case is None:
            yield Finding(("measurement", index, "case"), "missing; must be given here or at the top of the file")
    yield from _parameter_findings(table)


def _parameter_findings(table: FitTable) -> Iterator[Finding]:
    known = [measurement.name for measurement in table.measurement]
    for index, parameter in enumerate(table.parameter):
        for name in parameter.measurements or ():
            if name not in known:
                near = nearest_name(name, known)
                hint = f"did you mean {shown(near)}?" if near else f"there are {', '.join(map(shown, known))}"
                yield Finding(("parameter", index, "measurements"), f"there is no {shown(name)}; {hint}")
        for earlier in table.parameter[:index]:
            shared = set(parameter.key) & set(earlier.key)
            if shared and set(parameter.measurements or known) & set(earlier.measurements or known):
                message = f"{', '.join(sorted(shared))} is taken by {earlier.name} already"
                yield Finding(("parameter", index, "key"), message)
    if table.parameter and all(parameter.fixed for parameter in table.parameter):
        yield Finding(("parameter", 0, "fixed"), "leaves nothing to be fitted: at least one must not be fixed")


def _case(given: Any, changes: Mapping[str, Any] | None, directory: Path, place: str) -> Case:
    if isinstance(given, str):
        case = load_case(directory / given)
    else:
        case = Case.from_toml(tomli_w.dumps(given), f"{place}.case")
    return case.with_changes(changes) if changes else case


def _cases_of(sought: ParameterTable, measurements: Sequence[Measurement]) -> list[Case]:
    """Cases that a parameter is in."""
    return [each.case for each in measurements if sought.measurements is None or each.name in sought.measurements]


def _once(problems: Sequence[Problem]) -> list[Problem]:
    return list(dict.fromkeys(problems))
