import numpy as np
import pytest

from lenscal.calibration.calibration import Repeatability
from lenscal.calibration.pooling import pool_repeatability, pool_settings
from lenscal.calibration.refine import calibrate_views
from lenscal.calibration.slips import SHARED_BY_SETTINGS
from lenscal.calibration.summary import RobotWord, summarise_views

ROBOT = Repeatability(rotation_rad=1e-4, translation_mm=0.02)
#: Image distance and how far the projection centre has travelled, of six settings.
SETTINGS = ((100.0, 0.0), (110.0, -60.0), (120.0, -130.0), (130.0, -250.0), (90.0, 30.0), (95, 10))


def _calibrate(world, **options):
    return calibrate_views(
        world.points,
        world.pixels,
        world.camera.sensor,
        hand_poses=world.hands,
        hand_from_camera=world.hand_from_camera,
        **options,
    )


@pytest.fixture(scope="module")
def session(ride):
    """Six settings of one lens on one robot: worlds, and each calibrated by itself."""
    rng = np.random.default_rng(20)
    worlds = [
        ride(rng, image_distance_mm=d, object_distance_mm=410 - z, nodal_mm=(0.2, 0.1, z))
        for d, z in SETTINGS
    ]
    return worlds, [_calibrate(world, repeatability=ROBOT) for world in worlds]


def test_standoff_gains_by_what_the_others_know(session):
    worlds, alone = session
    pool = pool_settings([c.robot for c in alone])
    assert pool.notes == (None,) * 6
    for world, single, prior in zip(worlds, alone, pool.priors, strict=True):
        together = _calibrate(world, repeatability=ROBOT, mounting_prior=prior)
        assert together.sigma("standoff_mm") < 0.6 * single.sigma("standoff_mm")
        error = together.value("standoff_mm") - 410.0
        assert abs(error) < 3.5 * together.sigma("standoff_mm")


def test_the_result_is_that_of_all_settings_together(session):
    """With the others as prior, every setting comes to the same mounting."""
    worlds, alone = session
    pool = pool_settings([c.robot for c in alone])
    mountings = [
        _calibrate(world, repeatability=ROBOT, mounting_prior=prior).robot.mounting
        for world, prior in zip(worlds, pool.priors, strict=True)
    ]
    covariance = np.linalg.inv(pool.priors[0].information)
    sigmas = np.sqrt(np.diag(covariance))
    for mounting in mountings[1:]:
        apart = mountings[0].step_to(mounting)[SHARED_BY_SETTINGS]
        assert (np.abs(apart) < 0.1 * sigmas).all()


def test_one_setting_alone_learns_nothing(session):
    _, alone = session
    pool = pool_settings([alone[0].robot])
    assert pool.priors == (None,)


def test_a_target_that_was_knocked_is_named_and_stands_alone(session, ride):
    _, alone = session
    rng = np.random.default_rng(21)
    knocked = ride(rng, image_distance_mm=115.0, nodal_mm=(0.2, 0.1, -250.0))
    # The robot's word is off by the same 0.7 mm in all views: the target lay elsewhere.
    shift = np.array([0.5, 0.0, 0.5])
    hands = tuple(type(h)(h.rotation, h.translation_mm + shift) for h in knocked.hands)
    moved = calibrate_views(
        knocked.points, knocked.pixels, knocked.camera.sensor, hand_poses=hands, repeatability=ROBOT
    )
    pool = pool_settings(
        [*(c.robot for c in alone[:3]), moved.robot, *(c.robot for c in alone[3:])]
    )
    assert pool.priors[3] is None
    assert [note is None for note in pool.notes] == [True] * 3 + [False] + [True] * 3
    assert pool.notes[3].startswith("the target lies 0.")
    assert pool.notes[3].endswith("This setting was calibrated by itself")


def test_the_robot_is_judged_by_all_settings(session):
    _, alone = session
    found = pool_repeatability([c.robot for c in alone])
    assert found.translation_mm == pytest.approx(0.02, rel=0.25)
    assert found.rotation_rad == pytest.approx(1e-4, rel=0.25)


def test_a_setting_that_cannot_measure_the_mounting_is_told_by_the_others(session, ride):
    """Frontal views, displaced by a known way: with the mounting known, D comes from the way."""
    _, alone = session
    everybody = pool_settings([c.robot for c in alone]).everybody
    world = ride(
        np.random.default_rng(22),
        nodal_mm=(0.2, 0.1, -250.0),
        tilted=0,
        displacements_mm=(-30.0, -15.0, 15.0, 30.0),
    )
    word = RobotWord(world.hands, ROBOT, everybody, world.hand_from_camera)
    asked = summarise_views(world.camera, world.points, world.pixels, 0, word)
    place = asked.names.index("object_distance_mm")
    sigma = np.sqrt(asked.covariance[place, place])
    assert sigma < 0.002 * world.object_distance_mm
    assert abs(asked.values[place] - world.object_distance_mm) < 3.5 * sigma
