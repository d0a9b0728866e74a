"""The tables and keys of a fit file: what each means, and what is allowed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field, ValidationInfo, field_validator

from fvswell.case.tables import Table
from fvswell.case.values import Choice, Count, Flag, Name, Quantity, Text, ValueType
from fvswell.study.schema import Bound, CaseKeys, CaseSource, Changes, Names, VariableName

__all__ = ["FitTable", "MeasurementTable", "ParameterTable"]


@dataclass(frozen=True)
class Noise(ValueType):
    """A standard deviation; what is allowed depends on the quantity."""

    allowed = 'a quantity such as "0.5 kPa", or a part of the range of the curve such as "1 %"'

    def _read(self, value: Any) -> Any:
        if isinstance(value, bool | Mapping | list):
            raise ValueError(f"must be {self.allowed}")
        return value


class MeasurementTable(Table):
    """A measured curve."""

    name: Annotated[str, Name()] = Field(description="Name of the measurement; no two are alike.")
    case: Annotated[Any, CaseSource()] = Field(
        default=None, description="What was done to the sample, if it is not the case at the top of the file."
    )
    changes: Annotated[dict[str, Any] | None, Changes()] = Field(
        default=None, description="Values to change in the case, by dotted key."
    )
    file: Annotated[str, Text()] = Field(description="Path of the data file, from the directory of the fit file.")
    time: Annotated[str | None, Text()] = Field(
        default=None, description="Heading of the column with the times; the first column without it."
    )
    time_unit: Annotated[str | None, Text()] = Field(
        default=None, description="Unit of the times, where the heading does not say it."
    )
    start: Annotated[float, Quantity("time")] = Field(
        default=0.0,
        description="Time in the file at which the first phase of the case begins; earlier rows are left out.",
    )
    value: Annotated[str, Text()] = Field(description="Heading of the column with what was measured.")
    unit: Annotated[str | None, Text()] = Field(
        default=None, description="Unit of what was measured, where the heading does not say it."
    )
    zero: Annotated[float, Quantity()] = Field(
        default=0.0, description="What is taken off the measured numbers first, in their own unit."
    )
    factor: Annotated[float, Quantity()] = Field(
        default=1.0, description="What they are multiplied by then, such as -1 where compression was negative."
    )
    quantity: Annotated[str, Text()] = Field(
        description="What it is: a history of the case's result, such as global_strain, piston_pressure or top_force."
    )
    phases: Annotated[tuple[str, ...] | None, Names()] = Field(
        default=None, description="Names of the phases that count; all without it."
    )
    points: Annotated[int | None, Count(3)] = Field(
        default=None,
        description="How many rows to keep at most: spread over the time and over the way that the curve goes. All "
        "without it.",
    )
    noise: Annotated[Any, Noise()] = Field(
        default=None, description="Standard deviation of the noise; estimated from the misfit without it."
    )
    weight: Annotated[float, Quantity(above=0.0)] = Field(default=1.0, description="How often each point counts.")


class ParameterTable(Table):
    """A number of the case that is sought."""

    name: Annotated[str, VariableName()] = Field(description="Name of the parameter in tables, files and figures.")
    key: Annotated[tuple[str, ...], CaseKeys()] = Field(
        description="Dotted key of the case that takes the value; a list for several that take the same one."
    )
    start: Annotated[Any, Bound()] = Field(
        default=None, description="Where the search begins, or the value if it is fixed; the case's own without it."
    )
    low: Annotated[Any, Bound()] = Field(
        default=None, description="Lower bound; a tenth of the start without it, or the end of what is allowed."
    )
    high: Annotated[Any, Bound()] = Field(
        default=None, description="Upper bound; ten times the start without it, or the end of what is allowed."
    )
    scale: Annotated[str | None, Choice(("log", "linear"))] = Field(
        default=None,
        description="Whether it is searched for in its logarithm; without it, if it must be positive and has no upper "
        "end.",
    )
    measurements: Annotated[tuple[str, ...] | None, Names()] = Field(
        default=None, description="Names of the measurements that it is a property of; all without it."
    )
    fixed: Annotated[bool, Flag()] = Field(default=False, description="Whether it stays at its start.")


class FitTable(Table):
    """Keys at the top of the file, and the tables."""

    title: Annotated[str, Text()] = Field(description="What is fitted, in a line.")
    case: Annotated[Any, CaseSource()] = Field(
        default=None,
        description="Path of the case file, from the directory of the fit file; or the whole case as a table. Of the "
        "measurements that have none of their own.",
    )
    starts: Annotated[int, Count(1, 1000)] = Field(
        default=4, description="Number of searches, from the start and from points spread over the bounds."
    )
    seed: Annotated[int, Count(0)] = Field(default=0, description="Seed of these points and of posterior samples.")
    confidence: Annotated[float, Quantity(above=0.0, below=1.0)] = Field(
        default=0.9, description="Of the intervals: 0.9 for such that hold the truth in 9 of 10 fits."
    )
    measurement: tuple[MeasurementTable, ...]
    parameter: tuple[ParameterTable, ...]

    @field_validator("measurement", "parameter")
    @classmethod
    def _not_empty(cls, tables: tuple[Table, ...], info: ValidationInfo) -> tuple[Table, ...]:
        if not tables:
            raise ValueError(f"must hold at least one [[{info.field_name}]]")
        return tables
