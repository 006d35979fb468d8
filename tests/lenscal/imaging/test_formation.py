import cv2
import numpy as np
import pytest

from lenscal.camera import Camera
from lenscal.errors import InputError
from lenscal.imaging.blur import BlurFloor
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
SHARP_MM = 660.0
NO_FLOOR = BlurFloor(0.0, 0.0)


def pose(tilt_deg=0.0, roll=0.0, depth_mm=SHARP_MM):
    tilt = np.radians(tilt_deg)
    return Pose.from_rotation_vector([0.8 * tilt, 0.6 * tilt, roll], [0.31, 0.57, depth_mm])


def image(camera_from_target, surface, pupil_mm=40.0, **options):
    return render(
        CAMERA,
        camera_from_target,
        surface,
        object_distance_mm=SHARP_MM,
        entrance_pupil_diameter_mm=pupil_mm,
        **options,
    )


def as_8_bit(irradiance):
    return np.clip(np.rint(250 * irradiance), 0, 255).astype(np.uint8)


def board_reflectance(position_mm, surroundings):
    """The chessboard as a formula, without any texture."""
    x, y = np.moveaxis(position_mm, -1, 0)
    column, row = np.floor(x / 3 + 5), np.floor(y / 3 + 3.5)
    on_board = (column >= 0) & (column <= 9) & (row >= 0) & (row <= 6)
    printed = np.where(on_board & ((column + row) % 2 == 0), 0.0, 1.0)
    return np.where((np.abs(x) <= 18) & (np.abs(y) <= 13.5), printed, surroundings)


def supersampled(camera_from_target, window, n=16):
    """Mean of n × n exact rays per pixel: the pixels of a sensor n times as fine."""
    fine_sensor = Sensor(
        SENSOR.width_px * n,
        SENSOR.height_px * n,
        SENSOR.pitch_x_mm / n,
        SENSOR.pitch_y_mm / n,
        SENSOR.scale_factor,
    )
    centre = (CAMERA.centre_px + 0.5) * n - 0.5
    fine_camera = Camera(fine_sensor, CAMERA.image_distance_mm, CAMERA.k1_per_mm2, centre)
    fine = Window(window.left * n, window.top * n, window.width * n, window.height * n)
    position = points_on_plane(fine_camera, camera_from_target, fine).position_mm
    samples = board_reflectance(position, 0.3)
    return samples.reshape(window.height, n, window.width, n).mean(axis=(1, 3))


@pytest.mark.parametrize(
    ("tilt_deg", "roll", "most"),
    [(0, 0, 0.0065), (0, 0.03, 0.005), (25, 0.03, 0.005), (25, 0.5, 0.005), (35, 1.5, 0.005)],
)
def test_sharp_pixels_are_means_over_the_pixel(tilt_deg, roll, most):
    window = Window(140, 110, 160, 140)
    camera_from_target = pose(tilt_deg, roll)
    surface = TargetSurface(BOARD, ink=0.0)
    drawn = image(camera_from_target, surface, 1e-6, window=window, floor=NO_FLOOR)
    error = drawn - supersampled(camera_from_target, window)
    assert np.sqrt(np.mean(error**2)) < most
    assert abs(error.mean()) < 2e-4


@pytest.mark.parametrize("depth_mm", [660.0, 666.0])
@pytest.mark.parametrize(("tilt_deg", "roll"), [(0, 0), (0, 0.1), (25, 0.1)])
def test_corners_are_where_the_camera_projects_them(depth_mm, tilt_deg, roll):
    """Sharp and blurred by 5 px; half a pixel, a sample or a texel of shift would show."""
    camera_from_target = pose(tilt_deg, roll, depth_mm)
    picture = as_8_bit(image(camera_from_target, TargetSurface(BOARD)))
    found, corners = cv2.findChessboardCornersSB(picture, (9, 6), flags=cv2.CALIB_CB_ACCURACY)
    assert found
    expected = CAMERA.project(camera_from_target.transform(BOARD.points_mm))
    corners = corners.reshape(-1, 2)
    if np.linalg.norm(corners[0] - expected[0]) > np.linalg.norm(corners[-1] - expected[0]):
        corners = corners[::-1]
    error = corners - expected
    assert np.sqrt(np.mean(np.sum(error**2, axis=-1))) < 0.03


@pytest.mark.parametrize("roll", [0.05, 0.1, 0.2])
def test_refined_corners_of_a_blurred_board_are_where_the_camera_projects_them(roll):
    camera_from_target = pose(0.0, roll, 664.0)
    picture = as_8_bit(image(camera_from_target, TargetSurface(BOARD)))
    expected = CAMERA.project(camera_from_target.transform(BOARD.points_mm))
    start = expected.astype(np.float32)[:, None].copy()
    corners = cv2.cornerSubPix(picture, start, (9, 9), (-1, -1), (3, 60, 1e-5)).reshape(-1, 2)
    error = corners - expected
    assert np.sqrt(np.mean(np.sum(error**2, axis=-1))) < 0.03
    assert np.abs(error.mean(axis=0)).max() < 0.01


