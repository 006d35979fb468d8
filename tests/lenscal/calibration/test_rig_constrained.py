from dataclasses import replace

import numpy as np
import pytest

from lenscal.calibration.calibration import Repeatability
from lenscal.calibration.refine import calibrate_views
from lenscal.errors import DegenerateGeometryError, InputError
from lenscal.pose import Pose

ROBOT = Repeatability(rotation_rad=1e-4, translation_mm=0.02)
NAMES = (
    "object_distance_mm",
    "image_distance_mm",
    "magnification",
    "nodal_offset_mm",
    "nodal_x_mm",
    "nodal_y_mm",
    "standoff_mm",
)


def _calibrate(world, **options):
    return calibrate_views(
        world.points,
        world.pixels,
        world.camera.sensor,
        hand_poses=options.pop("hand_poses", world.hands),
        hand_from_camera=world.hand_from_camera,
        **options,
    )


def _truth(world):
    x, y, _ = world.nodal_mm
    return {
        "object_distance_mm": world.object_distance_mm,
        "image_distance_mm": world.camera.image_distance_mm,
        "magnification": world.camera.image_distance_mm / world.object_distance_mm,
        "nodal_offset_mm": world.nodal_offset_mm,
        "nodal_x_mm": x,
        "nodal_y_mm": y,
        "standoff_mm": world.object_distance_mm - world.nodal_offset_mm,
    }


def test_exact_data_give_the_exact_answer(ride):
    world = ride(np.random.default_rng(0), noise_px=0.0, slip_mm=0.0, slip_rad=0.0)
    result = _calibrate(world, repeatability=ROBOT)
    for name, value in _truth(world).items():
        assert result.value(name) == pytest.approx(value, rel=1e-6, abs=1e-5), name
    np.testing.assert_allclose(
        result.robot.mounting.camera_from_hand.matrix, world.camera_from_hand.matrix, atol=1e-4
    )
    np.testing.assert_allclose(
        result.robot.mounting.base_from_target.matrix, world.base_from_target.matrix, atol=1e-4
    )


def test_every_error_is_within_what_is_stated(ride):
    """Forty robots: normalised errors of everything have a spread of one."""
    rng = np.random.default_rng(1)
    errors = []
    for _ in range(40):
        world = ride(rng)
        result = _calibrate(world, repeatability=ROBOT)
        truth = _truth(world)
        errors.append([(result.value(n) - truth[n]) / result.sigma(n) for n in NAMES])
    spread = np.sqrt((np.array(errors) ** 2).mean(axis=0))
    np.testing.assert_array_less(spread, 1.35)
    np.testing.assert_array_less(0.65, spread)


def test_standoff_is_known_far_better_than_d_and_the_offset(ride):
    result = _calibrate(ride(np.random.default_rng(2)))
    large, small = result.sigma("object_distance_mm"), result.sigma("standoff_mm")
    assert small < 0.1 * large
    assert result.sigma("nodal_offset_mm") == pytest.approx(large, rel=0.02)
    shared = result.covariance(["object_distance_mm", "nodal_offset_mm"])
    assert shared[0, 1] / np.sqrt(shared[0, 0] * shared[1, 1]) > 0.99
    assert result.value("standoff_mm") == pytest.approx(
        result.object_distance_mm - result.value("nodal_offset_mm"), abs=1e-9
    )


def test_displacements_show_d_where_perspective_is_weak(ride):
    """A narrow field: the robot's displacements halve σ(D), and more of them help more."""
    far = {
        "image_distance_mm": 400.0,
        "object_distance_mm": 2000.0,
        "nodal_mm": (0.0, 0.0, -1500.0),
        "tilt_deg": 10.0,
    }
    with_robot = ride(np.random.default_rng(3), displacements_mm=(-40.0, -40.5, 40.0, 40.5), **far)
    free = calibrate_views(with_robot.points, with_robot.pixels, with_robot.camera.sensor)
    tied = _calibrate(with_robot, repeatability=ROBOT)
    assert tied.sigma("object_distance_mm") < 0.5 * free.sigma("object_distance_mm")
    error = tied.object_distance_mm - with_robot.object_distance_mm
    assert abs(error) < 3 * tied.sigma("object_distance_mm")


def test_the_repeatability_is_found(ride):
    """Mean over twenty sessions of ten views, of a robot ten times worse than the usual one.

    A little is believed to be usual beforehand, which makes the estimate 4 % too small.
    """
    rng = np.random.default_rng(4)
    found = [
        _calibrate(ride(rng, slip_mm=0.2, slip_rad=1e-3)).robot.repeatability for _ in range(20)
    ]
    assert np.mean([f.translation_mm for f in found]) == pytest.approx(0.2, rel=0.1)
    assert np.mean([f.rotation_rad for f in found]) == pytest.approx(1e-3, rel=0.1)


