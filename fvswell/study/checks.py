"""Whether the valid values of a study fit together: names, phases, and parameters in their protocols."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from fvswell.case.case import Case
from fvswell.case.errors import Finding, Location, nearest_name, shown
from fvswell.study.fields import RESULT_NAMES
from fvswell.study.runs import parameters_of, protocols_of
from fvswell.study.schema import Grid, StudyTable

__all__ = ["check_study"]


def check_study(table: StudyTable, cases: Sequence[Case | None]) -> Iterator[Finding]:
    """Everything wrong between the values of a study, each of which is valid by itself.

    Parameters
    ----------
    table
        The study.
    cases
        Case of each protocol, None where it has problems of its own.
    """
    if table.model == table.reference_model:
        yield Finding(("reference_model",), "must not be the model that is judged")
    unknown = [*_repeated_names(table), *_unknown_names(table)]
    yield from unknown
    yield from _taken_names(table)
    yield from _shared_keys(table)
    yield from _unlike_protocols(cases)
    yield from _unknown_phases(table, cases)
    if not unknown:
        yield from _idle_designs(table)


def _repeated_names(table: StudyTable) -> Iterator[Finding]:
    for kind in ("parameter", "design", "protocol"):
        names = [item.name for item in getattr(table, kind)]
        for index, name in enumerate(names):
            if name in names[:index]:
                yield Finding((kind, index, "name"), f"must not be the name of an earlier {kind}")


def _unknown_names(table: StudyTable) -> Iterator[Finding]:
    protocols = [protocol.name for protocol in table.protocol]
    parameters = [parameter.name for parameter in table.parameter]
    for index, parameter in enumerate(table.parameter):
        yield from _not_among(parameter.protocols, protocols, ("parameter", index, "protocols"))
    for index, design in enumerate(table.design):
        yield from _not_among(design.protocols, protocols, ("design", index, "protocols"))
        key, named = ("counts", design.counts) if isinstance(design, Grid) else ("parameters", design.parameters)
        yield from _not_among(named, parameters, ("design", index, key))


def _not_among(names: Iterable[str] | None, known: Sequence[str], location: Location) -> Iterator[Finding]:
    for name in names or ():
        if name not in known:
            near = nearest_name(name, known)
            hint = f"did you mean {shown(near)}?" if near else f"there are {', '.join(map(shown, known))}"
            yield Finding(location, f"there is no {shown(name)}; {hint}")


def _taken_names(table: StudyTable) -> Iterator[Finding]:
    for index, parameter in enumerate(table.parameter):
        if parameter.name in RESULT_NAMES:
            yield Finding(("parameter", index, "name"), "is the name of something else in the result: choose another")


def _shared_keys(table: StudyTable) -> Iterator[Finding]:
    for index, parameter in enumerate(table.parameter):
        for earlier in table.parameter[:index]:
            shared = set(parameter.key) & set(earlier.key)
            apart = (
                parameter.protocols is not None
                and earlier.protocols is not None
                and not set(parameter.protocols) & set(earlier.protocols)
            )
            if shared and not apart:
                yield Finding(
                    ("parameter", index, "key"), f"{', '.join(sorted(shared))} is varied by {earlier.name} already"
                )


def _unlike_protocols(cases: Sequence[Case | None]) -> Iterator[Finding]:
    """Protocols that cannot stand in one table of results, or that a study cannot run."""
    first = next((case for case in cases if case is not None), None)
    for index, case in enumerate(cases):
        if case is None or first is None:
            continue
        if case.geometry.kind != "column":
            yield Finding(("protocol", index, "case"), f"its geometry is {case.geometry.kind}: a study is of columns")
        phases, others = ([phase.name for phase in one.phase] for one in (case, first))
        if phases != others:
            named = ", ".join(phases)
            yield Finding(
                ("protocol", index, "case"),
                f"has the phases {named}: all protocols must have the same, and the first has {', '.join(others)}",
            )
        if case.time.samples_per_phase != first.time.samples_per_phase:
            yield Finding(
                ("protocol", index, "case"),
                f"has {case.time.samples_per_phase} steps in a phase: all protocols must have as many, and the first "
                f"has {first.time.samples_per_phase}",
            )


def _unknown_phases(table: StudyTable, cases: Sequence[Case | None]) -> Iterator[Finding]:
    for index, parameter in enumerate(table.parameter):
        for protocol, case in zip(table.protocol, cases, strict=True):
            if case is None or (parameter.protocols is not None and protocol.name not in parameter.protocols):
                continue
            names = [phase.name for phase in case.phase]
            for key in parameter.key:
                kind, _, rest = key.partition(".")
                name = rest.partition(".")[0]
                if kind != "phase" or name in names or (name.isdecimal() and int(name) < len(names)):
                    continue
                near = nearest_name(name, names)
                hint = f"did you mean {near}?" if near else f"its phases are {', '.join(names)}"
                yield Finding(("parameter", index, "key"), f"protocol {protocol.name} has no phase {name}; {hint}")


def _idle_designs(table: StudyTable) -> Iterator[Finding]:
    for index, design in enumerate(table.design):
        for p in protocols_of(table, design):
            protocol = table.protocol[p]
            if not parameters_of(table, design, protocol):
                yield Finding(
                    ("design", index, "name"),
                    f"varies nothing in protocol {protocol.name}: leave it out of the design's protocols",
                )
