"""Loads as a machine has recorded them: columns of a text file, with names in its first line and a unit each."""

from __future__ import annotations

import csv
import hashlib
import io
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from fvswell.case.errors import nearest_name, shown
from fvswell.case.lists import read_table
from fvswell.case.values import Quantity
from fvswell.units import parse

__all__ = ["LoadFile", "Points", "files_beside", "read_load_file"]

_folder: ContextVar[Path] = ContextVar("folder of the case file", default=Path())
_SEPARATORS = {"\t": "tabs", ";": "semicolons", ",": "commas"}
_UNIT = re.compile(r"\s*(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*(?:\([^()]*\)[^()]*)*)\)|\s/\s(.*))\s*")
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")
_MOST_SHOWN = 3  # of the lines in which something is wrong
_PERCENT = "%"


class LoadFile(NamedTuple):
    """Where the points of a load have come from."""

    file: str  # relative to the folder of the case file
    time: str  # names of the columns
    value: str
    sha256: str  # of the file

    def has_changed(self, folder: Path) -> bool:
        """Whether there is a file of that name in a folder, and it is another one than it was."""
        path = folder / self.file
        return path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() != self.sha256


class Points(NamedTuple):
    """What has been read from a load file."""

    times: tuple[float, ...]  # s
    values: tuple[float, ...]  # in internal units, or strains
    source: LoadFile
    are_strains: bool


@contextmanager
def files_beside(folder: Path) -> Iterator[None]:
    """Context in which load files are looked for in the folder of a case file."""
    token = _folder.set(folder)
    try:
        yield
    finally:
        _folder.reset(token)


def read_load_file(table: Mapping[str, Any], quantity: Quantity, strain: bool) -> Points:
    """Read the points of a load from two columns of a file.

    Parameters
    ----------
    table
        With ``file``, ``time`` and ``value``, and ``time_unit`` and ``value_unit`` where the file does not say them.
    quantity
        That the values are.
    strain
        Whether they may be strains in per cent instead.

    Raises
    ------
    ValueError
        With all that is wrong.
    """
    keys = ("file", "time", "value", "time_unit", "value_unit")
    given = read_table(table, dict.fromkeys(keys, _text), optional=keys[3:])
    lines, checksum = _lines(given["file"])
    problems, columns = [], []
    for key, own in (("time", Quantity("time", at_least=0.0)), ("value", quantity)):
        try:
            columns.append(_column(lines, key, given, own, strain and key == "value"))
        except ValueError as error:
            problems.append(str(error))
    numbers = []
    for column in columns:
        read, wrong = column.read(lines)
        numbers.append(read)
        problems += wrong
    problems += _wrong_widths(lines)
    if not problems:
        problems = _not_increasing(numbers[0], lines, columns[0])
    if problems:
        raise ValueError(f"{given['file']}: " + "; ".join(problems))
    source = LoadFile(given["file"], given["time"], given["value"], checksum)
    return Points(tuple(numbers[0]), tuple(numbers[1]), source, columns[1].unit == _PERCENT)


class _Lines(NamedTuple):
    """Content of a file: what its first line says, and the lines below that are not empty, with their numbers."""

    header: list[str]
    rows: list[tuple[int, list[str]]]
    separator: str


def _text(value: Any) -> str:
    if not isinstance(value, str) or not value.strip():
        raise ValueError("must be a text and not empty")
    return value


def _lines(name: str) -> tuple[_Lines, str]:
    path = _folder.get() / name
    try:
        content = path.read_bytes()
        text = content.decode("utf-8-sig")
    except FileNotFoundError:
        near = nearest_name(path.name, [other.name for other in path.parent.glob("*")] if path.parent.is_dir() else [])
        raise ValueError(f"{path}: no such file" + (f"; did you mean {near}?" if near else "")) from None
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: is not UTF-8 text: {error.reason} at byte {error.start}") from None
    first = next(filter(str.strip, text.splitlines()), "")
    separator = next((s for s in _SEPARATORS if len(next(csv.reader([first], delimiter=s), [])) > 1), ",")
    try:
        read = list(enumerate(csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True), start=1))
    except csv.Error as error:
        raise ValueError(f"{path}: cannot be read as columns separated by {_SEPARATORS[separator]}: {error}") from None
    filled = [(number, _without_empty_end(row)) for number, row in read if any(cell.strip() for cell in row)]
    if not filled:
        raise ValueError(f"{path}: is empty")
    if len(filled) == 1:
        raise ValueError(f"{path}: holds no numbers below its first line, which has the names of the columns")
    return _Lines(filled[0][1], filled[1:], separator), hashlib.sha256(content).hexdigest()


def _without_empty_end(row: Sequence[str]) -> list[str]:
    cells = [cell.strip() for cell in row]
    while not cells[-1]:
        cells.pop()
    return cells


