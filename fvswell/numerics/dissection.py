"""Order of elimination on a grid: its two halves before the line of unknowns that separates them, and so on."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from fvswell.compiled import kernel
from fvswell.physics.tissue import Array

__all__ = ["Part", "nested_dissection"]

_UNDIVIDED = 100  # unknowns: smaller parts are not cut again (the time hardly depends on it from 60 to 150)


class Part(NamedTuple):
    """Unknowns that are eliminated together."""

    unknowns: Array
    children: list[int]  # indices of the parts that it separates; they come before it


class _Cut(NamedTuple):
    before: Array
    after: Array
    separating: Array


def nested_dissection(graph: sparse.csr_array, places: Array) -> list[Part]:
    """Divide the unknowns of a grid into parts, in the order of their elimination (George 1973).

    Parameters
    ----------
    graph
        Has an entry where two unknowns appear together in an equation; symmetric.
    places
        Of the unknowns, ``(2, unknowns)``; nan for those that belong to no single place, which come last.

    Returns
    -------
    list of Part
        Every unknown is in one of them. Two unknowns of the graph that appear together are in one part, or one is in
        a descendant of the other's part.
    """
    parts: list[Part] = []
    behind = np.zeros(graph.shape[0], dtype=bool)  # the unknowns before a cut

    def separated(before: Array, after: Array) -> _Cut:
        separating = np.empty(len(after), dtype=bool)
        behind[before] = True
        _find_neighbours(graph.indptr, graph.indices, after, behind, separating)
        behind[before] = False
        return _Cut(before, after[~separating], after[separating])

    def cut(unknowns: Array) -> _Cut | None:
        """Cut before or behind the middle line of a part, whichever takes the shorter separator."""
        axis = np.ptp(places[:, unknowns], axis=1).argmax()
        along, across = places[axis, unknowns], places[1 - axis, unknowns]
        line = np.sort(along)[len(along) // 2]
        sides = [side for side in (along < line, along <= line) if side.any() and not side.all()]
        if not sides:
            return None
        # along a line its unknowns are in order, so that those which border on a part are consecutive
        ordered = np.lexsort((along, across))
        cuts = [separated(unknowns[ordered][side[ordered]], unknowns[ordered][~side[ordered]]) for side in sides]
        return min(cuts, key=lambda found: len(found.separating))

    def add(unknowns: Array, children: list[int]) -> list[int]:
        if not len(unknowns):
            return children
        parts.append(Part(unknowns, children))
        return [len(parts) - 1]

    def divide(unknowns: Array) -> list[int]:
        found = cut(unknowns) if len(unknowns) > _UNDIVIDED else None
        if found is None:
            return add(unknowns, [])
        return add(found.separating, [*divide(found.before), *divide(found.after)])

    placed = np.isfinite(places).all(axis=0)
    add(np.flatnonzero(~placed), divide(np.flatnonzero(placed)))
    return parts


@kernel
def _find_neighbours(begin: Any, columns: Any, unknowns: Any, marked: Any, found: Any) -> Any:
    """Which of some unknowns appear together with any that is marked."""
    for i in range(len(unknowns)):
        found[i] = False
        for entry in range(begin[unknowns[i]], begin[unknowns[i] + 1]):
            if marked[columns[entry]]:
                found[i] = True
                break
