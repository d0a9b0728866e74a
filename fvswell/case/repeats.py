"""Groups of phases that are repeated, written out one after the other before a case is read.

    [[phase]]
    name = "cycle"
    repeat = 20

    [[phase.phase]]
    name = "loading"
    ...

stands for the phases "cycle 1 loading", ..., "cycle 20 ...".
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple, TypeVar

from fvswell.case.errors import CaseError, Finding, Problem, nearest_name, shown
from fvswell.case.reading import read_tables
from fvswell.case.tables import Table
from fvswell.case.values import Count, Name

__all__ = ["read_repeated"]

_Root = TypeVar("_Root", bound=Table)
_KEYS = ("name", "repeat", "phase")
_MOST = 10_000


class _Place(NamedTuple):
    """Where a phase that has been written out comes from."""

    group: int  # number of the group among the phases as given
    phase: int  # number in the group
    round: int  # 0 for phases that stand alone


def read_repeated(
    root: type[_Root], content: Mapping[str, Any], source: str, check: Callable[[_Root], Iterable[Finding]]
) -> _Root:
    """Read raw content as `fvswell.case.reading.read_tables` does, with all groups of phases written out.

    Raises
    ------
    CaseError
        With all that is wrong; what is wrong with a phase of a group in every round is reported once.
    """
    phases = content.get("phase")
    if not isinstance(phases, list | tuple) or not any(map(_is_group, phases)):
        return read_tables(root, content, source, check)
    written: list[Any] = []
    places: list[_Place] = []
    problems: list[Problem] = []
    for index, item in enumerate(phases):
        if not _is_group(item):
            written.append(item)
            places.append(_Place(index, 0, 0))
            continue
        wrong = _group_problems(item, index)
        problems += wrong
        for number in range(1, 2 if wrong else item["repeat"] + 1):
            inner = item.get("phase")
            for place, phase in enumerate(inner if isinstance(inner, list | tuple) else ()):
                written.append(_named(phase, f"{item['name'] if _has_name(item) else 'group'} {number}"))
                places.append(_Place(index, place, number))
    try:
        table = read_tables(root, {**content, "phase": written}, source, check)
    except CaseError as error:
        raise CaseError([*problems, *_once(error.problems, written, places)], source) from None
    if problems:
        raise CaseError(problems, source)
    return table


def _is_group(item: Any) -> bool:
    return isinstance(item, Mapping) and ("repeat" in item or "phase" in item)


def _has_name(group: Mapping[str, Any]) -> bool:
    try:
        return bool(Name()._read(group.get("name")))
    except ValueError:
        return False


def _named(phase: Any, prefix: str) -> Any:
    if not isinstance(phase, Mapping) or not isinstance(phase.get("name"), str):
        return phase
    return {**phase, "name": f"{prefix} {phase['name']}"}


def _group_problems(group: Mapping[str, Any], index: int) -> list[Problem]:
    """What is wrong with a group itself."""
    place = f"phase[{group['name'] if isinstance(group.get('name'), str) else index}]"
    problems = []
    for key, value in group.items():
        if key not in _KEYS:
            near = nearest_name(key, _KEYS)
            hint = f"did you mean {near}?" if near else "loads and durations are given in each [[phase.phase]]"
            problems.append(Problem(f"{place}.{key}", shown(value), f"is no key of a group of phases; {hint}"))
    readers = {"name": Name()._read, "repeat": Count(1, _MOST)._read, "phase": _phases}
    for key, read in readers.items():
        if key not in group:
            problems.append(Problem(f"{place}.{key}", "", f"missing; {_MISSING[key]}"))
            continue
        try:
            read(group[key])
        except ValueError as error:
            problems.append(Problem(f"{place}.{key}", shown(group[key]), str(error)))
    return problems


_MISSING = {
    "name": "a group of phases has a name, which those of its phases begin with",
    "repeat": "how many times the phases follow one another",
    "phase": "the phases to repeat, each under [[phase.phase]]",
}


def _phases(value: Any) -> None:
    if not isinstance(value, list | tuple) or not value:
        raise ValueError("must be one or more tables with the heading [[phase.phase]]")
    if any(map(_is_group, value)):
        raise ValueError("must hold phases only: groups are not nested")


def _once(problems: Iterable[Problem], phases: list[Any], places: list[_Place]) -> list[Problem]:
    """Problems without those that are the same in a later round."""
    prefixes = {}
    for index, (phase, place) in enumerate(zip(phases, places, strict=True)):
        name = phase.get("name") if isinstance(phase, Mapping) else None
        prefixes[f"phase[{name if isinstance(name, str) else index}]"] = place
    seen = set()
    kept = []
    for problem in problems:
        head, bracket, rest = problem.key.partition("]")
        origin = prefixes.get(head + bracket)
        known = (origin and origin[:2], rest if origin else problem.key, problem.message)
        if known not in seen:
            seen.add(known)
            kept.append(problem)
    return kept
