"""The lens touches nothing, against solids that are measured in another way."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from lenscal.camera import Camera
from lenscal.errors import InputError, PlanningError
from lenscal.pose import Pose
from lenscal.sensor import Sensor
from planning.camera_body import CameraBody
from planning.cylinder import Cylinder
from planning.hull import Hull
from planning.lens_states import LensStates
from planning.polygons import area_vectors, convex_quadrilaterals
from planning.requirements.clearance import Clearance
from planning.scene import Scene
from planning.separation import (
    directions_apart,
    nearest_on_faces,
    nearest_on_triangles,
    separation_mm,
)
from planning.solid import Solid
from planning.target import Target
from planning.views import Subject, Views

SENSOR = Sensor(512, 480, 0.023, 0.01375)
TARGET = Target.segment((-5, 0, 0), (5, 0, 0))
DOWN = np.diag([1.0, -1.0, -1.0])


def states(*offsets: float) -> LensStates:
    centres = [(0, 0, -offset) for offset in offsets]
    count = len(offsets)
    return LensStates((Camera(SENSOR, 100.0),) * count, [600.0] * count, np.array(centres, float))


def box(low, high) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[low, high])


def solid(mesh: trimesh.Trimesh) -> Solid:
    return Solid(mesh.vertices, mesh.faces)


def separation(piece, triangles, group, enough) -> np.ndarray:
    # A triangle is a face of four corners, one of them twice.
    corners = np.stack([*np.moveaxis(np.asarray(triangles), 1, 0), np.asarray(triangles)[:, 0]])
    corners = np.ascontiguousarray(corners.transpose(0, 2, 1))
    gaps = [gap for _, *both in directions_apart(piece, corners) for gap in both]
    distance, _ = separation_mm(piece, corners, group, enough, np.max(gaps, axis=0))
    return distance


def look_down(height, scene, *offsets, x=0.0, requirement) -> np.ndarray:
    subject = Subject(TARGET, scene=scene)
    views = Views.of(Pose(DOWN, np.array([x, 0.0, height])), states(*offsets), subject)
    return requirement.margin(views).value[0]


def closest(cylinder: Cylinder, triangle) -> float:
    """Distance by a grid over the triangle that closes in on the best place: it is convex there."""
    low, high = np.zeros(2), np.ones(2)
    for _ in range(30):
        a, b = np.meshgrid(*np.linspace(low, high, 13).T)
        inside = a + b <= 1
        a, b = a[inside], b[inside]
        edges = triangle[1:] - triangle[0]
        away = triangle[0] + np.stack([a, b], axis=-1) @ edges - cylinder.centre_mm
        along = away @ cylinder.axis
        across = np.linalg.norm(away - along[:, None] * cylinder.axis, axis=-1)
        beyond = np.maximum(np.abs(along) - cylinder.half_length_mm, 0)
        distance = np.hypot(beyond, np.maximum(across - cylinder.radius_mm, 0))
        best = np.array([a[distance.argmin()], b[distance.argmin()]])
        size = 0.3 * (high - low)
        low, high = np.clip(best - size, 0, 1), np.clip(best + size, 0, 1)
    return float(distance.min())


def test_the_front_of_the_lens_moves_with_the_offset() -> None:
    """The projection centre is at 600, the front 500 before the reference centre."""
    requirement = Clearance(CameraBody.barrel(500.0, 20.0, 300.0), 40.0)
    scene = Scene([box((-50, -50, -10), (50, 50, 0))])
    # With an offset of 30 the reference centre is 30 nearer, and so is the front.
    found = look_down(
        600.0, scene, 0.0, 30.0, 59.0, 60.0, 75.0, 101.0, -30.0, requirement=requirement
    )
    np.testing.assert_allclose(found, [40, 30, 1, 0, -15, -41, 40], atol=1e-6)


def test_numbers_for_walls_beside_the_barrel() -> None:
    requirement = Clearance(CameraBody.barrel(500.0, 20.0, 300.0), 10.0)
    wall = Scene([box((25, -50, 0), (30, 50, 400))])
    assert look_down(600.0, wall, 0.0, requirement=requirement) == pytest.approx(-5)
    assert look_down(600.0, wall, 0.0, x=-10.0, requirement=requirement) == pytest.approx(5)
    assert look_down(600.0, wall, 0.0, x=-100.0, requirement=requirement) == pytest.approx(10)
    # A corner of the wall under the rim of the front: the distance is that of edge and circle.
    low = Scene([box((25, -50, 0), (30, 50, 90))])
    assert look_down(600.0, low, 0.0, requirement=requirement) == pytest.approx(
        np.hypot(5, 10) - 10, abs=2e-4
    )
    overlap = look_down(600.0, wall, 0.0, x=8.0, requirement=requirement)
    assert overlap == pytest.approx(-3 - 10), "three mm deep, and ten are asked"


def test_a_body_inside_of_material_is_not_free() -> None:
    requirement = Clearance(CameraBody.barrel(500.0, 2.0, 10.0), 10.0)
    block = Scene([box((-50, -50, 50), (50, 50, 150))])
    found = look_down(600.0, block, 0.0, requirement=requirement)
    assert found == pytest.approx(-45 - 10), "its middle is 45 from the nearest face"
    hollow = trimesh.creation.box(bounds=[(-60, -60, 40), (60, 60, 160)])
    cavity = box((-50, -50, 50), (50, 50, 150))
    cavity.invert()
    shell = Scene([trimesh.util.concatenate([hollow, cavity])])
    assert look_down(600.0, shell, 0.0, requirement=requirement) == pytest.approx(10)


def test_separation_agrees_with_a_general_minimiser() -> None:
    generator = np.random.default_rng(0)
    for _ in range(100):
        ends = generator.normal(size=(2, 3)) * 10
        cylinder = Cylinder(ends[0], ends[1], generator.uniform(1, 8))
        triangles = generator.normal(size=(4, 3, 3)) * 15 + generator.normal(size=(1, 1, 3)) * 25
        found = separation(cylinder, triangles, np.arange(4), 1e9)
        expected = np.array([closest(cylinder, t) for t in triangles])
        apart = expected > 1e-3
        np.testing.assert_allclose(found[apart], expected[apart], atol=2e-4)
        assert (found[apart] <= expected[apart] + 1e-8).all()
        assert (found[~apart] <= 1e-3).all()


def test_nearest_points_agree_with_trimesh() -> None:
    generator = np.random.default_rng(1)
    triangles, points = (
        generator.normal(size=(20_000, 3, 3)),
        2 * generator.normal(size=(20_000, 3)),
    )
    expected = trimesh.triangles.closest_point(triangles, points)
    found = nearest_on_triangles(*triangles.transpose(1, 2, 0), points.T)
    np.testing.assert_allclose(found.T, expected, atol=1e-9)


def test_a_face_of_four_corners_is_its_two_triangles() -> None:
    generator = np.random.default_rng(2)
    rectangle = np.array([[0, 0, 0], [3, 0, 0], [3, 2, 0], [0, 2, 0]], float)
    corners = np.repeat(rectangle[..., None], 1000, axis=2)
    points = generator.normal(size=(3, 1000)) * 4
    expected = np.clip(points, 0, [[3], [2], [0]])
    np.testing.assert_allclose(nearest_on_faces(corners, points), expected, atol=1e-12)
    cylinder = Cylinder((1, 1, 5), (1, 1, 9), 0.5)
    known = np.full(1, -np.inf)
    distance, direction = separation_mm(cylinder, corners[..., :1], np.zeros(1, int), 99.0, known)
    # No direction was tried before: the projections find it.
    assert distance == pytest.approx(5, abs=1e-4)
    np.testing.assert_allclose(direction[:, 0], (0, 0, -1), atol=1e-6)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000))
def test_quadrilaterals_cover_a_surface(seed: int) -> None:
    generator = np.random.default_rng(seed)
    part = box((0, 0, 0), generator.uniform(1, 5, 3))
    ball = trimesh.creation.icosphere(subdivisions=1)
    disk = trimesh.creation.cylinder(2.0, 1.0, sections=int(generator.integers(3, 12)))
    for mesh, most in ((part, 6), (ball, len(ball.faces)), (disk, len(disk.faces))):
        faces = convex_quadrilaterals(np.asarray(mesh.vertices), np.asarray(mesh.faces))
        assert len(faces) <= most
        areas = np.linalg.norm(area_vectors(faces), axis=-1)
        assert areas.sum() == pytest.approx(mesh.area)
        # They turn the same way, and enclose the same volume.
        moments = np.einsum("qi,qi->q", area_vectors(faces), faces[:, 0])
        assert moments.sum() / 3 == pytest.approx(mesh.volume)


def test_hull_is_measured_as_what_it_is() -> None:
    """A housing of two cubes, beside a block: faces, an edge and a corner."""
    housing = Hull(solid(box((-10, -10, -10), (10, 10, 10))))
    block = box((15, -100, -100), (40, 100, 100)).triangles
    assert separation(housing, block, np.zeros(12, int), 99.0).max() >= 5
    assert separation(housing, block, np.arange(12), 99.0).min() == pytest.approx(5)
    away = box((13, 14, -5), (20, 20, 5)).triangles
    assert separation(housing, away, np.arange(12), 99.0).min() == pytest.approx(5, abs=2e-4)
    corner = box((11, 12, 12), (20, 20, 20)).triangles
    assert separation(housing, corner, np.arange(12), 99.0).min() == pytest.approx(3, abs=2e-4)
    deep = box((8, -5, -5), (30, 5, 5)).triangles
    assert separation(housing, deep, np.arange(12), 99.0).min() == pytest.approx(-2, abs=2)
    requirement = Clearance(CameraBody(meshes=[solid(box((-30, -30, 480), (30, 30, 500)))]), 10.0)
    floor = Scene([box((-50, -50, -10), (50, 50, 85))])
    assert look_down(600.0, floor, 0.0, requirement=requirement) == pytest.approx(5)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000))
def test_margin_does_not_change_under_rigid_motion_and_is_monotone(seed: int) -> None:
    generator = np.random.default_rng(seed)
    body = CameraBody(
        [Cylinder((0, 0, 100), (0, 0, 480), 25), Cylinder((30, 0, 300), (60, 20, 300), 8)]
    )
    meshes = [box(c - 10, c + 10) for c in generator.uniform(-120, 120, (3, 3))]
    motion = Pose.from_rotation_vector(generator.normal(size=3), generator.normal(size=3) * 300)
    place = generator.uniform((-100, -100, 550), (100, 100, 700))
    z = -place / np.linalg.norm(place)
    x = np.cross(z, (0.3, 1, 0))
    x /= np.linalg.norm(x)
    pose = Pose(np.stack([x, np.cross(z, x), z], axis=-1), place)
    moved = [trimesh.Trimesh(motion.transform(m.vertices), m.faces, process=False) for m in meshes]
    lens = states(0.0, 50.0, 200.0)
    here = Clearance(body, 30.0).margin(Views.of(pose, lens, Subject(TARGET, scene=Scene(meshes))))
    there = Clearance(body, 30.0).margin(
        Views.of(motion @ pose, lens, Subject(TARGET, scene=Scene(moved)))
    )
    np.testing.assert_allclose(here.value, there.value, atol=4e-4)
    more = Scene([*meshes, box((-130, -130, -5), (130, 130, 0))])
    crowded = Clearance(body, 30.0).margin(Views.of(pose, lens, Subject(TARGET, scene=more)))
    assert (crowded.value <= here.value + 4e-4).all()
    stout = CameraBody([Cylinder((0, 0, 100), (0, 0, 480), 35), body.cylinders[1]])
    thicker = Clearance(stout, 30.0).margin(
        Views.of(pose, lens, Subject(TARGET, scene=Scene(meshes)))
    )
    assert (thicker.value <= here.value + 4e-4).all()


def test_many_views_are_the_same_as_one_by_one() -> None:
    generator = np.random.default_rng(5)
    scene = Scene([box((20, -50, 0), (30, 50, 60)), box((-80, -5, -40), (-20, 5, 30))])
    requirement = Clearance(CameraBody.barrel(500.0, 20.0, 300.0), 15.0)
    lens = states(0.0, 20.0, 55.0, 90.0)
    places = np.array([0, 0, 600.0]) + generator.normal(size=(40, 3)) * 40
    views = Views.looking_at(places, (0, 0, 0), (1, 0, 0), lens, Subject(TARGET, scene=scene))
    whole = requirement.margin(views).value
    assert (whole.min(), whole.max()) < (0.0, 15.0)
    each = Views(
        np.repeat(views.positions_mm, 4, axis=1), np.repeat(views.rotations, 4, axis=1), lens,
        views.subject,
    )  # fmt: skip
    np.testing.assert_allclose(requirement.margin(each).value, whole, atol=4e-4)
    for v in range(40):
        one = requirement.margin(views.some(slice(v, v + 1))).value
        np.testing.assert_allclose(one[0], whole[v], atol=4e-4)


def test_what_is_missing_or_makes_no_sense_is_named() -> None:
    scene = Scene([box((0, 0, 0), (1, 1, 1))])
    requirement = Clearance(CameraBody.barrel(500.0, 20.0, 300.0), 15.0)
    assert requirement.describe(SENSOR) == "clearance of 15 mm between the lens and the scene"
    pose = Pose(DOWN, np.array([0, 0, 600.0]))
    with pytest.raises(InputError, match="clearance needs the scene"):
        requirement.margin(Views.of(pose, states(0.0), Subject(TARGET)))
    unknown = LensStates((Camera(SENSOR, 100.0),), [600.0])
    with pytest.raises(PlanningError, match="this map has no nodal offsets, since no robot poses"):
        requirement.margin(Views.of(pose, unknown, Subject(TARGET, scene=scene)))
    with pytest.raises(InputError, match="distance_mm must be a positive number"):
        Clearance(requirement.body, 0.0)
    with pytest.raises(InputError, match="needs a cylinder or a mesh, but has neither"):
        CameraBody()
    with pytest.raises(InputError, match="a cylinder needs a length"):
        Cylinder((0, 0, 1), (0, 0, 1), 3)
    with pytest.raises(InputError, match="radius_mm must be a positive number"):
        Cylinder((0, 0, 1), (0, 0, 2), -3)
    with pytest.raises(InputError, match="length_mm must be a positive number"):
        CameraBody.barrel(500.0, 20.0, -300.0)
    with pytest.raises(InputError, match="a camera body needs a mesh with faces"):
        CameraBody(meshes=[Solid(np.zeros((0, 3)), np.zeros((0, 3), int))])
