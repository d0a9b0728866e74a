"""The command ``fvswell``. Commands import what they need when they run, so that help answers at once."""

from __future__ import annotations

import gc
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fvswell.case.errors import CaseError, Problem
from fvswell.cli import blocks, fits, studies
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
from fvswell.cli.errors import INTERRUPTED, reported_errors
from fvswell.errors import OutputError, SolverError
from fvswell.reporting.console import Console
from fvswell.version import __version__

if TYPE_CHECKING:
    from fvswell.case.case import Case
    from fvswell.simulation.run import Outcome, Progress

__all__ = ["app", "main"]

_GARBAGE_THRESHOLD = 100_000  # imports make as many objects, which all stay: to look for garbage among them takes 0.1 s

app = typer.Typer(
    help="Swelling and compression of soft, charged, hydrated tissues by three models: biphasic, "
    "biphasic-swelling and electrochemical.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help takes half the time
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main() -> None:
    """Run the command line."""
    gc.set_threshold(_GARBAGE_THRESHOLD)
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(errors="replace")  # type: ignore[union-attr]  # titles in any script, on any terminal
    app(prog_name="fvswell")


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"fvswell {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


@app.command()
@reported_errors
def run(
    case_file: CaseFile,
    model: Annotated[
        str | None,
        typer.Option(help="biphasic, biphasic-swelling or electrochemical; the case's own without it."),
    ] = None,
    settings: Settings = None,
    start_from: Annotated[
        Path | None,
        typer.Option("--from", metavar="RESULT", help="Start where this result ended, not from equilibrium."),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with a run that was interrupted.")] = False,
    output: Directory = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Simulate a case and write its result to DIR/MODEL.nc."""
    from fvswell.reporting.reports import case_lines
    from fvswell.results.file import refuse_existing

    case = read_case(case_file, settings, model)
    path = output_directory(case_file, output) / f"{case.model}.nc"
    if not resume:
        refuse_existing([path], force)
    console = Console(quiet)
    console.lines(*case_lines(case))
    print_warnings(case)
    try:
        _simulate(case, path, force, console, start_from=start_from, resume=resume)
    except KeyboardInterrupt:
        typer.echo("interrupted: what there is is kept, and the same command with --resume goes on", err=True)
        raise typer.Exit(INTERRUPTED) from None


@app.command()
@reported_errors
def check(
    case_file: CaseFile,
    settings: Settings = None,
    strict: Annotated[bool, typer.Option("--strict", help="Fail on warnings as well.")] = False,
    figure: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Draw the body with its parts, and what acts on them: .png, .pdf or .svg."),
    ] = None,
) -> None:
    """Check a case: all that is wrong, or derived numbers."""
    from fvswell.analysis.characteristics import characteristics
    from fvswell.reporting.reports import case_lines, characteristics_table, states_table

    case = read_case(case_file, settings)
    console = Console()
    console.lines(*case_lines(case), "")
    numbers = characteristics(case)
    console.table(states_table(numbers.states))
    console.lines("")
    table, lines = characteristics_table(case, numbers)
    console.table(table)
    console.lines("", *lines)
    warnings = print_warnings(case)
    if figure is not None:
        _draw_case(case, figure)
        console.lines(f"wrote {figure}")
    if strict and warnings:
        raise CaseError([Problem("", "", "has warnings, and --strict lets none pass")], case.source)
    console.lines(f"{case_file}: is valid")


@app.command()
@reported_errors
def new(
    name: Annotated[Path, typer.Argument(metavar="NAME", help="Name of the case; NAME.toml is written.")],
    tissue: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Properties of a tissue from the literature, such as annulus-fibrosus."),
    ] = None,
    like: Annotated[
        str | None, typer.Option(metavar="EXPERIMENT", help="A shipped case, such as indentation or stress-relaxation.")
    ] = None,
    force: Force = False,
) -> None:
    """Write a commented case to begin with."""
    from fvswell.case.case import starter_text
    from fvswell.case.shipped import shipped_text
    from fvswell.case.starter import starter_of_tissue

    if like is not None and tissue is not None:
        raise CaseError([Problem("--like", like, "cannot stand beside --tissue")], "new")
    text = starter_text() if tissue is None else starter_of_tissue(tissue)
    text = text if like is None else shipped_text(like)
    path = name if name.suffix == ".toml" else name.with_name(f"{name.name}.toml")
    try:
        with path.open("w" if force else "x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise OutputError(f"{path}: exists already; use --force to replace it") from None
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from None
    Console().lines(f"wrote {path}", f"try: fvswell check {path}, fvswell run {path}, fvswell compare {path}")


@app.command()
@reported_errors
def compare(
    case_file: CaseFile,
    models: Annotated[
        str, typer.Option(metavar="A,B,...", help="Models to compare, separated by commas.")
    ] = "biphasic,biphasic-swelling,electrochemical",
    measured: Annotated[
        str | None,
        typer.Option("--by", metavar="HISTORY", help="What to compare, such as piston_pressure or piston_potential."),
    ] = None,
    settings: Settings = None,
    output: Directory = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Run models of a case and show how far apart they are.

    Prints tables and writes the results, a figure and a table to DIR.
    """
    from fvswell.analysis.comparison import common_durations, compare_results, phase_lengths, with_models
    from fvswell.reporting.block_plots import all_blocks, block_comparison_figure
    from fvswell.reporting.comparison_report import comparison_remarks, comparison_tables
    from fvswell.reporting.plots import comparison_figure, save_figure
    from fvswell.reporting.reports import case_lines
    from fvswell.results.file import refuse_existing
    from fvswell.results.table import write_table

    case = read_case(case_file, settings)
    cases = with_models(case, [name.strip() for name in models.split(",")])
    directory = output_directory(case_file, output)
    paths = {name: directory / f"{name}.nc" for name in cases}
    table, *figures = (directory / f"comparison.{suffix}" for suffix in ("csv", "png", "pdf"))
    refuse_existing([*paths.values(), table, *figures], force)
    console = Console(quiet)
    console.lines(*case_lines(case, ", ".join(cases)))
    durations = common_durations(cases)
    results = {}
    for name, each in cases.items():
        result = results[name] = _simulate(each, paths[name], force, console, durations).dataset()
        durations = phase_lengths(result)
    comparison = compare_results(results, measured)
    write_table(table, comparison.header, comparison.rows)
    draw = block_comparison_figure if all_blocks(results) else comparison_figure
    for figure in figures:
        save_figure(draw(comparison), figure)
    for each_table in comparison_tables(comparison):
        console.lines("")
        console.table(each_table)
    console.lines("", *comparison_remarks(comparison), *(f"wrote {path}" for path in (table, *figures)))


@app.command()
@reported_errors
def plot(
    results: Annotated[list[Path], typer.Argument(metavar="RESULT...", help="Results (.nc) to draw.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Figure: .png, .pdf or .svg."),
    ] = None,
    times: Annotated[str | None, typer.Option(metavar='"10 s,1 min"', help="Times of the fields, with units.")] = None,
    variables: Annotated[
        list[str] | None,
        typer.Option("--variable", metavar="NAME", help="Field to draw. May be given many times."),
    ] = None,
) -> None:
    """Draw histories, and fields over depth or the moved grid."""
    from fvswell.reporting.block_plots import all_blocks, block_figure
    from fvswell.reporting.plots import chosen_times, chosen_variables, result_figure, result_labels, save_figure
    from fvswell.results.file import read_result

    datasets = [read_result(path) for path in results]
    labelled = dict(zip(result_labels(results, datasets), datasets, strict=True))
    name = f"{results[0].stem}.png" if len(results) == 1 else "results.png"
    path = output or results[0].with_name(name)
    draw = block_figure if all_blocks(labelled) else result_figure
    figure = draw(labelled, chosen_times(labelled, times), chosen_variables(labelled, variables))
    save_figure(figure, path)
    Console().lines(f"wrote {path}")


@app.command()
@reported_errors
def info(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="A result (.nc).")],
) -> None:
    """Show what is in a result."""
    from fvswell.analysis.cycles import cycles
    from fvswell.case.case import Case
    from fvswell.reporting.reports import (
        case_lines,
        content_table,
        cycle_lines,
        effort_lines,
        phase_table,
        result_lines,
        states_table,
    )
    from fvswell.results.file import read_result
    from fvswell.simulation.sample_states import states_in

    dataset = read_result(result)
    case = Case.from_toml(dataset.attrs["case_toml"], str(result))
    console = Console()
    console.lines(*case_lines(case), *result_lines(dataset), "")
    if states := states_in(dataset.attrs):
        console.table(states_table(states))
        console.lines("")
    console.table(phase_table(dataset, case))
    console.lines("", *effort_lines(dataset), *cycle_lines(cycles(case, dataset)), "")
    console.table(content_table(dataset))


app.add_typer(blocks.app)
app.add_typer(studies.app)
app.add_typer(fits.app)


def _draw_case(case: Case, path: Path) -> None:
    """Draw a case; durations that a run has to find are found."""
    from fvswell.reporting.case_figure import case_figure
    from fvswell.reporting.plots import save_figure
    from fvswell.simulation.relaxation import phase_durations

    save_figure(case_figure(case, phase_durations(case)), path)


def _simulate(
    case: Case,
    path: Path,
    replace: bool,
    console: Console,
    durations: list[float] | None = None,
    start_from: Path | None = None,
    resume: bool = False,
) -> Outcome:
    """Run a case into a file, with progress and a summary; of a run that had to stop as well."""
    from fvswell.analysis.cycles import cycles, has_cycles
    from fvswell.compiled.kernels import report_compilation
    from fvswell.reporting.reports import cycle_lines, duration_line, effort_lines, phase_table
    from fvswell.results.layout import COMPLETE
    from fvswell.simulation.run import simulate

    began = time.perf_counter()
    report_compilation(lambda text: console.lines(f"{text} ..."))
    with console.progress(case.model) as draw:

        def report(progress: Progress) -> None:
            if progress.steps == 0 and durations is None:
                console.lines(duration_line(case, progress.phase_ends))
            draw(progress)

        outcome = simulate(
            case,
            path=path,
            replace=replace,
            durations=durations,
            start_from=start_from,
            resume=resume,
            report=report,
        )
    console.lines("")
    console.table(phase_table(outcome.values, case))
    console.lines(*effort_lines(outcome.values), f"{time.perf_counter() - began:.1f} s, wrote {path}")
    if has_cycles(case):
        console.lines(*cycle_lines(cycles(case, outcome.dataset())))
    if outcome.status != COMPLETE:
        raise SolverError(f"{case.source}: {outcome.status}\n{path}: holds the result until then, marked as partial")
    return outcome
