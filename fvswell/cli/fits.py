"""Commands about measured curves: fits, data files, and plans of experiments."""

from __future__ import annotations

import re
import time
import tomllib
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
        "case": tomllib.loads(case.to_toml()),
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


def _planned_progress(console: Console) -> Callable[[FitProgress], None]:
    """What a plan reports to: a line for each protocol."""
    seen: list[str] = []

    def report(progress: FitProgress) -> None:
        if progress.stage not in seen:
            seen.append(progress.stage)
            console.lines(f"{len(seen)}: {progress.stage}")

    return report


def _progress_line(progress: FitProgress) -> str:
    return (
        f"{progress.stage}: {progress.runs} parameter sets, {progress.elapsed:.0f} s, misfit "
        f"{progress.misfit:.4g} of the noise or size"
    )


@app.command()
@reported_errors
def data(
    file: Annotated[
        Path, typer.Argument(metavar="DATA", help="A data file: text with columns, or of a Mach-1 tester.")
    ],
    time_column: Annotated[
        str | None, typer.Option("--time", metavar="COLUMN", help="Column with the times; the first without it.")
    ] = None,
    drive: Annotated[
        str | None, typer.Option(metavar="COLUMN", help="Column with what was controlled, such as the position.")
    ] = None,
    value: Annotated[
        str | None, typer.Option(metavar="COLUMN", help="Column with what was measured, such as the force.")
    ] = None,
    height: Annotated[str | None, typer.Option(metavar='"1.5 mm"', help="Thickness of the sample.")] = None,
    radius: Annotated[
        str | None, typer.Option(metavar='"2.4 mm"', help="Radius of a disc in unconfined compression.")
    ] = None,
    output: Directory = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Show a data file, and begin a case and a fit file for it.

    Prints its columns and the ramps and holds of its drive; writes a figure, case.toml and fit.toml to DIR.
    """
    import os

    from fvswell.case.case import Case
    from fvswell.fitting.data import read_data
    from fvswell.fitting.results import write_text
    from fvswell.fitting.starter import recording_of, starter_case, starter_fit
    from fvswell.reporting.data_report import about_lines, column_table, data_figure, stage_table
    from fvswell.reporting.plots import save_figure
    from fvswell.results.file import refuse_existing

    sizes = _sizes({"--height": height, "--radius": radius})
    directory = output_directory(file, output)
    case_path, fit_path, *figures = (directory / name for name in ("case.toml", "fit.toml", "data.png", "data.pdf"))
    refuse_existing([case_path, fit_path, *figures], force)
    read = read_data(file)
    recording = recording_of(read, time_column, drive, value)
    case_text = starter_case(recording, *sizes)
    Case.from_toml(case_text, str(case_path))
    console = Console(quiet)
    console.lines(*about_lines(read), "")
    console.table(column_table(read))
    console.lines("")
    if recording.stages:
        console.table(stage_table(recording))
    else:
        console.lines(f"{recording.drive} is no row of ramps and holds: the case takes it as it was recorded")
    for path in figures:
        save_figure(data_figure(recording), path)
    write_text(case_path, case_text)
    relative = os.path.relpath(file.absolute(), directory.absolute())
    write_text(fit_path, starter_fit(recording, case_path.name, relative, sizes[1]))
    console.lines("", *(f"wrote {path}" for path in (case_path, fit_path, *figures)))
    console.lines(f"try: fvswell check {case_path}, fvswell fit {fit_path}, once both say what the sample was")


def _sizes(given: dict[str, str | None]) -> tuple[float | None, float | None]:
    """Height and radius, mm."""
    from fvswell.case.values import Quantity
    from fvswell.units import number_or_text

    found: list[float | None] = []
    problems = []
    for name, text in given.items():
        try:
            found.append(None if text is None else Quantity("length", above=0.0).number(number_or_text(text)))
        except ValueError as error:
            problems.append(Problem(name, str(text), str(error)))
    if problems:
        raise CaseError(problems, "data")
    return found[0], found[1]


@app.command()
@reported_errors
def plan(
    case_files: Annotated[list[Path], typer.Argument(metavar="CASE...", help="Candidate protocols, as cases.")],
    parameters: Annotated[
        list[str] | None,
        typer.Option("--parameter", metavar="KEY[=LOW..HIGH]", help="What is to be found. May be given many times."),
    ] = None,
    quantities: Annotated[
        list[str] | None,
        typer.Option("--quantity", metavar="NAME", help="What is measured: a history of the result. Many times."),
    ] = None,
    noise: Annotated[
        list[str] | None,
        typer.Option("--noise", metavar='"1 kPa"', help="Standard deviation of the noise of each quantity."),
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=V1,V2,...", help="Values to try in every case, such as ramp times. Many times."),
    ] = None,
    every: Annotated[
        str | None, typer.Option(metavar='"1 s"', help="Time between points; 200 points of each protocol without it.")
    ] = None,
    budget: Annotated[str | None, typer.Option(metavar='"2 h"', help="Time that there is for experiments.")] = None,
    confidence: Annotated[float, typer.Option(min=0.01, max=0.999, help="Of the intervals.")] = 0.9,
    settings: Settings = None,
    processes: Processes = None,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Directory to write to.")] = Path(
        "output/plan"
    ),
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Find the experiment that would tell most, before it is done.

    Prints the intervals that a fit would reach in each protocol, and writes plan.csv and a figure to DIR.
    """
    from fvswell.fitting.candidates import candidate_problems, read_variation, varied_cases
    from fvswell.fitting.planning import plan as make_plan
    from fvswell.fitting.schema import ParameterTable
    from fvswell.reporting.plan_report import plan_figure, plan_lines, plan_table, write_plan
    from fvswell.reporting.plots import save_figure
    from fvswell.results.file import refuse_existing
    from fvswell.units import number_or_text, parse

    missing = {"--parameter": parameters, "--quantity": quantities, "--noise": noise}
    problems = [Problem(name, "", "missing; must be given") for name, given in missing.items() if not given]
    if len(quantities or []) != len(noise or []) and not problems:
        problems.append(Problem("--noise", ", ".join(noise or []), "must be given once for each --quantity"))
    times: dict[str, float | None] = {}
    for name, text in (("--every", every), ("--budget", budget)):
        try:
            times[name] = None if text is None else parse(number_or_text(text), "time")
        except ValueError as error:
            problems.append(Problem(name, str(text), str(error)))
    if problems:
        raise CaseError(problems, "plan")
    table, *figures = (output / name for name in ("plan.csv", "plan.png", "plan.pdf"))
    refuse_existing([table, *figures], force)
    sought = [ParameterTable.model_validate(_parameter(text)) for text in parameters or []]
    cases = {path.stem: read_case(path, settings) for path in case_files}
    candidates = varied_cases(cases, [read_variation(text) for text in vary or []])
    planned = candidate_problems(candidates, sought, quantities or [], noise or [], times["--every"], confidence)
    console = Console(quiet)
    console.lines(
        f"{len(planned)} protocols, {', '.join(each.name for each in sought)} from {', '.join(quantities or [])}"
    )
    with _reported_interruption():
        report = None if quiet else _planned_progress(console)
        found = make_plan(planned, times["--budget"] or float("inf"), processes, report)
    for path in figures:
        save_figure(plan_figure(found), path)
    write_plan(table, found)
    console.lines("")
    console.table(plan_table(found))
    console.lines("", *plan_lines(found, confidence), *(f"wrote {path}" for path in (table, *figures)))
