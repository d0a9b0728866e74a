"""FiPy's mesh of a column: its numbering, and its geometry before and after it has moved."""

from __future__ import annotations

from types import SimpleNamespace

import fipy
import numpy as np
import pytest

import fvswell.fipy.mesh
from fvswell.column.grid import ColumnGrid, column_grid
from fvswell.fipy import column_mesh, column_nodes, move
from fvswell.physics.tissue import Array


def assert_geometry(mesh: fipy.meshes.mesh1D.Mesh1D, grid: ColumnGrid, J: Array) -> None:
    nodes = column_nodes(grid, J)
    close = {"rtol": 0, "atol": 1e-14}
    np.testing.assert_allclose(mesh.cellVolumes, grid.widths * J, **close)
    np.testing.assert_allclose(mesh.faceCenters.value[0], nodes, **close)
    np.testing.assert_allclose(mesh.cellCenters.value[0], 0.5 * (nodes[1:] + nodes[:-1]), **close)
    np.testing.assert_allclose(mesh._cellDistances, grid.metric[0] * grid.face_stretch(J), **close)
    np.testing.assert_array_equal(mesh._faceAreas, 1.0)


@pytest.mark.parametrize("grading", [1.0, 20.0])
def test_reference_geometry_is_that_of_the_column(grading: float) -> None:
    grid = column_grid(0.5, 23, grading)
    mesh = column_mesh(grid)
    assert_geometry(mesh, grid, np.ones(23))
    np.testing.assert_allclose(mesh.cellCenters.value[0], grid.centres, rtol=0, atol=1e-14)


def test_moved_geometry_is_that_of_the_column() -> None:
    """Of a new mesh, and of one that is moved again and again; no volume or distance stays behind."""
    grid, draw = column_grid(0.5, 23, 20.0), np.random.default_rng(1)
    mesh = column_mesh(grid)
    for _ in range(3):
        J = draw.uniform(0.5, 1.5, 23)
        move(mesh, column_nodes(grid, J)[None])
        assert_geometry(mesh, grid, J)
        assert_geometry(column_mesh(grid, J), grid, J)


def test_variables_see_the_moved_mesh() -> None:
    """Gradients and volume averages of a variable that was made before the mesh moved."""
    grid = column_grid(0.5, 6, 3.0)
    mesh = column_mesh(grid)
    variable = fipy.CellVariable(mesh=mesh, value=1.0)
    variable.constrain(0.0, mesh.facesLeft)
    assert variable.faceGrad.value[0, 0] == pytest.approx(2.0 / grid.widths[0])
    J = np.linspace(0.7, 1.2, 6)
    move(mesh, column_nodes(grid, J)[None])
    variable.setValue(np.array(mesh.cellCenters[0]))
    np.testing.assert_allclose(variable.faceGrad.value[0, :-1], 1.0, rtol=1e-12)
    half = 0.5 * column_nodes(grid, J)[-1]
    assert float(variable.cellVolumeAverage.value) == pytest.approx(half, rel=1e-12)


def test_cells_and_faces_are_numbered_from_the_filter() -> None:
    mesh = column_mesh(column_grid(0.5, 5, 2.0))
    np.testing.assert_array_equal(np.ma.filled(mesh.faceCellIDs, -1), [[0, 0, 1, 2, 3, 4], [-1, 1, 2, 3, 4, -1]])
    np.testing.assert_array_equal(np.flatnonzero(mesh.facesLeft.value), [0])
    np.testing.assert_array_equal(np.flatnonzero(mesh.facesRight.value), [5])


def test_another_numbering_of_fipy_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def reversed_grid(dx: Array) -> SimpleNamespace:
        grid = fipy.Grid1D(dx=dx)
        return SimpleNamespace(faceVertexIDs=grid.faceVertexIDs, cellFaceIDs=np.asarray(grid.cellFaceIDs)[:, ::-1])

    monkeypatch.setattr(fvswell.fipy.mesh, "Grid1D", reversed_grid)
    with pytest.raises(RuntimeError, match="numbers the faces of a Grid1D differently"):
        column_mesh(column_grid(0.5, 5, 2.0))
