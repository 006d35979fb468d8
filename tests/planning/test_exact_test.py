"""The exact test of "sees the whole target": against linear programs, and by its laws."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from planning.scene import Scene
from planning.target import Target
from planning.visibility import exact_test
from planning.visibility.audit import sees_whole_target
from planning.visibility.exact_test import ExactTest, FaceSearch

SQUARE = np.array([[-5.0, -5, 0], [5, -5, 0], [5, 5, 0], [-5, 5, 0]])
LETTER_L = np.array([[-5.0, -5, 0], [5, -5, 0], [5, 0, 0], [0, 0, 0], [0, 5, 0], [-5, 5, 0]])
TARGETS = {
    "square": Target(SQUARE),
    "triangle": Target(SQUARE[:3]),
    "letter L": Target(LETTER_L),
    "segment": Target.segment((-5, 0, 0), (5, 1, 0)),
}


def soup(count: int, size: float, seed: int) -> np.ndarray:
    """Random triangles above the target."""
    generator = np.random.default_rng(seed)
    middles = generator.uniform([-25, -25, -3], [25, 25, 30], (count, 3))
    return middles[:, None] + size * generator.normal(size=(count, 3, 3))


def blob(seed: int) -> trimesh.Trimesh:
    """A convex body somewhere above the target."""
    generator = np.random.default_rng(seed)
    points = generator.uniform([-20, -20, 2], [20, 20, 30]) + 3 * generator.normal(size=(12, 3))
    return trimesh.convex.convex_hull(points)


def overlap(viewpoint, base, triangle) -> float:
    """Least growth of the triangle about its middle by which it misses the pyramid, as log.

    Solved as a linear program over the two hulls: the smallest factor by which the triangle must
    be scaled so that it meets the pyramid. Below 1: it reaches in.
    """
    pyramid = np.vstack([viewpoint, base])
    middle = triangle.mean(axis=0)
    m = len(pyramid)
    # Σ a_i p_i = middle + Σ b_j (t_j − middle), Σ a = 1, a ≥ 0, b ≥ 0; minimise Σ b.
    equal = np.block([[pyramid.T, -(triangle - middle).T], [np.ones(m), np.zeros(3)]])
    found = linprog(
        np.r_[np.zeros(m), np.ones(3)], A_eq=equal, b_eq=np.r_[middle, 1.0], method="highs"
    )
    return np.inf if found.status == 2 else float(found.fun)


@pytest.mark.parametrize("name", ["square", "triangle", "segment"])
def test_agrees_with_linear_programs(name: str) -> None:
    """One triangle at a time, small and large, also some that cross the target's plane."""
    target = TARGETS[name]
    generator = np.random.default_rng(1)
    hidden = 0
    for size in (0.3, 3.0, 15.0):
        triangles = soup(70, size, 5)
        points = generator.uniform([-30, -30, 0.1], [30, 30, 60], (len(triangles), 3))
        for triangle, point in zip(triangles, points, strict=True):
            factor = overlap(point, target.vertices_mm, triangle)
            if abs(factor - 1) > 1e-7:
                found = FaceSearch(triangle[None]).blockers(point[None], target)[0] == 0
                assert found == (factor < 1)
                hidden += found
    assert hidden > 5


@pytest.mark.parametrize("name", list(TARGETS))
@pytest.mark.parametrize("size", [0.3, 2.0])
def test_tree_and_rays_forget_no_face(name: str, size: float, monkeypatch) -> None:
    """All faces one by one hide what all together hide; with rays and without."""
    target, triangles = TARGETS[name], soup(int(60 / size**0.8), size, 7)
    points = np.random.default_rng(2).uniform([-40, -40, 0.1], [40, 40, 80], (300, 3))
    together = FaceSearch(triangles).blockers(points, target)
    singly = np.zeros(len(points), dtype=bool)
    for triangle in triangles:
        singly |= FaceSearch(triangle[None]).blockers(points, target) >= 0
    np.testing.assert_array_equal(together >= 0, singly)
    assert 0.02 < singly.mean() < 0.98
    monkeypatch.setattr(exact_test, "_FEW", 10**9)
    np.testing.assert_array_equal(FaceSearch(triangles).blockers(points, target) >= 0, singly)
    # The face that is named hides the target on its own.
    for k in np.flatnonzero(together >= 0)[:50]:
        assert FaceSearch(triangles[together[k]][None]).blockers(points[k : k + 1], target)[0] == 0


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1000), st.floats(-3, 6), st.sampled_from(list(TARGETS)))
def test_rigid_motion_and_scale_change_nothing(seed: int, decade: float, name: str) -> None:
    """From 1e-3 to 1e6 mm, in any direction, and faces in another order."""
    generator = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed).as_matrix()
    shift, scale = 100 * generator.normal(size=3), 10**decade / 100
    triangles, target = soup(60, 3.0, seed), TARGETS[name]
    points = generator.uniform([-30, -30, 0.5], [30, 30, 60], (150, 3))

    def moved(place):
        return (place @ turn.T + shift) * scale

    there = FaceSearch(moved(triangles)[generator.permutation(60)])
    found = there.blockers(moved(points), Target(moved(target.vertices_mm)))
    here = FaceSearch(triangles).blockers(points, target)
    np.testing.assert_array_equal(found >= 0, here >= 0)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1000))
