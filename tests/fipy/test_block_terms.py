"""Blocks in FiPy: the mesh, the transport balances and the diamond fluxes as Terms, on distorted grids."""

from __future__ import annotations

import numpy as np
import pytest
from blocks import (
    CLAMPED,
    CLAMPED_DISC,
    acting,
    distorted_vertices,
    no_time,
    random_unknowns,
    rough_grid,
    uniform_block,
)
from fipy import CellVariable, CentralDifferenceConvectionTerm, DiffusionTerm
from fipy_columns import dense
from tissues import BATH

from fvswell.block.geometry import diamond_metric, edge_area_vectors, quadrilateral_volume
from fvswell.block.grid import BlockGrid, block_grid, shaped_block_grid
from fvswell.fipy import BlockTransportTerm, DiamondFluxTerm, block_mesh, direct_solver, edge_faces, move
from fvswell.numerics.graded_grid import graded_nodes
from fvswell.physics.models import BIPHASIC, MODELS
from fvswell.physics.tissue import Array

KINDS = ["plane-strain", "axisymmetric"]


def moved_vertices(grid: BlockGrid) -> Array:
    x, y = grid.vertices
    return np.stack([x + 0.1 * np.sin(x) * (0.5 + y), y - 0.1 * np.cos(x) * y])


# ---- the mesh --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_mesh_has_the_geometry_of_the_block(kind: str) -> None:
    """Of the stress-free solid, and moved: volumes, areas, normals and centres to rounding."""
    grid = rough_grid(kind)
    mesh = block_mesh(grid)
    for vertices in (grid.vertices, moved_vertices(grid), 0.9 * grid.vertices):
        move(mesh, vertices)
        new = block_mesh(grid, vertices)
        for fipys in (mesh, new):
            close = {"rtol": 1e-14, "atol": 1e-14}
            volumes = quadrilateral_volume(grid.section, *vertices[:, grid.cell_vertices])
            np.testing.assert_allclose(fipys.cellVolumes, volumes, **close)
            centres = vertices[:, grid.cell_vertices].mean(axis=1)
            np.testing.assert_allclose(fipys.cellCenters.value, centres, **close)
            middles = vertices[:, grid.face_vertices].mean(axis=1)
            np.testing.assert_allclose(fipys.faceCenters.value, middles, **close)
            areas = np.array(edge_area_vectors(grid.section, *vertices[:, grid.face_vertices]))
            np.testing.assert_allclose(fipys.faceNormals * fipys._faceAreas, areas, rtol=1e-13, atol=1e-14)


def test_mesh_is_numbered_as_the_block() -> None:
    grid = rough_grid("plane-strain")
    mesh = block_mesh(grid)
    np.testing.assert_array_equal(np.ma.filled(mesh.faceCellIDs, -1), grid.face_cells)
    np.testing.assert_array_equal(np.sort(mesh.faceVertexIDs, axis=0), np.sort(grid.face_vertices, axis=0))
    sides = {"left": mesh.facesLeft, "right": mesh.facesRight, "bottom": mesh.facesBottom, "top": mesh.facesTop}
    move(mesh, moved_vertices(grid))  # the edges are curved now, and FiPy's own sides would be single faces
    for edge, faces in sides.items():
        np.testing.assert_array_equal(edge_faces(mesh, grid, edge).value, faces.value)


def test_another_numbering_of_fipy_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    grid = rough_grid("plane-strain")
    monkeypatch.setitem(grid.__dict__, "face_cells", grid.face_cells[:, ::-1])
    with pytest.raises(RuntimeError, match="numbers the faces of a Grid2D differently"):
        block_mesh(grid)


