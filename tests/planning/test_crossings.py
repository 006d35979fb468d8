"""Surfaces that cross themselves, and surfaces that only touch."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from planning.crossings import find_crossing


def crossing_of(*meshes: trimesh.Trimesh):
    both = trimesh.util.concatenate(meshes)
    return find_crossing(np.array(both.vertices), np.array(both.faces))


@pytest.mark.parametrize(
    ("low", "crosses"),
    [
        ((0.5, 0.5, 0.5), True),  # a corner inside
        ((0.5, 0.0, 0.0), True),  # sides lie in the same planes
        ((0.25, 0.25, -0.5), True),
        ((1.0, 0.0, 0.0), False),  # a face on a face
        ((1.0, 1.0, 0.0), False),  # an edge on an edge
        ((1.0, 1.0, 1.0), False),  # a corner on a corner
        ((0.25, 0.25, 1.0), False),  # standing on top
        ((1.5, 0.0, 0.0), False),
    ],
)
def test_two_boxes(bench, low, crosses: bool) -> None:
    first = bench.box((0, 0, 0), (1, 1, 1))
    second = bench.box(low, np.add(low, (1.0, 1.0, 1.0)))
    assert (crossing_of(first, second) is not None) == crosses


def test_the_place_lies_on_both_faces(bench) -> None:
    first, second = bench.box((0, 0, 0), (2, 2, 2)), bench.box((1, 1, 1), (3, 3, 3))
    both = trimesh.util.concatenate([first, second])
    found = find_crossing(np.array(both.vertices), np.array(both.faces))
    for face in found.faces:
        nearest = trimesh.triangles.closest_point(both.triangles[[face]], found.place[None])
        np.testing.assert_allclose(nearest[0], found.place, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_clean_surfaces_stay_clean_however_they_lie(seed: int) -> None:
    """A torus of long thin faces, turned, far away, and rounded to single precision."""
    torus = trimesh.creation.torus(3, 1, major_sections=60, minor_sections=24)
    turned = Rotation.random(rng=np.random.default_rng(seed)).apply(torus.vertices) + 100
    assert find_crossing(turned, np.array(torus.faces)) is None
    assert find_crossing(turned.astype(np.float32).astype(float), np.array(torus.faces)) is None


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e6])
def test_finds_the_one_spike_of_a_sphere(size: float) -> None:
    """A corner of a sphere pushed through its other side crosses there, whatever the size."""
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=size)
    vertices = np.array(sphere.vertices)
    spike = int(np.argmax(vertices[:, 2]))
    vertices[spike] = [0.1 * size, 0.05 * size, -1.5 * size]
    found = find_crossing(vertices, np.array(sphere.faces))
    assert found is not None
    assert found.place[2] == pytest.approx(-size, rel=0.02)


def test_one_triangle_crosses_nothing() -> None:
    assert find_crossing(np.eye(3), np.array([[0, 1, 2]])) is None
