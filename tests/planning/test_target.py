"""Targets: what is a face, what is refused."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from lenscal.errors import GeometryError
from planning.scene import Scene
from planning.target import Target

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


def test_refuses_a_face_with_a_hole(bench) -> None:
    plate = trimesh.boolean.difference(
        [bench.box((0, 0, 0), (9, 9, 1)), bench.box((3, 3, -1), (6, 6, 2))]
    )
    with pytest.raises(
        GeometryError, match="body 0 nearest to .* has 1 holes; give the target by its"
    ):
        Target.from_face(Scene([plate]), near=(1, 1, 2))
