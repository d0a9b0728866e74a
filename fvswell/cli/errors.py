"""What the commands do about errors: a line on the standard error stream, and an exit code."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec

import typer

from fvswell.case.errors import CaseError
from fvswell.errors import OutputError, SolverError

__all__ = ["BAD_INPUT", "INTERRUPTED", "SOLVER_STOPPED", "reported_errors"]

BAD_INPUT, SOLVER_STOPPED, INTERRUPTED = 2, 3, 130

_Parameters = ParamSpec("_Parameters")


def reported_errors(command: Callable[_Parameters, None]) -> Callable[_Parameters, None]:
    """Turn the errors that a user can do something about into a message and an exit code."""

    @functools.wraps(command)
    def wrapped(*args: _Parameters.args, **kwargs: _Parameters.kwargs) -> None:
        try:
            command(*args, **kwargs)
        except (CaseError, OutputError) as error:
            _stop(str(error), BAD_INPUT)
        except SolverError as error:
            _stop(str(error), SOLVER_STOPPED)
        except MemoryError:
            _stop("out of memory: fewer cells, steps or output times need less", SOLVER_STOPPED)
        except KeyboardInterrupt:
            _stop("interrupted", INTERRUPTED)

    return wrapped


def _stop(message: str, code: int) -> None:
    typer.echo("\n".join(f"error: {line}" for line in message.splitlines()), err=True)
    raise typer.Exit(code)
