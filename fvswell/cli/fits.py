"""Commands about measured curves: fits, data files, and plans of experiments."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fvswell.case.errors import CaseError, Problem
from fvswell.cli.arguments import Directory, Force, Quiet, Settings, output_directory, read_case
from fvswell.cli.errors import INTERRUPTED, reported_errors
from fvswell.reporting.console import Console

if TYPE_CHECKING:
    from fvswell.case.case import Case
    from fvswell.fitting.evaluator import FitProgress
    from fvswell.fitting.problem import FitProblem

__all__ = ["app"]

app = typer.Typer(rich_markup_mode=None)

Processes = Annotated[
    int | None,
    typer.Option(metavar="N", min=1, help="Processes on this machine; for blocks one for each core without it."),
]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler to compute on, such as tcp://127.0.0.1:8786.")
]


@app.command()
@reported_errors
def fit(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="A fit file (.toml); or a case, with --data or --against.")
    ],
    data: Annotated[
        Path | None, typer.Option("--data", metavar="DATA", help="Measured curve to fit the case to.")
    ] = None,
    quantity: Annotated[
        str, typer.Option(metavar="NAME", help="What was measured: a history of the case's result.")
    ] = "global_strain",
    value: Annotated[
        str | None, typer.Option(metavar="COLUMN", help="Column that it is in; that of the quantity's name without it.")
    ] = None,
    unit: Annotated[
        str | None, typer.Option(metavar="UNIT", help="Its unit, where the heading does not say it.")
    ] = None,
    noise: Annotated[
        str | None, typer.Option(metavar='"1 kPa"', help="Standard deviation of its noise; estimated without it.")
    ] = None,
    parameters: Annotated[
        list[str] | None,
        typer.Option(
            "--parameter",
            metavar="KEY[=LOW..HIGH]",
            help="What to fit, such as tissue.youngs_modulus. May be given many times.",
        ),
    ] = None,
    against: Annotated[
        str | None, typer.Option(metavar="MODEL", help="Fit the biphasic-swelling model to this one instead.")
    ] = None,
    phases: Annotated[str | None, typer.Option(metavar="A,B,...", help="Phases that count.")] = None,
    between: Annotated[
        str | None, typer.Option(metavar='"LOW, HIGH"', help="With --against: where to look, with units.")
    ] = None,
    models: Annotated[
        str | None, typer.Option(metavar="A,B,...", help="Models to compare on the same data as well.")
    ] = None,
    samples: Annotated[
        int, typer.Option(metavar="N", min=0, help="Steps of 64 walkers that sample the posterior (extra fit).")
    ] = 0,
    profiles: Annotated[
        bool, typer.Option("--profiles/--no-profiles", help="Whether to find profile likelihood intervals.")
    ] = True,
    settings: Settings = None,
    processes: Processes = None,
    scheduler: Scheduler = None,
    output: Directory = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Find properties from measured curves, and how sure they are.

    Writes values, intervals, curves and figures to DIR. Interrupted, it goes on where it was when it is called again.
    """
    from fvswell.case.toml_file import file_text, toml_content
    from fvswell.fitting.file import load_fit

    if file.suffix != ".nc" and data is None and "measurement" in toml_content(file_text(file), str(file)):
        if settings:
            raise CaseError(
                [Problem("--set", ", ".join(settings), "is for cases: write it into the fit file")], str(file)
            )
        problem = load_fit(file)
    elif data is not None:
        case = read_case(file, settings)
        names = None if phases is None else [name.strip() for name in phases.split(",")]
        problem = _problem_of(case, data, quantity, value, unit, noise, names, parameters or [])
    else:
        _fit_reduced(file, parameters, against, phases, between, settings, output, force, Console(quiet))
        return
    wanted = [] if models is None else [name.strip() for name in models.split(",")]
    directory = output_directory(file, output)
    _fit_measured(problem, wanted, samples, profiles, processes, scheduler, directory, force, Console(quiet))


def _fit_measured(
    problem: FitProblem,
    models: list[str],
    samples: int,
    with_profiles: bool,
    processes: int | None,
    scheduler: str | None,
    directory: Path,
    force: bool,
    console: Console,
) -> None:
    from fvswell.compiled.kernels import report_compilation
    from fvswell.fitting.fit import fit as run_fit
    from fvswell.fitting.model_comparison import compare_models
    from fvswell.fitting.results import FILES, write_fit
    from fvswell.reporting.fit_figures import FIT_FIGURES, fit_figures
    from fvswell.reporting.fit_report import (
        fit_lines,
        fit_tables,
        identifiability_lines,
        model_table,
        problem_lines,
    )
    from fvswell.reporting.plots import save_figure
    from fvswell.results.file import refuse_existing

    figures = [directory / f"{name}.{suffix}" for name in FIT_FIGURES for suffix in ("png", "pdf")]
    refuse_existing([*(directory / name for name in FILES), *figures], force)
    console.lines(*problem_lines(problem))
    report_compilation(lambda text: console.lines(f"{text} ..."))
    problem.check()
    with _reported_interruption(), _fit_progress(console) as report:
        result = run_fit(
            problem, with_profiles=with_profiles, samples=samples, processes=processes, scheduler=scheduler,
            keep=directory / "fit.runs", report=report,
        )  # fmt: skip
        compared = compare_models(problem, models, processes, scheduler, report)
    paths = write_fit(directory, result, compared)
    for name, figure in fit_figures(result).items():
        for suffix in ("png", "pdf"):
            save_figure(figure, directory / f"{name}.{suffix}")
            paths.append(directory / f"{name}.{suffix}")
    console.lines("", *identifiability_lines(result.before))
    for table in fit_tables(result):
        console.lines("")
        console.table(table)
    if compared:
        table, lines = model_table(compared)
        console.lines("")
        console.table(table)
        console.lines(*lines)
    console.lines("", *fit_lines(result), *(f"wrote {path}" for path in paths))


