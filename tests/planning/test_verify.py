"""The check of viewpoints by code of its own, against closed forms and against the planner's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from lenscal.camera import Camera
from lenscal.errors import InputError
from lenscal.maps.lens_map import LensMap
from lenscal.pose import Pose
from planning.camera_body import CameraBody
from planning.clearance_check import TOLERANCE_MM, distance_as_far_as
from planning.cylinder import Cylinder
from planning.enclosure import example_part
from planning.lens_states import LensStates
from planning.planner import plan
from planning.requirements.clearance import Clearance
from planning.requirements.depth_of_field import DepthOfField
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.incidence import Incidence
from planning.requirements.resolution import Resolution
from planning.requirements.unvignetted import Unvignetted
from planning.requirements.visibility import Visibility
from planning.solid import Solid, box_workspace
from planning.target import Target
from planning.task import Task
from planning.verify import verify_viewpoint
from planning.views import Subject, Views
from planning.visibility.exact_test import ExactTest
from planning.visibility.methods import visibility_region


@pytest.fixture(scope="module")
def camera(paper_sensor) -> Camera:
    return Camera(paper_sensor, 20.0)


def above(height: float, x: float = 0.0, y: float = 0.0) -> Pose:
    """A camera over the point (0, 0), looking down along z, displaced by x and y."""
    return Pose(np.diag([1.0, -1.0, -1.0]), np.array([x, y, height]))


def looking(place) -> Pose:
    """A camera that looks at the origin."""
    place = np.asarray(place, dtype=np.float64)
    z = -place / np.linalg.norm(place)
    x = np.cross([0.0, 1, 0], z)
    x /= np.linalg.norm(x)
    return Pose(np.stack([x, np.cross(z, x), z], axis=-1), place)


def check(bench, camera, pose, requirements, scene=None, **truth):
    scene = scene or bench.scene(bench.block)
    return verify_viewpoint(camera, pose, bench.target, bench.target, requirements, scene, **truth)


@pytest.mark.parametrize("wavelength", [None, 600.0])
def test_blur_is_that_of_the_closed_form(bench, camera, wavelength) -> None:
    seen = check(
        bench, camera, above(100), [DepthOfField(4.0, 3.0, wavelength)],
        object_distance_mm=97.0, entrance_pupil_diameter_mm=8.0,
    )  # fmt: skip
    spread = 8 * 20 * max(1 / 98 - 1 / 97, 1 / 97 - 1 / 98, 1 / 97 - 1 / 102)
    airy = 0.0 if wavelength is None else 2.44 * wavelength * 1e-6 * 20 / 8
    assert seen.blur_px == pytest.approx(np.hypot(spread, airy) / 0.01375)
    assert not seen.in_focus
    assert seen.failed == ("depth_of_field",)
    assert check(
        bench, camera, above(100), [DepthOfField(4.0, 1.001 * seen.blur_px, wavelength)],
        object_distance_mm=97.0, entrance_pupil_diameter_mm=8.0,
    ).satisfied  # fmt: skip
    behind = check(
        bench, camera, above(1), [DepthOfField(4.0, 3.0)],
        object_distance_mm=97.0, entrance_pupil_diameter_mm=8.0,
    )  # fmt: skip
    assert behind.blur_px == np.inf


def test_incidence_is_the_angle_at_the_worst_corner(bench, camera) -> None:
    seen = check(bench, camera, above(40, x=25), [Incidence(37)])
    wanted = np.degrees(np.arctan(np.hypot(30, 5) / 40))
    assert seen.incidence_deg == pytest.approx(wanted)
    assert seen.failed == ("incidence",)
    assert check(bench, camera, above(40, x=25), [Incidence(wanted + 1e-9)]).seen_steeply
    segment = Target.segment((-5, 0, 0), (5, 0, 0))
    bare = verify_viewpoint(camera, above(40), segment, segment, [], bench.scene(bench.block))
    assert np.isnan(bare.incidence_deg)


def test_the_distance_of_a_barrel_is_found(bench) -> None:
    """Straight down, tilted so that its rim is nearest, and beside an edge."""
    scene = bench.scene(bench.block)
    body = CameraBody.barrel(front_mm=10.0, radius_mm=4.0, length_mm=30.0)
    assert distance_as_far_as(body, above(50), scene, 39.9) == pytest.approx(40, abs=0.1)
    tilted = Pose.from_rotation_vector([0.3, 0, 0], [0, 0, 0]) @ above(50)
    wide = bench.scene(bench.box((-500, -500, -9), (500, 500, 0)))
    wanted = 50 * np.cos(0.3) - 10 * np.cos(0.3) - 4 * np.sin(0.3)
    found = distance_as_far_as(body, tilted, wide, wanted - 0.15)
    assert wanted <= found < wanted + 3
    assert distance_as_far_as(body, tilted, wide, wanted + 0.15) < wanted + 0.15
    beside = Pose(np.eye(3), np.array([13.0, 0, -5]))
    assert distance_as_far_as(body, beside, scene, 3.9) >= 3.9
    assert distance_as_far_as(body, beside, scene, 4.2) < 4.2


def test_bodies_that_overlap_have_no_distance(bench) -> None:
    body = CameraBody.barrel(front_mm=10.0, radius_mm=20.0, length_mm=60.0)
    small = bench.scene(bench.box((-1, -1, -1), (1, 1, 1)))
    assert distance_as_far_as(body, Pose.identity(), small, 1.0) == 0, "scene within the body"
    large = bench.scene(bench.box((-100, -100, -100), (100, 100, 100)))
    assert distance_as_far_as(body, Pose.identity(), large, 1.0) == 0, "body within the scene"
    cube = CameraBody(meshes=[box_workspace((-20, -20, -20), (20, 20, 20))])
    assert distance_as_far_as(cube, Pose.identity(), small, 1.0) == 0
    assert distance_as_far_as(cube, Pose.identity(), large, 1.0) == 0
    away = Pose(np.eye(3), np.array([0, 0, 24.0]))
    assert distance_as_far_as(cube, away, small, 2.9) == pytest.approx(3, abs=0.1)


def test_clearance_is_judged_as_the_requirement_judges_it(paper_sensor) -> None:
    """Random poses about the example part, barrel and housing: both methods agree."""
    scene = example_part().scene
    housing = trimesh.creation.box(bounds=[[-30, -25, -60], [30, 25, -5]])
    body = CameraBody(
        (Cylinder(np.zeros(3), np.array([0.0, 0, 60]), 18.0),),
        (Solid(housing.vertices, housing.faces),),
    )
    centre = np.array([0.4, -0.3, -20.0])
    clearance = Clearance(body, 8.0)
    states = LensStates((Camera(paper_sensor, 20.0),), np.array([100.0]), centre[None])
    generator = np.random.default_rng(0)
    places = generator.normal(size=(80, 3))
    places *= generator.uniform(60, 180, (80, 1)) / np.linalg.norm(places, axis=1, keepdims=True)
    poses = [looking(place) for place in places]
    subject = Subject(example_part().target, None, scene)
    margins = clearance.margin(Views.of(poses, states, subject)).value[:, 0]
    target = example_part().target
    exact = ExactTest(scene)
    clear = np.array([
        verify_viewpoint(
            states.cameras[0], pose, target, target, [clearance], scene,
            projection_centre_mm=centre, exact_test=exact,
        ).clear
        for pose in poses
    ])  # fmt: skip
    sure = np.abs(margins) > TOLERANCE_MM
    np.testing.assert_array_equal(clear[sure], margins[sure] > 0)
    assert 10 < clear.sum() < 70


def test_the_pupil_and_a_ball_are_looked_through(bench, camera) -> None:
    """Beside a wall on the target's edge: what reaches beyond its shadow's border sees less."""
    scene = bench.scene(bench.block, bench.box((5, -5, -5), (6, 5, 10)))
    wall = [Unvignetted()]
    for x, diameter, free in ((0.0, 8.0, True), (3.0, 8.0, False), (3.0, 3.0, True)):
        seen = check(
            bench, camera, above(60, x=x), wall, scene, entrance_pupil_diameter_mm=diameter
        )
        assert seen.visible
        assert seen.unvignetted is free
    assert seen.satisfied
    low = box_workspace((-50, -50, 1), (2, 50, 100))
    outside = check(bench, camera, above(60), wall, entrance_pupil_diameter_mm=8.0, workspace=low)
    assert outside.failed == ("unvignetted",)
    near, far = Visibility(1.9), Visibility(2.1)
    assert check(bench, camera, above(60, x=3), [near], scene).visible
    assert not check(bench, camera, above(60, x=3), [far], scene).visible


def test_pupil_is_judged_as_the_requirement_judges_it(bench, camera) -> None:
    scene = bench.scene(
        bench.block, bench.box((-9, -9, 20), (-2, 9, 21)), bench.box((2, -9, 20), (9, 9, 21))
    )
    wide = Target.segment((-1, 0, 0), (1, 0, 0))
    workspace = box_workspace((-30, -30, 30), (30, 30, 60))
    region = visibility_region(scene, wide, workspace, audit_points=0)
    states = LensStates((camera,), np.array([50.0]), None, np.array([3.0]))
    generator = np.random.default_rng(1)
    poses = [looking(p) for p in generator.uniform((-12, -12, 32), (12, 12, 58), (60, 3))]
    margin = Unvignetted().margin(Views.of(poses, states, Subject(wide, None, None, region)))
    exact = ExactTest(scene)
    free = np.array([
        verify_viewpoint(
            camera, pose, wide, wide, [Unvignetted()], scene, entrance_pupil_diameter_mm=3.0,
            workspace=workspace, exact_test=exact,
        ).unvignetted
        for pose in poses
    ])  # fmt: skip
    sure = np.abs(margin.value[:, 0]) > 0.02
    np.testing.assert_array_equal(free[sure], margin.value[sure, 0] > 0)
    assert 5 < free.sum() < 55


def test_resolution_on_a_face_is_that_of_its_worst_direction(bench, camera) -> None:
    """Seen at 60° a face is half as wide; the coarser spacing of samples counts."""
    place = 1000 * np.array([np.sin(np.pi / 3), 0, np.cos(np.pi / 3)])
    seen = check(bench, camera, looking(place), [Resolution(1, 10)])
    spacing = camera.sensor.sample_pitch_mm.max()
    assert seen.pixels_per_mm == pytest.approx(0.5 * 20 / 1000 / spacing, rel=0.03)
    assert check(bench, camera, looking(place), [Resolution(1, 10, "x")]).resolved


def test_what_is_not_given_is_asked_for(bench, camera) -> None:
    body = CameraBody.barrel(front_mm=10.0, radius_mm=4.0, length_mm=30.0)
    for requirement, given, message in (
        (DepthOfField(1, 1), {}, "depth_of_field cannot be verified .*object_distance_mm="),
        (DepthOfField(1, 1), {"object_distance_mm": 9.0}, "give .*entrance_pupil_diameter_mm="),
        (Unvignetted(), {}, "unvignetted cannot be verified .*entrance_pupil_diameter_mm="),
        (Clearance(body, 1.0), {}, "clearance cannot be verified .*projection_centre_mm="),
    ):
        with pytest.raises(InputError, match=message):
            check(bench, camera, above(50), [requirement], **given)


def test_plans_with_all_requirements_pass() -> None:
    """On the map's own values, by code that shares nothing with the planner."""
    part = example_part()
    body = CameraBody.barrel(front_mm=235.0, radius_mm=20.0, length_mm=200.0)
    requirements = [
        Resolution(3, 0.254, "x"), FieldOfView(25.4, "x"), DepthOfField(1.0, 2.5), Incidence(80),
        Clearance(body, 5.0), Unvignetted(), Visibility(1.0),
    ]  # fmt: skip
    task = Task(part.target, part.feature, requirements, part.workspace)
    lens = LensMap.load(Path(__file__).parents[2] / "data" / "vicon-1990" / "map.json")
    found = plan(task, lens, part.scene, audit_points=0, settings_tried=5)
    assert len(found.viewpoints) > 3
    states, exact = found.views.states, ExactTest(part.scene)
    for k, pose in enumerate(found.poses):
        seen = verify_viewpoint(
            states.cameras[k], pose, part.target, part.feature, requirements, part.scene,
            object_distance_mm=float(states.object_distance_mm[k]),
            entrance_pupil_diameter_mm=float(states.entrance_pupil_diameter_mm[k]),
            projection_centre_mm=states.projection_centre_mm[k],
            workspace=part.workspace, exact_test=exact,
        )  # fmt: skip
        assert seen.failed == ()
