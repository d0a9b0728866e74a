"""The tables and keys of a study file: what each means, and what is allowed.

Parameters of a study are dotted keys of its cases, so their dimensions and bounds are those of the case file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator

from fvswell.case.errors import nearest_name, shown
from fvswell.case.loads import Load
from fvswell.case.reading import value_type
from fvswell.case.schema import MODELS, CaseTable
from fvswell.case.tables import Table, inner_tables, is_array
from fvswell.case.values import Choice, Count, Flag, Name, Quantity, Text, ValueType

__all__ = [
    "SAMPLINGS", "Combinations", "Design", "Grid", "OneAtATime", "Parameter", "Protocol", "StudyTable",
    "Variation", "varied_quantity",
]  # fmt: skip

SAMPLINGS = ("sobol", "latin-hypercube", "halton", "random")

_PHASE = "phase"


@dataclass(frozen=True)
class VariableName(ValueType):
    """A name that can be a variable of a netCDF file and of a program."""

    allowed = "a name of letters, digits and _, beginning with a letter"

    def _read(self, value: Any) -> str:
        if not isinstance(value, str) or not re.fullmatch(r"[A-Za-z]\w*", value, re.ASCII):
            raise ValueError(f"must be {self.allowed}")
        return value


@dataclass(frozen=True)
class Names(ValueType):
    """A list of names, no two alike; a single one may stand without brackets."""

    allowed = "a list of names"

    def _read(self, value: Any) -> tuple[str, ...]:
        names = [value] if isinstance(value, str) else value
        if not isinstance(names, list | tuple) or not names or not all(isinstance(name, str) for name in names):
            raise ValueError(f"must be {self.allowed}")
        if len(set(names)) < len(names):
            raise ValueError("must not name anything twice")
        return tuple(names)

    def _plain(self, value: tuple[str, ...] | None) -> list[str] | None:
        return None if value is None else list(value)


@dataclass(frozen=True)
class CaseKeys(Names):
    """One or more dotted keys of a case that all take the same value."""

    allowed = 'a dotted key of the case, such as "tissue.youngs_modulus", or a list of such keys'

    def _read(self, value: Any) -> tuple[str, ...]:
        keys = super()._read(value)
        dimensions, problems = set(), []
        for key in keys:
            try:
                dimensions.add(varied_quantity(key).dimension)
            except ValueError as error:
                problems.append(f"{key}: {error}" if len(keys) > 1 else str(error))
        if problems:
            raise ValueError("; ".join(problems))
        if len(dimensions) > 1:
            raise ValueError(f"must be keys of one dimension, not of {' and '.join(sorted(dimensions))}")
        return keys


@dataclass(frozen=True)
class Bound(ValueType):
    """End of a range; what is allowed depends on the key."""

    allowed = "a quantity that the key takes"

    def _read(self, value: Any) -> Any:
        return value


@dataclass(frozen=True)
class CaseSource(ValueType):
    """Where the case of a protocol is."""

    allowed = "the path of a case file from the study file, or a table with a whole case"

    def _read(self, value: Any) -> Any:
        if not isinstance(value, Mapping) and not (isinstance(value, str) and value.strip()):
            raise ValueError(f"must be {self.allowed}")
        return value


@dataclass(frozen=True)
class Changes(ValueType):
    """New values of a case by dotted key."""

    allowed = 'a table of values by dotted key in quotes, such as { "geometry.cells" = 100 }'

    def _read(self, value: Any) -> dict[str, Any]:
        if not isinstance(value, Mapping):
            raise ValueError(f"must be {self.allowed}")
        return dict(value)


@dataclass(frozen=True)
class Counts(ValueType):
    """Number of values by name of a parameter."""

    allowed = "a table of whole numbers, at least 2, by parameter, such as { youngs_modulus = 5 }"

    def _read(self, value: Any) -> dict[str, int]:
        if not isinstance(value, Mapping) or not value:
            raise ValueError(f"must be {self.allowed}")
        if not all(isinstance(n, int) and not isinstance(n, bool) and n >= 2 for n in value.values()):
            raise ValueError(f"must be {self.allowed}")
        return dict(value)


class Parameter(Table):
    """Something that is varied, and the range it is varied over."""

    name: Annotated[str, VariableName()] = Field(description="Name of the parameter in designs and in the result.")
    key: Annotated[tuple[str, ...], CaseKeys()] = Field(
        description="Dotted key of the case that takes the values; a list for several that take the same ones."
    )
    spacing: Annotated[str, Choice(("linear", "log"))] = Field(
        default="linear", description="Whether values are spread evenly, or evenly in their logarithm."
    )
    low: Annotated[float, Bound()] = Field(description="Lower end of the range, as the key's values are given.")
    high: Annotated[float, Bound()] = Field(description="Upper end of the range.")
    protocols: Annotated[tuple[str, ...] | None, Names()] = Field(
        default=None, description="Names of the protocols that it is varied in; all without it."
    )

    @field_validator("low", "high")
    @classmethod
    def _range(cls, value: Any, info: ValidationInfo) -> float:
        numbers = [varied_quantity(key).number(value) for key in info.data.get("key", ())]
        if not numbers:
            return math.nan  # the key is wrong, so nothing can be said about its values
        number, low = numbers[0], info.data.get("low")
        if info.data.get("spacing") == "log" and number <= 0.0:
            raise ValueError("must be above 0, for the spacing is logarithmic")
        if info.field_name == "high" and low is not None and number <= low:
            raise ValueError(f"must be above low, which is {low:g}: there is nothing between")
        return number


class Design(Table):
    """Which values of the parameters are combined; each protocol takes those of its own parameters."""

    name: Annotated[str, Name()] = Field(description="Name of the design, kept with each of its runs.")
    protocols: Annotated[tuple[str, ...] | None, Names()] = Field(
        default=None, description="Names of the protocols to run; all without it."
    )


class OneAtATime(Design):
    """Each parameter in turn takes equally spaced values over its range, while the others stay as in the case."""

    kind: Literal["one-at-a-time"] = Field(description="One parameter at a time.")
    parameters: Annotated[tuple[str, ...] | None, Names()] = Field(
        default=None, description="Names of the parameters to vary; all without it."
    )
    count: Annotated[int, Count(2)] = Field(description="Number of values of each parameter, both ends included.")


class Grid(Design):
    """Every combination of equally spaced values; parameters without a count stay as in the case."""

    kind: Literal["grid"] = Field(description="A full grid.")
    counts: Annotated[dict[str, int], Counts()] = Field(
        description="Number of values of each parameter, both ends included."
    )


class Combinations(Design):
    """Points spread over the whole ranges of the parameters."""

    kind: Literal["combinations"] = Field(description="Random or low-discrepancy combinations.")
    parameters: Annotated[tuple[str, ...] | None, Names()] = Field(
        default=None, description="Names of the parameters to vary; all without it."
    )
    sampling: Annotated[str, Choice(SAMPLINGS)] = Field(
        default="sobol",
        description="How the points are chosen (scipy.stats.qmc); all but random cover the ranges evenly.",
    )
    count: Annotated[int, Count(1)] = Field(description="Number of points; a power of two for sobol.")
    seed: Annotated[int, Count(0)] = Field(default=0, description="Seed: the same one gives the same points.")

    @field_validator("count")
    @classmethod
    def _balanced(cls, count: int, info: ValidationInfo) -> int:
        if info.data.get("sampling") == "sobol" and count & (count - 1):
            below = 1 << (count.bit_length() - 1)
            raise ValueError(f"must be a power of two for sobol points, such as {below} or {2 * below}")
        return count


Variation = OneAtATime | Grid | Combinations


class Protocol(Table):
    """A case that the parameters are varied about: what is done to the tissue."""

    name: Annotated[str, Name()] = Field(description="Name of the protocol, kept with each of its runs.")
    case: Annotated[Any, CaseSource()] = Field(
        description="Path of the case file, from the directory of the study file; or the whole case as a table."
    )
    changes: Annotated[dict[str, Any] | None, Changes()] = Field(
        default=None, description="Values to change in that case, by dotted key."
    )


class StudyTable(Table):
    """Keys at the top of the file, and the tables."""

    title: Annotated[str, Text()] = Field(description="What is studied, in a line.")
    model: Annotated[str, Choice(MODELS)] = Field(
        default="biphasic-swelling", description="The model that is judged; the cases' own is ignored."
    )
    reference_model: Annotated[str, Choice(MODELS)] = Field(
        default="electrochemical", description="The model that it is judged by."
    )
    impossible: Annotated[str, Choice(("refuse", "skip"))] = Field(
        default="refuse",
        description="What to do about parameter sets that cannot be, such as a load that presses all water out: "
        "refuse the study, or leave them out and say why in their run_status.",
    )
    strain_curves: Annotated[bool, Flag()] = Field(
        default=False, description="Whether the result holds the strain curves too."
    )
    parameter: tuple[Parameter, ...]
    design: tuple[Annotated[Variation, Field(discriminator="kind")], ...]
    protocol: tuple[Protocol, ...]

    @field_validator("parameter", "design", "protocol")
    @classmethod
    def _not_empty(cls, tables: tuple[Table, ...], info: ValidationInfo) -> tuple[Table, ...]:
        if not tables:
            raise ValueError(f"must hold at least one [[{info.field_name}]]: without it there are no runs")
        return tables


def varied_quantity(key: str) -> Quantity:
    """What a dotted key of a case holds; phases may have any name.

    Raises
    ------
    ValueError
        If there is no such key, or it holds no quantity.
    """
    parts = key.split(".")
    for known, reader in _quantities(CaseTable, "", parts):
        if known == key:
            if reader is None:
                raise ValueError("is not a quantity, so it cannot be varied over a range")
            return reader
    names = [known for known, reader in _quantities(CaseTable, "", parts) if reader is not None]
    near = nearest_name(key, names) or nearest_name(key.rpartition(".")[2], names)
    raise ValueError("no such key of a case" + (f"; did you mean {shown(near)}?" if near else ""))


def _quantities(table: type[Table], prefix: str, key: list[str]) -> Iterator[tuple[str, Quantity | None]]:
    """All dotted keys of a schema with what they hold, None for what is no quantity.

    Tables of which there are many have the names or numbers that the parts of ``key`` give them.
    """
    for name, field in table.model_fields.items():
        inner = inner_tables(table, name)
        place = f"{prefix}{name}"
        if inner and is_array(table, name):
            parts = place.split(".")
            place += f".{key[len(parts)]}" if key[: len(parts)] == parts and len(key) > len(parts) else ".NAME"
        for below in inner:
            yield from _quantities(below, f"{place}.", key)
        reader = value_type(field)
        if inner or isinstance(reader, Quantity):
            yield place, None if inner else reader  # type: ignore[misc]  # mypy does not follow the condition
        elif isinstance(reader, Load):
            yield place, reader.quantity
            yield f"{place}.ramp_to", reader.quantity
            yield f"{place}.over", Quantity("time", above=0.0)
        else:
            yield place, None
    if table.named_tables is not None:
        outer = [part for part in prefix.split(".") if part]
        named = key[len(outer)] if key[: len(outer)] == outer and len(key) > len(outer) else "PART"
        if named not in table.model_fields:
            yield from _quantities(table.named_tables, f"{prefix}{named}.", key)
