import cv2
import numpy as np
import pytest

from lenscal.errors import InputError, UnitError
from lenscal.plate import Plate, parse_target
from lenscal.target import Charuco, Chessboard, CircleGrid, Disk, Target

SPECS = [
    "chessboard:9x6:25mm",
    "charuco:11x8:3mm:2.25mm:DICT_4X4_250:0",
    "charuco:5x4:10mm:7mm:DICT_5X5_50:20",
    "circles:7x5:4mm:2mm",
    "staggered-circles:4x11:4mm:2mm",
    "disk:6mm",
    "charuco:17x13:3mm:2.25mm:DICT_4X4_250:0@0,0+disk:6mm@0,27",
]


@pytest.mark.parametrize("spec", SPECS)
def test_a_target_and_its_words_round_trip(spec):
    target = parse_target(spec)
    assert target.spec == spec
    assert parse_target(target.spec) == target


@pytest.mark.parametrize("spec", SPECS)
def test_points_lie_centred_in_the_artwork(spec):
    target = parse_target(spec)
    points = target.points_mm
    assert points.shape == (len(target.ids()), 3)
    assert (points[:, 2] == 0).all()
    assert (np.abs(points[:, :2]) <= np.array(target.size_mm) / 2).all()
    if not isinstance(target, Plate):
        np.testing.assert_allclose(points.min(axis=0) + points.max(axis=0), 0, atol=1e-12)
    drawing = target.artwork(10)
    assert drawing.shape == tuple(round(10 * v) for v in target.size_mm[::-1])
    assert (drawing[0] == 255).all()


@pytest.mark.parametrize("target", [Chessboard(4, 3, 5.0), Charuco(5, 4, 5.0, 4.0)])
def test_corners_are_where_four_squares_meet(target: Target):
    """Around a corner black and white alternate; with markers, close enough to miss them."""
    drawing = target.artwork(10)
    origin = np.array(drawing.shape[::-1]) / 2
    for x, y in target.points_mm[:, :2] * 10 + origin:
        column, row = round(x), round(y)
        patch = drawing[row - 2 : row + 2, column - 2 : column + 2]
        assert (patch[:2, :2] == patch[2:, 2:]).all()
        assert (patch[:2, 2:] == patch[2:, :2]).all()
        assert (patch[:2, :2] != patch[:2, 2:]).all()


def test_the_top_left_square_is_black_as_opencv_draws_it():
    board = Charuco(7, 5, 6.0, 4.8)
    ours = board.artwork(10)[30:-30, 30:-30]
    theirs = board.board().generateImage((420, 300), marginSize=0, borderBits=1)
    assert (ours != theirs).mean() < 0.002


def test_opencv_finds_the_corners_of_the_drawing_under_the_same_ids():
    board = Charuco(7, 5, 6.0, 4.5, first_id=3)
    drawing = board.artwork(10)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(board.board()).detectBoard(drawing)
    # For OpenCV texel centres are whole numbers, so borders lie at halves. Its search window
    # takes in markers, which costs two tenths of a texel; ids are what this test is about.
    expected = board.points_mm[ids.ravel(), :2] * 10 + np.array(drawing.shape[::-1]) / 2 - 0.5
    assert len(ids) == len(board.points_mm)
    assert np.abs(corners.reshape(-1, 2) - expected).max() < 0.25


def test_ids_on_a_plate_count_through_its_parts():
    plate = Plate(((Chessboard(3, 3, 2.0), (0.0, 0.0)), (Disk(4.0), (0.0, 12.0))))
    assert plate.first_id(0) == 0
    assert plate.first_id(1) == 9
    np.testing.assert_allclose(plate.points_mm[9], (0, 12, 0))
    assert plate.size_mm == (12.0, 32.0)


def test_the_rim_of_a_disk_covers_its_area():
    darkness = 1 - Disk(6.0).artwork(20) / 255
    assert darkness.sum() / 400 == pytest.approx(np.pi * 9, rel=1e-3)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("chess", "cannot read the target 'chess'; write chessboard:9x6:25mm"),
        ("chessboard:9:25mm", "cannot read the target"),
        ("chessboard:2x6:25mm", "a chessboard needs at least 3 × 3, but 2 × 6 is given"),
        ("charuco:5x4:3mm:4mm", "must be smaller than its squares; given 4 mm in 3 mm"),
        ("charuco:5x4:3mm:2mm:DICT_NONE", "unknown marker dictionary 'DICT_NONE'"),
        ("charuco:50x40:3mm:2mm", "needs markers 0 to 999, but DICT_4X4_250 has 0 to 249"),
        ("circles:7x5:4mm:4mm", "dots of 4 mm touch each other at 4 mm"),
        ("disk:-3mm", "diameter_mm must be a positive number, but is -3.0 mm"),
        ("disk:6mm@1", "cannot read the place of 'disk:6mm@1' on its plate"),
        ("disk:6mm@0,0+disk:6mm@1,0", "parts 0 .* and 1 .* of the plate overlap"),
    ],
)
def test_targets_that_cannot_be(spec, message):
    with pytest.raises(InputError, match=message):
        parse_target(spec)


def test_lengths_of_targets_need_units():
    with pytest.raises(UnitError, match="the length '25' has no unit"):
        parse_target("chessboard:9x6:25")


def test_a_plate_needs_a_part():
    with pytest.raises(InputError, match="a plate needs at least one target"):
        Plate(())


def test_staggered_rows_are_shifted_by_half():
    grid = CircleGrid(2, 3, 4.0, 1.0, staggered=True).points_mm
    np.testing.assert_allclose(grid[2] - grid[0], (2.0, 2.0, 0.0))
