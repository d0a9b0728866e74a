"""Forces of the deformed solid and of the pressure on the vertices of quadrilaterals, with their exact stiffness.

The stress is evaluated at four points of each cell (bilinear displacements, 2 x 2 Gauss points). By virtual work with
the first Piola-Kirchhoff stress P,

    force on a vertex = sum over points  weight * P : dF/d(position of the vertex),

with dF/d(position) constant, as F is linear in the positions. F is given as (xx, xy, yx, yy, zz), zz being the hoop
direction r/R of rings, or 1 in plane strain. The integration points are numbered as in `fvswell.block.grid`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fvswell.block.geometry import edge_pressure_forces, quadrilateral_gradient
from fvswell.block.grid import BlockGrid
from fvswell.compiled import kernel
from fvswell.compiled.dual import slope_of, value_of, variables
from fvswell.physics.solids import SolidStress, cauchy_stress
from fvswell.physics.tissue import Array, Tissue

__all__ = [
    "BlockSolid",
    "Mechanics",
    "block_solid",
    "cell_stress",
    "deformation_gradient",
    "find_edge_forces",
    "find_forces",
    "find_stiffness",
    "integration_points",
]

_CORNERS = np.array([[-1.0, 1.0, 1.0, -1.0], [-1.0, -1.0, 1.0, 1.0]])  # of the unit cell
_POINTS = _CORNERS / np.sqrt(3.0)


class BlockSolid(NamedTuple):
    """The solid of a block, at its integration points."""

    parameters: Any  # (parameters, 4 cells): of the solid and, last, the fluid fraction
    slopes: Any  # (cells, 4 points, 3, 4 corners): of the shape functions along x and y, and they over the radius
    weights: Any  # (cells, 4 points): reference volumes
    cell_vertices: Any  # (4, cells)


class Mechanics(NamedTuple):
    """Deformation and forces, set by `find_forces`. Corners of cells: all x before all y."""

    deformation: Any  # (5, 4 cells): F
    stress: Any  # (5, 4 cells): P
    tangent: Any  # (5, 5, 4 cells): its derivative by F
    forces: Any  # (8, cells): what holds the corners where they are, against solid and pressure
    gradient: Any  # (8, cells): volumes of the cells by positions of the corners


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
    slopes = np.zeros((grid.cells, 4, 3, 4))
    slopes[:, :, 0], slopes[:, :, 1] = gradient[..., 0], gradient[..., 1]
    if grid.section.rings:
        slopes[:, :, 2] = shape / radius[..., None]
    numbers = [*tissue.solid, tissue.fluid_fraction]
    parameters = np.stack([np.broadcast_to(number, 4 * grid.cells) for number in numbers]).astype(float)
    weights = np.linalg.det(jacobian) * grid.section.thickness(radius)
    return BlockSolid(parameters, slopes, weights, np.ascontiguousarray(grid.cell_vertices, dtype=np.int64))


def mechanics_room(cells: int) -> Mechanics:
    """Arrays for `find_forces`."""
    points = 4 * cells
    shapes: list[tuple[int, ...]] = [(5, points), (5, points), (5, 5, points), (8, cells), (8, cells)]
    return Mechanics(*(np.empty(shape) for shape in shapes))


@kernel
def find_forces(
    section: Any, law: Any, solid: Any, positions: Any, pressure: Any, of_vertex: Any, result: Any, total: Any
) -> Any:
    """Forces at the corners of the cells and, summed up, along the displacements.

    Parameters
    ----------
    section, law, solid
        Of the grid, of `fvswell.block.laws`, and `BlockSolid`.
    positions
        Of the vertices, (2, vertices) mm.
    pressure
        Of the fluid in the cells, (cells,) MPa.
    of_vertex
        (2, vertices): displacement that moves each component, -1 where it is held.
    result
        `Mechanics`, set.
    total
        (displacements,), set.
    """
    cells = len(pressure)
    v, F, P = solid.cell_vertices, result.deformation, result.stress
    for c in range(cells):
        for q in range(4):
            i = q * cells + c
            for component in range(5):
                F[component, i] = section.slab if component == 4 else 0.0
            for a in range(4):
                x, y = positions[0, v[a, c]], positions[1, v[a, c]]
                F[0, i] += solid.slopes[c, q, 0, a] * x
                F[1, i] += solid.slopes[c, q, 1, a] * x
                F[2, i] += solid.slopes[c, q, 0, a] * y
                F[3, i] += solid.slopes[c, q, 1, a] * y
                F[4, i] += solid.slopes[c, q, 2, a] * x
    law(solid.parameters, F, P, result.tangent)
    for k in range(len(total)):
        total[k] = 0.0
    for c in range(cells):
        x = (positions[0, v[0, c]], positions[0, v[1, c]], positions[0, v[2, c]], positions[0, v[3, c]])
        y = (positions[1, v[0, c]], positions[1, v[1, c]], positions[1, v[2, c]], positions[1, v[3, c]])
        gradient = quadrilateral_gradient(section, x, y)
        for a in range(4):
            along_x, along_y = 0.0, 0.0
            for q in range(4):
                i, weight = q * cells + c, solid.weights[c, q]
                by_x, by_y, hoop = solid.slopes[c, q, 0, a], solid.slopes[c, q, 1, a], solid.slopes[c, q, 2, a]
                along_x += weight * (by_x * P[0, i] + by_y * P[1, i] + hoop * P[4, i])
                along_y += weight * (by_x * P[2, i] + by_y * P[3, i])
            result.forces[a, c] = along_x - pressure[c] * gradient[a]
            result.forces[4 + a, c] = along_y - pressure[c] * gradient[4 + a]
            for component in range(2):
                k = 4 * component + a
                result.gradient[k, c] = gradient[k]
                if of_vertex[component, v[a, c]] >= 0:
                    total[of_vertex[component, v[a, c]]] += result.forces[k, c]


@kernel
def find_stiffness(
    section: Any,
    solid: Any,
    positions: Any,
    mechanics: Any,
    pressure: Any,
    pressure_slope: Any,
    scratch: Any,
    stiffness: Any,
) -> Any:
    """Derivative of the forces at the corners by the positions of the corners, (8, 8, cells).

    ``pressure_slope`` (cells,) is the derivative of the pressure by the volume of the cell; ``scratch`` is (5, 8).
    """
    cells = len(pressure)
    v, T = solid.cell_vertices, mechanics.tangent
    for c in range(cells):
        x = (positions[0, v[0, c]], positions[0, v[1, c]], positions[0, v[2, c]], positions[0, v[3, c]])
        y = (positions[1, v[0, c]], positions[1, v[1, c]], positions[1, v[2, c]], positions[1, v[3, c]])
        p = variables(x[0], x[1], x[2], x[3], y[0], y[1], y[2], y[3])
        gradient = quadrilateral_gradient(section, (p[0], p[1], p[2], p[3]), (p[4], p[5], p[6], p[7]))
        for k in range(8):
            outward = pressure_slope[c] * value_of(gradient[k])
            for m in range(8):
                stiffness[k, m, c] = -pressure[c] * slope_of(gradient[k], m) - outward * value_of(gradient[m])
        for q in range(4):
            i, weight = q * cells + c, solid.weights[c, q]
            for a in range(4):
                by_x, by_y, hoop = solid.slopes[c, q, 0, a], solid.slopes[c, q, 1, a], solid.slopes[c, q, 2, a]
                for j in range(5):
                    scratch[j, a] = weight * (T[j, 0, i] * by_x + T[j, 1, i] * by_y + T[j, 4, i] * hoop)
                    scratch[j, 4 + a] = weight * (T[j, 2, i] * by_x + T[j, 3, i] * by_y)
            for a in range(4):
                by_x, by_y, hoop = solid.slopes[c, q, 0, a], solid.slopes[c, q, 1, a], solid.slopes[c, q, 2, a]
                for m in range(8):
                    stiffness[a, m, c] += by_x * scratch[0, m] + by_y * scratch[1, m] + hoop * scratch[4, m]
                    stiffness[4 + a, m, c] += by_x * scratch[2, m] + by_y * scratch[3, m]


@kernel
def find_edge_forces(
    section: Any, face_vertices: Any, positions: Any, pressure: Any, of_vertex: Any, slopes: Any, total: Any
) -> Any:
    """Forces of pressures (faces,) on faces at the edges, along the displacements.

    ``total`` (displacements,) is set; so is ``slopes`` (4, 4, faces), minus the derivatives of the forces at the ends
    of the faces by their positions, all x before all y.
    """
    for k in range(len(total)):
        total[k] = 0.0
    for f in range(len(pressure)):
        first, second = face_vertices[0, f], face_vertices[1, f]
        p = variables(positions[0, first], positions[0, second], positions[1, first], positions[1, second])
        forces = edge_pressure_forces(section, (p[0], p[1]), (p[2], p[3]))
        for k in range(4):
            for m in range(4):
                slopes[k, m, f] = -pressure[f] * slope_of(forces[k], m)
            vertex = first if k % 2 == 0 else second
            index = of_vertex[k // 2, vertex]
            if index >= 0:
                total[index] += pressure[f] * value_of(forces[k])


def deformation_gradient(solid: BlockSolid, slab: float, positions: Array) -> Array:
    """F at the integration points, ``(5, ..., 4, cells)``, from positions of the vertices ``(..., 2, vertices)``.

    ``slab`` is of the section.
    """
    x, y = np.moveaxis(positions[..., solid.cell_vertices], -3, 0)
    by_x, by_y, hoop = np.moveaxis(solid.slopes, 2, 0)
    parts = ((by_x, x), (by_y, x), (by_x, y), (by_y, y), (hoop, x))
    F = np.stack([np.einsum("cqa,...ac->...qc", slope, component) for slope, component in parts])
    F[4] += slab
    return F


def cell_stress(solid: BlockSolid, law: type, F: Array) -> SolidStress:
    """Cauchy stress of the solid, means over the cells, each component ``(..., cells)``; F as above."""
    *numbers, fluid_fraction = solid.parameters.reshape(len(solid.parameters), *F.shape[-2:])
    stress = cauchy_stress(law(*numbers), fluid_fraction, tuple(F))
    return SolidStress(*(component.mean(axis=-2) for component in stress))


def _shape_functions() -> tuple[Array, Array]:
    """Bilinear shape functions (points, corners) and their slopes (points, corners, 2) at the integration points."""
    along = 1.0 + _POINTS[:, :, None] * _CORNERS[:, None, :]
    slope = 0.25 * np.stack([_CORNERS[0] * along[1], _CORNERS[1] * along[0]], axis=-1)
    return 0.25 * along[0] * along[1], slope
