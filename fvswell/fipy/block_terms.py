"""The transport of a block as FiPy Terms: our diamond fluxes, which FiPy has nothing like, with implicit derivatives.

FiPy's own diffusion takes the difference across a face alone (on distorted quadrilaterals it does not converge) or
corrects for the rest explicitly (which diverges when the grid is refined).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse

from fvswell.block.block import Block
from fvswell.block.diamonds import Diamonds
from fvswell.block.outside import Beyond
from fvswell.fipy.terms import Linearisation, LinearisedTerm
from fvswell.physics.tissue import Array

__all__ = ["BlockTransportTerm", "DiamondFluxTerm"]


class BlockTransportTerm(LinearisedTerm):
    """Storage and outflow of volume, ions and charge in the cells of a block whose vertices stand still.

    Parameters
    ----------
    block
        The block.
    var
        Its potentials, a vector variable on the block's mesh (mu_f, and where ions are transported ln a~ and
        F psi~/(R T)).
    positions
        Of the vertices, ``(2, vertices)`` mm; may be set anew between sweeps, as may the rest.
    base
        Contents that the step starts from, ``(balances, cells)`` per reference volume.
    beyond
        What there is outside at the end of the step: ``block.beyond(loads, outer)``, with the unknowns of the boundary,
        if it has any, as they are.
    """

    def __init__(self, block: Block, var: Any, positions: Array, base: Array, beyond: Beyond) -> None:
        super().__init__(var)
        self.block, self.positions, self.base, self.beyond = block, positions, base, beyond

    def linearise(self, values: Array, dt: float | None) -> Linearisation:
        """Rates of storage and outflow at potentials, and their derivatives."""
        if dt is None:
            raise TypeError("the balances of a block have storage in them: give dt")
        potentials = values.reshape(len(self.block.balances), -1)
        system = self.block.transport_system(self.positions, potentials, self.base, dt, self.beyond)
        entries = system.jacobian
        return Linearisation(system.residual.ravel() / dt, entries.data / dt, entries.row, entries.col)


class DiamondFluxTerm(LinearisedTerm):
    """Outflow of a solute from the cells of a block: it diffuses, and is dragged along by the water.

    The flux through a face, in total, is  drag * water - diffusivity * (area * normal . grad c).

    Parameters
    ----------
    maps
        The diamonds of the block's faces.
    var
        The concentration, a variable on the block's mesh.
    metric
        Of the diamonds as they are now, ``(3, crossed)``, see `fvswell.block.geometry.diamond_metric`.
    diffusivity
        Per area of the face, one for each crossed face ``(crossed,)`` or for all, mm2/s.
    flow
        What the solute is dragged with through the crossed faces, in total, ``(crossed,)`` mm3/s.
    outside
        Concentration on the crossed faces of the boundary: a number, or one for each vertex of the grid.
    """

    def __init__(
        self, maps: Diamonds, var: Any, metric: Array, diffusivity: Array | float, flow: Array, outside: Array | float
    ) -> None:
        super().__init__(var)
        across, along = (sparse.diags_array(-diffusivity * part) for part in metric[1:])
        dragged = sparse.diags_array(flow)
        self._through = (across @ maps.across + along @ maps.along + dragged @ maps.mean).tocsr()
        bath = outside * np.ones(maps.across_outside.shape[1])
        at_boundary = maps.across_outside @ bath
        self._from_bath = across @ at_boundary + along @ (maps.along_outside @ bath) + flow * at_boundary
        self._outflow = maps.outflow

    def fluxes(self, values: Array) -> Array:
        """Fluxes through the crossed faces at concentrations of the cells, ``(crossed,)``."""
        fluxes: Array = self._through @ values + self._from_bath
        return fluxes

    def linearise(self, values: Array, dt: float | None) -> Linearisation:
        """Outflow and its derivatives."""
        matrix = (self._outflow @ self._through).tocoo()
        return Linearisation(self._outflow @ self.fluxes(values), matrix.data, matrix.row, matrix.col)
