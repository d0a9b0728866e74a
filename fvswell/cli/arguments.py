"""Arguments that several commands share, and what they stand for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fvswell.case.errors import CaseError, Problem

if TYPE_CHECKING:
    from fvswell.case.case import Case

__all__ = [
    "CaseFile", "Directory", "Force", "Quiet", "Settings", "output_directory", "print_warnings", "read_case",
]  # fmt: skip

CaseFile = Annotated[
    Path, typer.Argument(metavar="CASE", help="A case (.toml), or a result (.nc) whose case is taken.")
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a value of the case, such as tissue.hindrance_factor=0 or "
        '"phase.loading.piston.pressure=0.1 MPa". May be given many times.',
    ),
]
Directory = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="DIR", help="Directory to write to; output/CASE without it."),
]
Force = Annotated[bool, typer.Option("--force", help="Replace files that are there already.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]


def read_case(path: Path, settings: list[str] | None, model: str | None = None) -> Case:
    """The case of a file with the changes asked for; all that is wrong with the settings is reported at once."""
    from fvswell.case.case import load_case, parse_setting
    from fvswell.results.file import read_case as case_of_result

    changes: dict[str, Any] = {}
    problems: list[Problem] = []
    for setting in settings or []:
        try:
            key, value = parse_setting(setting)
            changes[key] = value
        except CaseError as error:
            problems += error.problems
    if problems:
        raise CaseError(problems, "--set")
    if model is not None:
        changes["model"] = model
    case = case_of_result(path) if path.suffix == ".nc" else load_case(path)
    for remark in case.changed_load_files():
        typer.echo(remark, err=True)
    return case.with_changes(changes) if changes else case


def print_warnings(case: Case) -> list[Problem]:
    """Print what is legal in a case and hardly meant, on the standard error stream."""
    from fvswell.case.plausibility import warnings_of

    warnings = warnings_of(case)
    for warning in warnings:
        typer.echo(f"warning: {case.source}: {warning}", err=True)
    return warnings


def output_directory(case_file: Path, output: Path | None) -> Path:
    """Where to write: as asked for, else output/ and the name of the file."""
    return output if output is not None else Path("output") / case_file.stem
