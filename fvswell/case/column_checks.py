"""Whether the loads of a column leave water in the tissue."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from fvswell.case.acting_loads import acting_loads, reference_bath
from fvswell.case.errors import Finding, Location
from fvswell.case.loads import AnyLoad, Shape, divided, extremes, final_value, in_length, shape_of
from fvswell.case.phases import Phase
from fvswell.case.reference_state import stress_free
from fvswell.case.schema import CaseTable
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import MODELS
from fvswell.physics.osmotic import osmotic_pressure_difference
from fvswell.physics.solids import uniaxial_stress
from fvswell.physics.tissue import Array, Tissue

__all__ = ["longest", "lost_water", "piston_pressure", "pressed_by"]

_State = tuple[float, float]  # pressure of the piston, concentration of the bath

_NEXT_TO_NO_WATER = 1e-6  # of the water in the stress-free solid
_BISECTIONS = 40
_DIGITS = 3


def lost_water(case: CaseTable, tissue: Tissue, depth: Array) -> Iterator[Finding]:
    """Loads at whose end no water would be left in the tissue.

    Parameters
    ----------
    case
        Of a column.
    tissue
        At the depths.
    depth
        Increasing, mm from the filter, ``(points,)``.
    """
    reference = reference_bath(case.parts)
    if reference is None:
        return  # reported of the boundary
    tissue, swollen = stress_free(case, tissue, MODELS[case.model])
    start = (0.0, case.bath.concentration)
    loads: dict[int, _State] = {}  # at the end of each phase under pressure
    acting = acting_loads(case)
    for index, each in enumerate(acting):
        if (pressure := piston_pressure(case, each)) is not None:
            bath = final_value(shape_of(each[f"{reference.name}.bath_concentration"]))
            loads[index] = (final_value(pressure), bath)
    states = [start, *loads.values()]
    if not _clearly_hold_water(tissue, states):
        lost = [bool(np.isnan(J).any()) for J in _volume_ratios(tissue, states)]
        if lost[0]:
            yield Finding(("bath", "concentration"), "draws all water out of the tissue even without a load")
            return
        for (index, state), gone in zip(loads.items(), lost[1:], strict=True):
            if gone:
                yield Finding(pressed_by(case, index), _largest_load(tissue, *state))
    yield from _too_low_pistons(case, acting, tissue, depth, swollen)


def piston_pressure(case: CaseTable, acting: Mapping[str, AnyLoad]) -> Shape | None:
    """Pressure of the piston, also where a force on its area gives it; None where it is found."""
    geometry: Any = case.geometry
    if "piston.force" in acting:
        return divided(shape_of(acting["piston.force"]), geometry.area)
    return shape_of(acting["piston.pressure"]) if "piston.pressure" in acting else None


def pressed_by(case: CaseTable, index: int) -> Location:
    """What a phase gives of the piston's load, or the phase."""
    given = (name for name in case.phase[index].loads() if name in ("piston.pressure", "piston.force"))
    name = next(given, "")
    return ("phase", index, *name.split(".")) if name else ("phase", index)


def _clearly_hold_water(tissue: Tissue, states: list[_State]) -> bool:
    """Whether next to no water suffices to push outward in every state, so that more balances it.

    This spares most cases the search for the equilibrium, which takes ten times longer than reading a case.
    """
    pressure, bath = _columns(states)
    J = 1.0 - tissue.fluid_fraction * (1.0 - _NEXT_TO_NO_WATER)
    push = -uniaxial_stress(tissue.solid, J, tissue.fluid_fraction) - pressure
    return bool(np.all(push + osmotic_pressure_difference(tissue, J, bath) > 0.0))


def _columns(states: list[_State]) -> tuple[Array, Array]:
    """Pressures and baths, each of shape (states, 1)."""
    pressure, bath = np.array(states).T[:, :, np.newaxis]
    return pressure, bath


def _volume_ratios(tissue: Tissue, states: list[_State]) -> Array:
    """Volume ratios in equilibrium, (states, points) or (states, 1)."""
    return equilibrium_volume_ratio(tissue, *_columns(states))


def _largest_load(tissue: Tissue, pressure: float, bath: float) -> str:
    low, high = 0.0, pressure
    if np.isnan(_volume_ratios(tissue, [(low, bath)])).any():
        return f"a bath of {bath:g} mmol/mm^3 draws all water out of the tissue even without a load"
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if np.isnan(_volume_ratios(tissue, [(middle, bath)])).any():
            high = middle
        else:
            low = middle
    return f"leaves no equilibrium with water in the tissue; up to {_rounded_down(low):g} MPa does"


def _rounded_down(value: float) -> float:
    """Magnitude rounded down to a few digits, so that what is allowed stays allowed."""
    if value == 0.0:
        return 0.0
    scale = 10.0 ** (_DIGITS - 1 - math.floor(math.log10(abs(value))))
    return math.trunc(value * scale) / scale


def _too_low_pistons(
    case: CaseTable, acting: Sequence[Mapping[str, AnyLoad]], tissue: Tissue, depth: Array, swollen: Array | float
) -> Iterator[Finding]:
    """Displacements that would leave no room for water beside the solid.

    ``swollen`` is the volume ratio of the state that the height and the depths are of.
    """
    loads = {index: each.get("piston.displacement") for index, each in enumerate(acting)}
    displacements = {index: load for index, load in loads.items() if load is not None}
    if not displacements:
        return
    height = case.geometry.height
    solid = height * _mean((1.0 - np.atleast_1d(tissue.fluid_fraction)) / swollen, depth)
    free = height * _mean(_volume_ratios(tissue, [(0.0, case.bath.concentration)])[0] / swollen, depth)
    for index, load in displacements.items():
        left = free + extremes(in_length(load, free), longest(case.phase[index]), 0.0)[0]
        if left <= solid:
            yield Finding(
                ("phase", index, "piston", "displacement"),
                f"leaves a height of {left:.3g} mm of the {free:.3g} mm in equilibrium, but the solid alone takes "
                f"{solid:.3g} mm: must be above {solid - free:.3g} mm",
            )


def longest(phase: Phase) -> float:
    """How long a phase may last, s."""
    return phase.duration if isinstance(phase.duration, float) else math.inf


def _mean(values: Array, depth: Array) -> float:
    if values.size == 1:
        return float(values[0])
    return float(np.trapezoid(values, depth) / (depth[-1] - depth[0]))
