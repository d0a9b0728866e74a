"""Columns of numbers with their units, and what can be wrong with them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fvswell.case.errors import CaseError, Problem, nearest_name, shown
from fvswell.physics.tissue import Array

__all__ = ["DataFile", "numbers_of", "refuse", "split_heading"]

_MOST_REPORTED = 10
_SHORT_UNITS = ("s", "min", "h", "ms", "mm", "um", "N", "mN", "Pa", "kPa", "MPa", "mV", "V", "M", "percent")  # after _


@dataclass(frozen=True)
class DataFile:
    """What a data file holds.

    Parameters
    ----------
    source
        Its name.
    columns
        Numbers by the heading of the column, all of shape (rows,).
    units
        Of the columns, where the file says so; "" where it does not.
    lines
        Line of the file that each row is from, (rows,).
    about
        What else the file says, by name.
    """

    source: str
    columns: Mapping[str, Array]
    units: Mapping[str, str]
    lines: Array
    about: Mapping[str, str] = field(default_factory=dict)

    def column(self, name: str) -> str:
        """Heading of the column that a name means: its heading, whole or without the unit, in any case.

        Raises
        ------
        ValueError
            If there is none; says which is nearest.
        """
        wanted = name.strip().casefold()
        for heading in self.columns:
            if wanted in (heading.casefold(), split_heading(heading)[0].casefold()):
                return heading
        plain = {split_heading(heading)[0]: heading for heading in self.columns}
        near = nearest_name(split_heading(name)[0], plain)
        hint = f"did you mean {shown(plain[near])}?" if near else f"there are {', '.join(map(shown, self.columns))}"
        raise ValueError(f"{self.source} has no such column; {hint}")


def split_heading(heading: str) -> tuple[str, str]:
    """Name and unit of a heading: "time (s)", "time [s]", "Time, s" or "time_s"; the unit is "" where there is none."""
    match = re.fullmatch(r"\s*(.*?)\s*(?:\[([^]]*)\]|\(([^()]*(?:\([^()]*\)[^()]*)*)\)|,\s*([^,]*))\s*", heading)
    if match is not None and match[1]:
        return match[1].strip(), next((part for part in match.groups()[1:] if part is not None), "").strip()
    name, underscore, unit = heading.strip().rpartition("_")
    if underscore and unit in _SHORT_UNITS:
        return name, unit
    return heading.strip(), ""


def numbers_of(
    rows: Sequence[Sequence[str]], lines: Sequence[int], headings: Sequence[str], source: str
) -> tuple[Array, list[Problem]]:
    """Numbers of rows of fields, ``(rows, columns)``, and what is wrong with them."""
    problems = []
    numbers = np.full((len(rows), len(headings)), np.nan)
    for index, (line, row) in enumerate(zip(lines, rows, strict=True)):
        if len(row) != len(headings):
            problems.append(Problem(f"line {line}", "", f"has {len(row)} fields, the line of headings {len(headings)}"))
            continue
        for column, text in enumerate(row):
            try:
                number = float(text)
            except ValueError:
                problems.append(Problem(f"line {line}, {headings[column]}", shown(text), "must be a number"))
                continue
            if not np.isfinite(number):
                problems.append(Problem(f"line {line}, {headings[column]}", text.strip(), "must be a finite number"))
            numbers[index, column] = number
    return numbers, problems


def refuse(problems: Sequence[Problem], source: str) -> None:
    """Raise CaseError with the first of some problems and how many more there are, if there are any."""
    if not problems:
        return
    listed = list(problems[:_MOST_REPORTED])
    if len(problems) > len(listed):
        listed.append(Problem("", "", f"and {len(problems) - len(listed)} more"))
    raise CaseError(listed, source)
