"""Whether the valid values of a case fit together: phases, times, and loads that the tissue can bear."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from fvswell.case.errors import Finding
from fvswell.case.profiles import DepthProfile, PlaneProfile
from fvswell.case.schema import CaseTable
from fvswell.case.values import final_value
from fvswell.physics.equilibrium import equilibrium_volume_ratio, osmotic_pressure_difference
from fvswell.physics.solid import uniaxial_stress
from fvswell.physics.tissue import Array, Tissue

__all__ = ["check_case", "osmotic_problems", "repeated_names", "times_beyond_end"]

_State = tuple[float, float]  # pressure of the piston, concentration of the bath

_NEXT_TO_NO_WATER = 1e-6  # of the water in the stress-free solid
_BISECTIONS = 40
_ROUNDING = 1e-12
_DIGITS = 3


def check_case(case: CaseTable) -> Iterator[Finding]:
    """Everything wrong between the values of a case, each of which is valid by itself."""
    yield from repeated_names(case)
    yield from _piston_jumps(case)
    yield from times_beyond_end(case)
    for key, value in case.tissue:
        if isinstance(value, PlaneProfile):
            yield Finding(("tissue", key), "varies with x or y: in a column give {depth = [...], value = [...]}")
            return
    depth = _sampled_depths(case)
    tissue = case.tissue.at({"depth": depth}, case.bath)
    problems = list(osmotic_problems(case, tissue))
    yield from problems or _lost_water(case, tissue, depth)


def osmotic_problems(case: CaseTable, tissue: Tissue) -> Iterator[Finding]:
    """A fall of the osmotic coefficient with the charge that leaves nothing of it."""
    least = np.min(tissue.osmotic_coefficient)
    if least <= 0.0:
        most = case.bath.osmotic_coefficient / np.max(tissue.fixed_charge_density)
        yield Finding(
            ("tissue", "osmotic_coefficient_per_charge"),
            f"makes the osmotic coefficient in the tissue {least:.3g}, which must be above 0; where the "
            f"charge is highest, values below {most:.3g} mm^3/mmol do",
        )


def repeated_names(case: CaseTable) -> Iterator[Finding]:
    """Phases of one name."""
    names = [phase.name for phase in case.phase]
    for index, name in enumerate(names):
        if name in names[:index]:
            yield Finding(("phase", index, "name"), "must not be the name of an earlier phase")


def _piston_jumps(case: CaseTable) -> Iterator[Finding]:
    """Steps of the piston's displacement, which an incompressible mixture takes at infinite pressure only."""
    left: float | None = 0.0  # where the previous phase leaves the piston, None where only a run can tell
    for index, phase in enumerate(case.phase):
        given = phase.piston_displacement
        if isinstance(given, float) and (left is None or not math.isclose(given, left)):
            place = "where the pressure left it" if left is None else f"at {left:g} mm"
            yield Finding(
                ("phase", index, "piston_displacement"),
                f"the piston stands {place} and a jump would need infinite pressure: use "
                f"{{ramp_to = {given:g}, over = ...}}",
            )
        left = None if given is None else final_value(given)


def times_beyond_end(case: CaseTable) -> Iterator[Finding]:
    """Output asked for after the end."""
    durations = [phase.duration for phase in case.phase if isinstance(phase.duration, float)]
    end = math.fsum(durations)
    if (
        len(durations) == len(case.phase)
        and case.output.times is not None
        and case.output.times[-1] > end * (1.0 + _ROUNDING)
    ):
        yield Finding(("output", "times"), f"must not go beyond the end of the run at {end:g} s")


def _sampled_depths(case: CaseTable) -> Array:
    """Depths to check the tissue at: the knots of all profiles and the nodes of an even grid."""
    profiles = [value for _, value in case.tissue if isinstance(value, DepthProfile)]
    if not profiles:
        return np.zeros(1)
    height = case.geometry.height
    knots = np.concatenate([profile.depth for profile in profiles])
    return np.union1d(np.linspace(0.0, height, case.geometry.cells + 1), knots[knots <= height])


def _lost_water(case: CaseTable, tissue: Tissue, depth: Array) -> Iterator[Finding]:
    """Loads at whose end no water would be left in the tissue."""
    rest = (0.0, case.bath.concentration)
    loads: dict[int, _State] = {}  # at the end of each phase under pressure
    bath = case.bath.concentration
    for index, phase in enumerate(case.phase):
        bath = bath if phase.bath_concentration is None else final_value(phase.bath_concentration)
        if phase.piston_pressure is not None:
            loads[index] = (final_value(phase.piston_pressure), bath)
    states = [rest, *loads.values()]
    if not _clearly_hold_water(case, tissue, states):
        lost = [bool(np.isnan(J).any()) for J in _volume_ratios(case, tissue, states)]
        if lost[0]:
            yield Finding(("bath", "concentration"), "draws all water out of the tissue even without a load")
            return
        for (index, state), gone in zip(loads.items(), lost[1:], strict=True):
            if gone:
                yield Finding(("phase", index, "piston_pressure"), _largest_load(case, tissue, *state))
    yield from _too_low_pistons(case, tissue, depth)


def _clearly_hold_water(case: CaseTable, tissue: Tissue, states: list[_State]) -> bool:
    """Whether next to no water suffices to push outward in every state, so that more balances it.

    This spares most cases the search for the equilibrium, which takes ten times longer than reading a case.
    """
    pressure, bath = _columns(states)
    J = 1.0 - tissue.fluid_fraction * (1.0 - _NEXT_TO_NO_WATER)
    push = -uniaxial_stress(tissue, J) - pressure
    if case.model != "biphasic":
        push = push + osmotic_pressure_difference(tissue, J, bath, case.bath.osmotic_coefficient)
    return bool(np.all(push > 0.0))


def _columns(states: list[_State]) -> tuple[Array, Array]:
    """Pressures and baths, each of shape (states, 1)."""
    pressure, bath = np.array(states).T[:, :, np.newaxis]
    return pressure, bath


def _volume_ratios(case: CaseTable, tissue: Tissue, states: list[_State]) -> Array:
    pressure, bath = _columns(states)
    swelling = case.model != "biphasic"
    return equilibrium_volume_ratio(tissue, pressure, bath, case.bath.osmotic_coefficient, swelling)


def _largest_load(case: CaseTable, tissue: Tissue, pressure: float, bath: float) -> str:
    low, high = 0.0, pressure
    if np.isnan(_volume_ratios(case, tissue, [(low, bath)])).any():
        return f"a bath of {bath:g} mmol/mm^3 draws all water out of the tissue even without a load"
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if np.isnan(_volume_ratios(case, tissue, [(middle, bath)])).any():
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
    given = {index: phase.piston_displacement for index, phase in enumerate(case.phase)}
    displacements = {index: final_value(load) for index, load in given.items() if load is not None}
    if not displacements:
        return
    height = case.geometry.height
    solid = height * _mean(1.0 - tissue.fluid_fraction[0], depth)
    rest = height * _mean(_volume_ratios(case, tissue, [(0.0, case.bath.concentration)])[0], depth)
    for index, displacement in displacements.items():
        left = rest + displacement
        if left <= solid:
            yield Finding(
                ("phase", index, "piston_displacement"),
                f"leaves a height of {left:.3g} mm of the {rest:.3g} mm at rest, but the solid alone takes "
                f"{solid:.3g} mm: must be above {solid - rest:.3g} mm",
            )


def _mean(values: Array, depth: Array) -> float:
    if values.size == 1:
        return float(values[0])
    return float(np.trapezoid(values, depth) / (depth[-1] - depth[0]))
