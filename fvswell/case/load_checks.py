"""Whether the loads of a case can act: on parts that are there and take them, without jumps that nothing could push."""

from __future__ import annotations

import math
from collections.abc import Iterator

from fvswell.boundary.checks import condition_problems
from fvswell.boundary.parts import LOADED, MEASURED, Part
from fvswell.case.acting_loads import acting_loads, moved_part, reference_bath
from fvswell.case.errors import Finding, Location, nearest_name
from fvswell.case.loads import AnyLoad, Sine, StrainLoad, jumps, kept, settled, shape_of
from fvswell.case.schema import CaseTable

__all__ = ["load_findings"]

_DISPLACEMENTS = ("displacement", "tangential_displacement")
_ELECTRICAL = ("current", "potential")
_BATH = ("bath_concentration", "bath_pressure")


def load_findings(case: CaseTable) -> Iterator[Finding]:
    """What is wrong with the conditions on the parts, and with the loads of the phases."""
    if case.geometry.kind == "column":
        for problem in condition_problems(case.parts):
            yield Finding(("boundary",), problem)
        yield from _one_current(case)
    unknown = list(_unknown_parts(case))
    yield from unknown
    yield from _long_loads(case)
    yield from _foreign_loads(case)
    if not unknown:
        yield from _jumps(case)
        yield from _rates(case)
        yield from _two_baths(case)
    yield from _unknown_measure(case)


def _one_current(case: CaseTable) -> Iterator[Finding]:
    """What goes into a column at one end leaves it at the other."""
    for part, other in zip(case.parts, case.parts[::-1], strict=True):
        if part.electrical == "current" and other.electrical not in ("grounded", "potential"):
            yield Finding(
                ("boundary", part.name, "electrical"),
                f"a current through {part.name} leaves through {other.name}, which is {other.electrical}: it has to be "
                "grounded or at a given potential",
            )


def _unknown_measure(case: CaseTable) -> Iterator[Finding]:
    """A history to compare by that no result has."""
    measured = case.output.measured
    if measured is None:
        return
    known = [*case.geometry.histories, "height", *(f"{part.name}_{kind}" for part in case.parts for kind in MEASURED)]
    if measured not in known:
        near = nearest_name(measured, known)
        hint = f"; did you mean {near}?" if near else ""
        yield Finding(("output", "measured"), f"is no history of this sample: {', '.join(known)}{hint}")


def _unknown_parts(case: CaseTable) -> Iterator[Finding]:
    names = [part.name for part in case.parts]
    for index, phase in enumerate(case.phase):
        for name, _ in phase.part_loads():
            if name not in names:
                near = nearest_name(name, names)
                hint = f"; did you mean {near}?" if near else ""
                yield Finding(("phase", index, name), f"is no part of the boundary, which are {', '.join(names)}{hint}")


def _long_loads(case: CaseTable) -> Iterator[Finding]:
    """Ramps and tables that outlast their phase, and sines in a phase that ends when something has come to rest."""
    for index, phase in enumerate(case.phase):
        for place, load in phase.all_loads():
            location: Location = ("phase", index, *place)
            shape = shape_of(load)
            if not isinstance(phase.duration, float):
                if isinstance(shape, Sine):
                    yield Finding(location, "never comes to rest: give the duration of the phase in s")
            elif isinstance(shape, Sine):
                if phase.until is not None:
                    yield Finding(location, "never comes to rest: leave until away")
            elif not isinstance(shape, float) and shape.settled > phase.duration:
                yield Finding(location, shape.longer_than(phase.duration))
            elif settled(load) == phase.duration and phase.until is not None:
                yield Finding(location, "changes for all of the longest duration, and until counts after that")


def _rates(case: CaseTable) -> Iterator[Finding]:
    """Phases that end on a rate of what is not found in them, or whose longest duration is not known."""
    for index, (phase, acting) in enumerate(zip(case.phase, acting_loads(case), strict=True)):
        if phase.until is None:
            continue
        place: Location = ("phase", index, "until")
        if not isinstance(phase.duration, float):
            yield Finding(place, "needs the longest duration in s")
        part = moved_part(case, acting)
        of_pressure = phase.until.dimension == "pressure rate"
        if part is None and of_pressure:
            yield Finding(place, 'must be of the strain, such as "1e-4 /min": no displacement moves a part')
        if part is not None and not of_pressure:
            yield Finding(place, f'must be of the pressure, such as "1e-3 MPa/min": a displacement moves {part}')


