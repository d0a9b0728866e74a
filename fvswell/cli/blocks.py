"""The commands ``export`` and ``show``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fvswell.cli.arguments import (
    CaseFile,
    Force,
    Settings,
    output_directory,
    print_warnings,
    read_case,
)
from fvswell.cli.errors import reported_errors
from fvswell.reporting.console import Console

__all__ = ["app"]

app = typer.Typer(rich_markup_mode=None)


@app.command()
@reported_errors
def export(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="A result (.nc) of a block.")],
    to: Annotated[str, typer.Option("--to", metavar="FORMAT", help="vtu, a time series for ParaView.")] = "vtu",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="DIR", help="Directory to write to; that of the result.")
    ] = None,
    force: Force = False,
) -> None:
    """Write a result in a format of other programs."""
    from fvswell.results.export import export_result

    path = export_result(result, to, output, force)
    Console().lines(f"wrote {path}, open it with ParaView")


@app.command()
@reported_errors
def show(
    case_file: CaseFile,
    settings: Settings = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Figure: .png, .pdf or .svg; tissue.png in output/CASE."),
    ] = None,
    force: Force = False,
) -> None:
    """Draw the laws of a case's tissue on one sheet.

    Stress against stretch, swelling pressure, permeability, equilibria and ions, with the states that the protocol
    comes to marked. Nothing is run.
    """
    from fvswell.reporting.plots import save_figure
    from fvswell.reporting.tissue_figure import show as sheet
    from fvswell.results.file import refuse_existing

    case = read_case(case_file, settings)
    path = output or output_directory(case_file, None) / "tissue.png"
    refuse_existing([path], force)
    print_warnings(case)
    save_figure(sheet(case), path)
    Console().lines(f"wrote {path}")
