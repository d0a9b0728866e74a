"""Reading a TOML file, reporting what is wrong as of a case."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from fvswell.case.errors import CaseError, Problem, nearest_name

__all__ = ["file_text", "toml_content"]


def file_text(file: Path) -> str:
    """The text of a file.

    Raises
    ------
    CaseError
        If it cannot be read; names the file of the nearest name.
    """
    try:
        return file.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        message = f"no such file{_similar_file(file)}"
    except OSError as error:
        message = f"cannot be read: {error.strerror}"
    except UnicodeDecodeError as error:
        message = f"is not UTF-8 text: {error.reason} at byte {error.start}"
    raise CaseError([Problem("", "", message)], str(file))


def toml_content(text: str, source: str) -> dict[str, Any]:
    """What a text says.

    Raises
    ------
    CaseError
        If it is not TOML; ``source`` is what it is called.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise CaseError([Problem("", "", f"cannot be read as TOML: {error}")], source) from None


def _similar_file(file: Path) -> str:
    names = [other.name for other in file.parent.glob("*.toml")] if file.parent.is_dir() else []
    near = nearest_name(file.name, names)
    return f"; did you mean {file.with_name(near)}?" if near else ""
