"""Forces of the deformed solid on the vertices of quadrilaterals, with their exact stiffness.

The stress is evaluated at four points of each cell (bilinear displacements, 2 x 2 Gauss points). By virtual work with
the first Piola-Kirchhoff stress P,

    force on a vertex = sum over points  weight * P : dF/d(position of the vertex),

with dF/d(position) constant, as F is linear in the positions. F is told as (xx, xy, yx, yy, zz), zz being the hoop
direction r/R of rings, or 1 in plane strain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fvswell.block.grid import BlockGrid
from fvswell.physics.differentiation import local_derivative
from fvswell.physics.solid import SolidStress, cauchy_stress
from fvswell.physics.tissue import Array, Tissue

__all__ = ["BlockSolid", "block_solid", "integration_points"]

_CORNERS = np.array([[-1.0, 1.0, 1.0, -1.0], [-1.0, -1.0, 1.0, 1.0]])  # of the unit cell
_POINTS = _CORNERS / np.sqrt(3.0)


@dataclass(frozen=True)
class BlockSolid:
    """The solid of a block. Corner positions and forces are ``(2, 4, cells)``."""

    tissue: Tissue  # at the integration points, (1, 4 cells) or broadcasting to it
    operator: Array  # (cells, 4 points, 5, 8): dF/d(positions of the corners)
    weights: Array  # (cells, 4 points): reference volumes
    plane: bool

    def deformation_gradient(self, corners: Array) -> Array:
        """F at the integration points, ``(5, 4, cells)``."""
        F = np.einsum("cqfk,kc->fqc", self.operator, corners.reshape(8, -1))
        if self.plane:
            F[4] = 1.0
        return F

    def forces(self, F: Array) -> Array:
        """Forces that the corners need to stay where they are, ``(2, 4, cells)``."""
        P = np.moveaxis(self._piola(F.reshape(5, 1, -1)).reshape(F.shape), -1, 0)
        return np.einsum("cqfk,cfq,cq->kc", self.operator, P, self.weights).reshape(2, 4, -1)

    def stiffness(self, F: Array) -> Array:
        """Derivative of the forces by the positions, ``(8, 8, cells)``."""
        tangent = local_derivative(self._piola, F.reshape(5, 1, -1)).reshape(5, 5, *F.shape[1:])
        weighted = np.ascontiguousarray(tangent.transpose(3, 2, 0, 1)) * self.weights[..., None, None]
        cells = len(self.operator)
        product = (weighted @ self.operator).reshape(cells, 20, 8)
        return np.moveaxis(self.operator.reshape(cells, 20, 8).transpose(0, 2, 1) @ product, 0, -1)

    def cell_stress(self, F: Array) -> SolidStress:
        """Cauchy stress of the solid, means over the cells, each component ``(cells,)``."""
        stress = self._cauchy(F.reshape(5, 1, -1))
        means = [component.reshape(F.shape[1:]).mean(axis=0) for component in stress]
        return SolidStress(*means)

    def _cauchy(self, F: Array) -> SolidStress:
        xx, xy, yx, yy, zz = F
        return cauchy_stress(self.tissue, xx * xx + xy * xy, yx * yx + yy * yy, zz * zz, xx * yx + xy * yy)

    def _piola(self, F: Array) -> Array:
        """P = sigma cof F, shapes ``(5, ..., 4 cells)``."""
        xx, xy, yx, yy, zz = F
        sigma = self._cauchy(F)
        return np.stack(
            [
                (sigma.xx * yy - sigma.xy * xy) * zz,
                (sigma.xy * xx - sigma.xx * yx) * zz,
                (sigma.xy * yy - sigma.yy * xy) * zz,
                (sigma.yy * xx - sigma.xy * yx) * zz,
                sigma.zz * (xx * yy - xy * yx),
            ]
        )


def integration_points(grid: BlockGrid) -> Array:
    """Coordinates of the integration points, ``(2, 4 cells)``: where the solid's properties are asked for."""
    shape, _ = _shape_functions()
    return np.einsum("qa,dac->dqc", shape, grid.vertices[:, grid.cell_vertices]).reshape(2, -1)


def block_solid(grid: BlockGrid, tissue: Tissue) -> BlockSolid:
    """The solid of a block, with properties at its integration points."""
    shape, slope = _shape_functions()
    corners = grid.vertices[:, grid.cell_vertices]
    jacobian = np.einsum("qae,dac->cqde", slope, corners)
    gradient = np.einsum("qae,cqed->cqad", slope, np.linalg.inv(jacobian))  # of the shape functions
    radius = np.einsum("qa,ac->cq", shape, corners[0])
    operator = np.zeros((grid.cells, 4, 5, 2, 4))
    for component, (direction, by) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
        operator[:, :, component, direction] = gradient[..., by]
    if grid.section.rings:
        operator[:, :, 4, 0] = shape / radius[..., None]
    weights = np.linalg.det(jacobian) * grid.section.thickness(radius)
    return BlockSolid(tissue, operator.reshape(grid.cells, 4, 5, 8), weights, plane=not grid.section.rings)


def _shape_functions() -> tuple[Array, Array]:
    """Bilinear shape functions (points, corners) and their slopes (points, corners, 2) at the integration points."""
    along = 1.0 + _POINTS[:, :, None] * _CORNERS[:, None, :]
    slope = 0.25 * np.stack([_CORNERS[0] * along[1], _CORNERS[1] * along[0]], axis=-1)
    return 0.25 * along[0] * along[1], slope