@pytest.mark.parametrize("depth_mm", [661.5, 664.0, 668.0, 640.0])
def test_a_point_is_blurred_by_the_circle_of_confusion(depth_mm):
    """Second moments of a dot grow by diameter²/16 along both axes, on the sensor in mm."""
    surface = TargetSurface(Disk(1.5), ink=0.0, surroundings=1.0)
    grown_mm2 = moments_mm2(image(pose(depth_mm=depth_mm), surface, floor=NO_FLOOR)) - moments_mm2(
        image(pose(depth_mm=depth_mm), surface, 1e-6, floor=NO_FLOOR)
    )
    expected = blur_diameter_mm(depth_mm, SHARP_MM, CAMERA.image_distance_mm, 40.0)
    np.testing.assert_allclose(4 * np.sqrt(grown_mm2), expected, rtol=0.01)


def moments_mm2(picture):
    dark = 1.0 - picture.astype(np.float64)
    dark[np.abs(dark) < 1e-5] = 0.0  # rounding of white, far away, would weigh heavily
    moments = []
    for axis, pitch in enumerate(SENSOR.sample_pitch_mm):
        profile = dark.sum(axis=axis) / dark.sum()
        place = np.arange(len(profile)) * pitch
        moments.append(profile @ place**2 - (profile @ place) ** 2)
    return np.array(moments)


def test_the_width_of_a_blurred_edge_is_the_circle_of_confusion():
    """The line spread of a uniform disk has the variance diameter²/16; pixels add pitch²/12."""
    camera = Camera(SENSOR, 131.0)
    window = Window(200, 230, 112, 8)
    edge = render(
        camera,
        Pose(np.eye(3), np.array([3.0, 5.0, 668.0])),
        TargetSurface(Chessboard(3, 3, 10.0), ink=0.0),
        object_distance_mm=SHARP_MM,
        entrance_pupil_diameter_mm=40.0,
        window=window,
        floor=NO_FLOOR,
    ).mean(axis=0)
    spread = np.diff(edge.astype(np.float64))
    place = np.arange(len(spread)) * SENSOR.sample_pitch_x_mm
    variance = spread @ place**2 / spread.sum() - (spread @ place / spread.sum()) ** 2
    measured = 4 * np.sqrt(variance - SENSOR.sample_pitch_x_mm**2 / 6)
    assert measured == pytest.approx(
        float(blur_diameter_mm(668.0, SHARP_MM, 131.0, 40.0)), rel=0.03
    )


def test_blur_grows_with_depth_over_a_tilted_board():
    tilted = pose(30.0)
    picture = image(tilted, TargetSurface(BOARD))
    row, column = np.gradient(picture)
    steepness = np.hypot(row, column)
    middle, aside = steepness[216:256, 230:290].max(), steepness[100:140, 350:400].max()
    assert middle > 2 * aside


def test_blur_conserves_light():
    surface = TargetSurface(Disk(3.0), ink=0.0, surroundings=1.0)
    camera_from_target = pose(20.0, 0.3, 668.0)
    sharp = image(camera_from_target, surface, 1e-6, floor=NO_FLOOR)
    blurred = image(camera_from_target, surface)
    assert (1 - blurred).sum() == pytest.approx((1 - sharp).sum(), rel=1e-3)


@pytest.mark.parametrize("depth_mm", [660.0, 690.0])
def test_a_window_shows_the_same_pixels_as_the_whole_image(depth_mm):
    camera_from_target = pose(25.0, 0.2, depth_mm)
    surface = TargetSurface(BOARD)
    window = Window(301, 17, 130, 75)
    whole = image(camera_from_target, surface)
    part = image(camera_from_target, surface, window=window)
    np.testing.assert_allclose(part, whole[17 : 17 + 75, 301 : 301 + 130], atol=1e-5)


@pytest.mark.parametrize(
    "camera_from_target",
    [
        pytest.param(pose(depth_mm=-300.0), id="behind"),
        pytest.param(Pose(np.eye(3), np.array([500.0, 0.0, 660.0])), id="out of view"),
        pytest.param(
            Pose.from_rotation_vector([np.pi, 0, 0], [0.0, 0.0, 660.0]), id="back to the camera"
        ),
        pytest.param(Pose.from_rotation_vector([np.pi / 2, 0, 0], [0.0, 0.0, 660.0]), id="edge-on"),
    ],
)
def test_a_target_that_shows_nothing_leaves_its_surroundings(camera_from_target):
    picture = image(camera_from_target, TargetSurface(BOARD, surroundings=0.25))
    np.testing.assert_allclose(picture, 0.25, atol=1e-6)


@pytest.mark.parametrize(
    "window", [Window(-1, 0, 10, 10), Window(0, 0, 513, 10), Window(10, 10, 0, 5)]
)
def test_a_window_outside_the_frame_is_refused(window):
    with pytest.raises(InputError, match="does not lie in the frame of 512 × 480 px"):
        image(pose(), TargetSurface(BOARD), window=window)


def test_a_pupil_without_size_is_refused():
    with pytest.raises(InputError, match="entrance_pupil_diameter_mm must be a positive number"):
        image(pose(), TargetSurface(BOARD), 0.0)