def _foreign_loads(case: CaseTable) -> Iterator[Finding]:
    """Loads that the conditions of a part do not take."""
    parts = {part.name: part for part in case.parts}
    for index, phase in enumerate(case.phase):
        for name, given in phase.part_loads():
            part = parts.get(name)
            for kind, load in given:
                if part is not None and load is not None and kind not in part.loads:
                    yield Finding(("phase", index, name, kind), _who_takes(part, kind))
            force = given.force if part is not None and case.geometry.kind == "column" else None
            if force is not None and getattr(case.geometry, "area", None) is None:
                yield Finding(("phase", index, name, "force"), "needs geometry.area, the area of the cross-section")


def _who_takes(part: Part, kind: str) -> str:
    if kind in _BATH:
        return f'{part.name} is closed: it can be given with bath = "open"'
    if kind in _ELECTRICAL:
        return f'{part.name} is {part.electrical}: it can be given with electrical = "{kind}"'
    takers = " or ".join(mechanical for mechanical, kinds in LOADED.items() if kind in kinds)
    return f"{part.name} is {part.mechanical}: it can be given for {takers}"


def _jumps(case: CaseTable) -> Iterator[Finding]:
    """Steps of a displacement, which an incompressible mixture takes at infinite pressure only."""
    before: dict[str, AnyLoad | None] = {}
    for index, (phase, acting) in enumerate(zip(case.phase, acting_loads(case), strict=True)):
        given = phase.loads()
        for part in case.parts:
            for kind in _DISPLACEMENTS:
                if kind not in part.loads:
                    continue
                name = f"{part.name}.{kind}"
                left = before.get(name, 0.0)
                if name in given and (problem := _jump(part, given[name], left)):
                    yield Finding(("phase", index, part.name, kind), problem)
                duration = phase.duration if isinstance(phase.duration, float) else math.nan
                before[name] = kept(acting[name], duration) if name in acting else None
                if kind == "tangential_displacement" and name not in acting:
                    before[name] = 0.0


def _jump(part: Part, load: AnyLoad, left: AnyLoad | None) -> str:
    """What is wrong with a displacement that begins elsewhere than where the phase before left it."""
    shape = shape_of(load)
    if not jumps(shape, math.inf):
        return ""  # goes on from wherever it is
    there = math.inf if left is None else shape_of(left)
    assert isinstance(there, float)
    if left is not None and there != 0.0 and isinstance(load, StrainLoad) != isinstance(left, StrainLoad):
        return f"{part.name} stands at {_text(left)}: begin there, in the same unit"
    if not jumps(shape, there):
        return ""
    place = "is where the pressure left it" if left is None else f"stands at {_text(left)}"
    ramp = f"{{ramp_to = {_number(load)}, over = ...}}" if isinstance(shape, float) else "a ramp in a phase before"
    return f"{part.name} {place} and a jump would need infinite pressure: use {ramp}"


def _number(load: AnyLoad) -> str:
    """A single displacement as a file has it."""
    shape = shape_of(load)
    assert isinstance(shape, float)
    return f'"{100.0 * shape:g} %"' if isinstance(load, StrainLoad) else f"{shape:g}"


def _text(load: AnyLoad) -> str:
    """A single displacement with its unit."""
    return _number(load).strip('"') if isinstance(load, StrainLoad) else f"{_number(load)} mm"


def _two_baths(case: CaseTable) -> Iterator[Finding]:
    """Baths that differ, in a model whose ions are in equilibrium with one."""
    reference = reference_bath(case.parts)
    if case.model != "biphasic-swelling" or reference is None:
        return
    for index, acting in enumerate(acting_loads(case)):
        bath = acting[f"{reference.name}.bath_concentration"]
        for part in case.parts:
            if part.open and acting[f"{part.name}.bath_concentration"] != bath:
                yield Finding(
                    ("phase", index, part.name, "bath_concentration"),
                    f"differs from that of {reference.name}: the ions of the biphasic-swelling model are in "
                    "equilibrium with one bath; the electrochemical model can have two",
                )
                return
