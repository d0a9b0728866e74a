"""What acts on the parts of the boundary in each phase: the loads that it gives, and those that go on."""

from __future__ import annotations

import math
from collections.abc import Mapping

from fvswell.boundary.parts import LOADED, Part, load_names
from fvswell.case.loads import AnyLoad, kept
from fvswell.case.schema import CaseTable

__all__ = ["acting_loads", "initial_loads", "moved_part", "reference_bath"]

Loads = dict[str, AnyLoad]
_DRIVES = frozenset(kind for kinds in LOADED.values() for kind in kinds) - {"tangential_displacement"}


def initial_loads(case: CaseTable) -> dict[str, float]:
    """Loads before the first phase, in equilibrium with the bath: no pressures, no currents."""
    exclusive = {"force", "displacement"}
    return {
        name: case.bath.concentration if kind == "bath_concentration" else 0.0
        for name in load_names(case.parts)
        if (kind := name.partition(".")[2]) not in exclusive
    }


def moved_part(case: CaseTable, acting: Mapping[str, AnyLoad]) -> str | None:
    """The first part whose displacement is given, or a fixed piston: a pressure is measured there; else None."""
    return next(
        (
            part.name
            for part in case.parts
            if f"{part.name}.displacement" in acting or (part.name, part.mechanical) == ("piston", "fixed")
        ),
        None,
    )


def acting_loads(case: CaseTable, held: Mapping[str, float] | None = None) -> list[Loads]:
    """All loads in each phase, "PART.KIND".

    Parameters
    ----------
    case
        Whose phases are meant.
    held
        Loads before the first phase, as `initial_loads` gives them by default.

    Returns
    -------
    list
        For each phase the load of every part that has one: of pressure, force and displacement the one that drives it.
        A load that the phase does not give stays at the value that the phase before ended with.
    """
    acting: Loads = dict(initial_loads(case) if held is None else held)
    phases = []
    for phase in case.phase:
        if phase.bath_concentration is not None:
            acting |= {f"{part.name}.bath_concentration": phase.bath_concentration for part in case.parts if part.open}
        given = phase.loads()
        driven = {name.partition(".")[0] for name in given if _drives(name)}
        acting = {name: load for name, load in acting.items() if not (_drives(name) and _part(name) in driven)}
        acting |= given
        phases.append(acting)
        duration = phase.duration if isinstance(phase.duration, float) else math.nan
        acting = {name: kept(load, duration) for name, load in acting.items()}
    return phases


def reference_bath(parts: tuple[Part, ...]) -> Part | None:
    """The first open part, whose bath is the reference; None where all are closed."""
    return next((part for part in parts if part.open), None)


def _part(name: str) -> str:
    return name.partition(".")[0]


def _drives(name: str) -> bool:
    return name.partition(".")[2] in _DRIVES
