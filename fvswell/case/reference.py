"""The reference of the case file for the documentation, written from the schema.

``python -m fvswell.case.reference > docs/case-file.md`` brings the page up to date.
"""

from __future__ import annotations

from inspect import getdoc

from pydantic.fields import FieldInfo

from fvswell.case.loads import Load
from fvswell.case.reading import allowed_values, tables_below, value_type
from fvswell.case.schema import CaseTable
from fvswell.case.tables import Table, inner_tables
from fvswell.case.values import Quantity
from fvswell.units import DIMENSIONS

__all__ = ["case_reference"]

_INTRODUCTION = """\
# The case file

This page is written from the schema by `python -m fvswell.case.reference`.

A case is a [TOML](https://toml.io) file. `fvswell new NAME` writes a commented one to begin with, and
`fvswell check CASE` lists everything that is wrong with one at once.

**Quantities** are texts with a unit, such as `"0.5 MPa"`, or plain numbers in the internal units shown below.
Any unit of the dimension will do: `"0.2 meq/ml"` and `"0.2 M"` are the same concentration, for one equivalent
is one mole of charge. Conversion is exact: a case gives the same results in whatever units it is written.

**Profiles.** A key marked *varies* also takes `{ depth = [...], value = [...] }`: linear between the depths,
constant outside them. Depth is the distance from the filter in the stress-free solid. Entries are quantities.
In a block it is `{ x = [...], y = [...], value = [[...], ...] }`, with a row of values for each y, or
`{ x = [...], value = [...] }`, or the same with y.

**Loads** marked *over time* step to the given value when their phase starts, or they are one of

- `{ ramp_to = ..., over = ... }`: a ramp that goes there linearly within the time `over` of the start of the phase.
- `{ times = [...], values = [...] }`: linear between points as they were measured, constant after the last. Times are
  from the start of the phase; a first one above 0 is reached on a ramp from the present value.
- `{ file = "protocol.csv", time = "Time [s]", value = "Force [N]" }`: the same from two columns of a text file beside
  the case file, separated by commas, semicolons or tabs, with names in the first line. A column may be called without
  its unit; where the file says none, give it as `time_unit = "s"` or `value_unit = "N"`. Decimals have a point. The
  points go into the result, which can be run again without the file; if the file has changed by then, that is reported.
- `{ mean = ..., amplitude = ..., period = ... }`: mean + amplitude sin(2 pi t/period) from the start of the phase.

None may be longer than its phase. A displacement may also be given in %, of the equilibrated height or width; all
values of one load then are.

**Groups of phases** that are repeated are written as one phase with a name, `repeat = 20`, and under it the phases as
`[[phase.phase]]`. Phase "loading" of group "cycle" is called "cycle 1 loading" in the first round.
"""


def case_reference() -> str:
    """Markdown page with every key of a case: unit, default, allowed values and meaning."""
    headings: dict[type[Table], list[str]] = {}
    for heading, table in tables_below(CaseTable):
        title = f"`{heading}` {heading.variant}".strip() if heading.key else "At the top"
        headings.setdefault(table, []).append(title)
    tables = [
        f"## {', '.join(dict.fromkeys(titles))}\n\n{getdoc(table)}\n\n{_rows(table)}{_tables(table)}"
        for table, titles in headings.items()
    ]
    return "\n".join([_INTRODUCTION, _units(), *tables])


def _units() -> str:
    rows = [
        f"| {name} | {f'`{dimension.unit}`' if dimension.unit else ''} | `{dimension.example}` |"
        for name, dimension in DIMENSIONS.items()
    ]
    return "\n".join(["## Units", "", "| dimension | internal unit | example |", "|---|---|---|", *rows, ""])


def _rows(table: type[Table]) -> str:
    rows = [
        f"| `{key}` | {_unit(field)} | {_default(field)} | {_allowed(field)} | {field.description} |"
        for key, field in table.model_fields.items()
        if field.description is not None
    ]
    if not rows:
        return ""
    return "\n".join(["| key | unit | default | allowed | meaning |", "|---|---|---|---|---|", *rows, ""])


def _tables(table: type[Table]) -> str:
    inner = [f"`{key}`" for key in table.model_fields if inner_tables(table, key)]
    return f"\nTables in it: {', '.join(inner)}.\n" if inner else ""


def _unit(field: FieldInfo) -> str:
    reader = value_type(field)
    return f"`{reader.unit}`" if reader is not None and reader.unit else ""


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    if field.default is None:
        return ""
    if isinstance(field.default, str):
        return f'`"{field.default}"`'
    return f"{field.default:g}" if isinstance(field.default, float) else f"`{str(field.default).lower()}`"


def _allowed(field: FieldInfo) -> str:
    reader = value_type(field)
    marks = {"varies": isinstance(reader, Quantity) and reader.varying, "over time": isinstance(reader, Load)}
    return "; ".join([allowed_values(field), *(f"*{mark}*" for mark, given in marks.items() if given)])


if __name__ == "__main__":
    print(case_reference(), end="")
