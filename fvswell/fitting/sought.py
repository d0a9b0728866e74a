"""From a table of a fit file to a parameter, with its start and bounds checked."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from typing import Any

from fvswell.case.case import Case
from fvswell.case.errors import CaseError, Problem, shown
from fvswell.case.values import Quantity
from fvswell.fitting.parameters import Parameter, default_bounds, searched_in_log
from fvswell.fitting.schema import ParameterTable
from fvswell.study.schema import varied_quantity
from fvswell.study.study import number_at
from fvswell.units import number_or_text

__all__ = ["parameter_of"]


def parameter_of(table: ParameterTable, cases: Sequence[Case]) -> Parameter:
    """A parameter, checked.

    Parameters
    ----------
    table
        What the fit file says of it.
    cases
        That it is in.

    Raises
    ------
    CaseError
        With every problem that it has.
    """
    place = f"parameter[{table.name}]"
    quantity = varied_quantity(table.key[0])
    problems: list[Problem] = []

    def read(key: str) -> float | None:
        given: Any = getattr(table, key)
        if given is None:
            return None
        try:
            return quantity.number(number_or_text(given))
        except ValueError as error:
            problems.append(Problem(f"{place}.{key}", shown(given), str(error)))
            return None

    start, low, high = (read(key) for key in ("start", "low", "high"))
    if table.start is None:
        start = _present(table, cases, place, problems)
    if problems or start is None:
        raise CaseError(problems, place)
    log = table.scale == "log" or (table.scale is None and searched_in_log(quantity, start))
    lowest, highest = default_bounds(quantity, start, log)
    if table.fixed:
        low, high = start, start
    low, high = (given if given is not None else usual for given, usual in ((low, lowest), (high, highest)))
    problems += _bound_problems(table, place, (start, low, high), log, quantity)
    if problems:
        raise CaseError(problems, place)
    assert low is not None
    assert high is not None
    return Parameter(table.name, table.key, start, low, high, log, table.measurements, table.fixed)


def _present(table: ParameterTable, cases: Sequence[Case], place: str, problems: list[Problem]) -> float | None:
    """The value that the cases have."""
    found = {number_at(tomllib.loads(case.to_toml()), key) for case in cases for key in table.key}
    if any(math.isnan(value) for value in found):
        keys = ", ".join(table.key)
        problems.append(Problem(f"{place}.start", "", f"missing; the case does not give {keys} as one number"))
        return None
    if len(found) > 1:
        values = " and ".join(f"{value:g}" for value in sorted(found))
        problems.append(Problem(f"{place}.start", "", f"missing; the cases have different values, {values}"))
        return None
    return next(iter(found), None)


def _bound_problems(
    table: ParameterTable, place: str, numbers: tuple[float, float | None, float | None], log: bool, quantity: Quantity
) -> list[Problem]:
    start, low, high = numbers
    unit = f" {quantity.unit}" if quantity.unit else ""
    missing = [key for key, bound in (("low", low), ("high", high)) if bound is None]
    if missing:
        message = "missing; a quantity without ends of its own needs bounds"
        return [Problem(f"{place}.{key}", "", message) for key in missing]
    assert low is not None
    assert high is not None
    if log and not low > 0.0:
        return [Problem(f"{place}.low", shown(low), 'must be above 0, or scale = "linear"')]
    if table.fixed:
        return []
    if not low < high:
        return [Problem(f"{place}.high", f"{high:g}{unit}", f"must be above low, which is {low:g}{unit}")]
    if not low <= start <= high:
        return [Problem(f"{place}.start", f"{start:g}{unit}", f"must be within the bounds, {low:g} to {high:g}{unit}")]
    return []
