"""Visibility as a margin, and the whole pupil in the region."""

from __future__ import annotations

import numpy as np
import pytest

from lenscal.camera import Camera
from lenscal.errors import InputError, PlanningError
from lenscal.pose import Pose
from lenscal.sensor import Sensor
from planning.lens_states import LensStates
from planning.requirements.unvignetted import Unvignetted, disk_radius_mm
from planning.requirements.visibility import Visibility
from planning.solid import box_workspace
from planning.views import Subject, Views
from planning.visibility.methods import visibility_region

SENSOR = Sensor(512, 480, 0.023, 0.01375)


def states(*pupils: float) -> LensStates:
    count = len(pupils)
    return LensStates(
        (Camera(SENSOR, 100.0),) * count, [50.0] * count,
        entrance_pupil_diameter_mm=np.array(pupils),
    )  # fmt: skip


@pytest.fixture(scope="module")
def walled(bench):
    """A 10 × 10 wall on an edge of the 10 × 10 target: the region ends at a plane through both."""
    scene = bench.scene(bench.block, bench.box((5, -5, -5), (6, 5, 10)))
    region = visibility_region(scene, bench.target, bench.workspace, audit_points=0)
    return Subject(bench.target, None, scene, region)


def test_visibility_is_the_signed_distance(walled) -> None:
    places = np.random.default_rng(0).uniform((-45, -45, 5), (45, 45, 95), (50, 3))
    views = Views.looking_at(places, (0, 0, 0), (1, 0.1, 0), states(4.0, 8.0), walled)
    margin = Visibility(2.0).margin(views)
    distance = walled.region.distance_to_boundary(places)
    np.testing.assert_allclose(margin.value, np.repeat(distance[:, None] - 2, 2, axis=1))
    np.testing.assert_allclose(margin.share, margin.value / 50)
    assert (margin.unit, margin.binds) == (
        "mm", "visibility of the whole target, 2 mm inside its region",
    )  # fmt: skip
    assert Visibility().describe(SENSOR) == "visibility of the whole target"


def test_pupil_may_be_as_wide_as_the_region_leaves_it(walled) -> None:
    """Every point of a disk that just fits is inside, and some of a larger one are not."""
    generator = np.random.default_rng(1)
    places = generator.uniform((-45, -45, 5), (45, 45, 95), (300, 3))
    views = Views.looking_at(places, (0, 0, 0), (1, 0.1, 0), states(30.0), walled)
    margin = Unvignetted().margin(views)
    assert margin.share.max() <= 1
    around = np.linspace(0, 2 * np.pi, 720, endpoint=False)[:, None]
    tried = 0
    for v in range(300):
        radius = margin.value[v, 0] + 15
        x, y = views.rotations[v, 0, :, 0], views.rotations[v, 0, :, 1]
        circle = np.cos(around) * x + np.sin(around) * y
        if radius <= 0:
            assert not walled.region.contains(places[v])
            continue
        assert walled.region.contains(places[v] + 0.999 * radius * circle).all()
        if margin.share[v, 0] < 1:
            assert not walled.region.contains(places[v] + 1.001 * radius * circle).all()
            tried += 1
    assert tried > 30


def test_ball_is_not_mistaken_for_the_disk(bench) -> None:
    """Near the top of the workspace, looking down, the disk is free where the ball is not."""
    region = visibility_region(
        bench.scene(bench.block), bench.target, bench.workspace, audit_points=0
    )
    subject = Subject(bench.target, None, None, region)
    pose = Pose(np.diag([1.0, -1, -1]), np.array([0, 0, 99.0]))
    margin = Unvignetted().margin(Views.of(pose, states(20.0, 60.0, 120.0), subject))
    np.testing.assert_allclose(margin.value[0], [10, 20, -10])
    np.testing.assert_allclose(margin.share[0], [1, 2 / 3, -1 / 6])
    assert margin.binds == "visibility from all of the entrance pupil"
    wider = Unvignetted().margin(Views.of(pose, states(20.0, 21.0), subject)).value[0]
    assert wider[1] > wider[0], "as far as is told, one radius"


def test_disk_in_a_box() -> None:
    triangles = box_workspace((-10, -20, -30), (10, 20, 30)).triangles_mm
    centres = np.zeros((4, 3))
    normals = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0], [0, 0, -1]])
    np.testing.assert_allclose(disk_radius_mm(centres, normals, triangles), [10, 20, 10, 10])
    far = disk_radius_mm(np.array([[0, 0, 99.0]]), normals[:1], triangles)
    assert far == np.inf
    with pytest.raises(InputError, match="4 disks need as many normals, but there are 1"):
        disk_radius_mm(centres, normals[:1], triangles)


def test_what_is_missing_or_makes_no_sense_is_named(walled, bench) -> None:
    with pytest.raises(InputError, match="distance_mm must be zero or a positive number"):
        Visibility(-1.0)
    pose = Pose(np.diag([1.0, -1, -1]), np.array([0, 0, 50.0]))
    for requirement in (Visibility(), Unvignetted()):
        with pytest.raises(InputError, match="visibility is judged by the region"):
            requirement.margin(Views.of(pose, states(1.0), Subject(bench.target)))
    unknown = LensStates((Camera(SENSOR, 100.0),), [50.0])
    with pytest.raises(PlanningError, match="whether the entrance pupil is free needs its"):
        Unvignetted().margin(Views.of(pose, unknown, walled))
