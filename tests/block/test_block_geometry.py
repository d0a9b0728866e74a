"""Grids of blocks, their volumes and their diamonds."""

from __future__ import annotations

import numpy as np
import pytest
from blocks import BATH, CLAMPED, CLAMPED_DISC, beyond, distorted_vertices, rough_grid, uniform_block

from fvswell.block.geometry import (
    SECTIONS,
    diamond_metric,
    edge_pressure_forces,
    quadrilateral_gradient,
    quadrilateral_volume,
)
from fvswell.block.grid import block_grid, shaped_block_grid
from fvswell.compiled.dual import slope_of, variables
from fvswell.numerics.graded_grid import graded_nodes
from fvswell.physics.differentiation import COMPLEX_STEP
from fvswell.physics.models import ELECTROCHEMICAL

KINDS = tuple(SECTIONS)


@pytest.mark.parametrize("kind", KINDS)
def test_volumes_of_a_distorted_grid_add_up(kind: str) -> None:
    grid = rough_grid(kind)
    assert grid.volumes.sum() == pytest.approx(2.0 if kind == "plane-strain" else np.pi * 4.0, rel=1e-14)
    assert (grid.volumes > 0).all()


def test_ring_volume_of_a_rectangle() -> None:
    x, y = np.array([1.0, 3.0, 3.0, 1.0]), np.array([0.0, 0.0, 2.0, 2.0])
    assert quadrilateral_volume(SECTIONS["axisymmetric"], x, y) == pytest.approx(2.0 * np.pi * (9.0 - 1.0), rel=1e-15)


@pytest.mark.parametrize("kind", KINDS)
def test_volume_gradient_is_the_derivative_of_the_volume(kind: str) -> None:
    section, corners = SECTIONS[kind], rough_grid(kind).vertices[:, rough_grid(kind).cell_vertices]
    gradient = quadrilateral_gradient(section, *corners)
    for k in range(8):
        shifted = corners.reshape(8, -1).astype(complex)
        shifted[k] += 1j * COMPLEX_STEP
        volume = quadrilateral_volume(section, *shifted.reshape(2, 4, -1))
        np.testing.assert_allclose(gradient[k], volume.imag / COMPLEX_STEP, rtol=0, atol=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_slopes_of_the_metric_by_dual_numbers_are_those_by_complex_step(kind: str) -> None:
    section, points = SECTIONS[kind], np.random.default_rng(2).uniform(0.5, 1.5, (12, 3))
    duals = variables(*points)
    metric = diamond_metric(section, duals[:6], duals[6:])
    forces = edge_pressure_forces(section, duals[:2], duals[6:8])
    for k in range(12):
        shifted = points.astype(complex)
        shifted[k] += 1j * COMPLEX_STEP
        expected = [
            *diamond_metric(section, shifted[:6], shifted[6:]),
            *edge_pressure_forces(section, shifted[:2], shifted[6:8]),
        ]
        for found, value in zip((*metric, *forces), expected, strict=True):
            np.testing.assert_allclose(slope_of(found, k), value.imag / COMPLEX_STEP, rtol=1e-13, atol=1e-14)


def test_numbers_of_cells_vertices_and_faces() -> None:
    """As FiPy's Grid2D numbers them; `tests/fipy` compares the two."""
    grid = block_grid("plane-strain", np.arange(3.0), np.arange(3.0))
    assert grid.cell_vertices.T.tolist() == [[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]]
    assert grid.face_vertices.T.tolist() == [
        [0, 1], [1, 2], [4, 3], [5, 4], [7, 6], [8, 7], [3, 0], [1, 4], [2, 5], [6, 3], [4, 7], [5, 8]
    ]  # fmt: skip
    assert grid.face_cells.T.tolist() == [
        [0, -1], [1, -1], [0, 2], [1, 3], [2, -1], [3, -1], [0, -1], [0, 1], [1, -1], [2, -1], [2, 3], [3, -1]
    ]  # fmt: skip
    edges = {"left": [6, 9], "right": [8, 11], "bottom": [0, 1], "top": [4, 5]}
    assert {edge: faces.tolist() for edge, faces in grid.edges.items()} == edges


@pytest.mark.parametrize(("kind", "moved"), [("plane-strain", False), ("plane-strain", True), ("axisymmetric", False)])
def test_linear_potentials_have_exact_fluxes_on_distorted_quads(kind: str, moved: bool) -> None:
    block = uniform_block(rough_grid(kind), CLAMPED_DISC if kind == "axisymmetric" else CLAMPED, ELECTROCHEMICAL)
    grid = block.grid
    positions = grid.vertices.copy()
    if moved:
        inner = np.setdiff1d(np.arange(positions.shape[1]), np.concatenate([grid.edge_vertices(e) for e in CLAMPED]))
        positions[:, inner] += np.random.default_rng(8).uniform(-0.03, 0.03, (2, len(inner)))
    slopes = np.array([[0.3, -0.2], [0.4, 0.1], [-0.1, 0.5]])
    if kind == "axisymmetric":
        slopes[:, 0] = 0.0  # nothing flows through the axis
    constants = np.array([0.1, np.log(BATH), 0.0])

    def potentials(points: np.ndarray) -> np.ndarray:
        return slopes @ points + constants[:, None]

    inside = potentials(positions[:, grid.cell_vertices].mean(axis=1))
    gradients = block.transport(positions, inside, beyond(block, potentials(positions))).gradients
    a, b = positions[:, grid.face_vertices[:, block.diamonds.faces]].transpose(1, 0, 2)
    area = np.stack([b[1] - a[1], a[0] - b[0]])
    if kind == "axisymmetric":
        area *= np.pi * (a[0] + b[0])
    np.testing.assert_allclose(gradients, slopes @ area, rtol=0, atol=1e-13)


def test_grading_towards_chosen_ends() -> None:
    start, end = (np.diff(graded_nodes(3.0, 6, 4.0, [side])) for side in ("start", "end"))
    np.testing.assert_allclose(start, end[::-1])
    assert start[-1] / start[0] == pytest.approx(4.0)
    both = np.diff(graded_nodes(3.0, 6, 4.0, ["start", "end"]))
    assert both.sum() == pytest.approx(3.0)
    np.testing.assert_allclose(both, both[::-1])
    assert both[2] / both[0] == pytest.approx(4.0)
    with pytest.raises(ValueError, match="no such end: middle"):
        graded_nodes(3.0, 6, 4.0, ["middle"])


def test_inverted_and_misplaced_grids_are_refused() -> None:
    vertices = distorted_vertices(4, 3)
    vertices[0, 1, 1] += 1.2
    with pytest.raises(ValueError, match="inverted or degenerate"):
        shaped_block_grid("plane-strain", vertices)
    with pytest.raises(ValueError, match="radius 0"):
        block_grid("axisymmetric", np.array([1.0, 2.0]), np.array([0.0, 1.0]))
