"""Whether the valid values of a case fit together: names, times, tissue, and what its geometry asks for."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from fvswell.case.block_checks import edge_conditions, edge_loads
from fvswell.case.column_checks import lost_water
from fvswell.case.errors import Finding
from fvswell.case.load_checks import load_findings
from fvswell.case.profiles import DepthProfile, PlaneProfile
from fvswell.case.schema import CaseTable
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
    varying = {key: value for key, value in case.tissue if isinstance(value, DepthProfile | PlaneProfile)}
    foreign = [key for key, value in varying.items() if not isinstance(value, case.geometry.profile)]
    for key in foreign:
        yield Finding(("tissue", key), f"varies along another axis: {case.geometry.profile_example}")
    if foreign:
        return
    points = case.geometry.sample_points(list(varying.values()))
    tissue = case.tissue.at(case.geometry.coordinates(points), case.bath)
    problems = list(_osmotic_problems(case, tissue))
    loads = edge_loads if case.geometry.kind in _BLOCKS else lost_water
    yield from problems or loads(case, tissue, points)


def _osmotic_problems(case: CaseTable, tissue: Tissue) -> Iterator[Finding]:
    """A fall of the osmotic coefficient with the charge that leaves nothing of it."""
    least = np.min(tissue.osmotic.osmotic_coefficient)
    if not least > 0.0:
        most = case.bath.osmotic_coefficient / np.max(tissue.fixed_charge_density)
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
