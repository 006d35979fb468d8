"""Pixels and corners against brute force: 16 × 16 exact rays per pixel, and a disk drawn finely.

OpenCV's detectors have a bias of their own. They are therefore run on our picture and on the
brute-force one, and must agree with the projection and with each other.
"""

import cv2
import numpy as np
import pytest

from lenscal.camera import Camera
from lenscal.imaging.blur import BlurFloor
from lenscal.imaging.detector import Detector
from lenscal.imaging.formation import render
from lenscal.imaging.plane_mapping import points_on_plane
from lenscal.imaging.texture import TargetSurface
from lenscal.optics import blur_diameter_mm
from lenscal.pose import Pose
from lenscal.sensor import Sensor, Window
from lenscal.target import Chessboard, Disk

SENSOR = Sensor(512, 480, 0.023, 0.01375, scale_factor=0.70642)
CAMERA = Camera(SENSOR, 131.0, -2e-4, [258.0, 236.0])
BOARD = Chessboard(9, 6, 3.0)
SHARP_MM, PUPIL_MM, PINHOLE_MM = 660.0, 40.0, 1e-6
NO_FLOOR = BlurFloor(0.0, 0.0)
FINE = 16
#: Depth at which the blur is 3.2 px.
BLURRED_MM = 664.0


def pose(tilt_deg=0.0, roll=0.0, depth_mm=SHARP_MM):
    tilt = np.radians(tilt_deg)
    return Pose.from_rotation_vector([0.8 * tilt, 0.6 * tilt, roll], [0.31, 0.57, depth_mm])


def drawn(camera_from_target, pupil_mm, window):
    return render(
        CAMERA,
        camera_from_target,
        TargetSurface(BOARD, ink=0.0),
        object_distance_mm=SHARP_MM,
        entrance_pupil_diameter_mm=pupil_mm,
        window=window,
        floor=NO_FLOOR,
    )


def board_reflectance(position_mm):
    """The chessboard as a formula, without any texture."""
    x, y = np.moveaxis(position_mm, -1, 0)
    column, row = np.floor(x / 3 + 5), np.floor(y / 3 + 3.5)
    on_board = (column >= 0) & (column <= 9) & (row >= 0) & (row <= 6)
    printed = np.where(on_board & ((column + row) % 2 == 0), 0.0, 1.0)
    on_sheet = (np.abs(x) <= 18) & (np.abs(y) <= 13.5)
    return np.where(on_sheet, printed, 0.3).astype(np.float32)


