import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lenscal.calibration.swapped import (
    NOT_EXCHANGED,
    exchanged_with,
    numbering_in_list,
    numbering_in_place,
    seen_from_behind,
)
from lenscal.camera import Camera
from lenscal.pose import Pose
from lenscal.sensor import Sensor
from lenscal.target import Chessboard

SENSOR = Sensor(2448, 2048, 0.00345, 0.00345)
CAMERA = Camera(SENSOR, 130.0, 2e-4)
BOARD = Chessboard(8, 6, 2.5)
POSE = Pose.from_rotation_vector((0.3, -0.2, 0.4), (0.3, -0.2, 650.0))
LIMIT_PX = 0.5


def _seen(points_mm, pose=POSE):
    return CAMERA.project(pose.transform(points_mm))


@pytest.fixture
def predicted():
    return _seen(BOARD.points_mm)


def _noisy(pixels, seed=0):
    return pixels + 0.1 * np.random.default_rng(seed).standard_normal(pixels.shape)


@given(st.permutations(range(9)), st.permutations(range(BOARD.columns * BOARD.rows)))
def test_whatever_the_exchange_it_is_found(order, corners):
    """Any permutation of some corners: each ring of it is found, and who stayed is not named."""
    predicted = _seen(BOARD.points_mm)
    some, order = np.array(corners[: len(order)]), np.array(order)
    observed = _noisy(predicted)
    observed[some] = observed[some[order]]
    rejected = np.zeros(len(predicted), dtype=bool)
    rejected[some] = True
    expected = np.full(len(predicted), NOT_EXCHANGED)
    moved = order != np.arange(len(order))
    expected[some[moved]] = some[order[moved]]
    np.testing.assert_array_equal(exchanged_with(predicted, observed, rejected, LIMIT_PX), expected)


def test_a_corner_seen_where_a_good_one_is_was_not_exchanged(predicted):
    observed = _noisy(predicted)
    observed[5] = predicted[6]
    rejected = np.arange(len(predicted)) == 5
    assert (exchanged_with(predicted, observed, rejected, LIMIT_PX) == NOT_EXCHANGED).all()
    rejected[20] = True
    observed[20] += 40.0
    assert (exchanged_with(predicted, observed, rejected, LIMIT_PX) == NOT_EXCHANGED).all()


def test_a_row_that_slid_by_one_is_no_exchange(predicted):
    """Its last corner has left the row, so that the others do not come back to a beginning."""
    observed = _noisy(predicted)
    observed[:7] = observed[1:8].copy()
    observed[7] = 2 * predicted[7] - predicted[6]
    rejected = np.arange(len(predicted)) < 8
    assert (exchanged_with(predicted, observed, rejected, LIMIT_PX) == NOT_EXCHANGED).all()


def test_two_corners_in_one_place_are_no_exchange(predicted):
    observed = _noisy(predicted)
    observed[[3, 4, 5]] = predicted[[4, 3, 3]]
    rejected = np.isin(np.arange(len(predicted)), (3, 4, 5))
    assert (exchanged_with(predicted, observed, rejected, LIMIT_PX) == NOT_EXCHANGED).all()


def test_corners_too_close_to_be_told_apart_are_not_named(predicted):
    observed = _noisy(predicted)
    observed[[3, 4]] = predicted[[4, 3]]
    rejected = np.isin(np.arange(len(predicted)), (3, 4))
    spacing = np.linalg.norm(predicted[3] - predicted[4])
    assert (exchanged_with(predicted, observed, rejected, 1.1 * spacing) == NOT_EXCHANGED).all()


def test_without_a_prediction_nothing_is_said(predicted):
    nowhere = np.full_like(predicted, np.nan)
    everything = np.ones(len(predicted), dtype=bool)
    assert (exchanged_with(nowhere, predicted, everything, LIMIT_PX) == NOT_EXCHANGED).all()
    assert numbering_in_place(BOARD.points_mm, nowhere, predicted, LIMIT_PX) is None


@pytest.mark.parametrize(
    ("flip", "words"),
    [
        ((-1, -1, 1), "its corners look numbered from the other end"),
        ((-1, 1, 1), "its columns look numbered from the other end"),
        ((1, -1, 1), "its rows look numbered from the other end"),
        ((1, 1, 1), None),
    ],
)
def test_a_turned_board_is_told_where_its_pose_is_known(predicted, flip, words):
    observed = _noisy(_seen(BOARD.points_mm * flip))
    # A view loses a corner or two to other faults.
    observed[3] += 60.0
    points = BOARD.points_mm
    assert numbering_in_place(points, predicted, observed, LIMIT_PX) == words
    # Two thirds of the board are enough, four corners of a side are not.
    part = slice(0, 32)
    assert numbering_in_place(points[part], predicted[part], observed[part], LIMIT_PX) in (
        words,
        None,
    )
    assert numbering_in_place(points[:5], predicted[:5], observed[:5], LIMIT_PX) is None


def test_most_of_a_board_is_enough(predicted):
    observed = _noisy(_seen(-BOARD.points_mm))
    middle = slice(4, -8)
    assert numbering_in_place(
        BOARD.points_mm[middle], predicted[middle], observed[middle], LIMIT_PX
    ) == ("its corners look numbered from the other end")


def test_a_board_that_merely_moved_is_not_turned(predicted):
    shifted = np.roll(predicted.reshape(6, 8, 2), 1, axis=0).reshape(-1, 2)
    assert numbering_in_place(BOARD.points_mm, predicted, shifted, LIMIT_PX) is None


def test_a_list_in_another_order_is_told():
    """Of a part of a board, which is not its own mirror image."""
    part = BOARD.points_mm[:-3]
    observed = _noisy(_seen(part))
    straight = CAMERA.undistort((observed - CAMERA.centre_px) * SENSOR.sample_pitch_mm)
    straight = straight / SENSOR.sample_pitch_mm + CAMERA.centre_px
    assert numbering_in_list(part, straight, LIMIT_PX) is None
    assert numbering_in_list(part, straight[::-1], LIMIT_PX) == (
        "its corners look numbered from the other end"
    )
    by_columns = np.lexsort(np.round(part[:, 1::-1].T, 6))
    words = "its corners look numbered by columns where rows are meant, or the other way round"
    assert numbering_in_list(part, straight[by_columns], LIMIT_PX) == words
    assert numbering_in_list(part[by_columns], straight, LIMIT_PX) == words
    shuffled = np.random.default_rng(0).permutation(straight)
    assert numbering_in_list(part, shuffled, LIMIT_PX) is None


@pytest.mark.parametrize(
    ("points", "pixels"),
    [
        (BOARD.points_mm[:4], np.eye(4, 2)),
        (BOARD.points_mm[:8], np.eye(8, 2)),
        (BOARD.points_mm[:20], np.zeros((20, 2))),
    ],
)
def test_too_little_says_nothing_about_a_list(points, pixels):
    assert numbering_in_list(points, pixels, LIMIT_PX) is None


def test_a_mirrored_board_is_seen_from_behind():
    assert not seen_from_behind(POSE)
    mirrored = POSE @ Pose.from_rotation_vector((0.0, np.pi, 0.0))
    assert seen_from_behind(mirrored)
    # Its points, reversed in x, are seen in the same places.
    np.testing.assert_allclose(
        _seen(BOARD.points_mm * (-1, 1, 1), mirrored), _seen(BOARD.points_mm), atol=1e-9
    )
