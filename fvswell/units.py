"""Quantities as people write them ("0.5 MPa", "25 degC") turned into numbers in the internal units.

Inside the package everything is in mm, N, s, mmol, K and C, so stress is in MPa and electric potential in mV.
One equivalent is one mole of charge. Common units are in a table (`fvswell.common_units`); pint is imported when
another one is met.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from numbers import Real
from typing import Any

from fvswell.common_units import BASE_DIMENSIONS, Unit, common_unit

__all__ = [
    "DIMENSIONS",
    "NUMBER",
    "PLAIN_NUMBER",
    "Dimension",
    "QuantityError",
    "number_or_text",
    "parse",
    "uncommon_unit",
]

PLAIN_NUMBER = "plain number"
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"

_QUANTITY = re.compile(rf"\s*({NUMBER})\s*(.*?)\s*", re.DOTALL)
_UNIT_TEXT = re.compile(r"[\w\s%°·⁰¹²³⁴⁵⁶⁷⁸⁹⁻*/^().+-]*")


class QuantityError(ValueError):
    """A value that is not a quantity of the dimension asked for; the message says what is."""


@dataclass(frozen=True)
class Dimension:
    """A physical dimension: its internal unit, which fixes the dimensionality, and an example."""

    unit: str
    example: str


DIMENSIONS: dict[str, Dimension] = {
    "length": Dimension("mm", '"0.5 mm"'),
    "time": Dimension("s", '"10 min"'),
    "area": Dimension("mm^2", '"20 mm^2"'),
    "force": Dimension("N", '"2 N"'),
    "pressure": Dimension("MPa", '"0.5 MPa"'),
    "hydraulic permeability": Dimension("mm^4/(N s)", '"1e-3 mm^4/(N s)"'),
    "concentration": Dimension("mmol/mm^3", '"0.15 M"'),
    "diffusivity": Dimension("mm^2/s", '"5e-4 mm^2/s"'),
    "volume per charge": Dimension("mm^3/mmol", '"500 mm^3/meq"'),
    "temperature": Dimension("K", '"298 K"'),
    "electric potential": Dimension("mV", '"30 mV"'),
    "electric current": Dimension("A", '"0.1 mA"'),
    "current density": Dimension("A/mm^2", '"0.1 mA/cm^2"'),
    "pressure rate": Dimension("MPa/s", '"1e-3 MPa/min"'),
    "strain rate": Dimension("1/s", '"1e-4 /min"'),
    PLAIN_NUMBER: Dimension("", "0.5"),
}


def number_or_text(given: float | str) -> float | str:
    """What a command line gives as `parse` takes it: text without a unit is a number in the internal one."""
    try:
        return float(given)
    except ValueError:
        return given


def parse(value: str | float, dimension_name: str) -> float:
    """Value of a quantity in the internal unit of its dimension.

    Parameters
    ----------
    value
        Text with a number and a unit, or a number that is already in the internal unit.
    dimension_name
        Key of ``DIMENSIONS``.

    Returns
    -------
    float
        The double nearest to the exact result: units are converted in rational numbers, so one quantity
        written in different units gives one number.

    Raises
    ------
    QuantityError
        If the value is no finite quantity, or one of another dimension.
    """
    if isinstance(value, Real) and not isinstance(value, bool):
        number = float(value)
    elif isinstance(value, str):
        number = _from_text(value, dimension_name)
    else:
        raise QuantityError(f"must be {_expected(dimension_name)}")
    if not math.isfinite(number):
        raise QuantityError("must be a finite number")
    return number


def _from_text(text: str, dimension_name: str) -> float:
    match = _QUANTITY.fullmatch(text)
    if match is None or not math.isfinite(float(match[1])):
        raise QuantityError(f"is not a quantity: must be {_expected(dimension_name)}")
    number, unit_text = match.groups()
    if not unit_text and dimension_name != PLAIN_NUMBER:
        raise QuantityError(f"has no unit: must be {_expected(dimension_name)}")
    unit, internal = _unit(unit_text), _unit(DIMENSIONS[dimension_name].unit)
    if unit is None or internal is None:
        raise QuantityError(f'has no unit known as "{unit_text}": must be {_expected(dimension_name)}')
    if unit.exponents != internal.exponents:
        raise QuantityError(f"{_given(unit)}: must be {_expected(dimension_name)}")
    # A text far below the smallest double is zero; its exact fraction could fill the memory.
    exact = Fraction(number) if float(number) else Fraction(0)
    try:
        return float((exact * unit.factor + unit.offset - internal.offset) / internal.factor)
    except OverflowError:
        return math.inf


def _expected(dimension_name: str) -> str:
    dimension = DIMENSIONS[dimension_name]
    if dimension_name == PLAIN_NUMBER:
        return "a number without a unit"
    return f"of dimension {dimension_name}, such as {dimension.example}, or a number in {dimension.unit}"


def _given(unit: Unit) -> str:
    for name, dimension in DIMENSIONS.items():
        internal = _unit(dimension.unit)
        if internal is not None and internal.exponents == unit.exponents:
            return f"is of dimension {name}"
    return "is of another dimension"


@cache
def _unit(text: str) -> Unit | None:
    """The unit that a text stands for, None where there is none."""
    if not _UNIT_TEXT.fullmatch(text):
        return None
    text = _with_explicit_operators(text)
    return common_unit(text) or uncommon_unit(text)


def _with_explicit_operators(text: str) -> str:
    """Rewrite the way people print units, as in mm4/Ns and /min."""
    return re.sub(r"\bNs\b", "(N s)", re.sub(r"(?<=[A-Za-z])(?=\d)", "^", re.sub(r"^/", "1/", text)))


def uncommon_unit(text: str) -> Unit | None:
    """What pint makes of a text."""
    registry = _registry()
    try:
        zero, one, two = (registry.Quantity(Fraction(n), text).to_base_units() for n in (0, 1, 2))
        exponents = tuple(Fraction(one.dimensionality.get(f"[{name}]", 0)) for name in BASE_DIMENSIONS)
        offset, factor = zero.magnitude, one.magnitude - zero.magnitude
        if two.magnitude - one.magnitude != factor or len(one.dimensionality) != sum(map(bool, exponents)):
            return None
        return Unit(Fraction(factor), exponents, Fraction(offset))
    except Exception:  # pint hands the text to Python's tokenizer and operators, which raise all kinds of errors
        return None


@cache
def _registry() -> Any:
    import pint

    registry: Any = pint.UnitRegistry(non_int_type=Fraction)
    registry.define("equivalent = mole = eq")
    registry.define("@alias equivalent = Eq")
    return registry
