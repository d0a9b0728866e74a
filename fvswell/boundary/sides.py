"""The four edges of a block: their names, and where they face."""

from __future__ import annotations

__all__ = ["EDGES", "EDGE_AXIS", "OUTWARD"]

EDGES = ("left", "right", "bottom", "top")
EDGE_AXIS = {"left": 0, "right": 0, "bottom": 1, "top": 1}  # direction of the normal
OUTWARD = {"left": -1.0, "right": 1.0, "bottom": -1.0, "top": 1.0}  # sign of the outward normal
