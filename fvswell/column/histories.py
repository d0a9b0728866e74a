"""What is driven and measured at the two parts of a column, over time: named "PART_KIND", arrays ``(outputs,)``."""

from __future__ import annotations

from fvswell.column.balances import COLUMN_LOADS
from fvswell.column.column import Column
from fvswell.column.electrical import potentials_of_parts
from fvswell.numerics.state import Record
from fvswell.physics.tissue import Array

__all__ = ["column_histories"]


def column_histories(
    column: Column, initial_volume_ratio: Array, record: Record, potential_difference: Array
) -> dict[str, Array]:
    """Histories of both parts of a column.

    Pressures are without those of the baths, which press on open parts as well. What has entered, and the current, are
    per area.

    Parameters
    ----------
    column
        That was run.
    initial_volume_ratio
        J of the cells in equilibrium before the first phase.
    record
        Its outputs.
    potential_difference
        Potential of the piston less that of the filter, mV, (outputs,); of no meaning where ions are not transported.
    """
    outputs = int(record.filled[0])
    crossed = record.crossed[:outputs]
    values = dict(zip(COLUMN_LOADS, record.loads[:outputs].T, strict=True))
    filter_part, piston_part = column.parts
    total = values["pressure"] + (values["piston_bath_pressure"] if piston_part.open else 0.0)
    histories = {
        f"{filter_part.name}_pressure": total - (values["filter_bath_pressure"] if filter_part.open else 0.0),
        f"{piston_part.name}_pressure": values["pressure"],
        f"{filter_part.name}_displacement": 0.0 * total,
        f"{piston_part.name}_displacement": values["height"] - initial_volume_ratio @ column.grid.widths,
    }
    ions = column.model.transports_ions
    for index, (end, part) in enumerate(zip(("filter", "piston"), column.parts, strict=True)):
        if part.open:
            histories |= {
                f"{part.name}_bath_{kind}": values[f"{end}_bath_{kind}"] for kind in ("concentration", "pressure")
            }
            histories[f"{part.name}_water_volume"] = crossed[:, index, 0]
        if ions and (part.open or column.ends[1, index] != 0.0):
            histories[f"{part.name}_cation_amount"] = crossed[:, index, 2]
            histories[f"{part.name}_anion_amount"] = crossed[:, index, 1]
    if ions:
        given = values["filter_potential"], values["piston_potential"]
        potentials = potentials_of_parts(column.parts, potential_difference, given)
        for part, sign, potential in zip(column.parts, (1.0, -1.0), potentials, strict=True):
            histories[f"{part.name}_current"] = sign * values["filter_current"]
            histories[f"{part.name}_potential"] = potential
    return histories