def _problem_of(
    case: Case,
    data: Path,
    quantity: str,
    value: str | None,
    unit: str | None,
    noise: str | None,
    phases: list[str] | None,
    parameters: list[str],
) -> FitProblem:
    """The problem of a case and one curve, as a fit file would describe it."""
    from fvswell.fitting.file import fit_problem

    if not parameters:
        message = "missing; say what to fit, such as --parameter tissue.youngs_modulus"
        raise CaseError([Problem("--parameter", "", message)], case.source)
    measurement = {
        "name": "measured", "file": str(data.absolute()), "value": value or quantity, "quantity": quantity,
        "unit": unit, "noise": noise, "phases": phases,
    }  # fmt: skip
    content = {
        "title": case.title,
        "case": case,
        "measurement": [{key: item for key, item in measurement.items() if item is not None}],
        "parameter": [_parameter(text) for text in parameters],
    }
    return fit_problem(content, case.source)


def _parameter(text: str) -> dict[str, Any]:
    """A parameter from KEY or KEY=LOW..HIGH; a bare name is a property of the tissue."""
    key, equals, bounds = text.partition("=")
    key = key.strip() if "." in key else f"tissue.{key.strip()}"
    table: dict[str, Any] = {"name": re.sub(r"\W+", "_", key.split(".", 1)[-1]), "key": key}
    low, dots, high = bounds.partition("..")
    if equals and not (dots and low.strip() and high.strip()):
        message = 'must be KEY=LOW..HIGH, such as "tissue.youngs_modulus=0.1 MPa..1 MPa"'
        raise CaseError([Problem("--parameter", text, message)], "fit")
    return table | ({"low": low.strip(), "high": high.strip()} if equals else {})


def _fit_reduced(
    case_file: Path,
    parameters: list[str] | None,
    against: str | None,
    phases: str | None,
    between: str | None,
    settings: list[str] | None,
    output: Path | None,
    force: bool,
    console: Console,
) -> None:
    """Fit the biphasic-swelling model, without open-circuit correction, to a fuller one by a property of the tissue."""
    from fvswell.analysis.comparison import with_models
    from fvswell.fitting.reduced_model import FITTED_MODEL, fit_reduced_model, reduced_problem
    from fvswell.reporting.fit_report import reduced_fit_report
    from fvswell.reporting.reports import case_lines
    from fvswell.results.file import refuse_existing
    from fvswell.results.table import write_table

    case = read_case(case_file, settings)
    if against is None:
        message = "missing; give the curves to fit, by a fit file or --data, or a fuller model to follow, by --against"
        raise CaseError([Problem("--data", "", message)], str(case_file))
    names = parameters or ["hydraulic_permeability"]
    if len(names) > 1:
        raise CaseError([Problem("--parameter", ", ".join(names), "must be one with --against")], str(case_file))
    parameter = names[0].removeprefix("tissue.")
    limits = None if between is None else [limit.strip() for limit in between.split(",")]
    chosen = None if phases is None else [name.strip() for name in phases.split(",")]
    problem = reduced_problem(case, parameter, against, chosen, limits)
    with_models(case, [against, FITTED_MODEL])
    directory = output_directory(case_file, output)
    table, reference, fitted = (directory / name for name in ("fit.csv", f"fit_{against}.nc", f"fit_{FITTED_MODEL}.nc"))
    refuse_existing([table, reference, fitted], force)
    console.lines(*case_lines(case, f"{FITTED_MODEL}, fitted to {against}"))
    with _fit_progress(console) as report, console.progress(against) as draw:
        done = fit_reduced_model(problem, reference, fitted, force, draw, report)
    write_table(table, done.header, done.rows)
    lines, summary = reduced_fit_report(done)
    console.lines("")
    console.table(summary)
    console.lines("", *lines, *(f"wrote {path}" for path in (table, reference, fitted)))


@contextmanager
def _reported_interruption() -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        typer.echo("interrupted: the runs so far are kept, and the same command goes on with the others", err=True)
        raise typer.Exit(INTERRUPTED) from None


@contextmanager
def _fit_progress(console: Console) -> Iterator[Callable[[FitProgress], None] | None]:
    """Context of a fit; gives what it is to report to."""
    if console.quiet:
        yield None
    elif not console.is_terminal:
        yield _PlainProgress(console)
    else:
        yield lambda progress: typer.echo(f"\r\x1b[K{_progress_line(progress)}", nl=False)
        typer.echo("\r\x1b[K", nl=False)


class _PlainProgress:
    """A line when a stage begins, and every ten seconds."""

    def __init__(self, console: Console) -> None:
        self.console, self.stage, self.last = console, "", 0.0

    def __call__(self, progress: FitProgress) -> None:
        now = time.monotonic()
        if progress.stage != self.stage or now - self.last > 10.0:
            self.stage, self.last = progress.stage, now
            self.console.lines(_progress_line(progress))


def _progress_line(progress: FitProgress) -> str:
    return (
        f"{progress.stage}: {progress.runs} parameter sets, {progress.elapsed:.0f} s, misfit "
        f"{progress.misfit:.4g} of the noise or size"
    )
