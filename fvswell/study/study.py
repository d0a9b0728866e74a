"""The study: many parameter sets of one or more protocols, read from a TOML file and checked whole."""

from __future__ import annotations

import hashlib
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from fvswell.case.case import Case, load_case
from fvswell.case.errors import CaseError, Problem, shown
from fvswell.case.reading import read_tables
from fvswell.case.toml_file import file_text, toml_content
from fvswell.physics.tissue import Array
from fvswell.study.checks import check_study
from fvswell.study.runs import Runs, expand
from fvswell.study.schema import StudyTable

__all__ = ["Study", "load_study", "number_at"]

_MOST_LISTED = 10  # impossible parameter sets that are listed one by one
_HEADER = "# Plain numbers are in mm, N, s, mmol, K: MPa, mmol/mm^3, mm^4/(N s), mm^2/s.\n"


@dataclass(frozen=True, eq=False)
class Study:
    """A checked study.

    Attributes
    ----------
    table
        What the file says.
    cases
        The case of each protocol.
    runs
        All parameter sets.
    impossible
        Why a run cannot be made, by its number; empty unless the study says to skip such runs.
    source
        Where it was read from.
    """

    table: StudyTable
    cases: tuple[Case, ...]
    runs: Runs
    impossible: Mapping[int, str]
    source: str

    @classmethod
    def from_toml(cls, text: str, source: str = "study", directory: Path | None = None) -> Study:
        """Read and check a study.

        Parameters
        ----------
        text
            Content of a study file.
        source
            What to call it in messages.
        directory
            Where the paths of case files begin; the working directory if not given.

        Raises
        ------
        CaseError
            With every problem that the text has; only if there is none, with the parameter sets that cannot be.
        """
        content, cases, problems = _with_whole_cases(toml_content(text, source), directory or Path())
        try:
            table = read_tables(StudyTable, content, source, lambda table: check_study(table, cases))
        except CaseError as error:
            raise CaseError([*error.problems, *problems], source) from None
        found = [case for case in cases if case is not None]
        if problems or len(found) < len(cases):
            raise CaseError(problems, source)
        return cls(table, tuple(found), runs := expand(table), _impossible_runs(table, found, runs, source), source)

    @property
    def models(self) -> tuple[str, str]:
        """Names of the model that is judged and of the one it is judged by."""
        return self.table.model, self.table.reference_model

    @property
    def phases(self) -> tuple[str, ...]:
        """Names of the phases, the same in all protocols."""
        return tuple(phase.name for phase in self.cases[0].phase)

    def changes(self, run: int) -> dict[str, float]:
        """What a run changes in the case of its protocol, by dotted key."""
        return _changes(self.table, self.runs.values[run])

    def case(self, run: int) -> Case:
        """The case of a run; CaseError if it is impossible."""
        return self.cases[self.runs.protocol[run]].with_numbers(self.changes(run))

    def parameter_values(self) -> Array:
        """Value of every parameter in every run, ``(runs, parameters)``; nan where the case has no such number."""
        values = self.runs.values.copy()
        for p, case in enumerate(self.cases):
            content = tomllib.loads(case.to_toml())
            own = self.runs.protocol == p
            for i, parameter in enumerate(self.table.parameter):
                kept = own & np.isnan(values[:, i])
                values[kept, i] = number_at(content, parameter.key[0])
        return values

    def to_toml(self) -> str:
        """The resolved study in internal units with its cases whole: ``Study.from_toml`` gives the same back."""
        return _HEADER + tomli_w.dumps(self.table.model_dump(exclude_none=True))

    @cached_property
    def sha256(self) -> str:
        """Checksum of the resolved study."""
        return hashlib.sha256(self.to_toml().encode()).hexdigest()


def load_study(path: str | PathLike[str]) -> Study:
    """Read and check a study file.

    Raises
    ------
    CaseError
        If the file cannot be read, or with every problem that it has.
    """
    file = Path(path)
    return Study.from_toml(file_text(file), str(file), file.parent)


