"""AX = XB: every method finds a known X, and says so where nothing shows it."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from lenscal.calibration.hand_eye_equation import (
    METHODS,
    base_from_target,
    refuse_too_little_turning,
    solve_hand_eye_equation,
)
from lenscal.errors import DegenerateGeometryError, InputError
from lenscal.pose import Pose

each_method = pytest.mark.parametrize("method", METHODS)
vectors = arrays(float, 3, elements=st.floats(-1.0, 1.0))
anywhere = st.builds(lambda r, t: Pose.from_rotation_vector(3 * r, 500 * t), vectors, vectors)
seeds = st.integers(0, 2**32 - 1)

X = Pose.from_rotation_vector([0.1, 0.2, 1.5], [30.0, -50.0, 100.0])
Y = Pose.from_rotation_vector([0.3, 0.0, 0.2], [600.0, 100.0, 0.0])


def _hands(rng, count=8, widest_rad=0.6):
    """Turned from where the first is by up to so much, two of them surely, about two axes."""
    axes = rng.standard_normal((count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    angles = rng.uniform(0, widest_rad, count)
    axes[:3], angles[:3] = np.eye(3), (0.0, widest_rad, widest_rad)
    middle = Pose.from_rotation_vector(3 * rng.uniform(-1, 1, 3), 500 * rng.standard_normal(3))
    return [
        middle @ Pose.from_rotation_vector(angle * axis, 100 * rng.standard_normal(3))
        for axis, angle in zip(axes, angles, strict=True)
    ]


def _seen(hands, hand_from_camera=X, base_from_target=Y):
    return [(hand @ hand_from_camera).inverse() @ base_from_target for hand in hands]


def _shaken(rng, pose, turn_rad, shift_mm):
    """Turned about the origin of its second frame, and shifted along the axes of its first."""
    turn = Pose.from_rotation_vector(turn_rad * rng.standard_normal(3))
    shift = Pose(np.eye(3), shift_mm * rng.standard_normal(3))
    return shift @ pose @ turn


def _noisy(rng, count=12):
    hands = _hands(rng, count)
    seen = [_shaken(rng, pose, 1e-3, 0.1) for pose in _seen(hands)]
    return seen, [_shaken(rng, hand, 2e-4, 0.05) for hand in hands]


def _assert_same(a, b, shift_mm=1e-6, turn_rad=1e-8):
    shift, turn = a.distance_to(b)
    assert shift < shift_mm
    assert turn < turn_rad


# ── what is lawful ────────────────────────────────────────────────────────────────────────────────
@each_method
@settings(max_examples=30)
@given(hand_from_camera=anywhere, target=anywhere, seed=seeds)
def test_exact_poses_give_the_exact_answer(method, hand_from_camera, target, seed):
    hands = _hands(np.random.default_rng(seed))
    seen = _seen(hands, hand_from_camera, target)
    result = solve_hand_eye_equation(seen, hands, method)
    _assert_same(result, hand_from_camera)
    _assert_same(base_from_target(result, seen, hands), target)


@each_method
@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 0, 1), (0.6, 0.0, 0.8)])
def test_a_camera_that_is_mounted_the_other_way_round(method, axis):
    """By half a turn, at which the Rodrigues vector of Tsai and Lenz is infinite."""
    upside_down = Pose.from_rotation_vector(np.pi * np.asarray(axis), [10.0, 20.0, 30.0])
    hands = _hands(np.random.default_rng(0))
    result = solve_hand_eye_equation(_seen(hands, upside_down), hands, method)
    _assert_same(result, upside_down)


@each_method
def test_three_poses_suffice(method):
    hands = _hands(np.random.default_rng(1), count=3, widest_rad=np.radians(10))
    _assert_same(solve_hand_eye_equation(_seen(hands), hands, method), X)


@each_method
def test_half_turns_do_no_harm(method):
    """Noise decides about the sign of their axis, on the hand and on the camera by itself."""
    rng = np.random.default_rng(2)
    half = Pose.from_rotation_vector([0.0, np.pi, 0.0], [50.0, 0.0, 0.0])
    hands = [pose for hand in _hands(rng, 6) for pose in (hand, hand @ half)]
    seen = [_shaken(rng, pose, 1e-3, 0.0) for pose in _seen(hands)]
    _assert_same(solve_hand_eye_equation(seen, hands, method), X, 2.0, 2e-3)


@each_method
@settings(max_examples=30)
@given(frame=anywhere, seed=seeds)
def test_base_and_target_may_be_chosen_freely(method, frame, seed):
    seen, hands = _noisy(np.random.default_rng(seed))
    usual = solve_hand_eye_equation(seen, hands, method)
    for other_seen, other_hands in (
        (seen, [frame @ hand for hand in hands]),
        ([pose @ frame for pose in seen], hands),
    ):
        _assert_same(solve_hand_eye_equation(other_seen, other_hands, method), usual)


@each_method
@settings(max_examples=30)
@given(order=st.permutations(range(12)), seed=seeds)
def test_the_order_of_the_views_does_not_matter(method, order, seed):
    seen, hands = _noisy(np.random.default_rng(seed))
    shuffled = [seen[i] for i in order], [hands[i] for i in order]
    _assert_same(
        solve_hand_eye_equation(*shuffled, method), solve_hand_eye_equation(seen, hands, method)
    )


@each_method
@settings(max_examples=30)
@given(unit=st.floats(1e-3, 1e3), seed=seeds)
def test_the_unit_of_length_does_not_matter(method, unit, seed):
    seen, hands = _noisy(np.random.default_rng(seed))
    usual = solve_hand_eye_equation(seen, hands, method)
    result = solve_hand_eye_equation(
        [_scaled(pose, unit) for pose in seen], [_scaled(pose, unit) for pose in hands], method
    )
    _assert_same(_scaled(result, 1 / unit), usual)


def _scaled(pose, unit):
    return Pose(pose.rotation, unit * pose.translation_mm)


# ── noise ─────────────────────────────────────────────────────────────────────────────────────────
def test_all_methods_are_about_as_good():
    """Root mean square of 40 trials: within a factor of two of the best, and small.

    The target is about a metre away, where a turn of 1 mrad is 1 mm.
    """
    rng = np.random.default_rng(3)
    squares = {method: np.zeros(2) for method in METHODS}
    for _ in range(40):
        seen, hands = _noisy(rng)
        for method in METHODS:
            error = solve_hand_eye_equation(seen, hands, method).distance_to(X)
            squares[method] += np.square(error) / 40
    errors = np.sqrt(list(squares.values()))
    assert (errors < 2 * errors.min(axis=0)).all()
    assert (errors < [2.0, 4e-3]).all()


@each_method
def test_more_views_make_it_better(method):
    rng = np.random.default_rng(4)
    few, many = (
        np.mean(
            [
                np.square(solve_hand_eye_equation(*_noisy(rng, count), method).distance_to(X))
                for _ in range(20)
            ],
            axis=0,
        )
        for count in (6, 40)
    )
    assert (many < few / 2).all()


@pytest.mark.skipif(
    not hasattr(cv2, "calibrateHandEye"), reason="this OpenCV has no calibrateHandEye"
)
@pytest.mark.parametrize("method", ["park", "horaud"])
def test_opencv_says_the_same(method):
    """To rounding of the rotation. It takes each pair one way only, so the translation differs."""
    seen, hands = _noisy(np.random.default_rng(5))
    rotation, translation = cv2.calibrateHandEye(
        [hand.rotation for hand in hands],
        [hand.translation_mm for hand in hands],
        [pose.rotation for pose in seen],
        [pose.translation_mm for pose in seen],
        method=getattr(cv2, f"CALIB_HAND_EYE_{method.upper()}"),
    )
    result = solve_hand_eye_equation(seen, hands, method)
    _assert_same(result, Pose(rotation, translation[:, 0]), shift_mm=0.5)


def test_one_bad_view_does_not_move_the_target():
    rng = np.random.default_rng(6)
    seen, hands = _noisy(rng, count=9)
    good = base_from_target(X, seen, hands)
    hands[4] = hands[4] @ Pose.from_rotation_vector([0.0, 1.0, 0.5], [300.0, 0.0, 0.0])
    _assert_same(base_from_target(X, seen, hands), good, 0.5, 1e-3)


# ── what shows nothing ────────────────────────────────────────────────────────────────────────────
WANTED = "give three poses or more, turned about two different axes by 10° or more"


def _turned(*rotation_vectors_deg):
    rng = np.random.default_rng(7)
    return [
        Pose.from_rotation_vector(np.radians(vector), 100 * rng.standard_normal(3))
        for vector in rotation_vectors_deg
    ]


@pytest.mark.parametrize(
    ("hands", "said"),
    [
        pytest.param([], "0 poses of the hand", id="nothing"),
        pytest.param(_turned((0, 0, 0)), "1 pose of the hand", id="one"),
        pytest.param(_turned((20, 0, 0), (0, 20, 0)), "2 poses of the hand", id="two"),
        pytest.param(
            _turned(*np.zeros((5, 3))),
            r"the 5 poses of the hand are turned by at most 0\.0°",
            id="stage",
        ),
        pytest.param(
            _turned(*np.outer([0, 20, -30, 45], [0.6, 0, 0.8])),
            r"turned by at most 75\.0°, and by 0\.0° about a second axis",
            id="one axis",
        ),
        pytest.param(
            _turned((0, 0, 0), (40, 0, 0), (20, 2, 0)),
            r"turned by at most 40\.0°, and by 2\.\d° about a second axis",
            id="hardly about the second",
        ),
    ],
)
def test_too_little_turning_is_refused(hands, said):
    with pytest.raises(DegenerateGeometryError, match=f"{said}.*{WANTED}"):
        refuse_too_little_turning(hands)
    with pytest.raises(DegenerateGeometryError, match=said):
        solve_hand_eye_equation(_seen(hands), hands)


def test_what_is_asked_for_suffices():
    refuse_too_little_turning(_turned((0, 0, 0), (10, 0, 0), (0, 10, 0)))


def test_half_turns_alone_are_refused():
    hands = _turned((0, 0, 0), (180, 0, 0), (0, 180, 0))
    with pytest.raises(DegenerateGeometryError, match=r"3 poses .* half turns .* in between"):
        refuse_too_little_turning(hands)


def test_a_target_that_does_not_turn_with_the_hand_is_refused():
    hands = _hands(np.random.default_rng(8))
    seen = [Pose(np.eye(3), hand.translation_mm) for hand in hands]
    with pytest.raises(
        DegenerateGeometryError,
        match=r"saw the target turn by at most 0\.0°.* belongs to its view",
    ):
        solve_hand_eye_equation(seen, hands)


def test_andreff_needs_a_camera_that_moves():
    """Turned about its own centre, it shows the rotation up to scale only; the others find it."""
    turns = Rotation.from_rotvec([[0, 0, 0], [0.5, 0, 0], [0, 0.5, 0], [0, 0, 0.5]])
    cameras = [Pose(turn.as_matrix(), np.array([0.0, 0.0, 700.0])) for turn in turns]
    hands = [camera @ X.inverse() for camera in cameras]
    with pytest.raises(DegenerateGeometryError, match=r"scale of .* hardly moved.* another method"):
        solve_hand_eye_equation(_seen(hands), hands, "andreff")
    for method in set(METHODS) - {"andreff"}:
        _assert_same(solve_hand_eye_equation(_seen(hands), hands, method), X)


# ── what is asked for wrongly ─────────────────────────────────────────────────────────────────────
def test_poses_without_partner_are_refused():
    hands = _hands(np.random.default_rng(9))
    said = "one pose a view each, but there are 7 and 8; leave out"
    with pytest.raises(InputError, match=said):
        solve_hand_eye_equation(_seen(hands)[:7], hands)
    with pytest.raises(InputError, match=said):
        base_from_target(X, _seen(hands)[:7], hands)


def test_a_target_that_nobody_saw_is_nowhere():
    with pytest.raises(InputError, match="no view was given; give at least one"):
        base_from_target(X, [], [])


def test_an_unknown_method_is_refused_with_those_there_are():
    hands = _hands(np.random.default_rng(10))
    with pytest.raises(InputError, match=f"no hand-eye method 'guess'.*{', '.join(METHODS)}"):
        solve_hand_eye_equation(_seen(hands), hands, "guess")
