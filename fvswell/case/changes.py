"""Changes to a case by dotted key, made in its raw content, which is read and checked again afterwards."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, TypeVar

from fvswell.case.errors import CaseError, Problem, nearest_name, shown
from fvswell.case.tables import Table, inner_tables, is_array

__all__ = ["changed_content", "with_numbers"]

_Root = TypeVar("_Root", bound=Table)
_DERIVED = ("content", "sha256", "parts")  # what a case has worked out, and keeps


def changed_content(
    root: type[Table], content: Mapping[str, Any], changes: Mapping[str, Any], source: str
) -> Mapping[str, Any]:
    """Raw content with some values changed; the original is left as it is, and what stays is shared.

    Parameters
    ----------
    root
        Table at the top of the schema.
    content
        Raw content of a valid case.
    changes
        New values by dotted key; None takes a key away.
    source
        File name for messages.

    Raises
    ------
    CaseError
        If a key leads nowhere. Keys that the schema does not know are found when the content is read.
    """
    problems = []
    for key, value in changes.items():
        try:
            content = _changed(root, content, "", key.split("."), value, changes)
        except ValueError as error:
            problems.append(Problem(key, shown(value), str(error)))
    if problems:
        raise CaseError(problems, source)
    return content


def with_numbers(table: _Root, changes: Mapping[str, float]) -> _Root | None:
    """Copy of a table with some single numbers in place of others, by dotted key; None if it takes more than that."""
    for key, value in changes.items():
        changed = _with_number(table, key.split("."), value)
        if changed is None:
            return None
        table = changed
    return table


def _with_number(table: _Root, keys: Sequence[str], value: float) -> _Root | None:
    key, *rest = keys
    old = getattr(table, key, None)
    new: Any = None
    if not rest:
        new = value if isinstance(old, float) and key != "duration" else None  # ramps must not be longer than that
    elif isinstance(old, Table):
        new = _with_number(old, rest, value)
    elif isinstance(old, tuple) and len(rest) > 1:
        index = _index([getattr(item, "name", None) for item in old], rest[0])
        item = _with_number(old[index], rest[1:], value) if isinstance(old[0], Table) and index < len(old) else None
        new = None if item is None else (*old[:index], item, *old[index + 1 :])
    if new is None:
        return None
    copy = table.model_copy(update={key: new})
    for name in _DERIVED:
        copy.__dict__.pop(name, None)
    return copy


def _changed(
    table: type[Table] | None,
    content: Any,
    prefix: str,
    keys: list[str],
    value: Any,
    changes: Mapping[str, Any],
) -> dict[str, Any]:
    """Copy of the raw content of a table with one value set, sharing all that stays as it is."""
    if not isinstance(content, Mapping):
        raise ValueError(f"{prefix.removesuffix('.')} holds a single value and no keys")
    key, *rest = keys
    new = dict(content)
    inner = inner_tables(table, key) if table is not None else []
    if not rest:
        if value is None:
            new.pop(key, None)
            return new
        new[key] = value
        return new if table is None else _without(new, set(table.displaced(key, new)) - {key}, prefix, changes)
    prefix = f"{prefix}{key}."
    old: Any = content.get(key, () if table is not None and is_array(table, key) else {})
    before = table.inner_table(content, key, old) if table is not None else None
    if isinstance(old, list | tuple) and inner:
        new[key] = _changed_array(before, old, prefix, rest, value, changes)
        return new
    new[key] = _changed(before, old, prefix, rest, value, changes)
    after = table.inner_table(new, key, new[key]) if table is not None else None
    if before is not None and after is not None and after is not before:
        lost = before.model_fields.keys() - after.model_fields.keys()  # what only the old variant knows
        new[key] = _without(new[key], lost, prefix, changes)
    return new


def _without(
    content: Mapping[str, Any], keys: Collection[str], prefix: str, changes: Mapping[str, Any]
) -> dict[str, Any]:
    """Content without some keys, except those that are asked for."""
    return {key: item for key, item in content.items() if key not in keys or f"{prefix}{key}" in changes}


def _changed_array(
    table: type[Table] | None,
    items: Sequence[Any],
    prefix: str,
    keys: list[str],
    value: Any,
    changes: Mapping[str, Any],
) -> list[Any]:
    """Copy of an array of tables with one value set in the table of a given name or number."""
    name, *rest = keys
    names = [str(item.get("name", "")) if isinstance(item, Mapping) else "" for item in items]
    index = _index(names, name)
    if index >= len(items):
        near = nearest_name(name, names)
        hint = f"; did you mean {near}?" if near else ""
        known = [own or str(number) for number, own in enumerate(names)]
        raise ValueError(f"there is no {prefix}{name}; there are {', '.join(known) or 'none'}{hint}")
    new = list(items)
    if not rest:
        new[index] = value
        return new
    new[index] = _changed(table, items[index], f"{prefix}{name}.", rest, value, changes)
    return new


def _index(names: Sequence[str | None], name: str) -> int:
    """Place of a table in an array by its name or its number; their count if there is none."""
    if name in names:
        return names.index(name)
    return min(int(name), len(names)) if name.isdecimal() else len(names)
