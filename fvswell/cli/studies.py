"""Commands about many columns: studies, the rules they give, advice by them, the paper's figures and sensitivity."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fvswell.case.errors import CaseError, Problem
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
from fvswell.reporting.console import Console, TextTable

if TYPE_CHECKING:
    from fvswell.study.run import StudyProgress

__all__ = ["app"]

app = typer.Typer(rich_markup_mode=None)

Processes = Annotated[
    int | None, typer.Option(metavar="N", min=1, help="Processes on this machine; one for each core without it.")
]


@app.command()
@reported_errors
def study(
    study_file: Annotated[Path, typer.Argument(metavar="STUDY", help="A study (.toml).")],
    output: Directory = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Dask scheduler to compute on, such as tcp://127.0.0.1:8786."),
    ] = None,
    processes: Processes = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Run two models over many parameter sets.

    Writes how far apart they are to DIR/study.nc. Interrupted, it goes on where it was when it is called again.
    """
    from fvswell.results.file import refuse_existing
    from fvswell.study.run import run_study
    from fvswell.study.study import load_study

    path = output_directory(study_file, output) / "study.nc"
    refuse_existing([path], force)
    console = Console(quiet)
    whole = load_study(study_file)
    console.lines(whole.table.title, f"  {len(whole.runs)} runs of {whole.models[0]} and {whole.models[1]}")
    with _reported_interruption(), _study_progress(console) as report:
        outcome = run_study(whole, path, scheduler=scheduler, processes=processes, replace=force, report=report)
    failed = f", {outcome.runs - outcome.complete} without a result (see run_status)" * (
        outcome.complete < outcome.runs
    )
    console.lines(
        f"{outcome.complete} of {outcome.runs} runs complete{failed}", f"{outcome.elapsed:.0f} s, wrote {path}"
    )


@app.command()
@reported_errors
def rules(
    result: Annotated[Path, typer.Argument(metavar="STUDY", help="Result of a study (.nc).")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="DIR", help="Directory to write to; the result's without it."),
    ] = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Judge the paper's rule and the predictor by a study.

    Prints tables and writes rules.json, rules.csv (every point), rules.png and rules.pdf to DIR.
    """
    from fvswell.analysis.prediction_accuracy import assess
    from fvswell.analysis.rules import paper_fits
    from fvswell.reporting.plots import save_figure
    from fvswell.reporting.rules_report import rules_figure, rules_tables, source_of, write_points, write_rules
    from fvswell.results.file import refuse_existing
    from fvswell.study.file import read_study
    from fvswell.study.points import study_points

    directory = output or result.parent
    numbers, table, *figures = (directory / f"rules.{suffix}" for suffix in ("json", "csv", "png", "pdf"))
    refuse_existing([numbers, table, *figures], force)
    dataset = read_study(result)
    points = study_points(dataset)
    fits, assessment = paper_fits(points), assess(points)
    figure = rules_figure(points, fits, assessment)
    for path in figures:
        save_figure(figure, path)
    write_rules(numbers, dataset, fits, assessment)
    write_points(table, points, fits, assessment)
    console = Console(quiet)
    console.lines(source_of(dataset))
    for each in rules_tables(points, fits, assessment):
        console.lines("")
        console.table(each)
    console.lines("", *(f"wrote {path}" for path in (numbers, table, *figures)))


@app.command()
@reported_errors
def advise(case_file: CaseFile, settings: Settings = None) -> None:
    """Say whether biphasic-swelling will do, without a run."""
    from fvswell.analysis.advice import advise as advise_on
    from fvswell.reporting.advice_report import advice_lines, advice_tables
    from fvswell.reporting.reports import case_lines

    case = read_case(case_file, settings)
    advice = advise_on(case)
    console = Console()
    console.lines(*case_lines(case, "biphasic-swelling or electrochemical?"))
    print_warnings(case)
    for table in advice_tables(advice):
        console.lines("")
        console.table(table)
    console.lines("", *advice_lines(advice))


@app.command()
@reported_errors
def paper(
    directory: Annotated[
        Path, typer.Argument(metavar="[DIR]", help="Directory with compression.toml and swelling.toml.")
    ] = Path("cases/paper"),
    sweep: Annotated[Path, typer.Option(metavar="STUDY", help="The study of tissue properties.")] = Path(
        "cases/studies/paper.toml"
    ),
    block: Annotated[Path, typer.Option(metavar="CASE", help="The two-dimensional case.")] = Path(
        "cases/plane_strain.toml"
    ),
    processes: Processes = None,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Directory to write to.")] = Path(
        "output/paper"
    ),
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Draw figures 3 to 9 of Wilson et al. (2005) anew.

    Shows what the paper reports beside what comes out, and writes the figures (.png and .pdf), paper.csv and study.nc,
    the result of the sweep, to output/paper. A sweep that exists already is not run again.
    """
    from fvswell.case.case import load_case
    from fvswell.paper.claims import claims, write_claims
    from fvswell.paper.figures import FIGURES, paper_figures
    from fvswell.paper.reproduction import paper_results
    from fvswell.reporting.plots import save_figure
    from fvswell.results.file import refuse_existing
    from fvswell.study.study import load_study

    paths = [output / f"{name}.{suffix}" for name in FIGURES for suffix in ("png", "pdf")]
    table = output / "paper.csv"
    refuse_existing([*paths, table], force)
    console = Console(quiet)
    files = (directory / "compression.toml", directory / "swelling.toml", block)
    compression, swelling, glued = (load_case(file) for file in files)
    whole = load_study(sweep)
    with _reported_interruption(), _study_progress(console) as report:
        results = paper_results(compression, swelling, glued, whole, output / "study.nc", processes, report)
    for name, figure in paper_figures(results).items():
        for suffix in ("png", "pdf"):
            save_figure(figure, output / f"{name}.{suffix}")
    found = claims(results)
    write_claims(table, found)
    rows = [[claim.subject, claim.paper, claim.here, claim.agrees] for claim in found]
    console.table(TextTable("What the paper reports, and what comes out here", ["", "paper", "here", "agrees"], rows))
    console.lines("", *(f"wrote {path}" for path in (*paths, table)))


