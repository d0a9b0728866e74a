"""Data files: columns of numbers with their units, from text, from Mach-1 testers, or from results of fvswell."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from fvswell.case.errors import CaseError, Problem, shown
from fvswell.case.toml_file import file_text
from fvswell.fitting.data_file import DataFile, numbers_of, refuse, split_heading
from fvswell.fitting.mach1 import is_mach1, read_mach1
from fvswell.results.file import read_result

__all__ = ["read_data"]

_DELIMITERS = ("\t", ";", ",")


def read_data(path: Path) -> DataFile:
    """Read a data file, whatever it is.

    Text has a line of headings, such as ``time (s), force [N]`` or ``Time, s``, and rows of numbers between commas,
    semicolons or tabs; lines that begin with # are passed over, but one right above the numbers may hold the headings.

    Raises
    ------
    CaseError
        If there is no such file, or with all that is wrong in it.
    """
    if path.suffix == ".nc":
        return _from_result(path)
    text = file_text(path)
    if is_mach1(text):
        return read_mach1(text, str(path))
    return _from_text(text, str(path))


def _from_text(text: str, source: str) -> DataFile:
    content = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    told = [(number, line) for number, line in content if not line.lstrip().startswith("#")]
    if not told:
        raise CaseError([Problem("", "", "is empty: it must hold a line of headings and rows of numbers")], source)
    delimiter = _delimiter(told[-1][1])
    rows = [(number, fields) for number, fields in _fields(told, delimiter)]
    if _all_numbers(rows[0][1]):
        above = [line for number, line in content if number < rows[0][0] and line.lstrip().startswith("#")]
        headings = next(csv.reader([above[-1].lstrip("# ")], delimiter=delimiter)) if above else []
        if len(headings) != len(rows[0][1]):
            message = "the first line must hold the headings of the columns, such as time (s)"
            raise CaseError([Problem(f"line {rows[0][0]}", "", message)], source)
    else:
        headings, rows = rows[0][1], rows[1:]
    headings = [heading.strip() for heading in headings]
    problems = _heading_problems(headings)
    if not rows:
        problems.append(Problem("", "", "has headings but no rows of numbers"))
    refuse(problems, source)
    lines = [number for number, _ in rows]
    numbers, problems = numbers_of([fields for _, fields in rows], lines, headings, source)
    refuse(problems, source)
    columns = dict(zip(headings, numbers.T, strict=True))
    return DataFile(source, columns, {name: split_heading(name)[1] for name in headings}, np.array(lines))


def _fields(lines: Sequence[tuple[int, str]], delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Fields of lines; decimal commas become points where the comma does not part the fields."""
    for number, line in lines:
        fields = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
        if delimiter != ",":
            fields = [re.sub(r"^(\s*[+-]?\d+),(\d+)", r"\1.\2", each) for each in fields]
        yield number, [each.strip() for each in fields]


def _delimiter(line: str) -> str:
    return next((delimiter for delimiter in _DELIMITERS if delimiter in line), ",")


def _all_numbers(fields: Sequence[str]) -> bool:
    try:
        list(map(float, fields))
    except ValueError:
        return False
    return True


def _heading_problems(headings: Sequence[str]) -> list[Problem]:
    problems = [
        Problem("headings", "", f"column {index} has no heading") for index, name in enumerate(headings, 1) if not name
    ]
    twice = {name for name in headings if name and headings.count(name) > 1}
    return problems + [Problem("headings", shown(name), "stands above two columns") for name in sorted(twice)]


def _from_result(path: Path) -> DataFile:
    """Histories of a result."""
    result = read_result(path)
    columns = {"time": result["time"].values}
    units = {"time": "s"}
    for name, values in result.items():
        if values.dims == ("time",):
            columns[str(name)] = values.values
            units[str(name)] = ""  # in the unit of the history already
    return DataFile(str(path), columns, units, np.arange(1, len(columns["time"]) + 1))