# ---- the transport balances ------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)
def test_fipy_sees_the_matrix_and_the_residual_of_the_block(kind: str, model: object) -> None:
    """The matrix is the derivative of the balances that the block's own Newton method closes."""
    block = uniform_block(rough_grid(kind), CLAMPED if kind == "plane-strain" else CLAMPED_DISC, model)
    unknowns, duration = random_unknowns(block), 3.0
    potentials, positions = block.potentials(unknowns), block.positions(unknowns)
    interval = no_time(block)._replace(base=np.full(potentials.shape, 1e-4), duration=duration)
    variable = CellVariable(mesh=block_mesh(block.grid, positions), value=potentials, elementshape=(len(potentials),))
    term = BlockTransportTerm(block, variable, positions, interval.base, block.beyond(interval.loads, np.zeros(0)))
    matrix, residual = dense(term, duration)
    first, state = block.degrees_of_freedom.number, block.evaluate(unknowns, interval)
    np.testing.assert_allclose(residual * duration, state.residual[first:], rtol=0, atol=1e-13)
    jacobian = np.zeros((block.pattern.size, block.pattern.size))
    entries = block.jacobian(block.local_derivatives(state, duration), interval.loads)
    np.add.at(jacobian, (block.pattern.rows, block.pattern.columns), entries)
    own = jacobian[first:, first:]
    n = block.grid.cells
    for rows in (slice(start, start + n) for start in range(0, len(own), n)):
        assert np.abs(matrix[rows] * duration - own[rows]).max() < 1e-12 * np.abs(own[rows]).max()


def test_matrix_on_a_rectangular_grid_is_that_of_fipys_diffusion_term() -> None:
    """Water alone, at rest and in so long a time that what the stabilisation stores does not count."""
    grid = block_grid("plane-strain", graded_nodes(2.0, 5, 3.0, ["end"]), graded_nodes(1.0, 4, 2.0, ["start"]))
    block = uniform_block(grid, CLAMPED, BIPHASIC, stabilisation=0.0)
    variable = CellVariable(mesh=block_mesh(grid), value=0.0)
    variable.constrain(0.0, variable.mesh.exteriorFaces)
    outside = block.beyond(block.unloaded, np.zeros(0))
    own, _ = dense(BlockTransportTerm(block, variable, grid.vertices, np.ones((1, grid.cells)), outside), 1.0)
    stock, _ = dense(DiffusionTerm(coeff=1e-3, var=variable), 1.0)
    assert np.abs(own).max() > 1e-3
    np.testing.assert_allclose(own, -stock, rtol=0, atol=1e-12 * np.abs(stock).max())


@pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)
def test_sweeps_of_fipy_close_the_balances(model: object) -> None:
    """A block that swells into another bath, its vertices held: Newton's method by sweeps."""
    block = uniform_block(rough_grid("plane-strain"), CLAMPED, model)
    positions, base = block.grid.vertices, np.full((len(block.balances), block.grid.cells), 1.01)
    base[1:] *= 4e-5
    start = np.repeat(block.bath_potentials(BATH)[:, None], block.grid.cells, axis=1)
    variable = CellVariable(mesh=block_mesh(block.grid), value=start, elementshape=(len(start),))
    term = BlockTransportTerm(block, variable, positions, base, block.beyond(acting(block, 0.8 * BATH), np.zeros(0)))
    scale = np.repeat(block.content_scale, block.grid.cells)
    sizes = []
    for _ in range(8):
        sizes.append(float(np.abs(dense(term, 20.0)[1] / scale).max()))
        term.sweep(dt=20.0, solver=direct_solver())
    assert sizes[0] > 1e-5
    assert sizes[-1] < 1e-13


def test_balances_need_the_length_of_the_step() -> None:
    block = uniform_block(rough_grid("plane-strain"), CLAMPED, BIPHASIC)
    variable = CellVariable(mesh=block_mesh(block.grid), value=0.0)
    outside = block.beyond(block.unloaded, np.zeros(0))
    with pytest.raises(TypeError, match="give dt"):
        BlockTransportTerm(block, variable, block.grid.vertices, np.ones((1, block.grid.cells)), outside).sweep()


# ---- diamond fluxes of a solute --------------------------------------------------------------------------


def solute_term(
    grid: BlockGrid, c: CellVariable, diffusivity: float, velocity: Array, outside: Array
) -> DiamondFluxTerm:
    """Flux with the same velocity everywhere, on a plane grid all of whose edges are open."""
    maps = uniform_block(grid, CLAMPED, BIPHASIC).diamonds
    areas = np.array(edge_area_vectors(grid.section, *grid.vertices[:, grid.face_vertices[:, maps.faces]]))
    metric = np.array(diamond_metric(grid.section, *maps.local_points(grid.vertices)))
    return DiamondFluxTerm(maps, c, metric, diffusivity, velocity @ areas, outside)


