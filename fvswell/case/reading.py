"""From the raw content of a case file to checked tables, or to every problem in it at once."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Literal, NamedTuple, TypeVar, get_args, get_origin

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from fvswell.case.errors import CaseError, Finding, Location, Problem, nearest_name, shown
from fvswell.case.tables import Table, inner_tables, is_array, variant_names
from fvswell.case.values import ValueType

__all__ = ["Heading", "allowed_values", "problems_of", "read_tables", "tables_below", "value_type"]

_Root = TypeVar("_Root", bound=Table)
_NOTHING = object()


def read_tables(
    root: type[_Root], content: Mapping[str, Any], source: str, check: Callable[[_Root], Iterable[Finding]]
) -> _Root:
    """Read raw content into the tables of a schema and check how its values fit together.

    Parameters
    ----------
    root
        Table at the top of the schema.
    content
        What the TOML file holds.
    source
        File name for messages.
    check
        Finds what is wrong between valid values.

    Raises
    ------
    CaseError
        With all problems of the keys and values; if there are none, with all that ``check`` finds.
    """
    findings = list(_presence_findings(root, content, ()))
    try:
        table = root.model_validate(content, context=content)
    except ValidationError as error:
        findings = [*(_finding(root, content, details) for details in error.errors()), *findings]
    if not findings:
        findings = list(check(table))
    if findings:
        raise CaseError(problems_of(root, content, findings), source)
    return table


def problems_of(root: type[Table], content: Mapping[str, Any], findings: Iterable[Finding]) -> list[Problem]:
    """Findings in raw content as they are reported."""
    return [_problem(root, content, finding) for finding in findings]


class Heading(NamedTuple):
    """Where a table stands: its dotted key ("" at the top), whether there may be several, and which variant it is."""

    key: str = ""
    several: bool = False
    variant: str = ""  # such as: with kind = "plane-strain"

    def __str__(self) -> str:
        return f"[[{self.key}]]" if self.several else f"[{self.key}]"


def tables_below(table: type[Table], heading: Heading | None = None) -> Iterator[tuple[Heading, type[Table]]]:
    """All tables of a schema with their headings, such as [tissue]."""
    heading = heading or Heading()
    yield heading, table
    for key in table.model_fields:
        tables = inner_tables(table, key)
        names = {inner: f'with {tag} = "{name}"' for name, (tag, inner) in variant_names(tables).items()}
        whole = f"{heading.key}.{key}" if heading.key else key
        for inner in tables:
            variant = names.get(inner, inner.variant_label) if len(tables) > 1 else ""
            yield from tables_below(inner, Heading(whole, is_array(table, key), variant))
    if table.named_tables is not None:
        yield from tables_below(table.named_tables, Heading(f"{heading.key}.NAME"))


def value_type(field: FieldInfo) -> ValueType | None:
    """What reads the values of a key, None for tables and for the names of variants."""
    return next((item for item in field.metadata if isinstance(item, ValueType)), None)


def allowed_values(field: FieldInfo) -> str:
    """What may be given for a key, in a few words."""
    reader = value_type(field)
    if reader is not None:
        return reader.allowed
    if get_origin(field.annotation) is Literal:
        return ", ".join(f'"{name}"' for name in get_args(field.annotation))
    return "one or more tables" if get_origin(field.annotation) is tuple else "a table"


class _Place(NamedTuple):
    """A key: how it is written in a message, what was given, and the table and name it belongs to."""

    key: str
    given: Any
    table: type[Table]
    name: str


def _place(root: type[Table], content: Mapping[str, Any], location: Location) -> _Place:
    """Follow a location; parts that name a variant of a table, as pydantic inserts them, are passed over."""
    place, table = _Place("", content, root, ""), root
    parent: Mapping[str, Any] = content  # what holds the key of the place
    for part in location:
        given = place.given
        if isinstance(part, int):
            item = given[part]
            name = item.get("name") if isinstance(item, Mapping) else None
            place = place._replace(key=f"{place.key}[{name if isinstance(name, str) else part}]", given=item)
            table = place.table.inner_table(parent, place.name, item) or place.table
        elif part not in variant_names(inner_tables(place.table, place.name)):
            key = f"{place.key}.{part}" if place.key else part
            parent = given if isinstance(given, Mapping) else {}
            inner = parent.get(part, _NOTHING)
            place = _Place(key, inner, table, part)
            table = table.inner_table(parent, part, inner) or table
    return place


def _problem(root: type[Table], content: Mapping[str, Any], finding: Finding) -> Problem:
    place = _place(root, content, finding.location)
    return Problem(place.key, "" if place.given is _NOTHING else shown(place.given), finding.message)


def _presence_findings(table: type[Table], content: Mapping[str, Any], location: Location) -> Iterator[Finding]:
    """What the tables say about keys that exclude or need each other."""
    for key, message in table.presence_problems(content):
        yield Finding((*location, key), message)
    for key, inner in content.items():
        tables = inner_tables(table, key)
        several = is_array(table, key)
        if not tables or several != isinstance(inner, list | tuple):
            continue
        for index, part in enumerate(inner if several else [inner]):
            chosen = table.inner_table(content, key, part)
            if chosen is not None and isinstance(part, Mapping):
                place = (*location, key, index) if several else (*location, key)
                yield from _presence_findings(chosen, part, place)


def _finding(root: type[Table], content: Mapping[str, Any], details: Any) -> Finding:
    """Our words for one of pydantic's errors."""
    location, kind, context = details["loc"], details["type"], details.get("ctx", {})
    place = _place(root, content, location)
    if kind == "value_error":
        return Finding(location, str(context["error"]))
    if kind == "extra_forbidden":
        return Finding(location, f"unknown key; {_suggestion(root, place.table, place.name)}")
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        names = variant_names(inner_tables(place.table, place.name))
        tag = next(key for key, _ in names.values())
        given = place.given.get(tag) if isinstance(place.given, Mapping) else None
        return Finding((*location, tag), _one_of(names, given))
    if place.name not in place.table.model_fields and _is_misspelt(root, place.table, place.name):
        return Finding(location, f"unknown key; {_suggestion(root, place.table, place.name)}")
    if kind == "missing":
        field = place.table.model_fields[place.name]
        reader = value_type(field)
        unit = f" ({reader.unit})" if reader is not None and reader.unit else ""
        return Finding(location, f"missing; must be given: {allowed_values(field)}{unit}")
    if kind == "literal_error":
        return Finding(location, _one_of(_variants_beside(root, place.table), place.given))
    heading = Heading(re.sub(r"\[[^]]*\]", "", place.key), is_array(place.table, place.name))
    return Finding(location, f"must be a table with the heading {heading}")


