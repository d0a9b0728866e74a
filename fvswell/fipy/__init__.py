"""FiPy by composition: our balances as FiPy Terms, and the same in FiPy's stock terms, on FiPy's meshes.

Nothing else in fvswell needs this package; a case asks for it with ``assembly = "fipy"`` or ``"stock-terms"``.
"""

from __future__ import annotations

from fvswell.fipy.block_terms import BlockTransportTerm, DiamondFluxTerm
from fvswell.fipy.body import assembled, fipy_body
from fvswell.fipy.mesh import block_mesh, column_mesh, column_nodes, edge_faces, move
from fvswell.fipy.moving import MovingBlock, MovingBody, MovingColumn, Step
from fvswell.fipy.stock_terms import AlwaysImplicitSourceTerm, StockTerms
from fvswell.fipy.terms import ColumnFluxTerm, LinearisedTerm, contents_variable, direct_solver

__all__ = [
    "AlwaysImplicitSourceTerm", "BlockTransportTerm", "ColumnFluxTerm", "DiamondFluxTerm", "LinearisedTerm",
    "MovingBlock", "MovingBody", "MovingColumn", "Step", "StockTerms", "assembled", "block_mesh", "column_mesh",
    "column_nodes", "contents_variable", "direct_solver", "edge_faces", "fipy_body", "move",
]  # fmt: skip
