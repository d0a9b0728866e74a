"""Grids of blocks, their volumes and their diamonds."""

from __future__ import annotations

import numpy as np
import pytest
from blocks import BATH, CLAMPED, CLAMPED_DISC, block_system, distorted_vertices, rough_grid

from fvswell.block.edges import EdgeCondition, check_edges
from fvswell.block.geometry import SECTIONS, polygon_volume, polygon_volume_gradient
from fvswell.block.grid import block_grid, graded_nodes, shaped_block_grid
from fvswell.physics.differentiation import local_derivative
from fvswell.physics.models import ELECTROCHEMICAL

KINDS = tuple(SECTIONS)
FREE, ROLLER, TIED, FIXED = (EdgeCondition(name, name == "free") for name in ("free", "roller", "tied", "fixed"))  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", KINDS)
def test_volumes_of_a_distorted_grid_add_up(kind: str) -> None:
    grid = rough_grid(kind)
    assert grid.volumes.sum() == pytest.approx(2.0 if kind == "plane-strain" else np.pi * 4.0, rel=1e-14)
    assert (grid.volumes > 0).all()


def test_ring_volume_of_a_rectangle() -> None:
    x, y = np.array([1.0, 3.0, 3.0, 1.0]), np.array([0.0, 0.0, 2.0, 2.0])
    assert polygon_volume(SECTIONS["axisymmetric"], x, y) == pytest.approx(2.0 * np.pi * (9.0 - 1.0), rel=1e-15)


@pytest.mark.parametrize("kind", KINDS)
def test_volume_gradient_is_the_derivative_of_the_volume(kind: str) -> None:
    corners = rough_grid(kind).vertices[:, rough_grid(kind).cell_vertices]
    section = SECTIONS[kind]
    expected = local_derivative(
        lambda c: polygon_volume(section, *c.reshape(2, 4, 8, -1))[None], corners.reshape(8, -1)
    )
    gradient = polygon_volume_gradient(section, *corners).reshape(8, -1)
    np.testing.assert_allclose(gradient, expected[0], rtol=0, atol=1e-14)


@pytest.mark.parametrize(("kind", "moved"), [("plane-strain", False), ("plane-strain", True), ("axisymmetric", False)])
def test_linear_potentials_have_exact_fluxes_on_distorted_quads(kind: str, moved: bool) -> None:
    system = block_system(rough_grid(kind), CLAMPED_DISC if kind == "axisymmetric" else CLAMPED, ELECTROCHEMICAL)
    grid, term = system.block.grid, system.block.term
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

    term.bath_potentials = lambda bath: potentials(positions)
    state = term.face_state(potentials(positions[:, grid.cell_vertices].mean(axis=1))[:, None], positions, BATH)
    a, b = positions[:, grid.face_vertices[:, term.diamonds.faces]].transpose(1, 0, 2)
    area = np.stack([b[1] - a[1], a[0] - b[0]])
    if kind == "axisymmetric":
        area *= np.pi * (a[0] + b[0])
    np.testing.assert_allclose(state.gradients[:, 0], slopes @ area, rtol=0, atol=1e-13)


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


@pytest.mark.parametrize(
    ("rings", "edges", "problem"),
    [
        (False, (FREE, FREE, ROLLER, TIED), "moving along x"),
        (False, (ROLLER, FREE, FREE, TIED), "moving along y"),
        (False, (FREE, FREE, FREE, FREE), "moving along x or moving along y or turning"),
        (True, (ROLLER, FREE, TIED, TIED), "moving along the axis"),
        (False, (ROLLER, ROLLER, ROLLER, TIED), "no edge is permeable"),
        (False, (FIXED, FREE, ROLLER, TIED), "tied to move as one, but ends at the left edge"),
        (True, (FREE, FREE, ROLLER, TIED), "axis of the disc"),
    ],
)
def test_contradictory_edges_are_told(rings: bool, edges: tuple[EdgeCondition, ...], problem: str) -> None:
    problems = check_edges(rings, dict(zip(("left", "right", "bottom", "top"), edges, strict=True)))
    assert any(problem in text for text in problems), problems


def test_good_edges_pass() -> None:
    for edges in ((ROLLER, FREE, FIXED, TIED), (ROLLER, FREE, ROLLER, TIED), (FIXED, FREE, FREE, FREE)):
        assert check_edges(False, dict(zip(("left", "right", "bottom", "top"), edges, strict=True))) == []
