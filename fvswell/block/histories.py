"""What is measured at the parts of the boundary of a block, over time."""

from __future__ import annotations

import numpy as np

from fvswell.block.block import Block, BlockState, Interval, first_point
from fvswell.block.body import BlockBody
from fvswell.block.geometry import edge_area_vectors
from fvswell.block.part_loads import PartLoads, pressing_loads
from fvswell.block.reactions import part_areas, part_displacements, part_forces
from fvswell.boundary.parts import CONDUCTING, HELD
from fvswell.boundary.sides import EDGE_AXIS
from fvswell.numerics.state import Record
from fvswell.physics.constants import FARADAY
from fvswell.physics.tissue import Array

__all__ = ["part_histories"]

_ENTERED = ("water_volume", "anion_amount", "cation_amount")


def part_histories(body: BlockBody, record: Record, equilibrated: Array) -> dict[str, Array]:
    """Histories of the parts by the names "PART_KIND", ``(outputs,)`` each.

    Parameters
    ----------
    body, record
        What was integrated, and what its outputs are.
    equilibrated
        Positions of the vertices in equilibrium, ``(2, vertices)`` mm, from which displacements count.

    Returns
    -------
    dict
        Of every part ``force`` (N; of a disc, or 1 mm thick), ``pressure`` (its mean, MPa) and ``displacement`` (mean,
        normal, mm); of a glued plate ``tangential_displacement`` (mm); of open parts ``bath_concentration``,
        ``bath_pressure``; of parts that are crossed ``water_volume`` (mm3) and, where ions are transported,
        ``cation_amount`` and ``anion_amount`` (mmol), which have entered; of those also ``current`` (A, positive into
        the tissue) and ``potential`` (mV; of an insulating part the mean over its area).
    """
    block, outputs = body.block, int(record.filled[0])
    rows = [
        _at_output(body, unknowns, contents, loads, equilibrated)
        for unknowns, contents, loads in zip(
            record.unknowns[:outputs], record.contents[:outputs], record.loads[:outputs], strict=True
        )
    ]
    histories = {name: np.array([row[name] for row in rows]) for name in rows[0]} if rows else {}
    for row, part in enumerate(block.crossed_parts):
        for quantity, kind in enumerate(_ENTERED if block.model.transports_ions else _ENTERED[:1]):
            histories[f"{block.parts[part].name}_{kind}"] = record.crossed[:outputs, row, quantity].copy()
    return histories


def _at_output(
    body: BlockBody, unknowns: Array, contents: Array, values: Array, equilibrated: Array
) -> dict[str, float]:
    block, known = body.block, dict(zip(body.load_names, values, strict=True))
    loads = pressing_loads(block.parts, known, block.concentration)
    state = block.evaluate(unknowns, Interval(contents, 0.0, loads))
    areas, forces = part_areas(block, state.positions), part_forces(block, state, loads)
    moved = state.positions - equilibrated
    normal = part_displacements(block, moved)
    row: dict[str, float] = {}
    for index, part in enumerate(block.parts):
        force = forces[index] if part.mechanical in HELD else loads.pressure[index] * areas[index]
        row |= {
            f"{part.name}_force": force,
            f"{part.name}_pressure": force / areas[index] if areas[index] > 0.0 else 0.0,
            f"{part.name}_displacement": normal[index],
        }
        if part.mechanical == "glued-plate":
            first = block.grid.face_vertices[0, block.part_faces[index][0]]
            row[f"{part.name}_tangential_displacement"] = moved[1 - EDGE_AXIS[part.edge], first]
        if part.open:
            row[f"{part.name}_bath_concentration"] = loads.bath_concentration[index]
            row[f"{part.name}_bath_pressure"] = loads.bath_pressure[index]
    return row | (_electrical(block, state, loads) if block.model.transports_ions else {})


def _electrical(block: Block, state: BlockState, loads: PartLoads) -> dict[str, float]:
    """Currents and potentials of the parts that are crossed.

    Currents that are prescribed, be it as none, are those that the balances hold to rounding.
    """
    row: dict[str, float] = {}
    outer = block.outer(state.unknowns)
    millivolts = first_point(block.cells.thermal_energy) / FARADAY
    for index, faces in zip(block.crossed_parts, block.crossed_faces, strict=True):
        part, unknown = block.parts[index], block.outside.part_potential(index)
        current, potential = loads.current[index], loads.potential[index]
        if unknown is not None:
            potential = millivolts * outer[unknown]
        elif part.electrical in CONDUCTING:
            current = -FARADAY * state.transport.fluxes[2, faces].sum()
        else:
            own = block.outside.part == index
            ends = block.grid.face_vertices[:, block.part_faces[index]]
            areas = np.hypot(*edge_area_vectors(block.grid.section, *state.positions[:, ends]))
            potential = millivolts * float(outer[own] @ areas / areas.sum())
        row |= {f"{part.name}_current": current, f"{part.name}_potential": potential}
    return row
