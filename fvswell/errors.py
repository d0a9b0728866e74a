"""Errors that a user sees in a line, not as a traceback."""

from __future__ import annotations

from typing import Any

__all__ = ["OutputError", "SolverError"]


class OutputError(Exception):
    """A file that cannot be read or written as asked."""


class SolverError(Exception):
    """A run that had to stop; ``result`` holds what was computed until then, marked incomplete."""

    def __init__(self, message: str, result: Any = None) -> None:
        super().__init__(message)
        self.result = result
