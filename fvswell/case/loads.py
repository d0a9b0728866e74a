"""Loads of a case file: a step, a ramp, a table of a measured load, or a sine; how each is read and written back."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from decimal import Decimal
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from fvswell.case.errors import nearest_name
from fvswell.case.lists import read_increasing, read_list, read_table
from fvswell.case.load_files import LoadFile, read_load_file
from fvswell.case.values import Quantity, ValueType
from fvswell.units import NUMBER

__all__ = [
    "AnyLoad",
    "Load",
    "Ramp",
    "Shape",
    "Sine",
    "StrainLoad",
    "TableLoad",
    "divided",
    "extremes",
    "final_value",
    "in_length",
    "jumps",
    "kept",
    "settled",
    "shape_of",
    "value_at",
]

_Reader = Callable[[Any], float]

_PERCENT = re.compile(rf"\s*({NUMBER})\s*%\s*")
_WHOLE = 1e-9  # of a period: what is nearer to a whole number of them is that
_KINDS = {
    "a ramp": ("ramp_to", "over"),
    "a table": ("times", "values"),
    "a file": ("file", "time", "value"),
    "a sine": ("mean", "amplitude", "period"),
}


class Ramp(NamedTuple):
    """A linear change from the present value to ``ramp_to`` within ``over`` seconds of the phase's start."""

    ramp_to: float
    over: float

    def at(self, time: float, before: float) -> float:
        """Value at a time since the phase began; ``before`` is the value that the phase begins with."""
        return before + (self.ramp_to - before) * min(time / self.over, 1.0)

    def final(self, duration: float) -> float:
        """Value at the end of a phase."""
        return self.ramp_to

    def extremes(self, duration: float, before: float) -> tuple[float, float]:
        """Smallest and largest value in a phase."""
        return min(before, self.ramp_to), max(before, self.ramp_to)

    def jumps(self, before: float) -> bool:
        """Whether the load leaves ``before`` at once."""
        return False

    def scaled(self, factor: float) -> Ramp:
        """The load times a factor."""
        return self._replace(ramp_to=factor * self.ramp_to)

    def plain(self) -> dict[str, Any]:
        """Content of its inline table."""
        return self._asdict()

    @property
    def settled(self) -> float:
        """Time from which on the load is constant, s since the phase began."""
        return self.over

    def longer_than(self, duration: float) -> str:
        """What is wrong with a ramp that is longer than its phase."""
        return f"over: {self.over:g} s is longer than the phase, {duration:g} s"


@dataclass(frozen=True)
class TableLoad:
    """A load that is linear between points, as it was measured, and stays at the last one.

    If the first point is later than the start of the phase, it is reached on a ramp from the present value.
    """

    times: tuple[float, ...]  # s since the phase began, increasing
    values: tuple[float, ...]
    source: LoadFile | None = None  # file that they were read from

    def at(self, time: float, before: float) -> float:
        """Value at a time since the phase began; ``before`` is the value that the phase begins with."""
        times, values = self.times, self.values
        if times[0] > 0.0:
            times, values = (0.0, *times), (before, *values)
        return float(np.interp(time, times, values))

    def final(self, duration: float) -> float:
        """Value at the end of a phase."""
        return self.values[-1]

    def extremes(self, duration: float, before: float) -> tuple[float, float]:
        """Smallest and largest value in a phase."""
        values = self.values if self.times[0] == 0.0 else (before, *self.values)
        return min(values), max(values)

    def jumps(self, before: float) -> bool:
        """Whether the load leaves ``before`` at once."""
        return self.times[0] == 0.0 and _differ(self.values[0], before)

    def scaled(self, factor: float) -> TableLoad:
        """The load times a factor."""
        return replace(self, values=tuple(factor * value for value in self.values))

    def plain(self) -> dict[str, Any]:
        """Content of its inline table."""
        own = {"times": list(self.times), "values": list(self.values)}
        return own if self.source is None else own | self.source._asdict()

    @property
    def settled(self) -> float:
        """Time from which on the load is constant, s since the phase began."""
        return self.times[-1]

    def longer_than(self, duration: float) -> str:
        """What is wrong with a table that is longer than its phase."""
        return f"times: the last one, {self.times[-1]:g} s, is beyond the end of the phase, {duration:g} s"


