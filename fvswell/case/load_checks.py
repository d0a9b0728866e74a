"""Whether the loads of a case can act: on parts that are there and take them, without jumps that nothing could push."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from fvswell.boundary.checks import part_problems
from fvswell.boundary.parts import LOADED, Part
from fvswell.case.acting_loads import acting_loads, reference_bath
from fvswell.case.errors import Finding, Location, nearest_name
from fvswell.case.schema import CaseTable
from fvswell.case.values import Ramp, final_value

__all__ = ["load_findings"]

_DISPLACEMENTS = ("displacement", "tangential_displacement")
_ELECTRICAL = ("current", "potential")
_BATH = ("bath_concentration", "bath_pressure")


def load_findings(case: CaseTable) -> Iterator[Finding]:
    """What is wrong with the conditions on the parts, and with the loads of the phases."""
    for part, problem in part_problems(case.parts):
        place: Location = ("boundary",) if part is None else ("boundary", part.name)
        yield Finding(place, problem)
    unknown = list(_unknown_parts(case))
    yield from unknown
    yield from _long_ramps(case)
    yield from _foreign_loads(case)
    if not unknown:
        yield from _jumps(case)
        yield from _two_baths(case)


def _unknown_parts(case: CaseTable) -> Iterator[Finding]:
    names = [part.name for part in case.parts]
    for index, phase in enumerate(case.phase):
        for name, _ in phase.part_loads():
            if name not in names:
                near = nearest_name(name, names)
                hint = f"; did you mean {near}?" if near else ""
                yield Finding(("phase", index, name), f"is no part of the boundary, which are {', '.join(names)}{hint}")


def _long_ramps(case: CaseTable) -> Iterator[Finding]:
    for index, phase in enumerate(case.phase):
        if not isinstance(phase.duration, float):
            continue
        loads: dict[tuple[str, ...], Any] = {("bath_concentration",): phase.bath_concentration}
        loads |= {tuple(name.split(".")): load for name, load in phase.loads().items()}
        for place, load in loads.items():
            if isinstance(load, Ramp) and load.over > phase.duration:
                yield Finding(("phase", index, *place), load.longer_than(phase.duration))


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
    before: dict[str, float | None] = {}
    for index, (phase, acting) in enumerate(zip(case.phase, acting_loads(case), strict=True)):
        given = phase.loads()
        for part in case.parts:
            for kind in _DISPLACEMENTS:
                if kind not in part.loads:
                    continue
                name = f"{part.name}.{kind}"
                left = before.get(name, 0.0)
                load = given.get(name)
                if isinstance(load, float) and (left is None or not math.isclose(load, left)):
                    place = "is where the pressure left it" if left is None else f"stands at {left:g} mm"
                    yield Finding(
                        ("phase", index, part.name, kind),
                        f"{part.name} {place} and a jump would need infinite pressure: use "
                        f"{{ramp_to = {load:g}, over = ...}}",
                    )
                before[name] = final_value(acting[name]) if name in acting else None
                if kind == "tangential_displacement" and name not in acting:
                    before[name] = 0.0


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
