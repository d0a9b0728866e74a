"""The kinds of value a case file is made of: how each is read, what is allowed, how it is written back."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Integral
from typing import Any, NamedTuple

from pydantic_core import core_schema

from fvswell.case.errors import nearest_name
from fvswell.case.lists import read_increasing
from fvswell.case.profiles import DepthProfile, PlaneProfile, Profile, read_profile
from fvswell.units import DIMENSIONS, NUMBER, PLAIN_NUMBER, parse

__all__ = [
    "RATES",
    "Choice",
    "Count",
    "Counts",
    "Duration",
    "Flag",
    "Name",
    "Names",
    "Point",
    "Quantity",
    "Rate",
    "RateReader",
    "RelaxationTimes",
    "Text",
    "Times",
    "ValueType",
]

RATES = ("pressure rate", "strain rate")  # dimensions
_PERCENT_PER_TIME = re.compile(rf"\s*({NUMBER})\s*%\s*(/.*)")
_RELAXATION_TIMES = re.compile(rf"\s*({NUMBER})\s+relaxation\s+times?\s*")


class RelaxationTimes(NamedTuple):
    """A duration given in relaxation times of the biphasic-swelling model."""

    multiple: float

    def __str__(self) -> str:
        return f"{self.multiple!r} relaxation times"


class Rate(NamedTuple):
    """How fast a pressure or a strain changes."""

    value: float  # in the internal unit, 1/s or MPa/s
    dimension: str  # one of RATES


class ValueType(ABC):
    """Reads one kind of value; used as an annotation in the tables of the schema.

    ``_read`` raises ValueError with a message that completes "the value ...".
    """

    @property
    def unit(self) -> str:
        """Internal unit, "" for values without one."""
        return ""

    @property
    @abstractmethod
    def allowed(self) -> str:
        """What a right value is, in a few words."""

    @abstractmethod
    def _read(self, value: Any) -> Any:
        """The value in internal units."""

    def _plain(self, value: Any) -> Any:
        """The value as TOML can hold it; ``_read`` gives it back."""
        return value

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self._read, serialization=core_schema.plain_serializer_function_ser_schema(self._plain)
        )


@dataclass(frozen=True)
class Text(ValueType):
    """A text that is not empty."""

    allowed = "a text"

    def _read(self, value: Any) -> str:
        if not isinstance(value, str) or not value.strip():
            raise ValueError(f"must be {self.allowed} and not empty")
        return value


@dataclass(frozen=True)
class Name(ValueType):
    """A name that can stand in a dotted key."""

    allowed = "a name of letters, digits, spaces, - and _, beginning with a letter"

    def _read(self, value: Any) -> str:
        if not isinstance(value, str) or not re.fullmatch(r"[^\W\d_][\w -]*", value):
            raise ValueError(f"must be {self.allowed}")
        return value


@dataclass(frozen=True)
class Choice(ValueType):
    """One of some names."""

    names: tuple[str, ...]

    @property
    def allowed(self) -> str:
        """The names."""
        return ", ".join(f'"{name}"' for name in self.names)

    def _read(self, value: Any) -> str:
        if isinstance(value, str) and value in self.names:
            return value
        near = nearest_name(value, self.names)
        raise ValueError(f"must be one of {self.allowed}" + (f'; did you mean "{near}"?' if near else ""))


@dataclass(frozen=True)
class Names(ValueType):
    """A list of some names, none twice."""

    names: tuple[str, ...]

    @property
    def allowed(self) -> str:
        """The names."""
        return "a list of " + ", ".join(f'"{name}"' for name in self.names)

    def _read(self, value: Any) -> tuple[str, ...]:
        if not isinstance(value, list | tuple) or len(set(map(str, value))) != len(value):
            raise ValueError(f"must be {self.allowed}, none twice")
        return tuple(Choice(self.names)._read(item) for item in value)

    def _plain(self, value: tuple[str, ...]) -> list[str]:
        return list(value)


@dataclass(frozen=True)
class Flag(ValueType):
    """True or false."""

    allowed = "true or false"

    def _read(self, value: Any) -> bool:
        if not isinstance(value, bool):
            raise ValueError(f"must be {self.allowed}")
        return value


@dataclass(frozen=True)
class Counts(ValueType):
    """Two whole numbers: along x and along y."""

    at_least: int
    at_most: int

    @property
    def allowed(self) -> str:
        """The bounds of both."""
        return f"two whole numbers, [along x, along y], each from {self.at_least} to {self.at_most}"

    def _read(self, value: Any) -> tuple[int, int]:
        if not isinstance(value, list | tuple) or len(value) != 2:
            raise ValueError(f"must be {self.allowed}")
        x, y = (Count(self.at_least, self.at_most)._read(item) for item in value)
        return x, y

    def _plain(self, value: tuple[int, int]) -> list[int]:
        return list(value)


@dataclass(frozen=True)
class Point(ValueType):
    """A place in the stress-free solid."""

    unit = DIMENSIONS["length"].unit
    allowed = "two lengths, [x, y], at least 0"

    def _read(self, value: Any) -> tuple[float, float]:
        if not isinstance(value, list | tuple) or len(value) != 2:
            raise ValueError(f"must be {self.allowed}")
        x, y = (Quantity("length", at_least=0.0).number(item) for item in value)
        return x, y

    def _plain(self, value: tuple[float, float]) -> list[float]:
        return list(value)


@dataclass(frozen=True)
class Count(ValueType):
    """A whole number."""

    at_least: int
    at_most: int | None = None

    @property
    def allowed(self) -> str:
        """The bounds."""
        if self.at_most is None:
            return f"a whole number, at least {self.at_least}"
        return f"a whole number from {self.at_least} to {self.at_most}"

    def _read(self, value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, Integral) or not self._is_within(int(value)):
            raise ValueError(f"must be {self.allowed}")
        return int(value)

    def _is_within(self, value: int) -> bool:
        return self.at_least <= value and (self.at_most is None or value <= self.at_most)


@dataclass(frozen=True)
class Quantity(ValueType):
    """A number with a dimension, within bounds; with ``varying`` it may be a profile as well."""

    dimension: str = PLAIN_NUMBER
    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None
    varying: bool = False

    @property
    def unit(self) -> str:
        """Internal unit of the dimension."""
        return DIMENSIONS[self.dimension].unit

    @property
    def allowed(self) -> str:
        """The bounds."""
        limits = {
            "above": self.above,
            "at least": self.at_least,
            "below": self.below,
            "at most": self.at_most,
        }
        return " and ".join(f"{name} {limit:g}" for name, limit in limits.items() if limit is not None) or "any"

    def _read(self, value: Any) -> float | Profile:
        if isinstance(value, Mapping):
            if not self.varying:
                raise ValueError("must be one quantity: it cannot vary")
            return read_profile(value, self.number, Quantity("length", at_least=0.0).number)
        return self.number(value)

    def _plain(self, value: float | Profile) -> Any:
        if isinstance(value, DepthProfile):
            return {"depth": list(value.depth), "value": list(value.value)}
        if isinstance(value, PlaneProfile):
            return {"x": list(value.x), "y": list(value.y), "value": [list(row) for row in value.value]}
        return value

    def number(self, value: Any) -> float:
        """Read a single number of this quantity."""
        number = parse(value, self.dimension)
        if (
            (self.above is not None and not number > self.above)
            or (self.at_least is not None and not number >= self.at_least)
            or (self.below is not None and not number < self.below)
            or (self.at_most is not None and not number <= self.at_most)
        ):
            raise ValueError(f"must be {self.allowed}" + (f" {self.unit}" if self.unit else ""))
        return number


@dataclass(frozen=True)
class Duration(ValueType):
    """A time, or a multiple of the relaxation time."""

    unit = DIMENSIONS["time"].unit
    allowed = 'above 0; or "1.5 relaxation times"'

    def _read(self, value: Any) -> float | RelaxationTimes:
        positive = Quantity("time", above=0.0)
        match = _RELAXATION_TIMES.fullmatch(value) if isinstance(value, str) else None
        if match is None:
            return positive.number(value)
        return RelaxationTimes(Quantity(above=0.0).number(float(match[1])))

    def _plain(self, value: float | RelaxationTimes) -> Any:
        return str(value) if isinstance(value, RelaxationTimes) else value


@dataclass(frozen=True)
class RateReader(ValueType):
    """A rate at which a pressure or a strain changes."""

    allowed = 'a rate above 0, such as "1e-3 MPa/min" of a pressure, or "1e-4 /min" or "0.01 %/min" of a strain'

    def _read(self, value: Any) -> Rate:
        if not isinstance(value, str):
            raise ValueError(f"must be {self.allowed}")
        percent = _PERCENT_PER_TIME.fullmatch(value)
        text = value if percent is None else f"{percent[1]} {percent[2]}"
        for dimension in RATES if percent is None else ("strain rate",):
            try:
                number = parse(text, dimension)
            except ValueError:
                continue
            if number > 0.0:
                return Rate(number if percent is None else number / 100.0, dimension)
        raise ValueError(f"must be {self.allowed}")

    def _plain(self, value: Rate) -> str:
        return f"{value.value!r} {DIMENSIONS[value.dimension].unit}"


@dataclass(frozen=True)
class Times(ValueType):
    """An increasing list of times."""

    unit = DIMENSIONS["time"].unit
    allowed = "a list that increases from 0 or more"

    def _read(self, value: Any) -> tuple[float, ...]:
        return read_increasing(value, Quantity("time", at_least=0.0).number)

    def _plain(self, value: tuple[float, ...]) -> list[float]:
        return list(value)
