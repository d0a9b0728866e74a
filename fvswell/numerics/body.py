"""What the time integrator asks of a body, be it a column or a block; a body is chosen by its type.

Contents are ``(balances, cells)`` per reference volume; unknowns, ``(unknowns,)``, are whatever the body solves for.
"""

from __future__ import annotations

from typing import Any

from fvswell.compiled import generic

__all__ = ["admissible", "complete_loads", "find_rate", "find_unknowns", "global_strain", "solve_stage"]


@generic
def solve_stage(
    body: Any,
    unknowns: Any,
    contents: Any,
    base: Any,
    duration: Any,
    loads: Any,
    tolerance: Any,
    crossing: Any,
    clock: Any,
    report: Any,
) -> Any:
    """Solve an implicit stage,  contents - base - duration F(contents) = 0.

    Parameters
    ----------
    body
        The column or block.
    unknowns
        A guess, replaced by the solution.
    contents, crossing
        Set to the contents, and to the rates (parts, 3) at which water, anions and cations enter through each part.
    base, duration, loads
        What the stage starts from, its length (s), and the loads at its end; nan for those that are found.
    tolerance
        Largest error of the contents, relative to their natural size, as a mean over the body.
    clock
        Of the state: ``clock[NEWTON]``, how fast the iteration has converged so far, is used and replaced.
    report
        Set; see `fvswell.numerics.state`.

    Returns
    -------
    bool
        Whether the stage has been solved.
    """


@generic
def find_rate(
    body: Any, unknowns: Any, contents: Any, loads: Any, slopes: Any, rate: Any, crossing: Any, clock: Any, report: Any
) -> Any:
    """Find the unknowns that go with given contents and loads, and the rates at which contents change and cross.

    ``unknowns`` holds a guess; ``slopes`` are the derivatives of the loads by time. Returns whether it succeeded.
    """


@generic
def find_unknowns(body: Any, unknowns: Any, contents: Any, loads: Any, slopes: Any) -> Any:
    """Find the unknowns that go with given contents and loads within a step that has been solved.

    ``unknowns`` holds a guess, from the stages of the step with the same weights as the contents; ``slopes`` are the
    derivatives of the loads by time.
    """


@generic
def global_strain(body: Any, unknowns: Any, contents: Any) -> Any:
    """Change of the height over the height of the equilibrated sample."""


@generic
def admissible(body: Any, guess: Any, unknowns: Any) -> Any:
    """Whether a guess of unknowns can be started from: it has to stay near, and leave water in every cell."""


@generic
def complete_loads(body: Any, unknowns: Any, contents: Any, loads: Any) -> Any:
    """Replace the loads that are not prescribed (nan) by what they are found to be."""
