"""A commented case to begin with, with the properties of a tissue from the literature."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import fill
from typing import Any

from fvswell.case.case import starter_text
from fvswell.case.errors import CaseError, Problem, nearest_name, shown
from fvswell.case.reading import value_type
from fvswell.case.tables import Table
from fvswell.case.tissue import Fibres, TissueProperties
from fvswell.physics.tissues import TISSUES

__all__ = ["starter_of_tissue"]

_FIRST, _AFTER = "[tissue]\n", "# The sample swells"
_BATH = ("# osmotic_coefficient = 0.93\n", "osmotic_coefficient = 0.93\n")
_HANDY = {"mmol/mm^3": (1e3, "M")}
_WIDTH = 116


def starter_of_tissue(name: str) -> str:
    """The commented starter with the properties of a set of `fvswell.physics.tissues.TISSUES`, and their source.

    Raises
    ------
    CaseError
        If there is no such set.
    """
    if name not in TISSUES:
        near = nearest_name(name, TISSUES)
        hint = f"; did you mean {near}?" if near else ""
        raise CaseError([Problem("--tissue", shown(name), f"must be one of {', '.join(TISSUES)}{hint}")], "new")
    chosen = TISSUES[name]
    before, _, rest = starter_text().partition(_FIRST)
    _, _, after = rest.partition(_AFTER)
    remarks = [chosen.title + ".", f"Source: {chosen.source}.", f"Assumed: {chosen.assumed}."]
    comment = "\n".join(fill(text, _WIDTH, initial_indent="# ", subsequent_indent="#   ") for text in remarks)
    lines = [comment, "[tissue]", *_lines(TissueProperties, chosen.properties), ""]
    for family in chosen.fibres:
        lines += ["[[tissue.fibres]]", *_lines(Fibres, family), ""]
    text = before + "\n".join(lines) + "\n" + _AFTER + after
    needs_bath = chosen.properties["osmotic"] in ("constant", "charge-dependent")
    return text.replace(*_BATH) if needs_bath else text


def _lines(table: type[Table], values: Mapping[str, Any]) -> list[str]:
    """Keys with their values and units."""
    return [f"{key} = {_text(table, key, value)}" for key, value in values.items()]


def _text(table: type[Table], key: str, value: Any) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    reader = value_type(table.model_fields[key])
    unit = reader.unit if reader is not None else ""
    factor, handy = _HANDY.get(unit, (1.0, unit))
    number = f"{factor * value:.6g}"
    return f'"{number} {handy}"' if unit else number
