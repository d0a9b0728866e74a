"""A measured curve: what was measured, when, with which noise, and in which case."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from fvswell.case.case import Case
from fvswell.physics.tissue import Array
from fvswell.results.fields import FIELDS, Field, part_fields

__all__ = ["Measurement", "histories_of", "history_dimension", "history_unit"]

_DIMENSIONS = {  # dimension of `fvswell.units` by the unit of a history
    "1": "plain number", "mm": "length", "N": "force", "N mm-2": "pressure", "mmol mm-3": "concentration",
    "mV": "electric potential", "A": "electric current", "A mm-2": "current density",
}  # fmt: skip


@dataclass(frozen=True)
class Measurement:
    """A measured curve.

    Parameters
    ----------
    name
        Of the measurement; no two of a problem are alike.
    case
        What was done to the sample.
    quantity
        Name of a history of the case's result.
    times
        s since the run began, increasing, shape (points,).
    values
        In the unit of the history, shape (points,).
    noise
        Standard deviation, in the unit of the history; None if it is to be estimated.
    weight
        How often each point counts.
    source
        Where it comes from.
    """

    name: str
    case: Case
    quantity: str
    times: Array
    values: Array
    noise: float | None = None
    weight: float = 1.0
    source: str = ""

    def __len__(self) -> int:
        return len(self.times)

    @property
    def units(self) -> str:
        """Unit of the values, as results have it."""
        return histories_of(self.case)[self.quantity].units

    @property
    def size(self) -> float:
        """How much the values vary: largest less smallest, or the largest in magnitude where they do not."""
        return float(np.ptp(self.values)) or float(np.abs(self.values).max()) or 1.0


def histories_of(case: Case) -> dict[str, Field]:
    """Histories that results of a case may have, and that can be measured."""
    table = {name: each for name, each in FIELDS.items() if each.location == "global"}
    parts = part_fields([part.name for part in case.parts], case.geometry.kind == "column")
    return {name: each for name, each in (table | parts).items() if each.units in _DIMENSIONS}


def history_unit(units: str) -> str:
    """Unit of a history as people write it: "N/mm^2" for "N mm-2"; "" for a plain number."""
    parts = units.split()
    if parts == ["1"]:
        return ""
    split = [re.fullmatch(r"([A-Za-z]+)(-?\d+)?", part) for part in parts]
    powers = [(part[1], int(part[2] or 1)) for part in split if part is not None]
    above = " ".join(_power(name, power) for name, power in powers if power > 0) or "1"
    below = " ".join(_power(name, -power) for name, power in powers if power < 0)
    return f"{above}/({below})" if " " in below else f"{above}/{below}" if below else above


def history_dimension(units: str) -> str:
    """Name in `fvswell.units` of the dimension of a history that can be measured."""
    return _DIMENSIONS[units]


def _power(name: str, power: int) -> str:
    return name if power == 1 else f"{name}^{power}"