def _with_whole_cases(
    content: dict[str, Any], directory: Path
) -> tuple[dict[str, Any], list[Case | None], list[Problem]]:
    """Put the cases of the protocols in their place; what is malformed stays, for the schema to report."""
    protocols = content.get("protocol")
    if not isinstance(protocols, list):
        return content, [], []
    resolved, cases, problems = [], [], []
    for index, protocol in enumerate(protocols):
        case = None
        if isinstance(protocol, Mapping) and isinstance(protocol.get("case"), str | Mapping):
            name = protocol.get("name")
            place = f"protocol[{name if isinstance(name, str) else index}]"
            try:
                case = _protocol_case(protocol["case"], directory, place)
                changes = protocol.get("changes", {})
                if isinstance(changes, Mapping):
                    case = case.with_changes(changes)
            except CaseError as error:
                given = shown(protocol["case"])
                problems += [Problem(f"{place}.case", given, str(problem)) for problem in error.problems]
                case = None
            else:
                whole = {"case": tomllib.loads(case.to_toml())}
                done = isinstance(changes, Mapping)
                rest = {key: item for key, item in protocol.items() if key != "changes" or not done}
                protocol = rest | whole
        cases.append(case)
        resolved.append(protocol)
    return content | {"protocol": resolved}, cases, problems


def _protocol_case(given: str | Mapping[str, Any], directory: Path, place: str) -> Case:
    if isinstance(given, str):
        return load_case(directory / given)
    return Case.from_toml(tomli_w.dumps(given), place)


def _changes(table: StudyTable, values: Array) -> dict[str, float]:
    return {
        key: float(value)
        for parameter, value in zip(table.parameter, values, strict=True)
        if not math.isnan(value)
        for key in parameter.key
    }


def _impossible_runs(table: StudyTable, cases: Sequence[Case], runs: Runs, source: str) -> dict[int, str]:
    """Runs that cannot be made and why; CaseError if the study is to be refused for them."""
    models = _models_to_check(table)
    to_check = [[case.with_changes({"model": model}) for model in models] for case in cases]
    reasons: dict[int, str] = {}
    for run, protocol in enumerate(runs.protocol):
        changes = _changes(table, runs.values[run])
        if reason := _impossibility(to_check[protocol], changes):
            reasons[run] = reason
    if not reasons or (table.impossible == "skip" and len(reasons) < len(runs)):
        return reasons
    problems = [_listed(table, runs, run, reason) for run, reason in list(reasons.items())[:_MOST_LISTED]]
    if len(reasons) > _MOST_LISTED:
        problems.append(Problem("", "", f"and {len(reasons) - _MOST_LISTED} more of {len(runs)} parameter sets"))
    if table.impossible == "refuse":
        advice = 'narrow the ranges, or leave such sets out with impossible = "skip"'
        problems.append(Problem("impossible", shown(table.impossible), advice))
    raise CaseError(problems, source)


def _impossibility(cases: Sequence[Case], changes: Mapping[str, float]) -> str:
    """Why a parameter set cannot be in one of some cases, "" if it can."""
    for case in cases:
        try:
            case.with_numbers(changes)
        except CaseError as error:
            return "; ".join(map(str, error.problems))
    return ""


def _models_to_check(table: StudyTable) -> list[str]:
    """Models whose equilibria differ: the two that swell have the same."""
    models = (table.model, table.reference_model)
    swelling = next(model for model in models if model != "biphasic")
    return ["biphasic", swelling] if "biphasic" in models else [swelling]


def _listed(table: StudyTable, runs: Runs, run: int, reason: str) -> Problem:
    names = (parameter.name for parameter in table.parameter)
    values = {name: v for name, v in zip(names, runs.values[run], strict=True) if not math.isnan(v)}
    text = ", ".join(f"{name} = {value:.4g}" for name, value in values.items())
    design, protocol = table.design[runs.design[run]].name, table.protocol[runs.protocol[run]].name
    return Problem(f"run {run} of {design}, {protocol}", "", f"with {text} cannot be: {reason}")


def number_at(content: Any, key: str) -> float:
    """The number under a dotted key of the content of a case, nan if there is none."""
    for part in key.split("."):
        if isinstance(content, list):
            named = [item for item in content if item.get("name") == part]
            index = int(part) if part.isdecimal() else len(content)
            content = named[0] if named else content[index] if index < len(content) else None
        else:
            content = content.get(part) if isinstance(content, Mapping) else None
    return float(content) if isinstance(content, int | float) else math.nan
