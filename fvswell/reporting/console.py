"""How the commands print: lines, tables and progress.

On a terminal there are drawn tables and a progress line; elsewhere plain aligned text and a line at every
tenth of the run, so that a log can be read.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

import typer

if TYPE_CHECKING:
    from fvswell.simulation.run import Progress

__all__ = ["Console", "TextTable", "percent"]

_PLAIN_LINES = 10  # in a run whose output is no terminal


class TextTable(NamedTuple):
    """A table to print; the first column is text, the others are numbers."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]


class Console:
    """Prints for a command; a quiet one prints nothing."""

    def __init__(self, quiet: bool = False) -> None:
        self.quiet = quiet
        self.is_terminal = sys.stdout.isatty()

    def lines(self, *lines: str) -> None:
        """Print lines."""
        if not self.quiet:
            typer.echo("\n".join(lines))

    def table(self, table: TextTable) -> None:
        """Print a table."""
        if self.quiet:
            return
        if self.is_terminal:
            _print_rich_table(table)
        else:
            typer.echo("\n".join([table.title, *_aligned([table.header, *table.rows])]))

    @contextmanager
    def progress(self, model: str) -> Iterator[Callable[[Progress], None]]:
        """Context of a run; gives what the run is to report to."""
        if self.quiet:
            yield lambda progress: None
        elif self.is_terminal:
            with _rich_progress(model) as report:
                yield report
        else:
            yield _PlainProgress(model)


class _PlainProgress:
    """A line at every tenth of a run."""

    def __init__(self, model: str) -> None:
        self.model, self.lines = model, 0
        self.start: tuple[float, float] | None = None  # when, and how much of the run there was

    def __call__(self, progress: Progress) -> None:
        share = progress.time / progress.phase_ends[-1]
        if self.start is None:
            self.start = time.perf_counter(), share
            self.lines = int(share * _PLAIN_LINES + 1e-9)
        if share * _PLAIN_LINES < self.lines + 1 - 1e-9:
            return
        self.lines = int(share * _PLAIN_LINES + 1e-9)
        began, before = self.start
        left = (time.perf_counter() - began) * (1.0 - share) / (share - before)
        typer.echo(
            f"{self.model}: {100.0 * share:3.0f} %, t = {progress.time:.5g} s, "
            f"strain {percent(progress.strain)}, {max(left, 0.0):.0f} s left"
        )


@contextmanager
def _rich_progress(model: str) -> Iterator[Callable[[Progress], None]]:
    from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    state = TextColumn("t = {task.fields[time]:.5g} of {task.total:.5g} s, strain {task.fields[strain]}")
    columns = (TextColumn("{task.description}"), BarColumn(), state, TimeRemainingColumn())
    with Bar(*columns, transient=True) as bar:
        task = bar.add_task(model, total=None, time=0.0, strain="", visible=False)

        def report(progress: Progress) -> None:
            bar.update(
                task, completed=progress.time, total=progress.phase_ends[-1], visible=True,
                time=progress.time, strain=percent(progress.strain),
            )  # fmt: skip

        yield report


def _print_rich_table(content: TextTable) -> None:
    from rich.console import Console as RichConsole
    from rich.table import Table
    from rich.text import Text

    table = Table(title=Text(content.title), title_justify="left")
    for index, name in enumerate(content.header):
        table.add_column(Text(name), justify="right" if index else "left")
    for row in content.rows:
        table.add_row(*(Text(cell) for cell in row))
    RichConsole().print(table)


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.rjust(width) if index else cell.ljust(width)
            for index, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def percent(value: float) -> str:
    """A fraction in percent with its sign; a dash where there is none."""
    return "-" if value != value else f"{100.0 * value:+.3f} %"
