"""Whether the loads of a column are possible: the piston does not jump, and every load leaves water in the tissue."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from fvswell.case.errors import Finding
from fvswell.case.phases import ColumnPhase
from fvswell.case.schema import CaseTable
from fvswell.case.loads import final_value
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import MODELS
from fvswell.physics.osmotic import osmotic_pressure_difference
from fvswell.physics.solids import uniaxial_stress
from fvswell.physics.tissue import Array, Tissue

__all__ = ["lost_water", "piston_jumps"]

_State = tuple[float, float]  # pressure of the piston, concentration of the bath

_NEXT_TO_NO_WATER = 1e-6  # of the water in the stress-free solid
_BISECTIONS = 40
_DIGITS = 3


def piston_jumps(case: CaseTable) -> Iterator[Finding]:
    """Steps of the piston's displacement, which an incompressible mixture takes at infinite pressure only."""
    left: float | None = 0.0  # where the previous phase leaves the piston, None where only a run can find it
    for index, phase in _phases(case):
        given = phase.piston_displacement
        if isinstance(given, float) and (left is None or not math.isclose(given, left)):
            place = "where the pressure left it" if left is None else f"at {left:g} mm"
            yield Finding(
                ("phase", index, "piston_displacement"),
                f"the piston stands {place} and a jump would need infinite pressure: use "
                f"{{ramp_to = {given:g}, over = ...}}",
            )
        left = None if given is None else final_value(given)


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
    tissue = MODELS[case.model].tissue(tissue)
    start = (0.0, case.bath.concentration)
    loads: dict[int, _State] = {}  # at the end of each phase under pressure
    bath = case.bath.concentration
    for index, phase in _phases(case):
        bath = bath if phase.bath_concentration is None else final_value(phase.bath_concentration)
        if phase.piston_pressure is not None:
            loads[index] = (final_value(phase.piston_pressure), bath)
    states = [start, *loads.values()]
    if not _clearly_hold_water(tissue, states):
        lost = [bool(np.isnan(J).any()) for J in _volume_ratios(tissue, states)]
        if lost[0]:
            yield Finding(("bath", "concentration"), "draws all water out of the tissue even without a load")
            return
        for (index, state), gone in zip(loads.items(), lost[1:], strict=True):
            if gone:
                yield Finding(("phase", index, "piston_pressure"), _largest_load(tissue, *state))
    yield from _too_low_pistons(case, tissue, depth)


def _phases(case: CaseTable) -> Iterator[tuple[int, ColumnPhase]]:
    for index, phase in enumerate(case.phase):
        assert isinstance(phase, ColumnPhase)
        yield index, phase


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


def _too_low_pistons(case: CaseTable, tissue: Tissue, depth: Array) -> Iterator[Finding]:
    """Displacements that would leave no room for water beside the solid."""
    given = {index: phase.piston_displacement for index, phase in _phases(case)}
    displacements = {index: final_value(load) for index, load in given.items() if load is not None}
    if not displacements:
        return
    height = case.geometry.height
    solid = height * _mean(1.0 - np.atleast_1d(tissue.fluid_fraction), depth)
    free = height * _mean(_volume_ratios(tissue, [(0.0, case.bath.concentration)])[0], depth)
    for index, displacement in displacements.items():
        left = free + displacement
        if left <= solid:
            yield Finding(
                ("phase", index, "piston_displacement"),
                f"leaves a height of {left:.3g} mm of the {free:.3g} mm in equilibrium, but the solid alone takes "
                f"{solid:.3g} mm: must be above {solid - free:.3g} mm",
            )


def _mean(values: Array, depth: Array) -> float:
    if values.size == 1:
        return float(values[0])
    return float(np.trapezoid(values, depth) / (depth[-1] - depth[0]))
