"""The paper's frame grabber: what shows its scale factor, and what does not."""

from dataclasses import replace

import numpy as np
import pytest

from lenscal.calibration.refine import calibrate_views
from lenscal.calibration.scale_factor import (
    largest_angle_deg,
    refuse_one_orientation,
    refuse_unseen_scale_factor,
    scale_factor_doubt,
)
from lenscal.camera import Camera
from lenscal.detection import detect
from lenscal.errors import DegenerateGeometryError
from lenscal.pose import Pose
from lenscal.rig.simulated import SimulatedRig
from lenscal.sensor import Sensor
from lenscal.session.aim import hand_pose
from lenscal.session.runner import points_of_interest
from lenscal.setting import LensSetting
from lenscal.target import Chessboard

SCALE_FACTOR = 0.70642
SENSOR = Sensor(512, 480, 0.023, 0.01375, SCALE_FACTOR)
BOARD = Chessboard(15, 13, 3.0)
TILTS_DEG = ((0, 0), (25, 0), (-25, 0), (0, 25), (0, -25), (18, 18))


@pytest.fixture(scope="module", params=[72.5, 98.0], ids=["wide", "tele"])
def rendered(request):
    """Six views of the simulated rig, found in its pictures."""
    rig = SimulatedRig.preset("vicon-1990", seed=3)
    setting = rig.lens.move_to(LensSetting(request.param, 100.0, 20.0))
    standoff_mm = rig.truth(setting).standoff_mm
    _, middle_mm = points_of_interest(rig.target)
    observations = []
    for number, tilt_deg in enumerate(TILTS_DEG):
        turn = Pose.from_rotation_vector(np.radians([*tilt_deg, 7.0 * number]))
        rig.positioner.move_to(hand_pose(rig, standoff_mm, middle_mm, turn))
        observations.append(detect(rig.camera.grab().as_8_bit(), rig.target))
    return rig.camera.sensor, observations


@pytest.mark.parametrize("believed", [0.5, 0.75, 1.0])
def test_the_frame_grabber_is_found_in_pictures(rendered, believed):
    """Recovered within 0.1 %, from a sensor that is 30 % off and more."""
    sensor, observations = rendered
    assert sensor.scale_factor == SCALE_FACTOR
    result = calibrate_views(
        [o.points_mm for o in observations],
        [o.pixels for o in observations],
        replace(sensor, scale_factor=believed),
        free_scale_factor=True,
    )
    assert result.camera.sensor.scale_factor == pytest.approx(SCALE_FACTOR, rel=1e-3)
    assert scale_factor_doubt(result) < 3e-4
    assert result.noise_px < 0.06
    refuse_unseen_scale_factor(result)
    refuse_one_orientation(np.stack([p.rotation for p in result.poses]))


def _pose(tilt_deg, turn_deg=0.0, place_mm=(0.3, -0.2, 370.0)):
    """Tilt a board that was turned in its own plane first."""
    turned = Pose.from_rotation_vector(np.radians([*tilt_deg, 0.0])) @ Pose.from_rotation_vector(
        np.radians([0.0, 0.0, turn_deg])
    )
    return Pose(turned.rotation, np.array(place_mm))


def _calibrate(poses, *, distance_mm=44.0, noise_px=0.03, believed=1.0, seed=0):
    camera = Camera(SENSOR, distance_mm, 3e-4, SENSOR.centre_px + np.array([4.0, -3.0]))
    rng = np.random.default_rng(seed)
    exact = [camera.project(p.transform(BOARD.points_mm)) for p in poses]
    inside = [SENSOR.contains(e) for e in exact]
    seen = [e[i] for e, i in zip(exact, inside, strict=True)]
    return calibrate_views(
        [BOARD.points_mm[i] for i in inside],
        [e + noise_px * rng.standard_normal(e.shape) for e in seen],
        replace(SENSOR, scale_factor=believed),
        free_scale_factor=True,
    )


TILTED = [_pose(t) for t in ((0, 0), (25, 0), (-25, 0), (0, 25), (0, -25))]


@pytest.mark.parametrize("believed", [0.5, 0.75, 1.0])
def test_stated_errors_are_those_seen(believed):
    """6 views with 0.03 px corners, from three wrong beliefs."""
    poses = [*TILTED, _pose((18, 18))]
    off = []
    for seed in range(12):
        result = _calibrate(poses, believed=believed, seed=seed)
        factor = result.camera.sensor.scale_factor
        assert factor == pytest.approx(SCALE_FACTOR, rel=1e-3)
        off.append((factor - SCALE_FACTOR) / result.sigma("scale_factor"))
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.6


def test_small_tilts_are_enough_when_they_differ():
    """Planes 4° apart leave d known to 2 %, but show the scale factor to 0.01 %."""
    result = _calibrate([_pose(t) for t in ((0, 0), (2, 0), (-2, 0), (0, 2), (0, -2))])
    assert scale_factor_doubt(result) < 1e-4
    refuse_one_orientation(np.stack([p.rotation for p in result.poses]))
    refuse_unseen_scale_factor(result)


def test_one_view_is_refused():
    words = (
        "one view of a flat target cannot show the scale factor; give several views whose tilts "
        r"differ by 10° or more, or points in space \(calibrate_tsai\), or state the scale factor"
    )
    with pytest.raises(DegenerateGeometryError, match=words):
        refuse_one_orientation(_pose((20, 20)).rotation[None])


@pytest.mark.parametrize("tilt_deg", [(20, 20), (5, 5)])
def test_parallel_planes_are_one_view(tilt_deg):
    """Moved and turned in their planes, they only seem to be several views: κ1 hides it."""
    poses = [
        _pose(tilt_deg, turn, place)
        for turn, place in (
            (0, (0, 0, 370)),
            (30, (5, 0, 390)),
            (60, (-5, 4, 350)),
            (90, (3, -4, 410)),
        )
    ]
    with pytest.raises(DegenerateGeometryError, match="4 views with parallel target planes"):
        _show_one_orientation(poses)


def test_a_camera_that_never_moved_is_one_view():
    with pytest.raises(DegenerateGeometryError, match="3 views with parallel target planes"):
        _show_one_orientation([_pose((20, 20))] * 3)


def _show_one_orientation(poses):
    """Calibrate, which may refuse by itself, and ask afterwards."""
    refuse_one_orientation(np.stack([p.rotation for p in _calibrate(poses).poses]))


def test_a_doubtful_scale_factor_is_refused():
    """Tilts that hardly differ, and poor corners."""
    poses = [_pose((tilt, 0)) for tilt in (25, 24, 26)]
    words = (
        r"the views do not show the scale factor: it is only known to 3.6 %, and 1 % is the most "
        r"that is of use \(their planes differ by at most 2\.\d°\); give several views"
    )
    with pytest.raises(DegenerateGeometryError, match=words):
        refuse_unseen_scale_factor(_calibrate(poses, noise_px=0.6))


def test_a_plane_has_no_front():
    there = _pose((20, 0)).rotation
    back = there @ np.diag([1.0, -1.0, -1.0])
    assert largest_angle_deg(np.stack([there, back])) == pytest.approx(0.0, abs=1e-9)
    assert largest_angle_deg(np.stack([there, _pose((-30, 0)).rotation])) == pytest.approx(50.0)
    assert largest_angle_deg(there[None]) == 0.0
    refuse_one_orientation(there[:0].reshape(0, 3, 3))
