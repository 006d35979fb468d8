"""Which part of a plate suits a magnification."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lenscal.errors import DetectionError
from lenscal.plate import parse_target
from lenscal.pose import Pose
from lenscal.rig.simulated import SimulatedRig
from lenscal.rig.simulated.presets import PRESETS
from lenscal.sensor import Sensor
from lenscal.session.aim import hand_pose
from lenscal.session.exposure import expose
from lenscal.session.plate_parts import (
    board_to_look_at,
    boards_of,
    detect_boards,
    disk_to_focus_on,
    disks_of,
    offers_choice,
)
from lenscal.setting import LensSetting

PLATE = parse_target(PRESETS["machine-vision"].target)
SENSOR = Sensor(2448, 2048, 0.00345, 0.00345)


def magnification_for(square_mm, square_px):
    return square_px * 0.00345 / square_mm


def test_the_parts_are_told_apart():
    assert [disk.number for disk in disks_of(PLATE)] == [1, 3, 5]
    assert [disk.diameter_mm for disk in disks_of(PLATE)] == [80, 20, 6]
    assert [board.number for board in boards_of(PLATE)] == [0, 2, 4]
    assert boards_of(PLATE)[1].centre_mm == (270, -165)


@pytest.mark.parametrize(
    ("target", "several"),
    [
        (PRESETS["machine-vision"].target, True),
        (PRESETS["vicon-1990"].target, False),
        ("disk:6mm@0,0+disk:20mm@100,0", True),
        ("chessboard:4x3:5mm", False),
    ],
)
def test_a_choice_takes_two(target, several):
    assert offers_choice(parse_target(target)) is several


@given(st.floats(0.005, 0.2))
def test_some_disk_is_100_to_400_px_wide_or_none_is_better(magnification):
    disk = disk_to_focus_on(PLATE, SENSOR, magnification)
    off = [abs(np.log(d.diameter_px(magnification, SENSOR) / 200)) for d in disks_of(PLATE)]
    assert off[disks_of(PLATE).index(disk)] == min(off)
    assert 90 < disk.diameter_px(magnification, SENSOR) < 480


@given(st.floats(0.005, 0.2), st.floats(1.0, 1.5))
def test_a_larger_magnification_never_wants_a_larger_part(magnification, factor):
    for choose in (disk_to_focus_on, board_to_look_at):
        now = choose(PLATE, SENSOR, magnification).number
        assert choose(PLATE, SENSOR, magnification * factor).number >= now


@pytest.mark.parametrize(
    ("square_mm", "square_px", "number"),
    [
        (40, 100, 0),
        (40, 180, 0),  # all of it
        (40, 600, 2),  # three by three of its corners, against all of the next at 150 px
        (10, 130, 2),
        (3, 24, 0),
        (3, 100, 4),
    ],
)
def test_the_board_is_the_one_that_fills_the_view_with_corners(square_mm, square_px, number):
    magnification = magnification_for(square_mm, square_px)
    assert board_to_look_at(PLATE, SENSOR, magnification).number == number


@pytest.mark.parametrize(("square_px", "number"), [(26, 2), (24, 0)])
def test_corners_that_are_too_close_are_not_wanted(square_px, number):
    """Of the coarser board four corners are seen, of the finer one all."""
    plate = parse_target(
        "charuco:5x5:60mm:45mm:DICT_4X4_250:0@0,0+disk:6mm@300,60+"
        "charuco:13x10:3mm:2.25mm:DICT_4X4_250:130@300,0"
    )
    assert board_to_look_at(plate, SENSOR, magnification_for(3, square_px)).number == number


def test_a_board_of_which_no_corner_is_seen_is_not_wanted():
    plate = parse_target(
        "charuco:5x5:200mm:150mm:DICT_4X4_250:0@0,0+disk:6mm@700,60+"
        "charuco:13x10:3mm:2.25mm:DICT_4X4_250:130@700,0"
    )
    assert board_to_look_at(plate, SENSOR, magnification_for(3, 24)).number == 2


def test_where_all_corners_are_too_close_the_coarsest_board_is_looked_at():
    assert board_to_look_at(PLATE, SENSOR, magnification_for(40, 12)).number == 0


def test_a_chessboard_must_be_seen_whole():
    plate = parse_target("chessboard:9x6:20mm@0,0+chessboard:9x6:5mm@300,0+disk:6mm@300,60")
    whole = magnification_for(20, 200)
    assert board_to_look_at(plate, SENSOR, whole).number == 0
    assert board_to_look_at(plate, SENSOR, 1.6 * whole).number == 1


def test_the_points_found_are_those_of_boards_that_are_coarse_enough():
    """Two boards are in the picture; told of a lesser magnification, it passes one over."""
    rig = SimulatedRig.preset("machine-vision", seed=1)
    setting = LensSetting(1600.0, 6800.0, 20.0)
    rig.lens.move_to(setting)
    truth = rig.truth(setting)
    between_mm = (270.0, -75.0)
    rig.positioner.move_to(hand_pose(rig, truth.standoff_mm, between_mm))
    expose(rig.camera)
    image = rig.camera.grab().as_8_bit()
    both = detect_boards(image, PLATE, SENSOR, truth.magnification)
    assert {2, 4} == {int(part) for part in np.digitize(both.ids, [108, 109, 217, 218, 326])}
    np.testing.assert_array_equal(both.points_mm, PLATE.points_mm[both.ids])
    coarse = detect_boards(image, PLATE, SENSOR, truth.magnification / 2)
    np.testing.assert_array_equal(coarse.ids, both.ids[both.ids < 217])
    # The ids stand for the points that were seen.
    seen = truth.camera.project(rig.true_camera_from_target().transform(both.points_mm))
    assert np.abs(both.pixels - seen).max() < 0.5
    with pytest.raises(DetectionError, match="was not found; see that all of it"):
        detect_boards(np.full_like(image, 128), PLATE, SENSOR, truth.magnification)


def test_a_lone_target_is_a_part_too():
    board = parse_target("chessboard:4x3:5mm")
    assert boards_of(board)[0].target is board
    assert disks_of(board) == []
    assert np.array_equal(Pose.identity().translation_mm[:2], boards_of(board)[0].centre_mm)
