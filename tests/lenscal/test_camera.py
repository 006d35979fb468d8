import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lenscal.camera import Camera
from lenscal.errors import InputError
from lenscal.sensor import Sensor

SENSOR = Sensor(512, 480, 0.023, 0.01375, scale_factor=0.70642)
PIXEL = 1e-9  # rounding, in px

cameras = st.builds(
    lambda d, k1, c, k2, p: Camera(SENSOR, d, k1, c, (k2,), p),
    st.floats(5.0, 300.0),
    st.floats(-2e-3, 5e-3),
    st.tuples(st.floats(200.0, 300.0), st.floats(200.0, 280.0)),
    st.floats(-1e-6, 1e-5),
    st.tuples(st.floats(-2e-4, 2e-4), st.floats(-2e-4, 2e-4)),
)


@given(cameras, st.floats(10.0, 1e4))
def test_what_a_pixel_sees_projects_back_to_it(camera, distance):
    pixels = np.stack(np.meshgrid(np.linspace(0, 511, 9), np.linspace(0, 479, 9)), axis=-1)
    np.testing.assert_allclose(
        camera.project(distance * camera.unproject(pixels)), pixels, atol=1e-8
    )


def test_a_point_on_the_axis_lands_on_the_principal_point():
    camera = Camera(SENSOR, 50.0, 1e-3, (250.0, 230.0))
    np.testing.assert_allclose(camera.project([0.0, 0.0, 1234.0]), (250.0, 230.0))


def test_x_is_right_and_y_is_down():
    right, down = (
        Camera(SENSOR, 50.0).project([[1.0, 0, 100.0], [0, 1.0, 100.0]]) - SENSOR.centre_px
    )
    assert right[0] == pytest.approx(50 / 100 / SENSOR.sample_pitch_x_mm)
    assert right[1] == 0
    assert down[1] == pytest.approx(50 / 100 / SENSOR.sample_pitch_y_mm)


def test_kappa_maps_distorted_to_undistorted():
    """Tsai: r_u = r_d (1 + κ1 r_d²)."""
    camera = Camera(SENSOR, 50.0, k1_per_mm2=2e-3)
    np.testing.assert_allclose(camera.undistort([3.0, 4.0]), np.array([3.0, 4.0]) * (1 + 2e-3 * 25))


def test_points_that_no_pixel_can_show_are_nan():
    camera = Camera(SENSOR, 10.0, k1_per_mm2=-1e-3)
    assert np.isnan(camera.project([[0, 0, 0.0], [0, 0, -5.0]])).all()
    folded = camera.radius_limit_mm
    assert folded == pytest.approx(1 / np.sqrt(3e-3))
    farthest = folded * (1 - 1e-3 * folded**2)
    assert np.isfinite(camera.distort([farthest * (1 - 1e-9), 0.0])).all()
    assert np.isnan(camera.distort([farthest * (1 + 1e-9), 0.0])).any()


def test_opencv_projects_alike_within_the_stated_error():
    """cv2.projectPoints is the authority for OpenCV's own model."""
    import cv2

    camera = Camera(SENSOR, 60.0, -4e-4, (251.0, 236.0), (2e-6,), (2e-5, -1e-5))
    converted = camera.to_opencv()
    assert converted.worst_error_px < 0.02
    pixels = np.stack(np.meshgrid(np.linspace(0, 511, 7), np.linspace(0, 479, 7)), -1).reshape(
        -1, 2
    )
    points = 300.0 * camera.unproject(pixels)
    seen = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), converted.matrix, converted.distortion
    )
    assert np.abs(seen[0].reshape(-1, 2) - pixels).max() < converted.worst_error_px + PIXEL


def test_a_camera_survives_the_way_to_opencv_and_back():
    camera = Camera(SENSOR, 60.0, -4e-4, (251.0, 236.0))
    converted = camera.to_opencv()
    back = Camera.from_opencv(converted.matrix, converted.distortion, SENSOR, terms=2)
    pixels = np.array([[0, 0], [511, 479], [100, 300.0]])
    points = 300.0 * camera.unproject(pixels)
    np.testing.assert_allclose(back.project(points), pixels, atol=0.03)


def test_the_matrix_is_that_of_a_pinhole():
    matrix = Camera(SENSOR, 50.0, principal_point_px=(250.0, 240.0)).matrix
    expected = [
        [50 / SENSOR.sample_pitch_x_mm, 0, 250],
        [0, 50 / SENSOR.sample_pitch_y_mm, 240],
        [0, 0, 1],
    ]
    np.testing.assert_allclose(matrix, expected)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"image_distance_mm": 0.0}, "image_distance_mm must be a positive number, but is 0.0 mm"),
        ({"k1_per_mm2": np.nan}, "distortion must be finite"),
        ({"principal_point_px": (1.0,)}, r"principal_point_px must have shape \(2,\)"),
        ({"decentring": (np.inf, 0.0)}, "decentring must be finite"),
    ],
)
def test_bad_cameras_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        Camera(**{"sensor": SENSOR, "image_distance_mm": 50.0, **arguments})


def test_a_camera_reads_like_one():
    assert repr(Camera(SENSOR, 50.0, 1e-3)) == (
        "Camera(d 50 mm, κ1 0.001 /mm², principal point (255.50, 239.50) px, 512 × 480 px)"
    )