def _variants_beside(root: type[Table], table: type[Table]) -> list[str]:
    """Names of a variant of a table and of all others that may stand in its place."""
    places = (inner_tables(outer, key) for _, outer in tables_below(root) for key in outer.model_fields)
    return list(next(variant_names(tables) for tables in places if table in tables))


def _one_of(names: Iterable[str], given: Any) -> str:
    near = nearest_name(given, names)
    hint = f"; did you mean {shown(near)}?" if near else ""
    return f"must be one of {', '.join(map(shown, names))}{hint}"


def _is_misspelt(root: type[Table], table: type[Table], name: str) -> bool:
    """Whether a key that could be a name of the file's own is more likely another key, misspelt or misplaced."""
    elsewhere = {key for _, other in tables_below(root) for key in other.model_fields}
    return name in elsewhere or name in table.former or nearest_name(name, table.model_fields) is not None


def _suggestion(root: type[Table], table: type[Table], name: str) -> str:
    """What an unknown key may have been meant to be: it has another name now, or is misplaced or misspelt."""
    if name in table.former:
        return f"is now {table.former[name]}"
    elsewhere = {key for _, other in tables_below(root) for key in other.model_fields}
    if name in elsewhere:
        return f"belongs under {_home(root, table, name)}"
    near = nearest_name(name, table.model_fields)
    if near is not None:
        return f"did you mean {near}?"
    near = nearest_name(name, elsewhere)
    if near is not None:
        return f"did you mean {near}, which belongs under {_home(root, table, near)}?"
    return f"allowed here are {', '.join(table.model_fields)}"


def _home(root: type[Table], table: type[Table], name: str) -> str:
    """The headings under which a key may stand: those within the table where it was found, else all."""
    tables = list(tables_below(root))
    homes = [heading for heading, other in tables if name in other.model_fields]
    around = tuple(f"{heading.key}." for heading, other in tables if other is table and heading.key)
    inside = [heading for heading in homes if heading.key.startswith(around)] if around else []
    keys = [heading.key for heading in homes]

    def named(heading: Heading) -> str:
        if not heading.key:
            return "the title"
        return f"{heading} {heading.variant}".strip() if keys.count(heading.key) == 1 else str(heading)

    return " or ".join(dict.fromkeys(map(named, inside or homes)))
