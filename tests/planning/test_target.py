"""Targets: what is a face, what is refused."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from lenscal.errors import GeometryError, InputError
from planning.scene import Scene
from planning.target import Target
from planning.visibility.methods import visibility_region

U_SHAPE = np.array(
    [
        [-5.0, -5, 0],
        [5, -5, 0],
        [5, 5, 0],
        [2, 5, 0],
        [2, -2, 0],
        [-2, -2, 0],
        [-2, 5, 0],
        [-5, 5, 0],
    ]
)


def test_normal_follows_the_right_hand_rule(bench) -> None:
    np.testing.assert_allclose(bench.target.normal, [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(Target(bench.square[::-1]).normal, [0, 0, -1], atol=1e-15)


def test_area_and_centroid_of_a_concave_polygon() -> None:
    target = Target(U_SHAPE)
    assert target.area_mm2 == pytest.approx(72.0, rel=1e-12)
    # 100 mm² about the origin less 28 mm² about (0, 1.5).
    np.testing.assert_allclose(target.centroid_mm, [0, -28 * 1.5 / 72, 0], atol=1e-12)
    assert not target.is_convex
    assert len(target.pieces) == 3


def test_convex_polygon_is_one_piece_without_straight_corners(bench) -> None:
    with_middle = np.insert(bench.square, 1, [0, -5, 0], axis=0)
    target = Target(with_middle)
    assert target.is_convex
    assert len(target.pieces[0]) == 4


def test_segment_has_a_middle_and_no_plane() -> None:
    segment = Target.segment((0, 0, 0), (0, 0, 4))
    assert segment.is_segment
    assert segment.area_mm2 == 0
    assert segment.flatness_mm == 0
    np.testing.assert_array_equal(segment.centroid_mm, [0, 0, 2])
    with pytest.raises(GeometryError, match="a segment has no normal"):
        segment.normal  # noqa: B018


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        ([[0, 0, 0]], "two vertices .* or more, but has 1"),
        ([[1, 1, 1], [1, 1, 1]], "ends of a segment must differ"),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], "the target has no area"),
        ([[0, 0, 0], [1, 0, 0], [1, 1, 0.1], [0, 1, 0]], "not planar.*leave the plane by"),
        ([[0, 0, 0], [4, 0, 0], [4, 3, 0], [1, -1, 0], [0, 3, 0]], "crosses itself"),
    ],
)
def test_refuses_what_is_no_polygon(vertices, message: str) -> None:
    with pytest.raises(GeometryError, match=message):
        Target(np.array(vertices, dtype=float))


def test_picks_the_whole_flat_face_nearest_to_a_point(bench) -> None:
    scene = Scene([bench.block])
    target = Target.from_face(scene, near=(1, 2, 7))
    assert len(target.vertices_mm) == 4
    assert target.area_mm2 == pytest.approx(100)
    np.testing.assert_allclose(target.normal, [0, 0, 1], atol=1e-15)


def test_picks_a_concave_face(bench) -> None:
    step = trimesh.boolean.difference(
        [bench.box((0, 0, 0), (4, 4, 1)), bench.box((2, 2, -1), (5, 5, 2))]
    )
    target = Target.from_face(Scene([step]), near=(1, 1, 2))
    assert target.area_mm2 == pytest.approx(12)
    assert not target.is_convex


@pytest.fixture
def frame(bench) -> trimesh.Trimesh:
    """A plate of 9 × 9 with a square hole of 3 × 3."""
    return trimesh.boolean.difference(
        [bench.box((0, 0, 0), (9, 9, 1)), bench.box((3, 3, -1), (6, 6, 2))]
    )


def test_picks_a_face_with_a_hole(frame) -> None:
    target = Target.from_face(Scene([frame]), near=(1, 1, 2))
    assert target.area_mm2 == pytest.approx(72, rel=1e-12)
    np.testing.assert_allclose(target.centroid_mm, [4.5, 4.5, 1], atol=1e-12)
    assert [len(loop) for loop in target.loops] == [4, 4]
    assert len(target.outline_mm) == 4
    corners = [target.vertices_mm[piece] for piece in target.pieces]
    assert sum(Target(c).area_mm2 for c in corners) == pytest.approx(72, rel=1e-12)
    filled = Target.from_face(Scene([frame]), near=(1, 1, 2), fill_holes=True)
    assert filled.area_mm2 == pytest.approx(81)
    assert filled.is_convex


def test_what_stands_in_a_hole_hides_the_rim(bench, frame) -> None:
    """A pin through the hole: the face is seen from above, the filled one is covered by the pin."""
    scene = Scene([frame, bench.box((4, 4, -5), (5, 5, 3))], ["plate", "pin"])
    target = Target.from_face(scene, near=(1, 1, 1))
    region = visibility_region(scene, target, bench.workspace, audit_points=2000)
    assert 0.1 < region.volume_mm3 / bench.volume < 0.5
    assert region.audit.disagreements == 0
    filled = Target.from_face(scene, near=(1, 1, 1), fill_holes=True)
    with pytest.raises(GeometryError, match=r"material lies on the target at \(4.5, 4.5, 1\) mm"):
        visibility_region(scene, filled, bench.workspace)


@pytest.mark.parametrize("turn", [1, -1])
def test_holes_may_be_given_in_either_order(bench, turn: int) -> None:
    hole = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])[::turn]
    target = Target(bench.square, holes=[hole])
    assert target.area_mm2 == pytest.approx(96)
    assert target.normal[2] == 1


@pytest.mark.parametrize("shift", [4.5, 30.0])
def test_refuses_holes_that_are_not_inside(bench, shift: float) -> None:
    hole = np.add([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [shift, 0, 0])
    with pytest.raises(GeometryError, match="crosses itself or that of a hole, or a hole lies out"):
        Target(bench.square, holes=[hole])


def test_a_segment_has_no_holes(bench) -> None:
    with pytest.raises(GeometryError, match="a segment has no holes"):
        Target([[0, 0, 0], [1, 0, 0]], holes=[bench.square])


def test_a_polyline_is_its_segments() -> None:
    line = Target.polyline([[0, 0, 0], [1, 0, 0], [1, 2, 0]])
    assert [t.size_mm for t in line] == [1, 2]
    assert all(t.is_segment for t in line)
    with pytest.raises(GeometryError, match="a polyline needs two points or more, but has 1"):
        Target.polyline([[0, 0, 0]])


def test_a_face_is_picked_by_one_thing(bench) -> None:
    scene = Scene([bench.block])
    for given in ({}, {"near": (0, 0, 0), "face": 1}):
        with pytest.raises(InputError, match="either by a point near it or by its name or number"):
            Target.from_face(scene, **given)
    with pytest.raises(GeometryError, match="no face can be picked as 'top': the file holds"):
        Target.from_face(scene, face="top")
    with pytest.raises(GeometryError, match="there is no body 'lid'; the bodies are 'body 0'"):
        Target.from_face(scene, near=(0, 0, 0), body="lid")


def test_picks_within_one_body(bench) -> None:
    scene = Scene([bench.block, bench.box((-1, -1, 1), (1, 1, 2))], ["block", "lamp"])
    assert Target.from_face(scene, near=(0, 0, 1.1)).area_mm2 == pytest.approx(4)
    assert Target.from_face(scene, near=(0, 0, 1.1), body="block").area_mm2 == pytest.approx(100)
