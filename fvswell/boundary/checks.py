"""What is wrong with the conditions on the parts of a body, whatever its geometry, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from fvswell.boundary.parts import CONDUCTING, Part

__all__ = ["part_problems"]


def part_problems(parts: Sequence[Part]) -> Iterator[tuple[Part | None, str]]:
    """Contradictions between conditions: the part that each is about, or None, and what is wrong.

    Parameters
    ----------
    parts
        All parts of the boundary of a body.
    """
    if not any(part.open for part in parts):
        yield None, "no part is open to a bath: at least one has to be"
    for part in parts:
        if part.open and part.electrode != "bath":
            yield part, "is open to a bath, which carries the current: an electrode in the wall is for closed parts"
        elif not part.open and part.electrical in CONDUCTING and part.electrode == "bath":
            yield part, f'is closed and {part.electrical}: it needs electrode = "cation" or "anion", or bath = "open"'
        elif part.electrode != "bath" and part.electrical not in CONDUCTING:
            yield part, f"has an electrode but no current: give electrical as one of {', '.join(CONDUCTING)}"
    conducting = [part for part in parts if part.electrical in CONDUCTING]
    driven = [part for part in conducting if part.electrical == "current"]
    if driven and not any(part.electrical in ("grounded", "potential") for part in conducting):
        yield driven[0], "is given a current, which has no way back: ground another part"
    if conducting and all(part.electrical == "floating" for part in conducting):
        yield conducting[0], "floats, and so does every other part: ground one, which is the reference of the potential"