class Sine(NamedTuple):
    """A load mean + amplitude sin(2 pi t/period)."""

    mean: float
    amplitude: float
    period: float  # s

    def at(self, time: float, before: float) -> float:
        """Value at a time since the phase began; ``before`` is the value that the phase begins with."""
        periods = time / self.period
        if abs(2.0 * periods - round(2.0 * periods)) < _WHOLE:
            return self.mean  # exactly, after whole and half periods
        return self.mean + self.amplitude * math.sin(2.0 * math.pi * periods)

    def final(self, duration: float) -> float:
        """Value at the end of a phase; of one whose duration is not known, the mean."""
        return self.at(duration, self.mean) if math.isfinite(duration) else self.mean

    def extremes(self, duration: float, before: float) -> tuple[float, float]:
        """Smallest and largest value in a phase."""
        quarters = [self.at(0.25 * k * self.period, before) for k in range(1, 5) if 0.25 * k * self.period <= duration]
        values = [self.mean, *quarters, self.final(duration)]
        return min(values), max(values)

    def jumps(self, before: float) -> bool:
        """Whether the load leaves ``before`` at once."""
        return _differ(self.mean, before)

    def scaled(self, factor: float) -> Sine:
        """The load times a factor."""
        return self._replace(mean=factor * self.mean, amplitude=factor * self.amplitude)

    def plain(self) -> dict[str, Any]:
        """Content of its inline table."""
        return self._asdict()

    @property
    def settled(self) -> float:
        """Time from which on the load is constant, s since the phase began: never."""
        return math.inf

    def longer_than(self, duration: float) -> str:
        """Nothing: a sine is as long as its phase."""
        return ""


@dataclass(frozen=True)
class StrainLoad:
    """A displacement given as a strain: in shares of the extent of the equilibrated sample along its direction."""

    strain: Shape

    def of(self, extent: float) -> Shape:
        """The displacement, mm, of a sample of an extent, mm."""
        return extent * self.strain if isinstance(self.strain, float) else self.strain.scaled(extent)

    def plain(self) -> Any:
        """The value as TOML holds it: in per cent."""
        if isinstance(self.strain, float):
            return _percent(self.strain)
        content = self.strain.plain()
        for key in content.keys() & {"ramp_to", "mean", "amplitude"}:
            content[key] = _percent(content[key])
        if "values" in content:
            content["values"] = [_percent(value) for value in content["values"]]
        return content


Shape = float | Ramp | TableLoad | Sine  # of a load over time
AnyLoad = Shape | StrainLoad


def value_at(load: Shape, time: float, before: float) -> float:
    """Value of a load at a time since its phase began; ``before`` is the value that the phase begins with."""
    return load if isinstance(load, float) else load.at(time, before)


def final_value(load: Shape, duration: float = math.nan) -> float:
    """Value of a load at the end of a phase of a duration, s; only a sine depends on it."""
    return load if isinstance(load, float) else load.final(duration)


def extremes(load: Shape, duration: float, before: float) -> tuple[float, float]:
    """Smallest and largest value of a load in a phase that begins with the value ``before``."""
    return (load, load) if isinstance(load, float) else load.extremes(duration, before)


def jumps(load: Shape, before: float) -> bool:
    """Whether a load leaves the value ``before``, that its phase begins with, at once."""
    return _differ(load, before) if isinstance(load, float) else load.jumps(before)


def _kind(value: Mapping[str, Any]) -> str:
    """Which of the tables of a load a table is, or is most likely meant to be."""
    if "times" in value:
        return "a table"  # that has been read from a file, it may be
    shared = {kind: sum(key in value for key in keys) for kind, keys in _KINDS.items()}
    kind = max(shared, key=lambda name: shared[name])
    if shared[kind]:
        return kind
    near = [name for name, keys in _KINDS.items() if any(nearest_name(key, keys) for key in value)]
    if near:
        return near[0]
    ways = ", ".join("{" + ", ".join(keys) + "}" for keys in _KINDS.values())
    raise ValueError(f"must be a quantity or a table with one of these sets of keys: {ways}")


def _read_ramp(value: Mapping[str, Any], number: _Reader, _: _Reader) -> Ramp:
    return Ramp(**read_table(value, {"ramp_to": number, "over": Quantity("time", above=0.0).number}))


def _read_sine(value: Mapping[str, Any], number: _Reader, amplitude: _Reader) -> Sine:
    period = Quantity("time", above=0.0).number
    return Sine(**read_table(value, {"mean": number, "amplitude": amplitude, "period": period}))