def test_linear_concentration_diffuses_exactly_on_a_distorted_grid() -> None:
    grid = rough_grid("plane-strain")
    linear = 1.0 + 2.0 * grid.centres[0] - 3.0 * grid.centres[1]
    c = CellVariable(mesh=block_mesh(grid), value=linear)
    term = solute_term(grid, c, 0.3, np.zeros(2), 1.0 + 2.0 * grid.vertices[0] - 3.0 * grid.vertices[1])
    areas = np.array(edge_area_vectors(grid.section, *grid.vertices[:, grid.face_vertices]))
    faces = uniform_block(grid, CLAMPED, BIPHASIC).diamonds.faces
    np.testing.assert_allclose(term.fluxes(linear), -0.3 * np.array([2.0, -3.0]) @ areas[:, faces], atol=1e-13)
    np.testing.assert_allclose(term.justResidualVector(solver=direct_solver()), 0.0, atol=1e-13)


def test_on_a_rectangular_grid_the_fluxes_are_those_of_fipys_terms() -> None:
    grid = block_grid("plane-strain", np.linspace(0.0, 2.0, 6), np.linspace(0.0, 1.0, 5))
    c = CellVariable(mesh=block_mesh(grid), value=0.0)
    own, _ = dense(solute_term(grid, c, 0.3, np.array([0.2, -0.1]), 0.0), 1.0)
    c.constrain(0.0, c.mesh.exteriorFaces)
    inner = c.mesh.interiorFaces * np.array([[0.2], [-0.1]])
    stock, _ = dense(CentralDifferenceConvectionTerm(coeff=inner, var=c) - DiffusionTerm(coeff=0.3, var=c), 1.0)
    np.testing.assert_allclose(own, stock, rtol=0, atol=1e-12)


def _errors(n: int) -> tuple[float, float]:
    """Root mean square errors of our term and of FiPy's in a steady problem on a smoothly distorted grid."""
    grid = shaped_block_grid("plane-strain", distorted_vertices(2 * n, n))
    velocity, diffusivity = np.array([0.2, 0.1]), 0.3

    def exact(x: Array) -> Array:
        return np.sin(x[0] + 0.3) * np.cos(x[1])

    x, y = grid.centres + np.array([[0.3], [0.0]])
    slopes = np.stack([np.cos(x) * np.cos(y), -np.sin(x) * np.sin(y)])
    mesh = block_mesh(grid)
    source = CellVariable(mesh=mesh, value=velocity @ slopes + 2.0 * diffusivity * exact(grid.centres))
    ours, stock = CellVariable(mesh=mesh, value=0.0), CellVariable(mesh=mesh, value=0.0)
    equation = solute_term(grid, ours, diffusivity, velocity, exact(grid.vertices)) - source
    equation.solve(var=ours, solver=direct_solver())
    stock.constrain(exact(mesh.faceCenters.value), mesh.exteriorFaces)
    diffusion = DiffusionTerm(coeff=diffusivity, var=stock)
    convection = CentralDifferenceConvectionTerm(coeff=velocity[:, None] * mesh.interiorFaces, var=stock)
    at_edges = (velocity[:, None] * mesh.exteriorFaces * exact(mesh.faceCenters.value)).divergence
    (convection + at_edges - diffusion - source).solve(var=stock, solver=direct_solver())
    return tuple(float(np.sqrt(((c.value - exact(grid.centres)) ** 2).mean())) for c in (ours, stock))  # type: ignore[return-value]


def test_diamond_fluxes_converge_where_fipys_diffusion_does_not() -> None:
    errors = np.array([_errors(n) for n in (8, 16, 32)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert (orders[:, 0] > 1.8).all(), errors
    assert errors[-1, 0] < 3e-4
    assert (orders[:, 1] < 0.5).all(), errors
