"""What is wrong with the conditions on the parts of a body, whatever its geometry, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from fvswell.boundary.parts import CONDUCTING, Part

__all__ = ["condition_problems"]


def condition_problems(parts: Sequence[Part]) -> list[str]:
    """Contradictions between the bath and electrical conditions of all parts of a body; an empty list if none."""
    closed = [] if any(part.open for part in parts) else ["no part is open to a bath: at least one has to be"]
    return [*closed, *_electrodes(parts), *_circuit(parts)]


def _electrodes(parts: Sequence[Part]) -> Iterator[str]:
    for part in parts:
        conducts, wall = part.electrical in CONDUCTING, part.electrode != "bath"
        if part.open and wall:
            yield (
                f"the part {part.name} is open and has an electrode for {part.electrode}s: an electrode lies in the "
                "wall of a closed part, as an open one conducts through its bath"
            )
        elif not part.open and conducts and not wall:
            yield (
                f"the part {part.name} is {_condition(part)}, but closed: to conduct it needs an electrode in the "
                "wall, for cations or anions"
            )
        elif wall and not conducts:
            yield (
                f"the part {part.name} has an electrode, but is insulating: make it {', '.join(CONDUCTING[:-1])} or "
                f"{CONDUCTING[-1]}"
            )


def _circuit(parts: Sequence[Part]) -> Iterator[str]:
    """Currents without a return, and potentials without a reference."""
    if any(part.electrical in ("grounded", "potential") for part in parts) or not any(part.open for part in parts):
        return
    given = [part.name for part in parts if part.electrical == "current"]
    floating = [part.name for part in parts if part.electrical == "floating"]
    if given:
        yield (
            f"the current given at {_listed(given)} has no way back: make another part grounded or give its potential"
        )
    elif floating:
        yield f"{_listed(floating)} can float only against a part that is grounded or at a given potential"
    else:
        yield "no part is grounded or at a given potential, so that electric potentials have no reference"


def _condition(part: Part) -> str:
    return f"given a {part.electrical}" if part.electrical in ("current", "potential") else part.electrical


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
