"""Text files of Mach-1 testers (Biomomentum): what was done, and a table for each function.

<Mach-1 File>
<INFO> name:TAB value ... <END INFO>
<Stress Relaxation>             one or more functions, each with what was asked for,
name:TAB value ...
<DATA>                          a line of headings such as "Time, s", rows of numbers between tabs, in which
<divider>                       a divider ends a ramp, and
<END DATA>                      the end
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from fvswell.case.errors import CaseError, Problem
from fvswell.fitting.data_file import DataFile, numbers_of, refuse, split_heading

__all__ = ["is_mach1", "read_mach1"]

_FIRST = "<Mach-1 File>"


class _Function(NamedTuple):
    """What the tester did in one go."""

    name: str
    asked: dict[str, str]
    headings: list[str]
    lines: list[int]
    rows: list[list[str]]


def is_mach1(text: str) -> bool:
    """Whether a text is such a file."""
    return text.lstrip("﻿ \r\n").startswith(_FIRST)


def read_mach1(text: str, source: str) -> DataFile:
    """Read such a file; several functions become one table, in which time goes on from each to the next.

    Raises
    ------
    CaseError
        With all that is wrong in it.
    """
    about, functions = _parts(text, source)
    if not functions:
        raise CaseError([Problem("", "", "holds no <DATA>")], source)
    headings = functions[0].headings
    other = [each for each in functions if each.headings != headings]
    if other:
        message = f"<{other[0].name}> has other columns than <{functions[0].name}>: keep one of them in the file"
        raise CaseError([Problem("", "", message)], source)
    tables, problems = [], []
    for function in functions:
        numbers, found = numbers_of(function.rows, function.lines, headings, source)
        tables.append(numbers)
        problems += found
    if not sum(len(table) for table in tables):
        problems.append(Problem("", "", "has headings but no rows of numbers"))
    refuse(problems, source)
    begun = 0.0
    for before, table in pairwise(tables):
        if len(before) and len(table) and table[0, 0] <= before[-1, 0]:
            begun = before[-1, 0] + (before[-1, 0] - before[-2, 0] if len(before) > 1 else 0.0) - table[0, 0]
            table[:, 0] += begun
    numbers = np.concatenate(tables)
    asked = {f"{each.name}: {name}": value for each in functions for name, value in each.asked.items()}
    return DataFile(
        source,
        dict(zip(headings, numbers.T, strict=True)),
        {name: split_heading(name)[1] for name in headings},
        np.concatenate([np.array(each.lines, dtype=int) for each in functions]),
        {**about, "functions": ", ".join(each.name for each in functions), **asked},
    )


def _parts(text: str, source: str) -> tuple[dict[str, str], list[_Function]]:
    about: dict[str, str] = {}
    functions: list[_Function] = []
    lines = enumerate(text.splitlines(), start=1)
    name, asked = "", about
    for number, line in lines:
        tag = re.fullmatch(r"<(.*)>", line.strip())
        if tag is None:
            key, colon, value = line.partition(":")
            if colon:
                asked[key.strip()] = value.strip()
        elif tag[1] == "DATA":
            functions.append(_data(name, asked, lines, source, number))
        elif tag[1] == "INFO":
            asked = about
        elif not tag[1].startswith("END") and line.strip() != _FIRST:
            name, asked = tag[1], {}
    return about, functions


def _data(name: str, asked: dict[str, str], lines: Iterator[tuple[int, str]], source: str, began: int) -> _Function:
    headings: Sequence[str] = ()
    numbers: list[int] = []
    rows: list[list[str]] = []
    for number, line in lines:
        text = line.strip()
        if text == "<END DATA>":
            return _Function(name, asked, list(headings), numbers, rows)
        if not text or text.startswith("<"):
            continue
        fields = [each.strip() for each in line.split("\t")]
        if not headings:
            headings = fields
            continue
        numbers.append(number)
        rows.append(fields)
    if not rows:
        raise CaseError([Problem(f"line {began}", "", "<DATA> has no end and no rows")], source)
    return _Function(name, asked, list(headings), numbers, rows)  # the tester was switched off before the end
