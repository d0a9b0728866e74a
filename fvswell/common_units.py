"""The units that people write in case files, exactly, without the half second that a library of all units takes.

A unit is a rational factor on SI base units. What is not known here is left to that library, see `fvswell.units`.
"""

from __future__ import annotations

import re
from fractions import Fraction
from functools import cache
from typing import NamedTuple

__all__ = ["BASE_DIMENSIONS", "COMMON_UNITS", "Unit", "common_unit"]

BASE_DIMENSIONS = ("length", "mass", "time", "current", "temperature", "substance")


class Unit(NamedTuple):
    """A unit: value in SI base units = factor * number + offset."""

    factor: Fraction
    exponents: tuple[Fraction, ...]  # of BASE_DIMENSIONS
    offset: Fraction = Fraction(0)

    def times(self, other: Unit, sign: int = 1) -> Unit:
        """Product with another unit, or quotient by it with the sign -1."""
        exponents = tuple(a + sign * b for a, b in zip(self.exponents, other.exponents, strict=True))
        return Unit(self.factor * other.factor**sign, exponents)

    def power(self, exponent: int) -> Unit:
        """Integer power."""
        return Unit(self.factor**exponent, tuple(exponent * each for each in self.exponents))


def _unit(factor: str | int, *exponents: int) -> Unit:
    filled = (*exponents, *[0] * (len(BASE_DIMENSIONS) - len(exponents)))
    return Unit(Fraction(factor), tuple(map(Fraction, filled)))


_NOTHING = _unit(1)
_PREFIXES = {
    "G": 9, "M": 6, "k": 3, "": 0, "d": -1, "c": -2, "m": -3, "u": -6, "\N{MICRO SIGN}": -6,
    "\N{GREEK SMALL LETTER MU}": -6, "n": -9, "p": -12,
}  # fmt: skip
_PREFIXED = {
    "m": _unit(1, 1), "g": _unit("1/1000", 0, 1), "N": _unit(1, 1, 1, -2), "Pa": _unit(1, -1, 1, -2),
    "bar": _unit(100_000, -1, 1, -2), "s": _unit(1, 0, 0, 1), "A": _unit(1, 0, 0, 0, 1), "C": _unit(1, 0, 0, 1, 1),
    "V": _unit(1, 2, 1, -3, -1), "K": _unit(1, 0, 0, 0, 0, 1), "mol": _unit(1, 0, 0, 0, 0, 0, 1),
    "eq": _unit(1, 0, 0, 0, 0, 0, 1), "Eq": _unit(1, 0, 0, 0, 0, 0, 1), "M": _unit(1000, -3, 0, 0, 0, 0, 1),
    "l": _unit("1/1000", 3), "L": _unit("1/1000", 3),
}  # fmt: skip
_ALONE = {
    **{name: _unit(60, 0, 0, 1) for name in ("min", "minute", "minutes")},
    **{name: _unit(3600, 0, 0, 1) for name in ("h", "hour", "hours")},
    **{name: _unit(86_400, 0, 0, 1) for name in ("d", "day", "days")},
    **{name: _unit(1, 0, 0, 1) for name in ("second", "seconds")},
}
_UNCLEAR = ("ps", "pm", "cd", "dM", "dA", "dK", "cM", "Ml", "GL")  # rare, or other units of the same letters
_CELSIUS = _unit(1, 0, 0, 0, 0, 1)._replace(offset=Fraction("273.15"))
_TOKEN = re.compile(r"\s*([A-Za-z\N{MICRO SIGN}\N{GREEK SMALL LETTER MU}]+|\*\*|[*/^()\N{MIDDLE DOT}]|[+-]?\d+)")
COMMON_UNITS = {
    prefix + name: unit._replace(factor=unit.factor * Fraction(10) ** power)
    for name, unit in _PREFIXED.items()
    for prefix, power in _PREFIXES.items()
    if prefix + name not in _UNCLEAR
} | _ALONE


@cache
def common_unit(text: str) -> Unit | None:
    """The unit that a text such as "mm^4/(N s)" stands for, None if it is not made of the common ones."""
    if text.strip() in ("degC", "\N{DEGREE SIGN}C"):
        return _CELSIUS
    tokens, place = [], 0
    text = text.rstrip()
    while place < len(text):
        match = _TOKEN.match(text, place)
        if match is None:
            return None
        tokens.append(match[1])
        place = match.end()
    try:
        unit, rest = _product(tokens)
    except (LookupError, ValueError):
        return None
    return None if rest else unit


def _product(tokens: list[str]) -> tuple[Unit, list[str]]:
    """Read powers multiplied and divided from left to right; gives also what is left of the tokens."""
    if not tokens:
        return _NOTHING, []
    unit, tokens = _power(tokens)
    while tokens and tokens[0] != ")":
        sign = -1 if tokens[0] == "/" else 1
        if tokens[0] in ("*", "/", "\N{MIDDLE DOT}"):
            tokens = tokens[1:]
        factor, tokens = _power(tokens)
        unit = unit.times(factor, sign)
    return unit, tokens


def _power(tokens: list[str]) -> tuple[Unit, list[str]]:
    if tokens[0] == "(":
        unit, tokens = _product(tokens[1:])
        if tokens[0] != ")":
            raise ValueError("a parenthesis is not closed")
    else:
        unit = _NOTHING if tokens[:2] == ["1", "/"] else COMMON_UNITS[tokens[0]]
    tokens = tokens[1:]
    if tokens and tokens[0] in ("^", "**"):
        return unit.power(int(tokens[1])), tokens[2:]
    return unit, tokens