def _read_points(value: Mapping[str, Any], number: _Reader, _: _Reader) -> TableLoad:
    """A table of points; what was read from a file says so."""
    source = None
    if "sha256" in value:
        own = {key: value[key] for key in LoadFile._fields if key in value}
        source = LoadFile(**read_table(own, dict.fromkeys(LoadFile._fields, str)))
        value = {key: item for key, item in value.items() if key not in own}
    seconds = Quantity("time", at_least=0.0).number
    readers = {"times": lambda item: read_increasing(item, seconds), "values": lambda item: read_list(item, number)}
    table = TableLoad(**read_table(value, readers), source=source)
    if len(table.times) != len(table.values):
        counts = f"{len(table.times)} times and {len(table.values)} values"
        raise ValueError(f"has {counts}: must be as many of each")
    return table


_READERS: dict[str, Callable[[Mapping[str, Any], _Reader, _Reader], Ramp | TableLoad | Sine]] = {
    "a ramp": _read_ramp,
    "a table": _read_points,
    "a sine": _read_sine,
}


def _holds_strains(value: Mapping[str, Any]) -> bool:
    """Whether any value of a table is given in per cent."""
    values = value.get("values", ())
    items = [value.get(key) for key in ("ramp_to", "mean", "amplitude")]
    items += values if isinstance(values, list | tuple) else []
    return any(_strain(item) is not None for item in items)


def _strain_or_nothing(value: Any) -> float:
    """A strain in per cent, or a zero without a unit."""
    strain = _strain(value)
    if strain is None and (isinstance(value, str | bool) or value != 0):
        raise ValueError("must be a strain in % as the other values are")
    return strain or 0.0


def _strain(value: Any) -> float | None:
    """A strain that is given in per cent; None for anything else."""
    match = _PERCENT.fullmatch(value) if isinstance(value, str) else None
    return None if match is None else float(Fraction(match[1]) / 100)


def _percent(strain: float) -> str:
    """A strain in per cent; reading it gives the same number."""
    return f"{Decimal(repr(strain)) * 100} %"


def _differ(one: float, other: float) -> bool:
    return not math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-15)


def settled(load: AnyLoad) -> float:
    """Time from which on a load is constant, s since its phase began; inf for a sine."""
    shape = shape_of(load)
    return 0.0 if isinstance(shape, float) else shape.settled


def shape_of(load: AnyLoad) -> Shape:
    """How a load goes over time, whether it is given as such or as a strain."""
    return load.strain if isinstance(load, StrainLoad) else load


def kept(load: AnyLoad, duration: float) -> AnyLoad:
    """What a load goes on as after a phase of a duration, s, if no other takes its place."""
    value = final_value(shape_of(load), duration)
    return StrainLoad(value) if isinstance(load, StrainLoad) else value


def in_length(load: AnyLoad, extent: float) -> Shape:
    """A displacement in mm; ``extent`` of the sample, mm, is what strains are shares of."""
    return load.of(extent) if isinstance(load, StrainLoad) else load


def divided(load: Shape, by: float) -> Shape:
    """A load in parts of another quantity, such as a force by the area that it acts on."""
    return load / by if isinstance(load, float) else load.scaled(1.0 / by)


@dataclass(frozen=True)
class Load(ValueType):
    """A quantity that changes with time in one of the ways of this module."""

    quantity: Quantity
    strain: bool = False  # whether it may be given in %, of the extent of the equilibrated sample

    @property
    def unit(self) -> str:
        """Internal unit of the dimension."""
        return self.quantity.unit

    @property
    def allowed(self) -> str:
        """The bounds."""
        return self.quantity.allowed

    def _read(self, value: Any) -> AnyLoad:
        if not isinstance(value, Mapping):
            strain = _strain(value) if self.strain else None
            return self.quantity.number(value) if strain is None else StrainLoad(strain)
        kind = _kind(value)
        if kind == "a file":
            points = read_load_file(value, self.quantity, self.strain)
            table = TableLoad(points.times, points.values, points.source)
            return StrainLoad(table) if points.are_strains else table
        if self.strain and _holds_strains(value):
            return StrainLoad(_READERS[kind](value, _strain_or_nothing, _strain_or_nothing))
        load = _READERS[kind](value, self.quantity.number, self._amplitude)
        if isinstance(load, Sine):
            self._check(load)
        return load

    @property
    def _amplitude(self) -> Callable[[Any], float]:
        """Reads a number of this quantity without bounds."""
        return Quantity(self.quantity.dimension).number

    def _check(self, sine: Sine) -> None:
        for extreme in (sine.mean - sine.amplitude, sine.mean + sine.amplitude):
            try:
                self.quantity.number(extreme)
            except ValueError as error:
                raise ValueError(f"goes to {extreme:g} {self.unit}: {error}") from None

    def _plain(self, value: AnyLoad) -> Any:
        return value if isinstance(value, float) else value.plain()
