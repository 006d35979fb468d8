"""Coplanar triangles merge into convex polygons."""

from __future__ import annotations

import numpy as np
import trimesh

from planning.polygons import clip_polygons, merge_convex


def test_faces_of_a_box_become_six_rectangles() -> None:
    box = trimesh.creation.box(extents=(1, 2, 3))
    loops = merge_convex(box.vertices, box.faces)
    assert sorted(len(loop) for loop in loops) == [4] * 6


def test_faces_with_a_hole_become_convex_pieces_of_the_same_area(bench) -> None:
    plate = trimesh.boolean.difference(
        [bench.box((0, 0, 0), (9, 9, 1)), bench.box((3, 3, -1), (6, 6, 2))]
    )
    loops = merge_convex(plate.vertices, plate.faces)
    area = 0.0
    for loop in loops:
        corners = plate.vertices[loop]
        turns = np.cross(np.roll(corners, -1, 0) - corners, corners - np.roll(corners, 1, 0))
        vector = np.cross(corners, np.roll(corners, -1, 0)).sum(axis=0) / 2
        assert (turns @ vector <= 1e-9).all(), "convex: all corners turn the same way"
        area += np.linalg.norm(vector)
    assert np.isclose(area, plate.area)
    assert len(loops) <= 8 + 2 * 5


def test_faceted_sphere_keeps_its_triangles() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    assert len(merge_convex(ball.vertices, ball.faces)) == len(ball.faces)


def test_cut_at_the_plane_keeps_the_edge() -> None:
    upright = np.array([[0.0, 0, -1], [2, 0, -1], [2, 0, 1], [0, 0, 1]])
    above = np.array([0.0, 0, 1])
    batch = np.stack([upright, upright - 2 * above, upright + above])
    cut, kept = clip_polygons(batch, above)
    np.testing.assert_array_equal(kept, [0, 2])
    assert cut.shape == (2, 5, 3)
    wanted = [[0, 0, 0], [0, 0, 1], [2, 0, 0], [2, 0, 1]]
    np.testing.assert_allclose(np.unique(cut[0], axis=0), wanted)
    # Rows with fewer corners are filled up with the first.
    np.testing.assert_array_equal(cut[1], [*batch[2], batch[2, 0]])


def test_what_touches_the_plane_is_kept() -> None:
    touching = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, -1]]])
    cut, kept = clip_polygons(touching, np.array([0.0, 0, 1]))
    assert len(kept) == 1
    np.testing.assert_array_equal(np.unique(cut[0], axis=0), [[0, 0, 0], [1, 0, 0]])
    cut, kept = clip_polygons(touching[:0], np.array([0.0, 0, 1]))
    assert len(cut) == len(kept) == 0