def rays(camera_from_target, window, n, per_cell):
    """Means of exact rays, n per pixel along each axis, over cells of per_cell of them."""
    fine_sensor = Sensor(
        SENSOR.width_px * n,
        SENSOR.height_px * n,
        SENSOR.pitch_x_mm / n,
        SENSOR.pitch_y_mm / n,
        SENSOR.scale_factor,
    )
    centre = (CAMERA.centre_px + 0.5) * n - 0.5
    camera = Camera(fine_sensor, CAMERA.image_distance_mm, CAMERA.k1_per_mm2, centre)
    bands = []
    for row in range(window.height):
        fine = Window(window.left * n, (window.top + row) * n, window.width * n, n)
        samples = board_reflectance(points_on_plane(camera, camera_from_target, fine).position_mm)
        cells = samples.reshape(n // per_cell, per_cell, -1, per_cell)
        bands.append(cells.mean(axis=(1, 3)))
    return np.concatenate(bands)


def brute_force(camera_from_target, window, blur_mm=0.0, n=FINE):
    """Sharp pixels as means of n × n rays, or blurred by a disk on a grid of quarter pixels."""
    if not blur_mm:
        return rays(camera_from_target, window, n, n)
    fine_pitch = SENSOR.sample_pitch_mm / 4
    reach = np.ceil(blur_mm / 2 / fine_pitch).astype(int) + 1
    y, x = ((np.arange(-8 * r, 8 * (r + 1)) + 0.5) / 8 - 0.5 for r in (reach[1], reach[0]))
    inside = (x * fine_pitch[0]) ** 2 + ((y * fine_pitch[1]) ** 2)[:, None] <= blur_mm**2 / 4
    kernel = inside.reshape(len(y) // 8, 8, len(x) // 8, 8).mean(axis=(1, 3)).astype(np.float32)
    fine = cv2.filter2D(rays(camera_from_target, window, n, n // 4), -1, kernel / kernel.sum())
    return cv2.resize(fine, (window.width, window.height), interpolation=cv2.INTER_AREA)


def blur_mm(depth_mm):
    return float(blur_diameter_mm(depth_mm, SHARP_MM, CAMERA.image_distance_mm, PUPIL_MM))


@pytest.mark.parametrize(
    ("tilt_deg", "roll"), [(0, 0), (0, 0.03), (25, 0.03), (25, 0.5), (35, 1.5)]
)
def test_sharp_pixels_are_means_over_the_pixel(tilt_deg, roll):
    window = Window(140, 110, 160, 140)
    camera_from_target = pose(tilt_deg, roll)
    error = drawn(camera_from_target, PINHOLE_MM, window) - brute_force(camera_from_target, window)
    assert np.sqrt(np.mean(error**2)) < 0.005
    assert abs(error.mean()) < 2e-4


def test_along_the_rows_most_of_the_error_is_that_of_brute_force():
    """Rays step over an edge by whole sixteenths of a pixel; 48 × 48 show what we err ourselves."""
    window = Window(180, 150, 70, 60)
    ours = drawn(pose(), PINHOLE_MM, window)
    coarse, fine = (
        np.sqrt(np.mean((ours - brute_force(pose(), window, n=n)) ** 2)) for n in (16, 48)
    )
    assert fine < min(coarse, 0.003)


@pytest.mark.parametrize("roll", [0.0, 0.1])
def test_blurred_pixels_are_means_over_the_disk(roll):
    window, camera_from_target = Window(160, 120, 120, 100), pose(0.0, roll, BLURRED_MM)
    expected = brute_force(camera_from_target, window, blur_mm(BLURRED_MM))
    error = (drawn(camera_from_target, PUPIL_MM, window) - expected)[8:-8, 8:-8]
    assert np.sqrt(np.mean(error**2)) < 0.005


WHOLE_BOARD = Window(60, 60, 400, 360)


def deviation_px(corners, expected):
    """Root of the mean squared distance; the board may be found the other way round."""
    corners = corners.reshape(-1, 2) + np.array([WHOLE_BOARD.left, WHOLE_BOARD.top])
    if np.linalg.norm(corners[0] - expected[0]) > np.linalg.norm(corners[-1] - expected[0]):
        corners = corners[::-1]
    return np.sqrt(np.mean(np.sum((corners - expected) ** 2, axis=-1)))


def as_8_bit(irradiance):
    return np.clip(np.rint(250 * irradiance), 0, 255).astype(np.uint8)


def found_by_sectors(irradiance, expected):
    flags = cv2.CALIB_CB_ACCURACY
    found, corners = cv2.findChessboardCornersSB(as_8_bit(irradiance), (9, 6), flags=flags)
    assert found
    return deviation_px(corners, expected)


def found_by_gradients(irradiance, expected):
    start = (expected - np.array([WHOLE_BOARD.left, WHOLE_BOARD.top])).astype(np.float32)[:, None]
    corners = cv2.cornerSubPix(as_8_bit(irradiance), start.copy(), (9, 9), (-1, -1), (3, 60, 1e-5))
    return deviation_px(corners, expected)


@pytest.mark.parametrize("depth_mm", [SHARP_MM, BLURRED_MM, 666.0])
@pytest.mark.parametrize("roll", [0.0, 0.02, 0.05, 0.1, 0.2])
def test_corners_found_by_sectors_are_where_the_camera_projects_them(depth_mm, roll):
    camera_from_target = pose(0.0, roll, depth_mm)
    expected = CAMERA.project(camera_from_target.transform(BOARD.points_mm))
    assert found_by_sectors(drawn(camera_from_target, PUPIL_MM, WHOLE_BOARD), expected) < 0.025


@pytest.mark.parametrize("roll", [0.0, 0.02, 0.05, 0.1, 0.15, 0.2])
def test_corners_found_by_gradients_are_where_the_camera_projects_them(roll):
    camera_from_target = pose(0.0, roll, BLURRED_MM)
    expected = CAMERA.project(camera_from_target.transform(BOARD.points_mm))
    assert found_by_gradients(drawn(camera_from_target, PUPIL_MM, WHOLE_BOARD), expected) < 0.025


@pytest.mark.parametrize(
    ("tilt_deg", "roll", "depth_mm"), [(25, 0.1, SHARP_MM), (0, 0.1, BLURRED_MM)]
)
def test_detectors_find_the_same_in_ours_as_in_brute_force(tilt_deg, roll, depth_mm):
    camera_from_target = pose(tilt_deg, roll, depth_mm)
    expected = CAMERA.project(camera_from_target.transform(BOARD.points_mm))
    pupil_mm = PINHOLE_MM if depth_mm == SHARP_MM else PUPIL_MM
    ours = drawn(camera_from_target, pupil_mm, WHOLE_BOARD)
    reference = brute_force(camera_from_target, WHOLE_BOARD, blur_mm(depth_mm))
    for find in (found_by_sectors, found_by_gradients):
        assert find(ours, expected) == pytest.approx(find(reference, expected), abs=0.005)


def test_photon_transfer_of_rendered_flats_gives_gain_and_read_noise_back():
    """White paper fills the frame; variance over signal is a line: 1/gain, from the read noise."""
    detector = Detector(20_000.0, 12.0, 64.0, 12, 64e6)
    flat = render(
        CAMERA,
        Pose(np.eye(3), np.array([0.0, 40.0, SHARP_MM])),
        TargetSurface(Disk(60.0)),
        object_distance_mm=SHARP_MM,
        entrance_pupil_diameter_mm=PUPIL_MM,
        window=Window(150, 100, 200, 200),
        falloff=(-2e-3, 0.0),
    )
    rng, means, variances = np.random.default_rng(5), [], []
    for exposure_s in np.geomspace(2e-6, 6e-4, 24):
        electrons = detector.electrons(flat, exposure_s, 3.0)
        first, second = (detector.read(electrons, rng).astype(np.float64) for _ in range(2))
        means.append((first + second).mean() / 2 - detector.black_level_dn)
        variances.append((first - second).var() / 2)
    slope, start = np.polyfit(means, variances, 1, w=1 / np.array(variances))
    assert 1 / slope == pytest.approx(detector.electrons_per_dn, rel=0.03)
    # Rounding to whole grey values adds a twelfth.
    read_noise_e = np.sqrt(start - 1 / 12) * detector.electrons_per_dn
    assert read_noise_e == pytest.approx(detector.read_noise_e, rel=0.03)