def test_splitting_faces_changes_nothing(seed: int) -> None:
    triangles = soup(40, 5.0, seed)
    middle = triangles.mean(axis=1)
    split = np.concatenate(
        [np.stack([triangles[:, k], triangles[:, k - 1], middle], axis=1) for k in range(3)]
    )
    points = np.random.default_rng(seed).uniform([-30, -30, 0.5], [30, 30, 60], (150, 3))
    np.testing.assert_array_equal(
        FaceSearch(triangles).blockers(points, TARGETS["square"]) >= 0,
        FaceSearch(split).blockers(points, TARGETS["square"]) >= 0,
    )


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1000), st.sampled_from(["square", "triangle", "segment"]))
def test_what_lies_between_viewpoint_and_target_sees_it_too(seed: int, name: str) -> None:
    """The region is star-shaped about every point of a convex target."""
    generator = np.random.default_rng(seed)
    scene, target = Scene([blob(seed), blob(seed + 1), blob(seed + 2)]), TARGETS[name]
    test = ExactTest(scene)
    points = generator.uniform([-40, -40, 20], [40, 40, 80], (200, 3))
    seeing = points[test.sees(points, target)]
    weights = generator.dirichlet(np.ones(len(target.vertices_mm)), len(seeing))
    share = generator.uniform(0.02, 1.0, (len(seeing), 1))
    nearer = share * seeing + (1 - share) * (weights @ target.vertices_mm)
    assert test.sees(nearer, target).all()


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1000), st.sampled_from(list(TARGETS)))
def test_more_bodies_never_see_more(seed: int, name: str) -> None:
    bodies = [blob(seed + k) for k in range(4)]
    points = np.random.default_rng(seed).uniform([-40, -40, 0], [40, 40, 80], (200, 3))
    few = sees_whole_target(points, TARGETS[name], Scene(bodies[:2]))
    many = sees_whole_target(points, TARGETS[name], Scene(bodies))
    assert not (many & ~few).any()


def test_contact_does_not_hide_and_behind_the_plane_there_is_no_view(bench) -> None:
    wall = bench.box((-5, 5, -5), (5, 6, 10))
    test = ExactTest(bench.scene(bench.block, wall))
    points = np.array([[0, -10, 20], [0, 5, 20], [0, 4.999, 20], [0, 5.001, 20], [0, 0, 0]])
    np.testing.assert_array_equal(test.sees(points, bench.target), [True, True, True, False, False])
    assert not test.sees([0, 0, -1], bench.target)
    assert test.sees(np.full((2, 3, 3), 7.0) * [1, -1, 1], bench.target).shape == (2, 3)


def test_segment_on_a_body_is_not_seen_from_inside_of_it(bench) -> None:
    cube = bench.box((-10, 0, -10), (10, 10, 10))
    edge = Target.segment((-10, 0, 10), (10, 0, 10))
    test = ExactTest(bench.scene(cube))
    points = np.array([[0, 5, 5], [0, -5, 5], [0, 5, 15], [3, 9.9, 9.9]], float)
    np.testing.assert_array_equal(test.sees(points, edge), [False, True, True, False])
    # On its own line a segment is seen end on, unless something stands in between.
    assert test.sees([20, 0, 10], edge)
    beyond = Target.segment((-12, 2, 9), (-11, 2, 9))
    assert test.sees([-20, 2, 9], beyond)
    assert not test.sees([20, 2, 9], beyond)


def test_a_low_wall_hides_to_within_the_tolerance_of_its_plane(bench) -> None:
    """A facet of 1e-6 on the target's edge: contact must not be taken for more than rounding."""
    wall = bench.box((-5, 5, -5), (5, 6, 1e-6))
    test = ExactTest(bench.scene(wall))
    heights = np.linspace(1, 100, 50)
    beyond = np.stack([np.zeros(50), np.full(50, 5 + 1.7e-4), heights], axis=-1)
    assert not test.sees(beyond, bench.target).any()
    assert test.sees(beyond - [0, 2 * 1.7e-4, 0], bench.target).all()
