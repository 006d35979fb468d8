import cv2
import numpy as np
import pytest

from lenscal.detection import detect, load_images
from lenscal.errors import DetectionError, FileError, InputError
from lenscal.plate import Plate
from lenscal.target import Charuco, Chessboard, CircleGrid, Disk

SIZE = (640, 480)
TEXELS_PER_MM = 8
PLATE = Plate(
    (
        (Charuco(6, 5, 6, 4.5), (-25.0, 0.0)),
        (Charuco(6, 5, 6, 4.5, first_id=15), (25.0, 0.0)),
        (Disk(6), (0.0, 30.0)),
    )
)


def _view(scale_px_per_mm, tilt_deg=0.0, roll_deg=0.0, centre=(320, 240)):
    """Homography of a pinhole of 1500 px: (x, y) in mm to pixels."""
    tilt, _ = cv2.Rodrigues(np.radians([tilt_deg, tilt_deg / 2, 0.0]))
    roll, _ = cv2.Rodrigues(np.radians([0.0, 0.0, roll_deg]))
    rotation = tilt @ roll
    matrix = np.array([[1500.0, 0, centre[0]], [0, 1500.0, centre[1]], [0, 0, 1]])
    distance = 1500.0 / scale_px_per_mm
    return matrix @ np.column_stack([rotation[:, :2], [0, 0, distance]])


def _render(target, view, oversampling=4):
    art = target.artwork(TEXELS_PER_MM)
    rows, columns = art.shape
    from_texels = np.diag([1 / TEXELS_PER_MM, 1 / TEXELS_PER_MM, 1.0])
    from_texels[:2, 2] = (0.5 - columns / 2) / TEXELS_PER_MM, (0.5 - rows / 2) / TEXELS_PER_MM
    to_fine = np.diag([oversampling, oversampling, 1.0])
    to_fine[:2, 2] = (oversampling - 1) / 2
    fine = cv2.warpPerspective(
        art,
        to_fine @ view @ from_texels,
        (SIZE[0] * oversampling, SIZE[1] * oversampling),
        flags=cv2.INTER_AREA,
        borderValue=255,
    )
    return cv2.GaussianBlur(cv2.resize(fine, SIZE, interpolation=cv2.INTER_AREA), (0, 0), 0.8)


def _error_px(observation, view):
    plane = np.column_stack([observation.points_mm[:, :2], np.ones(len(observation))])
    exact = plane @ view.T
    return np.linalg.norm(exact[:, :2] / exact[:, 2:] - observation.pixels, axis=1)


@pytest.mark.parametrize(("tilt", "roll"), [(0, 0), (15, 10), (10, 80)])
@pytest.mark.parametrize(
    ("target", "scale", "tolerance_px"),
    [
        (Chessboard(9, 6, 6), 6, 0.05),
        (Chessboard(7, 7, 6), 6, 0.05),
        (Charuco(11, 8, 6, 4.5), 6, 0.1),
        (CircleGrid(7, 5, 8, 4), 7, 0.1),
        (CircleGrid(4, 11, 10, 4, staggered=True), 6, 0.1),
    ],
)
def test_all_points_are_found_where_they_are(target, scale, tolerance_px, tilt, roll):
    if roll == 80 and not isinstance(target, Charuco):
        roll = 40
    view = _view(scale, tilt, roll)
    observation = detect(_render(target, view), target)
    assert len(observation) == len(target.points_mm)
    np.testing.assert_array_equal(np.sort(observation.ids), target.ids())
    assert _error_px(observation, view).max() < tolerance_px


def test_a_chessboard_upside_down_is_told_by_its_colours():
    target, view = Chessboard(9, 6, 6), _view(6, 10, 175)
    assert _error_px(detect(_render(target, view), target), view).max() < 0.05


def test_an_ambiguous_chessboard_runs_to_the_right():
    """Nine and seven inner corners look the same upside down: the frame is turned, no more."""
    target = Chessboard(9, 7, 6)
    observation = detect(_render(target, _view(6, 0, 180)), target)
    assert observation.pixels[8, 0] > observation.pixels[0, 0]
    assert _error_px(observation, _view(6)).max() < 0.05


