"""Reading lists and inline tables of a case file, reporting all that is wrong with them at once."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from fvswell.case.errors import nearest_name, shown

__all__ = ["read_increasing", "read_list", "read_table"]


def read_table(
    table: Mapping[str, Any], readers: Mapping[str, Callable[[Any], Any]], optional: Collection[str] = ()
) -> dict[str, Any]:
    """Read the items of an inline table, all required but the optional ones, and report all that is wrong at once."""
    problems = [f"{key}: missing" for key in readers if key not in table and key not in optional]
    items = {}
    for key, value in table.items():
        if key not in readers:
            near = nearest_name(key, readers)
            hint = f"did you mean {near}?" if near else f"allowed are {', '.join(readers)}"
            problems.append(f"{key}: unknown key; {hint}")
            continue
        try:
            items[key] = readers[key](value)
        except ValueError as error:
            problems.append(f"{key}: {error}")
    if problems:
        raise ValueError("; ".join(problems))
    return items


def read_list(value: Any, read_number: Callable[[Any], float]) -> tuple[float, ...]:
    """Read a list that is not empty."""
    if not isinstance(value, list | tuple | np.ndarray) or len(value) == 0:
        raise ValueError("must be a list and not empty")
    numbers, problems = [], []
    for index, item in enumerate(value):
        try:
            numbers.append(read_number(item))
        except ValueError as error:
            problems.append(f"[{index}] = {shown(item)}: {error}")
    if problems:
        raise ValueError("; ".join(problems))
    return tuple(numbers)


def read_increasing(value: Any, read_number: Callable[[Any], float]) -> tuple[float, ...]:
    """Read a list that increases."""
    numbers = read_list(value, read_number)
    if any(right <= left for left, right in pairwise(numbers)):
        raise ValueError("must increase from one entry to the next")
    return numbers
