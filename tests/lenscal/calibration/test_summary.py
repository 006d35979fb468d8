from dataclasses import replace

import numpy as np
import pytest

from lenscal.calibration.calibration import Repeatability
from lenscal.calibration.refine import calibrate_views
from lenscal.calibration.summary import RobotWord, summarise_views
from lenscal.errors import DegenerateGeometryError

ROBOT = Repeatability(rotation_rad=1e-4, translation_mm=0.02)
NAMES = ("image_distance_mm", "object_distance_mm", "magnification", "k1_per_mm2")


def _beside(camera):
    """A camera that somebody else believes in, 1 % off."""
    return replace(camera, image_distance_mm=1.01 * camera.image_distance_mm)


def _sigma(summary, name):
    place = summary.names.index(name)
    return float(np.sqrt(summary.covariance[place, place]))


@pytest.mark.parametrize("with_robot", [False, True])
def test_where_views_determine_the_camera_the_answer_is_the_calibration(ride, with_robot):
    world = ride(np.random.default_rng(0))
    options, word = {}, None
    names = NAMES
    if with_robot:
        options = {
            "hand_poses": world.hands,
            "hand_from_camera": world.hand_from_camera,
            "repeatability": ROBOT,
        }
        word = RobotWord(world.hands, ROBOT, None, world.hand_from_camera)
        names = (*NAMES, "standoff_mm", "nodal_offset_mm", "nodal_x_mm")
    fitted = calibrate_views(world.points, world.pixels, world.camera.sensor, **options)
    asked = summarise_views(_beside(world.camera), world.points, world.pixels, 0, word)
    for name in names:
        assert asked.value(name) == pytest.approx(fitted.value(name), abs=0.05 * fitted.sigma(name))
        assert _sigma(asked, name) == pytest.approx(fitted.sigma(name), rel=0.05)
    assert asked.noise_px == pytest.approx(fitted.noise_px, rel=0.02)
    assert asked.rms_px > fitted.rms_px


def test_frontal_views_know_the_ratio_and_nothing_else(ride):
    world = ride(np.random.default_rng(1), tilted=0, displacements_mm=())
    asked = summarise_views(world.camera, world.points, world.pixels, 0)
    ratio = world.camera.image_distance_mm / world.object_distance_mm
    assert asked.value("magnification") == pytest.approx(ratio, rel=1e-3)
    assert _sigma(asked, "magnification") < 1e-3 * ratio
    assert _sigma(asked, "object_distance_mm") > 0.3 * asked.value("object_distance_mm")


def test_bad_corners_are_left_out(ride):
    world = ride(np.random.default_rng(2))
    pixels = [p.copy() for p in world.pixels]
    pixels[2][5] += 40.0
    asked = summarise_views(world.camera, world.points, pixels, 0)
    assert asked.corners == sum(len(p) for p in pixels) - 1


def test_views_of_another_camera_are_refused(ride):
    world = ride(np.random.default_rng(3))
    points, pixels = list(world.points), list(world.pixels)
    points[4], pixels[4] = points[4][:3], pixels[4][:3]
    with pytest.raises(DegenerateGeometryError, match="view 4 cannot be placed"):
        summarise_views(world.camera, points, pixels, 0)
    nonsense = np.random.default_rng(4).uniform(0, 400, world.pixels[0].shape)
    with pytest.raises(DegenerateGeometryError, match=r"focus view \(view 0\) does not go"):
        summarise_views(world.camera, world.points, [nonsense, *world.pixels[1:]], 0)
