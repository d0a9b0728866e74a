"""What is wrong with a case, told to the person who wrote it: every problem at once, each on a line."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["CaseError", "Problem", "nearest_name", "shown"]

_LONGEST_SHOWN = 70


@dataclass(frozen=True)
class Problem:
    """One thing wrong: where, what was given ("" if nothing), and what is allowed instead."""

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
    """The one of ``names`` that ``name`` was probably meant to be, or None."""
    matches = difflib.get_close_matches(str(name).lower(), list(names), n=1)
    return matches[0] if matches else None


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