@dataclass(frozen=True)
class _Column:
    """A column of a file."""

    name: str
    index: int
    unit: str
    quantity: Quantity

    def read(self, lines: _Lines) -> tuple[list[float], list[str]]:
        """Its values in internal units, and what is wrong with them."""
        values, problems = [], []
        for number, row in lines.rows:
            try:
                values.append(self._number(row))
            except ValueError as error:
                problems.append(f"line {number}, {self.name}: {error}")
        return values, _first(problems)

    def _number(self, row: Sequence[str]) -> float:
        text = row[self.index] if self.index < len(row) else ""
        if not text:
            raise ValueError("is empty")
        try:
            value = float(text)
        except ValueError:
            hint = f"; decimals are written with a point: {text.replace(',', '.')}" if _is_decimal_comma(text) else ""
            raise ValueError(f"{shown(text)} is not a number{hint}") from None
        if not math.isfinite(value):
            raise ValueError(f"{shown(text)}: must be a finite number")
        if self.unit == _PERCENT:
            return float(parse(value, "plain number")) / 100.0
        try:
            return self.quantity.number(f"{text} {self.unit}")
        except ValueError as error:
            raise ValueError(f"{shown(text)}: {error}") from None


def _column(lines: _Lines, key: str, given: Mapping[str, str], quantity: Quantity, strain: bool) -> _Column:
    """The column that a key of the case file names."""
    wanted = given[key].strip()
    names = [_split(cell)[0] for cell in lines.header]
    places = [i for i, cell in enumerate(lines.header) if cell == wanted]
    places = places or [i for i, name in enumerate(names) if name == wanted]
    if not places:
        there = ", ".join(shown(cell) for cell in lines.header if cell)
        near = nearest_name(wanted, [name.lower() for name in names if name])
        hint = f"there are {there}"
        if near is not None:
            hint = f"did you mean {shown(lines.header[[name.lower() for name in names].index(near)])}?"
        raise ValueError(f"{key}: there is no column {shown(wanted)}; {hint}")
    if len(places) > 1:
        raise ValueError(f"{key}: there are {len(places)} columns {shown(wanted)}")
    unit = _unit(lines.header[places[0]], f"{key}_unit", given, quantity, strain)
    return _Column(wanted, places[0], unit, quantity)


def _unit(header: str, key: str, given: Mapping[str, str], quantity: Quantity, strain: bool) -> str:
    """Unit of a column: that of the header, or of the key beside its name."""
    of_header = _split(header)[1]
    known = bool(of_header) and _is_unit(of_header, quantity, strain)
    if key in given:
        own = given[key].strip()
        if not _is_unit(own, quantity, strain):
            raise ValueError(f"{key} = {shown(own)}: must be a unit such as {_example(quantity)}")
        if known and own != of_header:
            raise ValueError(f"{key} = {shown(own)}: the file says {shown(of_header)}: leave {key} away")
        return own
    if known:
        return of_header
    says = f"its header says {shown(header)}" if of_header else f"its header {shown(header)} has none"
    raise ValueError(
        f"{key.removesuffix('_unit')}: the unit of the column is missing or of another dimension, {says}: "
        f"add {key} = {_example(quantity)}"
    )


def _example(quantity: Quantity) -> str:
    return shown(quantity.unit)


def _is_unit(text: str, quantity: Quantity, strain: bool) -> bool:
    """Whether a text is a unit of a quantity; "%" where strains may be given."""
    if text == _PERCENT:
        return strain
    try:
        parse(f"1 {text}", quantity.dimension)
    except ValueError:
        return False
    return bool(text)


def _split(header: str) -> tuple[str, str]:
    """Name and unit of a column, from a header such as "Time [s]", "Time (s)" or "Time / s"."""
    match = _UNIT.fullmatch(header)
    if match is None:
        return header, ""
    return match[1], next((unit.strip() for unit in match.groups()[1:] if unit), "")


def _is_decimal_comma(text: str) -> bool:
    return _DECIMAL_COMMA.fullmatch(text) is not None


def _wrong_widths(lines: _Lines) -> list[str]:
    """Lines with more fields than the first one, as decimal commas make them in a file separated by commas."""
    width = len(lines.header)
    hint = "; decimals are written with a point" if lines.separator == "," else ""
    found = [
        f"line {number} has {len(row)} fields where the first line has {width} names{hint}"
        for number, row in lines.rows
        if len(row) > width
    ]
    return _first(found)


def _not_increasing(times: Sequence[float], lines: _Lines, column: _Column) -> list[str]:
    """Lines whose time is not later than that of the line before."""
    found = [
        f"line {lines.rows[i][0]}, {column.name}: {lines.rows[i][1][column.index]} does not increase, after "
        f"{lines.rows[i - 1][1][column.index]}"
        for i in range(1, len(times))
        if times[i] <= times[i - 1]
    ]
    return _first(found)


def _first(problems: list[str]) -> list[str]:
    """The first few of many problems of one kind."""
    more = len(problems) - _MOST_SHOWN
    return problems if more <= 0 else [*problems[:_MOST_SHOWN], f"and {more} more lines"]
