"""The command ``export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fvswell.cli.arguments import Force
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