def test_a_slip_of_one_view_is_found_and_its_picture_kept(ride):
    world = ride(np.random.default_rng(5))
    wrong = Pose.from_rotation_vector([0.0, 0.0, 0.0], [0.8, 0.0, 0.5])
    hands = [*world.hands[:3], world.hands[3] @ wrong, *world.hands[4:]]
    result = _calibrate(world, hand_poses=hands)
    assert not result.robot.believed[3]
    assert result.robot.believed.sum() == len(hands) - 1
    note = next(w for w in result.warnings if "the robot stood" in w)
    assert note.startswith("in view 3 the robot stood ")
    assert note.endswith("the picture was used without the pose")
    assert result.inliers[3].any()
    error = result.value("nodal_offset_mm") - world.nodal_offset_mm
    assert abs(error) < 3 * result.sigma("nodal_offset_mm")


def test_views_without_a_pose_are_used_all_the_same(ride):
    world = ride(np.random.default_rng(6))
    hands = [*world.hands[:8], None, *world.hands[9:]]
    result = _calibrate(world, hand_poses=hands, repeatability=ROBOT)
    assert np.isnan(result.robot.slips[8]).all()
    assert np.isfinite(result.robot.slips[7]).all()
    assert result.inliers[8].any()
    assert "nodal_offset_mm" in result.quantities


def test_without_the_reference_camera_there_is_d_but_no_offset(ride):
    world = ride(np.random.default_rng(7))
    result = calibrate_views(
        world.points, world.pixels, world.camera.sensor, hand_poses=world.hands
    )
    assert result.sigma("object_distance_mm") > 0
    with pytest.raises(InputError, match="no value of nodal_offset_mm is known; known are"):
        result.value("nodal_offset_mm")


def test_d_is_measured_where_the_robot_says_the_plane_was(ride):
    """The focus view itself may have slipped by some hundredths; the plane did not."""
    world = ride(np.random.default_rng(8))
    result = _calibrate(world, repeatability=ROBOT)
    mounting = result.robot.mounting
    told = mounting.camera_from_target(world.hands[0])
    assert result.object_distance_mm == pytest.approx(
        told.rotation[:, 2] @ told.translation_mm / told.rotation[2, 2], abs=1e-9
    )
    assert result.magnification == pytest.approx(result.value("magnification"))
    assert result.focal_length_mm == pytest.approx(result.value("focal_length_mm"))


def test_a_hand_that_only_moves_shows_no_mounting(ride):
    world = ride(np.random.default_rng(9), tilted=0, displacements_mm=(-9, -6, -3, 3, 6, 9))
    with pytest.raises(DegenerateGeometryError, match="turn"):
        _calibrate(world)


def test_poses_of_other_pictures_are_refused(ride):
    world = ride(np.random.default_rng(10))
    shuffled = [world.hands[i] for i in (5, 9, 1, 7, 0, 3, 8, 2, 6, 4)]
    with pytest.raises(DegenerateGeometryError, match="do not go with the pictures") as caught:
        _calibrate(world, hand_poses=shuffled)
    assert "check that each pose belongs to its picture" in str(caught.value)


def test_a_robot_that_rarely_stands_where_it_says_is_refused(ride):
    """Told to be precise, it cannot have slipped in most of the views."""
    world = ride(np.random.default_rng(13), slip_mm=2.0, slip_rad=0.0)
    with pytest.raises(DegenerateGeometryError, match=r"only \d of the 10 poses .* agree"):
        _calibrate(world, repeatability=ROBOT)


def test_counts_must_agree(ride):
    world = ride(np.random.default_rng(11))
    with pytest.raises(InputError, match="there are 9 for 10 views"):
        _calibrate(world, hand_poses=world.hands[1:])


def test_bad_corners_are_left_out_before_the_robot_is_asked(ride):
    world = ride(np.random.default_rng(12))
    pixels = [p.copy() for p in world.pixels]
    pixels[4][17] += 30.0
    result = _calibrate(replace(world, pixels=tuple(pixels)), repeatability=ROBOT)
    assert [(r.view, r.point) for r in result.rejected] == [(4, 17)]


def test_a_hand_eye_calibration_of_stated_sigma_is_part_of_the_offset_alone(ride):
    """Turned by ε, the reference camera sees a centre 250 mm ahead of it 250 ε aside."""
    world = ride(np.random.default_rng(14))
    exact = _calibrate(world, repeatability=ROBOT)
    known = _calibrate(world, repeatability=ROBOT, hand_eye_sigma=(1e-3, 2.0))
    added = {"nodal_offset_mm": 2.0, "nodal_x_mm": np.hypot(2.0, 0.25), "standoff_mm": 0.0}
    for name, sigma in added.items():
        assert known.sigma(name) == pytest.approx(np.hypot(exact.sigma(name), sigma), rel=1e-3)
    assert known.sigma("object_distance_mm") == exact.sigma("object_distance_mm")
