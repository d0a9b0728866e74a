"""Tables of TOML files as pydantic models, and what a table may hold: tables in it, arrays and variants of them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import cache
from typing import Any, ClassVar, Literal, get_args, get_origin

from pydantic import BaseModel, ConfigDict

from fvswell.case.errors import nearest_name

__all__ = ["Table", "inner_tables", "is_array", "variant", "variant_names"]


class Table(BaseModel):
    """A table of a case file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    alternatives: ClassVar[tuple[str, ...]] = ()  # keys of which at most one may be given
    needs_alternative: ClassVar[bool] = True  # and exactly one has to be
    variant_label: ClassVar[str] = ""  # what documentation and messages call a variant that no key names
    named_tables: ClassVar[Any] = None  # table that each further key holds, whose names the file chooses
    former: ClassVar[Mapping[str, str]] = {}  # keys of earlier versions, and what they have become

    @classmethod
    def presence_problems(cls, table: Mapping[str, Any]) -> list[tuple[str, str]]:
        """Keys of a raw table that exclude each other or are missing, each with what is allowed."""
        given = [key for key in cls.alternatives if key in table]
        if len(given) > 1:
            return [(given[1], f"cannot stand beside {given[0]}: give one of {', '.join(cls.alternatives)}")]
        if cls.alternatives and cls.needs_alternative and not given:
            return [(cls.alternatives[0], f"missing; give one of {', '.join(cls.alternatives)}")]
        return []

    @classmethod
    def displaced(cls, key: str, content: Mapping[str, Any]) -> Collection[str]:
        """Keys that have no place beside one that has been set in the raw content of this table."""
        return cls.alternatives if key in cls.alternatives else ()

    @classmethod
    def inner_table(cls, content: Mapping[str, Any], key: str, item: Any) -> type[Table] | None:
        """Table that the content of a key, or an item of it, is read into.

        Parameters
        ----------
        content
            Raw content of this table.
        key
            A key of it.
        item
            What it holds; of an array of tables, one of them.

        Returns
        -------
        type or None
            None if the key holds no table, or nothing says which one.
        """
        return variant(inner_tables(cls, key), item)


@cache
def inner_tables(table: type[Table], key: str) -> tuple[type[Table], ...]:
    """Tables that a key of a table stands for: several for variants, none for a value or an unknown key."""
    if key in table.model_fields:
        return tuple(_tables_in(table.model_fields[key].annotation))
    return () if table.named_tables is None else (table.named_tables,)


@cache
def is_array(table: type[Table], key: str) -> bool:
    """Whether a key of a table stands for an array of tables."""
    return key in table.model_fields and get_origin(table.model_fields[key].annotation) is tuple


@cache
def variant_names(tables: tuple[type[Table], ...]) -> dict[str, tuple[str, type[Table]]]:
    """Variants of a table by name, each with the key that holds the name; empty where there are none."""
    return {
        get_args(field.annotation)[0]: (key, table)
        for table in tables
        for key, field in table.model_fields.items()
        if get_origin(field.annotation) is Literal
    }


def variant(tables: Sequence[type[Table]], content: Any) -> type[Table] | None:
    """The one of some variants of a table that raw content names, or misspells; None if it is none of them."""
    if len(tables) == 1:
        return tables[0]
    names = variant_names(tuple(tables))
    if not names or not isinstance(content, Mapping):
        return None
    for name, (key, table) in names.items():
        if content.get(key, table.model_fields[key].default) == name:
            return table
    given = [content[key] for key, _ in names.values() if key in content]
    near = nearest_name(given[0], names) if given else None
    return names[near][1] if near is not None else None


def _tables_in(annotation: Any) -> list[type[Table]]:
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return [annotation]
    return [table for argument in get_args(annotation) for table in _tables_in(argument)]
