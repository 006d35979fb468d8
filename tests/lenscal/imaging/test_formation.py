import tracemalloc

import numpy as np
import pytest

from lenscal.camera import Camera
from lenscal.errors import InputError
from lenscal.imaging.aperture import Aperture
from lenscal.imaging.blur import BlurFloor
from lenscal.imaging.formation import render
from lenscal.imaging.texture import TargetSurface
from lenscal.optics import blur_diameter_mm
from lenscal.plate import parse_target
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


@pytest.mark.parametrize("depth_mm", [661.5, 664.0, 668.0, 640.0])
def test_a_point_is_blurred_by_the_circle_of_confusion(depth_mm):
    """Second moments of a dot grow by diameter²/16 along both axes, on the sensor in mm.

    Moments of what pixels sample depend on where the dot lies between them: by 2 % of the diameter
    where the blur is as small as a pixel, by less than 1 % where it is larger.
    """
    surface = TargetSurface(Disk(1.5), ink=0.0, surroundings=1.0)
    grown_mm2 = moments_mm2(image(pose(depth_mm=depth_mm), surface, floor=NO_FLOOR)) - moments_mm2(
        image(pose(depth_mm=depth_mm), surface, 1e-6, floor=NO_FLOOR)
    )
    expected = blur_diameter_mm(depth_mm, SHARP_MM, CAMERA.image_distance_mm, 40.0)
    tolerance = 0.03 if expected < 2 * SENSOR.sample_pitch_x_mm else 0.01
    np.testing.assert_allclose(4 * np.sqrt(grown_mm2), expected, rtol=tolerance)


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


def test_light_falls_off_by_the_radius_on_the_sensor():
    camera_from_target, surface = pose(20.0, 0.3, 664.0), TargetSurface(BOARD)
    plain = image(camera_from_target, surface)
    dimmed = image(camera_from_target, surface, falloff=(-0.02, -1e-4))
    rows, columns = np.indices(plain.shape)
    away_mm = (np.stack([columns, rows], -1) - CAMERA.centre_px) * SENSOR.sample_pitch_mm
    squared = (away_mm**2).sum(axis=-1)
    np.testing.assert_allclose(dimmed, plain * (1 - 0.02 * squared - 1e-4 * squared**2), rtol=1e-5)


def test_light_never_falls_below_none():
    assert image(pose(), TargetSurface(BOARD), falloff=(-1.0, 0.0)).min() == 0


def test_a_target_out_of_view_is_dimmed_too():
    dimmed = image(pose(depth_mm=-300.0), TargetSurface(BOARD), falloff=(-0.02, 0.0))
    assert dimmed[0, 0] < dimmed[236, 258] == pytest.approx(0.3)


def test_a_dot_beyond_the_sharp_plane_shows_the_iris_and_a_nearer_one_shows_it_turned():
    """A triangle whose first corner points right has its skewness there."""
    surface = TargetSurface(Disk(0.5), ink=0.0, surroundings=1.0)

    def skewness(depth_mm):
        picture = image(pose(depth_mm=depth_mm), surface, aperture=Aperture(3), floor=NO_FLOOR)
        profile = (1.0 - picture.astype(np.float64)).sum(axis=0)
        profile[np.abs(profile) < 1e-3] = 0.0
        place = np.arange(len(profile)) - profile @ np.arange(len(profile)) / profile.sum()
        return profile @ place**3 / (profile @ place**2) ** 1.5 * np.sqrt(profile.sum())

    assert skewness(675.0) > 0.2
    assert skewness(645.0) < -0.2


def test_memory_stays_small_at_long_zoom():
    """The window, not the plate, says how much is drawn: 12 µm on the plate per pixel here."""
    plate = parse_target("charuco:17x13:3mm:2.25mm@0,0+disk:6mm@0,27")
    close = Pose(np.eye(3), np.array([0.0, 0.0, 100.0]))
    tracemalloc.start()
    image(close, TargetSurface(plate), 1.0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 60e6
