import numpy as np
import pytest

from lenscal.calibration.mounting import Mounting
from lenscal.calibration.slips import SHARED_BY_SETTINGS, MountingPrior, Slips
from lenscal.calibration.views import State, Views
from lenscal.pose import Pose


def _small(rng, rotation_rad, translation_mm):
    turn = rotation_rad * rng.standard_normal(3)
    return Pose.from_rotation_vector(turn, translation_mm * rng.standard_normal(3))


@pytest.fixture
def rng():
    return np.random.default_rng(3)


@pytest.fixture
def slipped(tele, rng):
    """Views of a robot that slips far, with a prior that is not where the mounting is."""
    views = Views.pad(tele.points, tele.pixels, tele.camera.sensor.sample_pitch_mm)
    single = [
        State.of(tele.camera, p, m) for p, m in zip(tele.poses, views.middles_mm, strict=True)
    ]
    mounting = Mounting(_small(rng, 1.0, 50.0), _small(rng, 1.0, 300.0))
    true_slips = [_small(rng, 0.05, 3.0) for _ in tele.poses]
    hands = [
        mounting.base_from_target @ pose.inverse() @ mounting.camera_from_hand @ slip.inverse()
        for pose, slip in zip(tele.poses, true_slips, strict=True)
    ]
    state = State(
        single[0].intrinsics,
        np.concatenate([s.rotations for s in single]),
        np.concatenate([s.placements for s in single]),
        mounting,
    )
    root = rng.standard_normal((9, 9))
    away = np.zeros(12)
    away[SHARED_BY_SETTINGS] = 1e-6 * rng.standard_normal(9)
    prior = MountingPrior(mounting.moved(away), root @ root.T)
    return state, views, hands, prior


def _knowledge(views, hands, prior=None, believed=None):
    count = len(hands)
    believed = np.ones(count, dtype=bool) if believed is None else believed
    return Slips.of(hands, views.middles_mm, 0.1, (1e-3, 0.1), believed, prior)


def test_a_robot_that_stands_where_it_says_does_not_slip(tele, rng):
    views = Views.pad(tele.points, tele.pixels, tele.camera.sensor.sample_pitch_mm)
    mounting = Mounting(_small(rng, 1.0, 50.0), _small(rng, 1.0, 300.0))
    hands = [
        mounting.base_from_target @ pose.inverse() @ mounting.camera_from_hand
        for pose in tele.poses
    ]
    single = [
        State.of(tele.camera, p, m) for p, m in zip(tele.poses, views.middles_mm, strict=True)
    ]
    state = State(
        single[0].intrinsics,
        np.concatenate([s.rotations for s in single]),
        np.concatenate([s.placements for s in single]),
        mounting,
    )
    np.testing.assert_allclose(_knowledge(views, hands).measure(state), 0.0, atol=1e-9)
    for pose, hand in zip(tele.poses, hands, strict=True):
        np.testing.assert_allclose(mounting.camera_from_target(hand).matrix, pose.matrix, atol=1e-9)


def test_a_slip_is_measured_in_the_frame_of_the_hand(slipped):
    """Slips of 3 mm and 50 mrad are given back; the rotation as the sine of its angle."""
    state, views, hands, _ = slipped
    poses = state.poses(views.middles_mm)
    measured = _knowledge(views, hands).measure(state)
    for pose, hand, slip in zip(poses, hands, measured, strict=True):
        mounting = state.mounting
        expected = (
            mounting.camera_from_hand.inverse() @ pose @ mounting.base_from_target.inverse() @ hand
        )
        np.testing.assert_allclose(slip[3:], expected.translation_mm, atol=1e-8)
        vector = expected.rotation_vector
        angle = np.linalg.norm(vector)
        np.testing.assert_allclose(slip[:3], vector * np.sin(angle) / angle, atol=1e-9)


def test_normal_equations_are_the_derivative_of_the_cost(slipped):
    state, views, hands, prior = slipped
    knowledge = _knowledge(views, hands, prior)
    count = len(state.intrinsics) + 12
    system = knowledge.system(state, np.ones(count, dtype=bool))
    for index in range(count + 6):
        shared, poses = np.zeros(count), np.zeros((len(hands), 6))
        size = 1e-9 if index == 0 else 1e-6
        if index < count:
            shared[index] = size
        else:
            poses[2, index - count] = size
        ahead, behind = state.moved(shared, poses), state.moved(-shared, -poses)
        difference = (knowledge.cost(ahead) - knowledge.cost(behind)) / (4 * size)
        exact = (*system.shared_slope, *system.pose_slopes[2])[index]
        assert difference == pytest.approx(exact, rel=1e-5, abs=1e-6), index


def test_second_derivatives_match_differences_of_the_slips(slipped):
    state, views, hands, _ = slipped
    knowledge = _knowledge(views, hands)
    by_shared, by_pose = knowledge.jacobians(state)
    count = by_shared.shape[2]
    for index in range(count + 6):
        shared, poses = np.zeros(count), np.zeros((len(hands), 6))
        size = 1e-9 if index == 0 else 1e-6
        if index < count:
            shared[index] = size
            exact = by_shared[..., index]
        else:
            poses[:, index - count] = size
            exact = by_pose[..., index - count]
        change = knowledge.measure(state.moved(shared, poses)) - knowledge.measure(
            state.moved(-shared, -poses)
        )
        scale = max(np.abs(exact).max(), 1e-9)
        np.testing.assert_allclose(change / (2 * size), exact, atol=1e-5 * scale)


def test_a_pose_that_is_not_believed_counts_for_nothing(slipped):
    state, views, hands, _ = slipped
    believed = np.arange(len(hands)) != 1
    without = [*hands[:1], None, *hands[2:]]
    some, none = _knowledge(views, hands, None, believed), _knowledge(views, without)
    assert some.cost(state) == pytest.approx(none.cost(state))
    assert some.cost(state) < _knowledge(views, hands).cost(state)


def test_steps_lead_from_one_mounting_to_another(rng):
    one = Mounting(_small(rng, 0.4, 10.0), _small(rng, 0.4, 10.0))
    other = Mounting(_small(rng, 0.4, 10.0), _small(rng, 0.4, 10.0))
    reached = one.moved(one.step_to(other))
    for name in ("camera_from_hand", "base_from_target"):
        np.testing.assert_allclose(
            getattr(reached, name).matrix, getattr(other, name).matrix, atol=1e-12
        )
