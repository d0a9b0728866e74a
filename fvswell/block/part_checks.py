"""Whether the parts of the boundary of a block go together: what is wrong with them, in sentences."""

from __future__ import annotations

import difflib
import math
from collections import Counter
from collections.abc import Iterator, Sequence

from fvswell.block.parts import SAME_PLACE
from fvswell.boundary.checks import condition_problems
from fvswell.boundary.parts import CONDUCTING, HELD, Part
from fvswell.boundary.sides import EDGE_AXIS, EDGES

__all__ = ["check_parts"]

_PLATES = ("straight", "glued-plate")
_NEIGHBOURS = {edge: tuple(other for other in EDGES if EDGE_AXIS[other] != EDGE_AXIS[edge]) for edge in EDGES}


def check_parts(rings: bool, extent: tuple[float, float], parts: Sequence[Part]) -> list[str]:
    """What is wrong with the parts of the boundary of a block, in sentences; an empty list if nothing is.

    Parameters
    ----------
    rings
        Whether the block is axisymmetric: its left edge is then the axis.
    extent
        Size of the stress-free solid along x and y, mm.
    parts
        In any order; together they have to cover every edge once.
    """
    problems = list(_naming(parts))
    if problems:
        return problems
    lengths = {edge: extent[1 - EDGE_AXIS[edge]] for edge in EDGES}
    for edge in EDGES:
        problems += _coverage(edge, lengths[edge], [part for part in parts if part.edge == edge])
    problems += _axis(rings, parts)
    problems += _meetings(lengths, parts)
    if free := _rigid_motions(rings, parts):
        problems.append(
            f"nothing keeps the block from {' or '.join(free)}: make a part fixed or a roller (plates move)"
        )
    return problems + condition_problems(parts)


def _naming(parts: Sequence[Part]) -> Iterator[str]:
    for name, count in Counter(part.name for part in parts).items():
        if count > 1:
            yield f"{count} parts are called {name}: every part needs a name of its own"
    for part in parts:
        if part.edge not in EDGES:
            nearest = difflib.get_close_matches(part.edge, EDGES, 1)
            guess = f"; did you mean {nearest[0]}?" if nearest else ""
            yield f'the part {part.name} lies on the edge "{part.edge}": edges are {", ".join(EDGES)}{guess}'


def _coverage(edge: str, length: float, parts: list[Part]) -> Iterator[str]:
    """Parts of one edge that are empty, lead beyond it, overlap, or leave gaps."""
    if not parts:
        yield f"no part covers the {edge} edge"
        return
    slack, reached, last = SAME_PLACE * length, 0.0, ""
    for part in sorted(parts, key=lambda part: part.start):
        end = min(part.end, length)
        if part.start < -slack or length + slack < part.end < math.inf:
            yield (
                f"the part {part.name} goes from {part.start:g} mm to {part.end:g} mm, but the {edge} edge from 0 to "
                f"{length:g} mm"
            )
        elif end - part.start <= slack:
            yield f"the part {part.name} begins at {part.start:g} mm and ends at {end:g} mm: it has no length"
        if part.start > reached + slack:
            yield f"no part covers the {edge} edge from {reached:g} mm to {min(part.start, length):g} mm"
        elif part.start < reached - slack:
            yield (
                f"the parts {last} and {part.name} overlap on the {edge} edge from {part.start:g} mm to "
                f"{min(reached, end):g} mm"
            )
        if end > reached:
            reached, last = end, part.name
    if reached < length - slack:
        yield f"no part covers the {edge} edge from {reached:g} mm to {length:g} mm"


def _axis(rings: bool, parts: Sequence[Part]) -> Iterator[str]:
    for part in parts:
        if (
            rings
            and part.edge == "left"
            and (part.mechanical != "roller" or part.open or part.electrical in CONDUCTING)
        ):
            yield f"the part {part.name} lies on the axis of the disc: it has to be a roller, closed and insulating"


def _meetings(lengths: dict[str, float], parts: Sequence[Part]) -> Iterator[str]:
    """Plates that meet what holds their ends."""
    for part in parts:
        if part.mechanical not in _PLATES:
            continue
        for other in parts:
            along = other.edge == part.edge and any(
                abs(first.end - second.start) <= SAME_PLACE * lengths[part.edge]
                for first, second in ((part, other), (other, part))
            )
            corner = other.edge in _NEIGHBOURS[part.edge] and _meet(lengths, part, other)
            if (other.mechanical == "fixed" and (along or corner)) or (other.mechanical == "roller" and along):
                kind = "straight" if part.mechanical == "straight" else "a glued plate"
                held = "fixed" if other.mechanical == "fixed" else "a roller on the same edge"
                yield f"the part {part.name} is {kind}, but ends at the part {other.name}, which is {held}"


def _meet(lengths: dict[str, float], part: Part, other: Part) -> bool:
    """Whether parts of two edges meet at the corner between the edges."""

    def reaches(first: Part, second: Part) -> bool:
        length = lengths[first.edge]
        at_start = second.edge in ("left", "bottom")
        return bool(first.start <= SAME_PLACE * length if at_start else first.end >= (1.0 - SAME_PLACE) * length)

    return reaches(part, other) and reaches(other, part)


def _rigid_motions(rings: bool, parts: Sequence[Part]) -> list[str]:
    """Rigid motions that the conditions leave open, each alone."""
    fixed = any(part.mechanical == "fixed" for part in parts)
    held = [fixed or any(part.mechanical in HELD and EDGE_AXIS[part.edge] == axis for part in parts) for axis in (0, 1)]
    turning = any(part.mechanical != "free" for part in parts)
    motions = [] if held[0] or rings else ["moving along x"]
    motions += [] if held[1] else ["moving along the axis" if rings else "moving along y"]
    return motions + ([] if turning or rings else ["turning"])
