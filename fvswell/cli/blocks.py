"""The commands ``fit``, ``export`` and ``show``."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from fvswell.cli.arguments import (
    CaseFile,
    Directory,
    Force,
    Quiet,
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
def fit(
    case_file: CaseFile,
    parameter: Annotated[
        str, typer.Option(metavar="NAME", help="Property of the tissue to fit.")
    ] = "hydraulic_permeability",
    against: Annotated[str, typer.Option(metavar="MODEL", help="Model that is followed.")] = "electrochemical",
    phases: Annotated[
        str | None, typer.Option(metavar="A,B,...", help="Phases that count; the first without it.")
    ] = None,
    between: Annotated[
        str | None,
        typer.Option(
            metavar='"LOW, HIGH"',
            help="Where to look, with units; without it a quarter to four times the case's value.",
        ),
    ] = None,
    settings: Settings = None,
    output: Directory = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Fit the biphasic-swelling model to a fuller one.

    Finds the value of a property of the tissue with which the biphasic-swelling model, without open-circuit
    correction, follows the fuller model best. Writes all trials and both results to DIR.
    """
    from fvswell.analysis.comparison import with_models
    from fvswell.analysis.fit import FITTED_MODEL, Trial, fit_problem, run_fit
    from fvswell.reporting.comparison_report import fit_report
    from fvswell.reporting.reports import case_lines
    from fvswell.results.file import refuse_existing
    from fvswell.results.table import write_table

    case = read_case(case_file, settings)
    limits = None if between is None else [limit.strip() for limit in between.split(",")]
    names = None if phases is None else [name.strip() for name in phases.split(",")]
    problem = fit_problem(case, parameter, against, names, limits)
    with_models(case, [against, FITTED_MODEL])
    directory = output_directory(case_file, output)
    table, reference, fitted = (directory / name for name in ("fit.csv", f"fit_{against}.nc", f"fit_{FITTED_MODEL}.nc"))
    refuse_existing([table, reference, fitted], force)
    console = Console(quiet)
    console.lines(*case_lines(case, f"{FITTED_MODEL}, fitted to {against}"))
    began = time.perf_counter()

    def report_trial(trial: Trial) -> None:
        elapsed = time.perf_counter() - began
        r_squared = ", ".join(f"{value:.6f}" for value in trial.r_squared)
        console.lines(f"run {trial.run}: {parameter} {trial.value:.6g}, R^2 {r_squared}, {elapsed:.1f} s")

    with console.progress(against) as draw:
        done = run_fit(problem, reference, fitted, force, draw, report_trial)
    write_table(table, done.header, done.rows)
    lines, summary = fit_report(done)
    console.lines("")
    console.table(summary)
    console.lines("", *lines, *(f"wrote {path}" for path in (table, reference, fitted)))


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
