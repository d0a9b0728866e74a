"""What is wrong with a case, for the person who wrote it: every problem at once, each on a line."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

__all__ = ["CaseError", "Finding", "Location", "Problem", "nearest_name", "shown"]

_LONGEST_SHOWN = 70

Location = tuple[str | int, ...]  # keys, and indices of phases, from the top of a case


class Finding(NamedTuple):
    """One thing wrong in a case: where, and what is allowed instead."""

    location: Location
    message: str


@dataclass(frozen=True)
class Problem:
    """A finding as it is reported: the dotted key, the value that was given ("" if none), and what is allowed."""

    key: str
    given: str
    message: str

    def __str__(self) -> str:
        place = f"{self.key} = {self.given}" if self.key and self.given else self.key or self.given
        return f"{place}: {self.message}" if place else self.message


class CaseError(Exception):
    """A case that cannot be used.

    Attributes
    ----------
    problems
        All that is wrong.
    file
        Where the case came from.
    """

    def __init__(self, problems: Iterable[Problem], file: str):
        self.problems = tuple(problems)
        self.file = file
        super().__init__(self.problems, file)

    def __str__(self) -> str:
        return "\n".join(f"{self.file}: {problem}" for problem in self.problems)


def nearest_name(name: object, names: Iterable[str]) -> str | None:
    """The one of ``names`` that ``name`` is probably a misspelling or a part of, or None."""
    text, known = str(name).lower(), list(names)
    containing = [other for other in known if text and text in other]
    return next(iter(difflib.get_close_matches(text, known, n=1) or containing), None)


def shown(value: Any) -> str:
    """A value as in the file, on one line, shortened."""
    if isinstance(value, Mapping):
        text = "{" + ", ".join(f"{key} = {shown(item)}" for key, item in value.items()) + "}"
    elif isinstance(value, list | tuple):
        text = "[" + ", ".join(shown(item) for item in value) + "]"
    elif isinstance(value, str | bool):
        text = json.dumps(value, ensure_ascii=False)
    else:
        text = f"{value:.15g}" if isinstance(value, float) else str(value)
    return text if len(text) <= _LONGEST_SHOWN else text[: _LONGEST_SHOWN - 3] + "..."
