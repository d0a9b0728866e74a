"""Whether the conditions and loads of a block are possible: its edges, probe, cells and durations."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np

from fvswell.boundary.parts import RESERVED
from fvswell.boundary.sides import EDGE_AXIS, OUTWARD
from fvswell.case.errors import Finding
from fvswell.case.geometry import BlockGeometry
from fvswell.case.loads import StrainLoad, extremes, shape_of
from fvswell.case.phases import BlockPhase
from fvswell.case.reference_state import stress_free
from fvswell.case.schema import CaseTable
from fvswell.case.values import RelaxationTimes
from fvswell.physics.equilibrium import equilibrium_volume_ratio
from fvswell.physics.models import MODELS
from fvswell.physics.tissue import Array, Tissue

__all__ = ["edge_conditions", "edge_loads"]

_LARGEST_ASPECT_RATIO = 1e5  # of a cell


def edge_conditions(case: CaseTable) -> Iterator[Finding]:
    """What is wrong with the edges, the probe, the cells, the durations, and the kinds of loads on the edges."""
    from fvswell.block.part_checks import check_parts  # takes scipy along, which columns need not wait for

    geometry = _geometry(case)
    yield from _part_names(case)
    problems = check_parts(geometry.kind == "axisymmetric", geometry.extent, case.parts)
    yield from (Finding(("boundary",), problem) for problem in problems)
    width, height = geometry.extent
    if geometry.probe is not None and (geometry.probe[0] > width or geometry.probe[1] > height):
        yield Finding(("geometry", "probe"), f"lies outside the block, which is {width:g} mm x {height:g} mm")
    if case.assembly == "stock-terms":
        yield Finding(("assembly",), "is for columns: FiPy's own terms cannot express a block")
    for index, phase in enumerate(case.phase):
        if isinstance(phase.duration, RelaxationTimes):
            yield Finding(("phase", index, "duration"), "relaxation times are of columns: give the duration in s")
    try:
        x, y = (np.diff(nodes) for nodes in geometry.grid_nodes(case.parts))
    except ValueError as error:  # parts that are too small, or are not there
        if not problems:
            yield Finding(("geometry", "cells"), str(error))
        return
    longest = max(x.max() / y.min(), y.max() / x.min())
    if not longest <= _LARGEST_ASPECT_RATIO:
        yield Finding(
            ("geometry", "cells"),
            f"a cell would be {longest:.2g} times as long as wide, more than {_LARGEST_ASPECT_RATIO:g}: change the "
            "lengths of the block, the cells or their grading",
        )


def _part_names(case: CaseTable) -> Iterator[Finding]:
    """Names of parts that a phase could not hold, or under which a result has something else."""
    taken = {*BlockPhase.model_fields, *RESERVED}
    for part in case.parts:
        if part.name in taken or not re.fullmatch(r"[A-Za-z]\w*", part.name):
            yield Finding(
                ("boundary", part.name),
                f"cannot be the name of a part: letters, digits and _ can, beginning with a letter, and none of "
                f"{', '.join(sorted(taken))}",
            )


def edge_loads(case: CaseTable, tissue: Tissue, points: Array) -> Iterator[Finding]:
    """Displacements that would move an edge through the block.

    A block is at most as thick as a column that swells along one axis alone.
    """
    tissue, swollen = stress_free(case, tissue, MODELS[case.model])
    free = equilibrium_volume_ratio(tissue, 0.0, case.bath.concentration) / swollen
    stretch = max(1.0, float(np.nan_to_num(free).max()))
    edges = {part.name: part.edge for part in case.parts}
    for index, phase in enumerate(case.phase):
        for name, load in phase.loads().items():
            part, _, kind = name.partition(".")
            edge = edges.get(part)
            if kind != "displacement" or edge is None or edge not in EDGE_AXIS:
                continue
            extent = stretch * _geometry(case).extent[EDGE_AXIS[edge]]
            duration = phase.duration if isinstance(phase.duration, float) else math.inf
            size = 1.0 if isinstance(load, StrainLoad) else extent
            if max(-OUTWARD[edge] * value for value in extremes(shape_of(load), duration, 0.0)) >= size:
                yield Finding(
                    ("phase", index, part, kind),
                    f"moves the edge through the block, which is less than {extent:.3g} mm thick in equilibrium",
                )


def _geometry(case: CaseTable) -> BlockGeometry:
    assert isinstance(case.geometry, BlockGeometry)
    return case.geometry