@app.command()
@reported_errors
def sensitivity(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="A case, or a study whose parameters and ranges are taken.")
    ],
    spread: Annotated[
        float, typer.Option(min=1.01, help="About a case, values range from a SPREADth to SPREAD times their own.")
    ] = 2.0,
    samples: Annotated[int, typer.Option(min=2, help="Base sample of the predictor, a power of two.")] = 1024,
    model_samples: Annotated[
        int, typer.Option(min=0, help="Base sample of the models, a power of two; 0 does not run them.")
    ] = 64,
    processes: Processes = None,
    output: Directory = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Find which parameters decide how far the models are apart.

    Sobol indices, by the predictor and, from fewer points, by the models themselves. Each base point takes as many runs
    as there are parameters, and two. Prints tables and writes sensitivity.csv, .png and .pdf to DIR.
    """
    from fvswell.analysis.sensitivity import read_ranges
    from fvswell.analysis.sensitivity import sensitivity as indices
    from fvswell.reporting.plots import save_figure
    from fvswell.reporting.sensitivity_report import sensitivity_figure, sensitivity_tables, write_sensitivity
    from fvswell.results.file import refuse_existing

    _require_powers_of_two({"--samples": samples, "--model-samples": model_samples})
    directory = output_directory(file, output)
    table, *figures = (directory / f"sensitivity.{suffix}" for suffix in ("csv", "png", "pdf"))
    refuse_existing([table, *figures], force)
    console = Console(quiet)
    results = indices(
        read_ranges(file, spread), samples, model_samples, processes,
        lambda protocol, done, total: console.lines(f"{protocol}: {done} of {total} runs of both models"),
    )  # fmt: skip
    figure = sensitivity_figure(results)
    for path in figures:
        save_figure(figure, path)
    write_sensitivity(table, results)
    for each in sensitivity_tables(results):
        console.lines("")
        console.table(each)
    console.lines("", *(f"wrote {path}" for path in (table, *figures)))


def _require_powers_of_two(options: dict[str, int]) -> None:
    problems = [
        Problem(name, str(value), "must be a power of two, such as 64 or 1024: other samples are not balanced")
        for name, value in options.items()
        if value & (value - 1)
    ]
    if problems:
        raise CaseError(problems, "sensitivity")


@contextmanager
def _reported_interruption() -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        typer.echo("interrupted: what is finished is kept, and the same command goes on with the others", err=True)
        raise typer.Exit(INTERRUPTED) from None


@contextmanager
def _study_progress(console: Console) -> Iterator[Callable[[StudyProgress], None] | None]:
    """Context of a study; gives what it is to report to."""
    if console.quiet:
        yield None
    elif not console.is_terminal:
        yield lambda progress: console.lines(_progress_line(progress))
    else:
        yield lambda progress: typer.echo(f"\r\x1b[K{_progress_line(progress)}", nl=False)
        typer.echo()


def _progress_line(progress: StudyProgress) -> str:
    line = f"{progress.done} of {progress.total} runs, {progress.elapsed:.0f} s"
    return line if progress.remaining is None else f"{line}, {progress.remaining:.0f} s left"
