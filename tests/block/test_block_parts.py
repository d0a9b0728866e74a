"""Parts of the edges of a block: where they lie on the grid, what does not go together, what moves as one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from blocks import FREE, GLUED, UNCONFINED, Parts, acting, no_time, one_stage, part, rough_grid, uniform_block

from fvswell.block.displacements import degrees_of_freedom
from fvswell.block.grid import block_grid
from fvswell.block.part_checks import check_parts
from fvswell.block.part_loads import part_loads
from fvswell.block.parts import faces_of_parts, nearest_lines
from fvswell.boundary.parts import load_names
from fvswell.numerics.graded_grid import graded_nodes
from fvswell.physics.models import BIPHASIC

EXTENT = (2.0, 1.0)  # of `rough_grid`
INDENTER = part("top", "straight", name="indenter", end=0.8) | part("top", "free", name="rest", open=True, start=0.8)


def edges(**conditions: Any) -> Parts:
    """The parts of `FREE` with other whole edges."""
    parts: Parts = dict(FREE)
    for edge, condition in conditions.items():
        chosen = {"mechanical": condition} if isinstance(condition, str) else condition
        parts |= part(edge, **chosen)
    return parts


def without(parts: Parts, *names: str) -> Parts:
    return {name: each for name, each in parts.items() if name not in names}


# ---- where they are ---------------------------------------------------------------------------------------


def test_faces_of_parts_are_those_between_their_ends() -> None:
    grid = rough_grid("plane-strain")  # lines at 0, 0.4, ... along x, at 0, 0.25, ... along y
    parts = [*INDENTER.values(), *part("left", "free", start=0.25, end=0.75).values()]
    faces = faces_of_parts(grid, parts)
    np.testing.assert_array_equal(faces[0], grid.edges["top"][:2])
    np.testing.assert_array_equal(faces[1], grid.edges["top"][2:])
    np.testing.assert_array_equal(faces[2], grid.edges["left"][1:3])


def test_parts_that_end_between_grid_lines_are_refused_all_at_once() -> None:
    parts = [*part("top", "free", name="a", end=0.7).values(), *part("left", "free", name="b", start=0.3).values()]
    with pytest.raises(ValueError, match=r"a ends at 0.7 mm.*nearest is at 0.8 mm; the part b begins at 0.3 mm.*0.25"):
        faces_of_parts(rough_grid("plane-strain"), parts)


def test_nearest_lines() -> None:
    np.testing.assert_array_equal(nearest_lines(np.array([0.0, 1.0, 3.0]), [0.4, 1.9, 2.1, 7.0]), [0, 1, 2, 2])


@pytest.mark.parametrize("grading", [1.0, 8.0])
@pytest.mark.parametrize("finest", [(), (1.0,), ("end",), ("start", 1.0), (1.0, 4.0)])
def test_grid_lines_fall_on_prescribed_places(grading: float, finest: tuple[Any, ...]) -> None:
    nodes = graded_nodes(6.0, 40, grading, finest, through=[1.0, 2.2])
    assert len(nodes) == 41
    widths = np.diff(nodes)
    assert (widths > 0.0).all()
    for place in (0.0, 1.0, 2.2, 6.0):
        assert np.abs(nodes - place).min() == 0.0
    ratio = widths.max() / widths.min()
    # pieces have whole numbers of cells, so there is one jump of width where each begins
    assert ratio < 1.2 * grading * (1.0 + 1.0 / 3.0)
    if finest and grading > 1.0:
        assert ratio > 0.7 * grading
        for place in [{"start": 0.0, "end": 6.0}.get(each, each) for each in finest]:
            near = widths[np.abs(0.5 * (nodes[1:] + nodes[:-1]) - place) < 0.1]
            assert near.max() < 2.0 * widths.min()


def test_widths_grow_smoothly_from_a_prescribed_place() -> None:
    widths = np.diff(graded_nodes(5.0, 60, 20.0, [1.0]))
    growth = np.abs(np.log(widths[1:] / widths[:-1]))
    assert growth.max() < 1.6 * np.median(growth)


def test_places_that_cannot_be_nodes_are_refused() -> None:
    with pytest.raises(ValueError, match="2 cells are too few to have nodes on 2 places"):
        graded_nodes(3.0, 2, through=[1.0, 2.0])
    with pytest.raises(ValueError, match="at 0, at the length of 3 mm, or beyond"):
        graded_nodes(3.0, 9, through=[3.0])
    np.testing.assert_allclose(graded_nodes(3.0, 3, 50.0, ["start"], [0.01, 0.02]), [0.0, 0.01, 0.02, 3.0])


# ---- what does not go together ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rings", "parts", "problem"),
    [
        (False, edges(left="free"), "nothing keeps the block from moving along x"),
        (False, edges(bottom="free"), "moving along y"),
        (False, edges(left="free", bottom="free"), "moving along x or moving along y or turning"),
        (True, edges(bottom="straight", top="straight"), "moving along the axis"),
        (False, edges(right="roller", top="straight"), "no part is open to a bath"),
        (False, edges(left="fixed", top="straight"), "the part top is straight, but ends at the part left"),
        (False, edges(left="fixed", top="glued-plate"), "the part top is a glued plate, but ends at the part left"),
        (False, FREE | INDENTER | part("top", "roller", name="rest", start=0.8), "the part indenter is straight, but "
         "ends at the part rest, which is a roller on the same edge"),
        (True, edges(left="free"), "the part left lies on the axis of the disc"),
        (True, edges(left={"mechanical": "roller", "open": True}), "the part left lies on the axis of the disc"),
        (True, edges(left={"mechanical": "roller", "electrical": "grounded", "electrode": "cation"}), "on the axis"),
        (False, without(FREE, "bottom"), "no part covers the bottom edge"),
        (False, FREE | part("top", "free", end=1.5), "no part covers the top edge from 1.5 mm to 2 mm"),
        (False, FREE | part("top", "free", start=0.5), "no part covers the top edge from 0 mm to 0.5 mm"),
        (False, FREE | part("top", "free", name="more", start=1.5), "the parts top and more overlap on the top edge "
         "from 1.5 mm to 2 mm"),
        (False, FREE | part("top", "free", end=3.0), "goes from 0 mm to 3 mm, but the top edge from 0 to 2 mm"),
        (False, FREE | part("top", "free", name="none", start=2.0), "the part none begins at 2 mm and ends at 2 mm"),
        (False, FREE | part("topp", "free"), 'lies on the edge "topp": edges are left, right, bottom, top; did you '
         "mean top?"),
        (False, FREE | {"again": FREE["top"]}, "2 parts are called top"),
        (False, edges(left={"mechanical": "roller", "electrical": "grounded"}), "the part left is grounded, but clos"),
        (False, edges(left={"mechanical": "roller", "electrical": "current"}), "is given a current, but closed"),
        (False, edges(left={"mechanical": "roller", "electrode": "anion"}), "has an electrode, but is insulating"),
        (False, edges(top={"mechanical": "free", "open": True, "electrode": "anion"}), "is open and has an electrode "
         "for anions"),
        (False, edges(right={"mechanical": "free", "open": True, "electrical": "current"},
                      top={"mechanical": "free", "open": True, "electrical": "floating"}),
         "the current given at right has no way back: make another part grounded"),
        (False, edges(right="free", top={"mechanical": "free", "open": True, "electrical": "floating"}),
         "top can float only against a part that is grounded"),
        (False, edges(right="free", top={"mechanical": "free", "open": True, "electrical": "insulating"}),
         "no part is grounded or at a given potential"),
    ],
)  # fmt: skip
def test_parts_that_contradict_each_other_are_reported(rings: bool, parts: Parts, problem: str) -> None:
    problems = check_parts(rings, EXTENT, tuple(parts.values()))
    assert any(problem in text for text in problems), problems


def test_everything_is_reported_at_once() -> None:
    parts = edges(left="free", right="free", top={"mechanical": "free", "electrical": "current", "end": 1.0})
    assert len(check_parts(False, EXTENT, tuple(parts.values()))) == 4
    with pytest.raises(ValueError, match=r"no part covers the top edge.*;.*moving along x.*;.*no part is open"):
        uniform_block(rough_grid("plane-strain"), parts, BIPHASIC)


@pytest.mark.parametrize(
    "parts",
    [
        GLUED, UNCONFINED, FREE, edges(left="fixed", bottom="free"), without(UNCONFINED, "top") | INDENTER,
        edges(top="glued-plate"),
        edges(top={"mechanical": "free", "open": True, "electrical": "insulating"}),
        edges(top={"mechanical": "straight", "electrical": "current", "electrode": "cation"}),
        edges(right={"mechanical": "free", "open": True, "electrical": "floating"},
              top={"mechanical": "straight", "electrical": "grounded", "electrode": "anion"}),
    ],
)  # fmt: skip
def test_parts_that_go_together_pass(parts: Parts) -> None:
    assert check_parts(False, EXTENT, tuple(parts.values())) == []


# ---- what moves as one ------------------------------------------------------------------------------------


def unknowns_of(kind: str, parts: Parts) -> Any:
    grid = rough_grid(kind)
    own = tuple(parts.values())
    return grid, degrees_of_freedom(grid, own, faces_of_parts(grid, own))


def test_plates_share_displacements() -> None:
    grid, unknown = unknowns_of("plane-strain", without(UNCONFINED, "top") | INDENTER)
    top, count = grid.edge_vertices("top"), grid.vertices.size
    assert len(np.unique(unknown.of_vertex[1, top[:3]])) == 1
    assert len(np.unique(unknown.of_vertex[1, top[3:]])) == 3
    assert len(np.unique(unknown.of_vertex[0, top[1:]])) == 5
    # x of the left edge and y of the bottom are held
    assert unknown.number == count - 5 - 6 - 2
    assert unknown.normal.tolist().count(-1) == 4


def test_a_glued_plate_does_not_slide() -> None:
    free = without(FREE, "left") | part("left", "free") | part("bottom", "roller")
    plate = part("top", "glued-plate")
    for kind, parts, tangential in (
        ("plane-strain", free | plate, True), ("plane-strain", UNCONFINED | plate, False),
        ("axisymmetric", FREE | part("top", "free", name="in", end=0.8) | part("top", "glued-plate", start=0.8), False),
    ):  # fmt: skip
        grid, unknown = unknowns_of(kind, parts)
        index = list(parts).index("top")
        vertices = grid.edge_vertices("top")[2 if kind == "axisymmetric" else 0 :]
        assert len(np.unique(unknown.of_vertex[:, vertices], axis=1).T) == 1
        assert (unknown.tangential[index] >= 0) == tangential
        assert unknown.normal[index] >= 0


def test_a_tangential_displacement_can_be_given() -> None:
    """The middle of a wide block is in simple shear then."""
    parts = part("left", "free") | part("right", "free", open=True) | part("bottom", "fixed")
    grid = block_grid("plane-strain", np.linspace(0.0, 20.0, 41), np.linspace(0.0, 1.0, 3))
    block = uniform_block(grid, parts | part("top", "glued-plate"), BIPHASIC)
    _, result = one_stage(block, 1e9, top__displacement=0.0, top__tangential_displacement=1e-4)
    moved = block.positions(result.unknowns) - grid.vertices
    np.testing.assert_allclose(moved[0, grid.edge_vertices("top")], 1e-4, rtol=0, atol=1e-14)
    middle = np.abs(grid.vertices[0] - 10.0) < 2.0
    np.testing.assert_allclose(moved[0, middle], 1e-4 * grid.vertices[1, middle], rtol=0, atol=1e-9)


def test_what_is_held_or_given_twice_cannot_be_moved() -> None:
    block = uniform_block(rough_grid("plane-strain"), UNCONFINED | part("top", "glued-plate"), BIPHASIC)
    with pytest.raises(ValueError, match="tangential displacement of top is held at 0"):
        block.evaluate(np.zeros(block.pattern.size), no_time(block, top__tangential_displacement=0.1))
    halves = part("top", "straight", name="a", end=0.8) | part("top", "straight", name="b", start=0.8)
    block = uniform_block(rough_grid("plane-strain"), without(UNCONFINED, "top") | halves, BIPHASIC)
    unknowns = np.zeros(block.pattern.size)
    block.evaluate(unknowns, no_time(block, a__displacement=0.1, b__displacement=0.1))
    with pytest.raises(ValueError, match="displacement of b is that of another part, which is given as well"):
        block.evaluate(unknowns, no_time(block, a__displacement=0.1, b__displacement=0.2))


def test_parts_driven_in_two_ways_are_refused_all_at_once() -> None:
    parts = tuple((UNCONFINED | part("right", "straight", open=True)).values())
    given = {"top.force": 1.0, "top.displacement": 0.0, "right.force": 0.0, "right.pressure": 0.0}
    values = np.array([given.get(name, np.nan) for name in load_names(parts)])
    with pytest.raises(ValueError, match="right, top: driven in more than one way at once"):
        part_loads(parts, values, 1e-4)


def test_nothing_acts_where_nothing_is_prescribed() -> None:
    block = uniform_block(rough_grid("plane-strain"), UNCONFINED, BIPHASIC)
    for found, expected in zip(block.unloaded, acting(block), strict=True):
        np.testing.assert_array_equal(found, expected)
