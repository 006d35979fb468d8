"""Membership and distance for many points: against the plain formulae, on awkward points too."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from planning import membership
from planning.box_tree import BoxTree
from planning.membership import Membership, winding_number
from planning.nearest import NearestSurface, distance_to_triangles
from planning.solid import Solid, box_workspace


def solids() -> dict[str, trimesh.Trimesh]:
    """Convex and not, with a cavity, and in two pieces."""
    torus = trimesh.creation.torus(10, 3, major_sections=24, minor_sections=12)
    hollow = trimesh.util.concatenate(
        [
            trimesh.creation.icosphere(subdivisions=2, radius=9),
            trimesh.Trimesh(*_inverted(trimesh.creation.box((6, 6, 6))), process=False),
        ]
    )
    pieces = trimesh.util.concatenate(
        [
            trimesh.creation.box(bounds=b)
            for b in ([[-9, -9, -9], [-1, 2, 9]], [[3, 0, 0], [8, 8, 8]])
        ]
    )
    return {
        "torus": torus,
        "sphere": trimesh.creation.icosphere(subdivisions=2, radius=9),
        "hollow": hollow,
        "pieces": pieces,
        "box": trimesh.creation.box((16, 8, 4)),
        "prism": trimesh.creation.cylinder(7, 12, sections=9),
    }


def _inverted(mesh: trimesh.Trimesh):
    return mesh.vertices, np.fliplr(mesh.faces)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
@pytest.mark.parametrize("name", list(solids()))
def test_membership_agrees_with_the_winding_number(name: str, scale: float) -> None:
    """Anywhere, far from the origin, and on lines through corners and edges along the axes."""
    mesh = solids()[name]
    turn = Rotation.from_rotvec([0.4, 0.2, -0.9]).as_matrix() if scale != 1.0 else np.eye(3)
    triangles = mesh.triangles @ turn.T * scale + 7 * scale
    generator = np.random.default_rng(3)
    low, high = triangles.reshape(-1, 3).min(axis=0), triangles.reshape(-1, 3).max(axis=0)
    anywhere = generator.uniform(1.2 * low - 0.2 * high, 1.2 * high - 0.2 * low, (500, 3))
    # The middles of faces, edges and corners, moved along the axes and along the line of sight.
    special = np.concatenate(
        [triangles.mean(axis=1), triangles[:, 0], triangles[:, :2].mean(axis=1)]
    )
    special = special[generator.integers(len(special), size=100)]
    along = np.concatenate([np.eye(3), -np.eye(3), membership.SKEW[2:], -membership.SKEW[2:]])
    special = (special[:, None] + 0.83 * scale * along).reshape(-1, 3)
    points = np.concatenate([anywhere, special])
    surface = NearestSurface(triangles).distance(points)
    points = points[surface > 1e-9 * scale]
    np.testing.assert_array_equal(
        Membership(triangles).contains(points), winding_number(points, triangles) > 0.5
    )


def test_lines_through_corners_fall_back_on_the_winding_number(monkeypatch) -> None:
    """Right below the corners of a sphere, no crossing is sure, and few points are asked again."""
    triangles = solids()["sphere"].triangles
    asked: list[int] = []

    def counted(points, faces):
        asked.append(len(points))
        return winding_number(points, faces)

    monkeypatch.setattr(membership, "winding_number", counted)
    up = membership.SKEW[2]
    upper = triangles[(triangles @ up).min(axis=1) > 3, 0]
    inside = Membership(triangles).contains(upper - 2 * up)
    assert inside.all()
    assert asked == [len(upper)]


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 120), st.floats(-3, 6))
def test_distance_is_that_of_the_nearest_triangle(seed: int, count: int, decade: float) -> None:
    """Slivers, points and lines for triangles included, at every scale."""
    generator = np.random.default_rng(seed)
    triangles = generator.normal(size=(count, 3, 3)) * generator.uniform(0, 1, (count, 1, 1))
    triangles += 2 * generator.normal(size=(count, 1, 3))
    triangles[::7, 2] = triangles[::7, 1]
    triangles[::11, 1] = triangles[::11, 0]
    triangles[::5, 2] = (triangles[::5, 0] + triangles[::5, 1]) / 2
    triangles *= 10**decade
    points = 3 * 10**decade * generator.normal(size=(40, 3))
    wanted = [distance_to_triangles(np.tile(p, (count, 1)), triangles).min() for p in points]
    found = NearestSurface(triangles).distance(points)
    np.testing.assert_allclose(found, wanted, rtol=1e-11)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000))
def test_distance_to_a_triangle_is_the_least_over_its_points(seed: int) -> None:
    """Close to a fine grid of points on the triangle, and never above it."""
    generator = np.random.default_rng(seed)
    triangle, point = generator.normal(size=(3, 3)), 2 * generator.normal(size=3)
    u, v = (g.ravel() for g in np.meshgrid(np.linspace(0, 1, 201), np.linspace(0, 1, 201)))
    kept = u + v <= 1
    weights = np.stack([1 - u - v, u, v], axis=-1)[kept]
    sampled = np.linalg.norm(weights @ triangle - point, axis=-1).min()
    distance = distance_to_triangles(point[None], triangle[None])[0]
    assert sampled - 0.05 <= distance <= sampled + 1e-12


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 200))
def test_tree_finds_each_pair_of_meeting_boxes_once(seed: int, count: int) -> None:
    generator = np.random.default_rng(seed)
    low = generator.uniform(size=(count, 3))
    high = low + 0.3 * generator.uniform(size=(count, 3))
    points = generator.uniform(size=(50, 3))

    def meets(which, centres, halves, some):
        assert ((low[some].T <= centres + halves) & (high[some].T >= centres - halves)).all()
        return (np.abs(points[which].T - centres) <= halves).all(axis=0)

    pairs = [
        (int(q), int(t))
        for questions, things in BoxTree(low, high).pairs(np.arange(50), meets)
        for q, t in zip(questions, things, strict=True)
    ]
    inside = (points[:, None] >= low) & (points[:, None] <= high)
    wanted = {(int(q), int(t)) for q, t in np.argwhere(inside.all(axis=-1))}
    # Boxes about several things meet more than their contents do.
    assert wanted <= set(pairs)
    assert len(pairs) == len(set(pairs))


def test_nothing_asked_nothing_answered() -> None:
    for mesh in solids().values():
        solid = Solid(mesh.vertices, mesh.faces)
        assert solid.contains(np.zeros((0, 3))).shape == (0,)
        assert solid.distance_to_surface_mm(np.zeros((0, 3))).shape == (0,)
    box = box_workspace((0, 0, 0), (1, 2, 3))
    assert box.contains(np.full((2, 5, 3), 0.5)).shape == (2, 5)
