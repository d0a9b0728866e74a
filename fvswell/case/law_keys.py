"""Tables in which keys choose laws, and the parameters of a law are given with it.

Laws are NamedTuples of their parameters, or functions that make one; parameters with a default may be left out.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import cache
from inspect import Parameter, signature
from typing import Any, ClassVar

from pydantic import model_validator

from fvswell.case.profiles import Coordinates, DepthProfile, PlaneProfile
from fvswell.case.tables import Table

__all__ = ["LawTable", "parameters_of"]

_Laws = Mapping[str, Callable[..., Any]]


@cache
def parameters_of(law: Callable[..., Any]) -> dict[str, Any]:
    """Parameters of a law by name, each with its default; `inspect.Parameter.empty` where it has none."""
    return {name: parameter.default for name, parameter in signature(law).parameters.items()}


class LawTable(Table):
    """A table in which some keys choose laws, and others are the parameters of these."""

    laws: ClassVar[dict[str, _Laws]]  # by the key that chooses one of them
    of_all: ClassVar[tuple[str, ...]] = ()  # parameters of laws that every table has

    @classmethod
    def law_left_out(cls, kind: str, table: Mapping[str, Any]) -> str | None:
        """The law of a kind in a raw table that does not choose one; None where it has to."""
        default = cls.model_fields[kind].default
        return default if isinstance(default, str) else None

    @classmethod
    def presence_problems(cls, table: Mapping[str, Any]) -> list[tuple[str, str]]:
        """As for every table; and the parameters of a law go with the law that uses them."""
        problems = super().presence_problems(table)
        for kind, laws in cls.laws.items():
            name = cls._chosen(kind, table)
            if name is None:
                continue  # reported as a wrong choice, or as missing
            own = cls._own(laws[name])
            for key in own:
                if key not in table and own[key] is Parameter.empty:
                    problems.append((key, f'missing; {kind} = "{name}" needs it'))
            strange = cls._parameters(kind) - own.keys()
            for key in (key for key in table if key in strange):
                names = " or ".join(f'"{other}"' for other, law in laws.items() if key in cls._own(law))
                problems.append((key, f"is for {kind} = {names} only"))
        return problems

    @classmethod
    def displaced(cls, key: str, content: Mapping[str, Any]) -> Collection[str]:
        """As for every table; and a law that is chosen has no place for the parameters of others."""
        name = cls._chosen(key, content) if key in cls.laws else None
        if name is None:
            return super().displaced(key, content)
        return cls._parameters(key) - cls._own(cls.laws[key][name]).keys()

    def law_of(self, kind: str, coordinates: Coordinates, **others: Any) -> Any:
        """The chosen law at points; numbers where homogeneous, arrays (points,) where varying.

        ``others`` are parameters that stand in other tables.
        """
        chosen = self.laws[kind][getattr(self, kind)]
        given = {key: self.value(key, coordinates) for key in parameters_of(chosen) if key in type(self).model_fields}
        others = {key: value for key, value in others.items() if key in parameters_of(chosen) and value is not None}
        return chosen(**given, **others)

    def value(self, key: str, coordinates: Coordinates) -> Any:
        """Value of a key at points."""
        value = getattr(self, key)
        return value.at(coordinates) if isinstance(value, DepthProfile | PlaneProfile) else value

    @classmethod
    def _chosen(cls, kind: str, table: Mapping[str, Any]) -> str | None:
        name = table[kind] if kind in table else cls.law_left_out(kind, table)
        return name if isinstance(name, str) and name in cls.laws[kind] else None

    @classmethod
    def _own(cls, law: Callable[..., Any]) -> dict[str, Any]:
        """Parameters of a law that are keys for it alone."""
        known = cls.model_fields.keys() - set(cls.of_all)
        return {key: default for key, default in parameters_of(law).items() if key in known}

    @classmethod
    def _parameters(cls, kind: str) -> set[str]:
        """Keys of all laws of a kind."""
        return {key for law in cls.laws[kind].values() for key in cls._own(law)}

    @model_validator(mode="before")
    @classmethod
    def _with_what_is_left_out(cls, table: Any) -> Any:
        """With the laws and the parameters that need not be given."""
        if not isinstance(table, Mapping):
            return table
        whole = dict(table)
        for kind, laws in cls.laws.items():
            name = cls._chosen(kind, table)
            if name is not None:
                defaults = {key: value for key, value in cls._own(laws[name]).items() if value is not Parameter.empty}
                whole = {kind: name} | defaults | whole
        return whole
