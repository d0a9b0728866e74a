"""Loads on the parts of the boundary of a block, as arrays over the parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from fvswell.boundary.parts import Part, load_names
from fvswell.physics.tissue import Array

__all__ = ["PartLoads", "part_loads", "pressing_loads"]

_EXCLUSIVE = ("pressure", "force", "displacement")


class PartLoads(NamedTuple):
    """What acts on the parts, ``(parts,)`` each, in the units of `fvswell.boundary.parts.load_names`.

    Displacements are nan where none is prescribed. Parts that are closed have a bath that nothing sees.
    """

    pressure: Array
    force: Array
    displacement: Array
    tangential_displacement: Array
    bath_concentration: Array
    bath_pressure: Array
    current: Array
    potential: Array


def part_loads(parts: Sequence[Part], values: Array, concentration: float) -> PartLoads:
    """Loads of the parts from the values of all loads.

    Parameters
    ----------
    parts
        Of the boundary.
    values
        In the order of `load_names`; nan where a load is not prescribed. Nothing acts then: a bath is that of
        ``concentration``, without pressure.
    concentration
        Of the bath that the block has been equilibrated in, mmol/mm3.

    Raises
    ------
    ValueError
        If a part is driven in more than one way at once; all such parts in one message.
    """
    loads = _of_parts(parts, dict(zip(load_names(parts), values, strict=True)), concentration)
    driven = np.array([[not np.isnan(value) for value in values] for values in loads[:3]]).sum(axis=0)
    if (driven > 1).any():
        names = ", ".join(part.name for part, ways in zip(parts, driven, strict=True) if ways > 1)
        raise ValueError(f"{names}: driven in more than one way at once; give pressure, force or displacement")
    return _without_gaps(loads)


def pressing_loads(parts: Sequence[Part], found: Mapping[str, float], concentration: float) -> PartLoads:
    """Loads of the parts where all of them are known, prescribed or found: forces as the mean pressures they make."""
    loads = _of_parts(parts, found, concentration)
    nothing = np.full(len(parts), np.nan)
    return _without_gaps(loads._replace(force=nothing, displacement=nothing, tangential_displacement=nothing))


def _of_parts(parts: Sequence[Part], given: Mapping[str, float], concentration: float) -> PartLoads:
    loads = PartLoads(
        *(np.array([given.get(f"{part.name}.{kind}", np.nan) for part in parts]) for kind in PartLoads._fields)
    )
    bath = np.where(np.isnan(loads.bath_concentration), concentration, loads.bath_concentration)
    return loads._replace(bath_concentration=bath)


def _without_gaps(loads: PartLoads) -> PartLoads:
    """What is not prescribed is zero, but for displacements."""
    zeroed = {
        kind: np.nan_to_num(values)
        for kind, values in loads._asdict().items()
        if kind not in ("displacement", "tangential_displacement")
    }
    return loads._replace(**zeroed)
