"""What a case comes to if it waits long enough: the first equilibrium, and what each phase ends with."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from fvswell.case.acting_loads import acting_loads, reference_bath
from fvswell.case.column_checks import longest, piston_pressure, pressed_by
from fvswell.case.errors import Location
from fvswell.case.loads import final_value, shape_of
from fvswell.case.schema import CaseTable

__all__ = ["EquilibriumState", "equilibrium_states"]


class EquilibriumState(NamedTuple):
    """Loads that a phase ends with."""

    name: str  # of the phase, "start" before the first
    location: Location  # of the key that gives them
    pressure: float  # of the piston, MPa; 0 where it is not given
    bath: float  # mmol/mm3, that of the first open part


def equilibrium_states(case: CaseTable) -> Iterator[EquilibriumState]:
    """The state before the first phase, and that of each phase."""
    yield EquilibriumState("start", ("bath", "concentration"), 0.0, case.bath.concentration)
    reference = reference_bath(case.parts)
    if reference is None:
        return
    for index, (phase, acting) in enumerate(zip(case.phase, acting_loads(case), strict=True)):
        location: Location = ("phase", index)
        if phase.bath_concentration is not None:
            location = ("phase", index, "bath_concentration")
        pressure = piston_pressure(case, acting)
        pressed = 0.0 if pressure is None else final_value(pressure, longest(phase))
        if pressed != 0.0:
            location = pressed_by(case, index)
        bath = final_value(shape_of(acting[f"{reference.name}.bath_concentration"]), longest(phase))
        yield EquilibriumState(phase.name, location, pressed, bath)
