"""Whether the valid values of a case fit together: names, times, tissue, and what its geometry asks for."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from inspect import Parameter

import numpy as np

from fvswell.case.block_checks import edge_conditions, edge_loads
from fvswell.case.column_checks import lost_water
from fvswell.case.errors import Finding, Location
from fvswell.case.law_keys import parameters_of
from fvswell.case.load_checks import load_findings
from fvswell.case.profiles import Profile
from fvswell.case.reference_state import reference_volume_ratio
from fvswell.case.schema import CaseTable
from fvswell.physics.models import MODELS
from fvswell.physics.osmotic import OSMOTIC_LAWS, ChargeDependentCoefficients, coefficients
from fvswell.physics.tissue import Tissue

__all__ = ["check_case"]

_ROUNDING = 1e-12


_BLOCKS = ("plane-strain", "axisymmetric")


def check_case(case: CaseTable) -> list[Finding]:
    """Everything wrong between the values of a case, each of which is valid by itself."""
    with np.errstate(all="ignore"):  # absurd numbers may overflow
        return list(_findings(case))


def _findings(case: CaseTable) -> Iterator[Finding]:
    yield from _repeated_names(case)
    yield from _times_beyond_end(case)
    if case.geometry.kind in _BLOCKS:
        yield from edge_conditions(case)
    yield from load_findings(case)
    varying = case.tissue.profiles
    problems = [*_foreign_profiles(case, varying), *_bath_coefficient(case)]
    if problems:
        yield from problems
        return
    points = case.geometry.sample_points(list(varying.values()))
    tissue = case.tissue.at(case.geometry.coordinates(points), case.bath)
    problems = [*_osmotic_problems(case, tissue), *_no_stress_free_state(case, tissue)]
    loads = edge_loads if case.geometry.kind in _BLOCKS else lost_water
    yield from problems or loads(case, tissue, points)


def _foreign_profiles(case: CaseTable, varying: Mapping[Location, Profile]) -> Iterator[Finding]:
    """Profiles that are for another geometry."""
    for place, value in varying.items():
        if not isinstance(value, case.geometry.profile):
            yield Finding(("tissue", *place), f"varies along another axis: {case.geometry.profile_example}")


def _bath_coefficient(case: CaseTable) -> Iterator[Finding]:
    """An osmotic coefficient of the bath that the osmotic law needs, or has no use for."""
    law, given = case.tissue.osmotic, case.bath.osmotic_coefficient
    default = parameters_of(OSMOTIC_LAWS[str(law)]).get("bath_osmotic_coefficient")
    place = ("bath", "osmotic_coefficient")
    if given is None and default is Parameter.empty:
        yield Finding(place, f'missing; osmotic = "{law}" needs it')
    if given is not None and default is None:
        yield Finding(place, f'osmotic = "{law}" has none: leave it out')


def _no_stress_free_state(case: CaseTable, tissue: Tissue) -> Iterator[Finding]:
    """A sample that no stress-free solid comes to in its bath."""
    if np.isnan(reference_volume_ratio(case, tissue, MODELS[case.model])).any():
        yield Finding(("tissue", "reference_state"), "no stress-free solid would be such a sample in this bath")


def _osmotic_problems(case: CaseTable, tissue: Tissue) -> Iterator[Finding]:
    """A fall of the osmotic coefficient with the charge that leaves nothing of it."""
    if not isinstance(tissue.osmotic, ChargeDependentCoefficients):
        return
    inside, outside, _ = coefficients(tissue.osmotic)
    least = np.min(inside)
    if not least > 0.0:
        most = outside / np.max(tissue.fixed_charge_density)
        yield Finding(
            ("tissue", "osmotic_coefficient_per_charge"),
            f"makes the osmotic coefficient in the tissue {least:.3g}, which must be above 0; where the "
            f"charge is highest, values below {most:.3g} mm^3/mmol do",
        )


def _repeated_names(case: CaseTable) -> Iterator[Finding]:
    """Phases of one name."""
    names = [phase.name for phase in case.phase]
    for index, name in enumerate(names):
        if name in names[:index]:
            yield Finding(("phase", index, "name"), "must not be the name of an earlier phase")


def _times_beyond_end(case: CaseTable) -> Iterator[Finding]:
    """Output asked for after the end."""
    durations = [phase.duration for phase in case.phase if isinstance(phase.duration, float)]
    end = math.fsum(durations)
    if (
        len(durations) == len(case.phase)
        and case.output.times is not None
        and case.output.times[-1] > end * (1.0 + _ROUNDING)
    ):
        yield Finding(("output", "times"), f"must not go beyond the end of the run at {end:g} s")
