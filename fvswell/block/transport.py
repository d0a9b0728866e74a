"""Contents of the cells of a block and fluxes through its faces, with their slopes: loops that run compiled.

The balance of each quantity over an interval reads, for a cell of reference volume V,

    V (content - base) + duration (sum over faces of the flux outward) = 0

with ``base`` the content the interval starts from, per reference volume, and fluxes in total per face. A flux depends
on the state at the face (volume ratio of its diamond, mean ln a~) and on the normal gradients of the potentials, linear
in their differences across and along the face.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fvswell.block.diamonds import Diamonds
from fvswell.block.geometry import diamond_metric, quadrilateral_gradient, quadrilateral_volume
from fvswell.compiled import kernel, point
from fvswell.compiled.dual import slope_of, variables

__all__ = [
    "Transport",
    "TransportSlopes",
    "TransportTables",
    "find_transport",
    "find_transport_slopes",
    "find_volume_ratio",
    "flux_change",
]


class TransportTables(NamedTuple):
    """What does not change: topology, properties, and constant maps, each as the three arrays of a CSR matrix."""

    cell_vertices: Any  # (4, cells)
    volumes: Any  # (cells,) reference
    cell_parameters: Any  # (parameters, cells)
    storage: Any  # from water potentials to volumes stored, see `fvswell.block.stabilisation`
    face_cells: Any  # (2, crossed), see `fvswell.block.diamonds` from here on
    face_parameters: Any  # (parameters + 1, crossed)
    along: Any
    places: Any
    place_of_point: Any  # (6, crossed)
    reference_volumes: Any  # (crossed,)


class Transport(NamedTuple):
    """State of the cells and of the crossed faces, set by `find_transport`."""

    volume_ratio: Any  # (cells,)
    log_activity: Any  # (cells,)
    osmotic: Any  # (3, cells): pressure, and its slopes by J and ln a~
    salt: Any  # (3, cells): content of anions, and its slopes
    contents: Any  # (balances, cells), per reference volume
    points: Any  # (2, places) of the diamonds
    face_ratio: Any  # (crossed,): J of the diamonds
    face_activity: Any  # (crossed,)
    metric: Any  # (3, crossed), see `geometry.diamond_metric`
    across: Any  # (balances, crossed): differences of the potentials across the faces
    along: Any  # and along them
    gradients: Any  # (balances, crossed), times the areas of the faces
    fluxes: Any  # (balances, crossed), in total per face
    slopes: Any  # (balances, 2 + balances, crossed): by J, ln a~ and the gradients
    outflow: Any  # (balances, cells)


class TransportSlopes(NamedTuple):
    """Derivatives of the balances by what they depend on locally, those of the fluxes times the duration."""

    contents_by_corner: Any  # (balances, 8, cells): contents times volume, by positions of the corners
    contents_by_activity: Any  # (balances, cells)
    by_activity: Any  # (balances, 1, crossed)
    across: Any  # (balances, balances, crossed)
    along: Any  # (balances, balances, crossed)
    points: Any  # (balances, 12, crossed): by the points of the diamonds, all x before all y


def transport_room(balances: int, tables: TransportTables) -> Transport:
    """Arrays for `find_transport`."""
    cell, face = (len(tables.volumes),), (len(tables.reference_volumes),)
    points = (2, len(tables.places[0]) - 1)
    shapes: list[tuple[int, ...]] = [cell, cell, (3, *cell), (3, *cell), (balances, *cell), points, face, face]
    shapes += [(3, *face)] + [(balances, *face)] * 4 + [(balances, 2 + balances, *face), (balances, *cell)]
    return Transport(*(np.empty(shape) for shape in shapes))


def csr_arrays(matrix: Any) -> tuple[Any, Any, Any]:
    """Arrays of a sparse matrix as kernels take them."""
    return matrix.indptr.astype(np.int64), matrix.indices.astype(np.int64), matrix.data.astype(float)


@point
def row_product(matrix: Any, row: Any, vector: Any) -> Any:
    """A row of a sparse matrix times a vector."""
    begin, columns, values = matrix
    total = 0.0
    for entry in range(begin[row], begin[row + 1]):
        total += values[entry] * vector[columns[entry]]
    return total


@point
def _find_points(tables: Any, positions: Any, points: Any) -> Any:
    """Positions, or displacements, of all points of the diamonds, (2, places)."""
    for component in range(2):
        for place in range(points.shape[1]):
            points[component, place] = row_product(tables.places, place, positions[component])


@point
def _of_diamond(tables: Any, values: Any, f: Any) -> Any:
    """Values, ``(places,)``, at the six points of a diamond."""
    p = tables.place_of_point
    return (
        values[p[0, f]], values[p[1, f]], values[p[2, f]], values[p[3, f]], values[p[4, f]], values[p[5, f]]
    )  # fmt: skip


@kernel
def find_volume_ratio(section: Any, tables: Any, positions: Any, volume_ratio: Any) -> Any:
    """Set the volumes of the cells over those of reference, (cells,), with the vertices at positions."""
    v = tables.cell_vertices
    for c in range(len(volume_ratio)):
        x = (positions[0, v[0, c]], positions[0, v[1, c]], positions[0, v[2, c]], positions[0, v[3, c]])
        y = (positions[1, v[0, c]], positions[1, v[1, c]], positions[1, v[2, c]], positions[1, v[3, c]])
        volume_ratio[c] = quadrilateral_volume(section, x, y) / tables.volumes[c]


@kernel
def find_transport(
    section: Any,
    cell_law: Any,
    face_law: Any,
    tables: Any,
    positions: Any,
    potentials: Any,
    outside_across: Any,
    outside_along: Any,
    log_bath: Any,
    result: Any,
) -> Any:
    """Contents and fluxes.

    Parameters
    ----------
    section
        Of the grid.
    cell_law, face_law
        Of `fvswell.block.laws`.
    tables
        `TransportTables`.
    positions
        Of the vertices, (2, vertices) mm.
    potentials
        Of the cells, (balances, cells).
    outside_across, outside_along
        (balances, crossed): what `fvswell.block.outside.Beyond` adds to the differences of the potentials.
    log_bath
        ln a~ of the reference bath, for models in which it is that of the cells as well.
    result
        `Transport`, set.
    """
    balances, cells = potentials.shape
    for c in range(cells):
        v = tables.cell_vertices
        x = (positions[0, v[0, c]], positions[0, v[1, c]], positions[0, v[2, c]], positions[0, v[3, c]])
        y = (positions[1, v[0, c]], positions[1, v[1, c]], positions[1, v[2, c]], positions[1, v[3, c]])
        result.volume_ratio[c] = quadrilateral_volume(section, x, y) / tables.volumes[c]
        result.log_activity[c] = potentials[1, c] if balances > 1 else log_bath
    cell_law(tables.cell_parameters, result.volume_ratio, result.log_activity, result.osmotic, result.salt)
    for c in range(cells):
        stored = row_product(tables.storage, c, potentials[0])
        result.contents[0, c] = result.volume_ratio[c] + stored / tables.volumes[c]
        if balances > 1:
            result.contents[1, c] = result.salt[0, c]
            result.contents[2, c] = 0.0
        for b in range(balances):
            result.outflow[b, c] = 0.0
    crossed = tables.face_cells.shape[1]
    _find_points(tables, positions, result.points)
    for f in range(crossed):
        metric = diamond_metric(
            section, _of_diamond(tables, result.points[0], f), _of_diamond(tables, result.points[1], f)
        )
        for m in range(3):
            result.metric[m, f] = metric[m]
        result.face_ratio[f] = metric[0] / tables.reference_volumes[f]
        first, second = tables.face_cells[0, f], tables.face_cells[1, f]
        for b in range(balances):
            across = outside_across[b, f] - potentials[b, first]
            if second >= 0:
                across += potentials[b, second]
            result.across[b, f] = across
            result.along[b, f] = outside_along[b, f] + row_product(tables.along, f, potentials[b])
            result.gradients[b, f] = metric[1] * across + metric[2] * result.along[b, f]
        if balances == 1:
            result.face_activity[f] = log_bath
        elif second >= 0:
            result.face_activity[f] = 0.5 * (potentials[1, first] + potentials[1, second])
        else:
            result.face_activity[f] = outside_across[1, f]
    face_law(
        tables.face_parameters, result.face_ratio, result.face_activity, result.gradients, result.fluxes, result.slopes
    )
    for f in range(crossed):
        first, second = tables.face_cells[0, f], tables.face_cells[1, f]
        for b in range(balances):
            result.outflow[b, first] += result.fluxes[b, f]
            if second >= 0:
                result.outflow[b, second] -= result.fluxes[b, f]


@kernel
def find_transport_slopes(section: Any, tables: Any, positions: Any, transport: Any, duration: Any, slopes: Any) -> Any:
    """Set `TransportSlopes` at a state that `find_transport` has found; by position only where there is room for it."""
    balances, cells = transport.contents.shape
    crossed = tables.face_cells.shape[1]
    for c in range(cells):
        v = tables.cell_vertices
        x = (positions[0, v[0, c]], positions[0, v[1, c]], positions[0, v[2, c]], positions[0, v[3, c]])
        y = (positions[1, v[0, c]], positions[1, v[1, c]], positions[1, v[2, c]], positions[1, v[3, c]])
        gradient = quadrilateral_gradient(section, x, y)
        for k in range(8):
            slopes.contents_by_corner[0, k, c] = gradient[k]
            if balances > 1:
                slopes.contents_by_corner[1, k, c] = transport.salt[1, c] * gradient[k]
                slopes.contents_by_corner[2, k, c] = 0.0
        if balances > 1:
            slopes.contents_by_activity[0, c] = 0.0
            slopes.contents_by_activity[1, c] = tables.volumes[c] * transport.salt[2, c]
            slopes.contents_by_activity[2, c] = 0.0
    for f in range(crossed):
        x = _of_diamond(tables, transport.points[0], f)
        y = _of_diamond(tables, transport.points[1], f)
        p = variables(x[0], x[1], x[2], x[3], x[4], x[5], y[0], y[1], y[2], y[3], y[4], y[5])
        volume, by_across, by_along = diamond_metric(
            section, (p[0], p[1], p[2], p[3], p[4], p[5]), (p[6], p[7], p[8], p[9], p[10], p[11])
        )
        for b in range(balances):
            if balances > 1:
                slopes.by_activity[b, 0, f] = duration * transport.slopes[b, 1, f]
            across, along = 0.0, 0.0
            for g in range(balances):
                by_gradient = duration * transport.slopes[b, 2 + g, f]
                slopes.across[b, g, f] = by_gradient * transport.metric[1, f]
                slopes.along[b, g, f] = by_gradient * transport.metric[2, f]
                across += by_gradient * transport.across[g, f]
                along += by_gradient * transport.along[g, f]
            by_volume = duration * transport.slopes[b, 0, f] / tables.reference_volumes[f]
            for k in range(12):
                slopes.points[b, k, f] = (
                    by_volume * slope_of(volume, k) + across * slope_of(by_across, k) + along * slope_of(by_along, k)
                )


@kernel
def flux_change(
    tables: Any,
    slopes: Any,
    displacements: Any,
    potentials: Any,
    outside_across: Any,
    outside_along: Any,
    points: Any,
    change: Any,
) -> Any:
    """Change of what flows through the faces in the duration of the slopes, (balances, crossed), by linearisation.

    ``displacements`` (2, vertices), ``potentials`` (balances, cells) and the differences of potentials that are made
    outside, (balances, crossed) each, are those of a Newton step; ``points`` is set as that of `Transport` is.
    """
    balances = potentials.shape[0]
    _find_points(tables, displacements, points)
    for f in range(tables.face_cells.shape[1]):
        first, second = tables.face_cells[0, f], tables.face_cells[1, f]
        x = _of_diamond(tables, points[0], f)
        y = _of_diamond(tables, points[1], f)
        for b in range(balances):
            p = slopes.points
            change[b, f] = (
                p[b, 0, f] * x[0] + p[b, 1, f] * x[1] + p[b, 2, f] * x[2] + p[b, 3, f] * x[3] + p[b, 4, f] * x[4]
                + p[b, 5, f] * x[5] + p[b, 6, f] * y[0] + p[b, 7, f] * y[1] + p[b, 8, f] * y[2] + p[b, 9, f] * y[3]
                + p[b, 10, f] * y[4] + p[b, 11, f] * y[5]
            )  # fmt: skip
            if balances > 1:
                at_face = outside_across[1, f]
                if second >= 0:
                    at_face = 0.5 * (potentials[1, first] + potentials[1, second])
                change[b, f] += slopes.by_activity[b, 0, f] * at_face
        for g in range(balances):
            across = outside_across[g, f] - potentials[g, first]
            if second >= 0:
                across += potentials[g, second]
            along = outside_along[g, f] + row_product(tables.along, f, potentials[g])
            for b in range(balances):
                change[b, f] += slopes.across[b, g, f] * across + slopes.along[b, g, f] * along


def transport_tables(
    cell_vertices: Any, volumes: Any, storage: Any, diamonds: Diamonds, cell_parameters: Any, face_parameters: Any
) -> TransportTables:
    """Put the tables together."""
    return TransportTables(
        np.ascontiguousarray(cell_vertices, dtype=np.int64), volumes, cell_parameters, csr_arrays(storage),
        np.ascontiguousarray(diamonds.cells, dtype=np.int64), face_parameters, csr_arrays(diamonds.along),
        csr_arrays(diamonds.places), np.ascontiguousarray(diamonds.place_of_point, dtype=np.int64),
        diamonds.reference_volumes,
    )  # fmt: skip