def test_a_part_of_a_charuco_board_is_enough():
    target, view = Charuco(11, 8, 6, 4.5), _view(8, 12, centre=(60, 300))
    observation = detect(_render(target, view), target)
    assert 10 < len(observation) < len(target.points_mm)
    assert _error_px(observation, view).max() < 0.1


def test_boards_of_a_plate_are_told_apart_and_its_disk_left_out():
    view = _view(5, 10)
    observation = detect(_render(PLATE, view), PLATE)
    np.testing.assert_array_equal(observation.ids, np.arange(40))
    assert _error_px(observation, view).max() < 0.15


def test_what_is_seen_of_a_plate_counts():
    """Only the second board is in the picture; its ids go on after those of the first."""
    view = _view(9, 0, centre=(80, 240))
    observation = detect(_render(PLATE, view), PLATE)
    assert set(observation.ids) <= set(range(20, 40))
    assert len(observation) >= 15
    assert _error_px(observation, view).max() < 0.15


@pytest.mark.parametrize(
    "target", [Chessboard(9, 6, 6), Charuco(11, 8, 6, 4.5), CircleGrid(7, 5, 8, 4), PLATE]
)
def test_nothing_there_is_said(target):
    with pytest.raises(DetectionError, match="was not found; see that all of it"):
        detect(np.full((480, 640), 128, np.uint8), target)


def test_markers_of_another_board_are_not_taken():
    image = _render(Charuco(6, 5, 6, 4.5, first_id=100), _view(8))
    with pytest.raises(DetectionError, match="was not found"):
        detect(image, Charuco(6, 5, 6, 4.5))


def test_unsuitable_input_is_refused():
    with pytest.raises(InputError, match="grey values of 8 bits, but this one is float64 of shape"):
        detect(np.zeros((4, 4)), Chessboard(9, 6, 6))
    with pytest.raises(InputError, match="disk:6mm has no points to calibrate with; use a chess"):
        detect(np.zeros((4, 4), np.uint8), Disk(6))


def _write(path, size=(8, 6)):
    cv2.imwrite(str(path), np.zeros(size[::-1], np.uint8))


def test_images_are_read_in_order(tmp_path):
    for name in ("b.png", "a.png"):
        _write(tmp_path / name)
    assert [name for name, _ in load_images(str(tmp_path / "*.png"))] == ["a.png", "b.png"]


def test_no_match_says_what_is_there(tmp_path):
    _write(tmp_path / "right01.png")
    with pytest.raises(FileError, match=r"no images match .*left\*.png.*has right01.png"):
        load_images(str(tmp_path / "left*.png"))
    with pytest.raises(FileError, match="no images match .*there is no folder"):
        load_images(str(tmp_path / "nowhere" / "*.png"))
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileError, match="has no files"):
        load_images(str(tmp_path / "empty" / "*.png"))


def test_files_that_are_no_images_are_refused(tmp_path):
    (tmp_path / "a.png").write_text("no image")
    with pytest.raises(FileError, match=r"a.png is no image that OpenCV can read; use PNG"):
        load_images(str(tmp_path / "*.png"))
    (tmp_path / "a.png").write_bytes(b"")
    with pytest.raises(FileError, match=r"a.png is no image"):
        load_images(str(tmp_path / "*.png"))


def test_images_of_different_sizes_are_refused(tmp_path):
    for name in ("a.png", "b.png"):
        _write(tmp_path / name)
    _write(tmp_path / "odd.png", (9, 9))
    with pytest.raises(InputError, match="most are 8 × 6 px, but not odd.png; calibrate pictures"):
        load_images(str(tmp_path / "*.png"))


def test_real_photographs(reference_data):
    """OpenCV's 13 photographs: the board is found in all of them."""
    images = load_images(f"{reference_data}/opencv-chessboard/left*.jpg")
    assert len(images) == 13
    assert all(len(detect(image, Chessboard(9, 6, 25))) == 54 for _, image in images)
