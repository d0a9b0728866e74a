"""Electrical conditions of a column: what its two parts say of the current, and of the potentials.

One current flows through the whole column. It is none where a part insulates or floats; it is given where a part gives
it; and where the potentials of both parts are given (grounded being 0) it is found. Models that do not transport ions
know of none of this.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fvswell.boundary.parts import Part
from fvswell.numerics.loads import Load
from fvswell.physics.tissue import Array

__all__ = ["Parts", "current_is_found", "electrical_loads", "electrode_sign", "potentials_of_parts"]

Parts = tuple[Part, Part]  # at x = 0 and at x = h
_POTENTIAL_IS_GIVEN = ("grounded", "potential")


def electrode_sign(part: Part) -> float:
    """Sign of the ion that an electrode in a closed part exchanges; 0 without an electrode."""
    if part.open or part.electrical == "insulating":
        return 0.0
    return {"bath": 0.0, "cation": 1.0, "anion": -1.0}[part.electrode]


def current_is_found(parts: Parts) -> bool:
    """Whether the potentials of both parts are given, and so the current is found."""
    return all(part.electrical in _POTENTIAL_IS_GIVEN for part in parts)


def electrical_loads(parts: Parts, given: Mapping[str, Any]) -> dict[str, Any]:
    """Currents and potentials among the loads of a column.

    Parameters
    ----------
    parts
        Of the column.
    given
        Loads by name, "PART.KIND"; others than currents and potentials are passed over.

    Returns
    -------
    dict
        Loads by their names in `fvswell.column.balances.COLUMN_LOADS`; None for what is found.
    """
    ends = dict(zip(("filter", "piston"), parts, strict=True))

    def load(part: Part, kind: str) -> Any:
        return given.get(f"{part.name}.{kind}") or Load(0.0)

    currents: dict[str, Any] = {f"{end}_current": None for end in ends}
    potentials = {
        f"{end}_potential": load(part, "potential") if part.electrical in _POTENTIAL_IS_GIVEN else None
        for end, part in ends.items()
    }
    driven = next((end for end, part in ends.items() if part.electrical == "current"), None)
    if driven is not None and not any(part.electrical in ("insulating", "floating") for part in parts):
        currents[f"{driven}_current"] = load(ends[driven], "current")
    elif not current_is_found(parts):
        currents["filter_current"] = Load(0.0)
    return currents | potentials


def potentials_of_parts(parts: Parts, difference: Array, loads: tuple[Array, Array]) -> tuple[Array, Array]:
    """Potentials of both parts, mV, relative to the reference.

    The reference is a part whose potential is given, else the bath of the first open part, else the first part.

    Parameters
    ----------
    parts
        Of the column.
    difference
        Potential of the second part less that of the first, mV.
    loads
        Potentials that are given for the two.
    """
    given = [index for index, part in enumerate(parts) if part.electrical in _POTENTIAL_IS_GIVEN]
    opened = [index for index, part in enumerate(parts) if part.open]
    reference = [*given, *opened, 0][0]
    level = loads[reference] if parts[reference].electrical == "potential" else np.zeros_like(difference)
    return (level, level + difference) if reference == 0 else (level - difference, level)
