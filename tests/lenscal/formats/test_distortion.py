import numpy as np
import pytest

from lenscal.errors import InputError
from lenscal.formats.distortion import camera_from_matrix

MATRIX = np.array([[700, 0, 330.5], [0, 710, 237.25], [0, 0, 1.0]])


def test_a_camera_without_distortion_is_kept_to_the_last_digits():
    camera, lost, _ = camera_from_matrix(MATRIX, [], (640, 480), 0.005)
    np.testing.assert_allclose(camera.matrix, MATRIX, rtol=1e-15)
    assert (lost, camera.k1_per_mm2, camera.radial) == (0.0, 0.0, ())


def test_the_rational_model_is_followed():
    """k4 to k6 count: without them the camera would be wrong by many pixels."""
    import cv2

    coefficients = np.array([0.3, 0.05, 1e-3, -5e-4, 0.01, 0.45, 0.02, 0.001])
    camera, lost, _ = camera_from_matrix(MATRIX, coefficients, (640, 480), 0.005)
    points = np.array([[0.4, 0.3, 1.0], [-0.3, 0.1, 1.0], [0.01, -0.3, 1.0]])
    theirs = cv2.projectPoints(points, np.zeros(3), np.zeros(3), MATRIX, coefficients)[0][:, 0]
    assert np.abs(camera.project(points) - theirs).max() <= 1.2 * lost + 1e-9
    assert lost < 0.1


def test_what_one_kappa_loses_is_stated():
    full = camera_from_matrix(MATRIX, [-0.25, 0.1, 1e-3, 0, 0], (640, 480), 0.005)
    alone = full.with_kappa_alone(1.0)
    assert alone.camera.radial == ()
    assert alone.camera.decentring == (0.0, 0.0)
    assert alone.camera.image_distance_mm == pytest.approx(705 * 0.005)
    assert alone.worst_error_px > 10 * full.worst_error_px
    pixels = np.array([[-0.5, -0.5], [639.5, 479.5], [300, 20]])
    back = alone.camera.project(full.camera.unproject(pixels))
    assert np.linalg.norm(back - pixels, axis=-1).max() <= 1.05 * alone.worst_error_px


def test_a_wide_lens_is_followed_as_far_as_it_goes():
    """A published test file of ROS, 102° across: one κ1 is 44 px off, all terms a quarter of it."""
    matrix = [[259.7989, 0, 332.0316], [0, 258.0087, 252.4607], [0, 0, 1]]
    full = camera_from_matrix(matrix, [-0.2613, 0.05351, -0.00433, 0.0003, 0], (640, 480), 0.005)
    assert full.worst_error_px < 12
    assert 30 < full.with_kappa_alone(0.993).worst_error_px < 60


def test_a_pinhole_stays_a_pinhole():
    alone = camera_from_matrix(MATRIX, [], (640, 480), 0.005).with_kappa_alone(710 / 700)
    assert alone.camera.k1_per_mm2 == 0
    assert alone.worst_error_px < 1e-9
    stretched = camera_from_matrix(MATRIX, [], (640, 480), 0.005).with_kappa_alone(1.0)
    # Half of 10 in 705 at the corner, 400 px out.
    assert 2 < stretched.worst_error_px < 4


@pytest.mark.parametrize(
    ("matrix", "coefficients", "message"),
    [
        (np.diag([700, -1, 1]), [], "wanted is a camera matrix"),
        (MATRIX + np.eye(3, k=1) * [0, 3, 0], [], "f_y, c_y"),
        (MATRIX, [0.1, 0.2, 0.3], "wanted are the distortion coefficients k1, k2, p1, p2"),
        (MATRIX, [0] * 8 + [0.1, 0, 0, 0], "thin prisms and tilted sensors are not modelled"),
        (np.diag([700, 1e9, 1.0]), [], "out of proportion to an image of 640 × 480 px"),
        (MATRIX, [-5.0, 0, 0, 0], "folds within the image: at .* pixels"),
    ],
)
def test_what_cannot_be_converted(matrix, coefficients, message):
    with pytest.raises(InputError, match=message):
        camera_from_matrix(matrix, coefficients, (640, 480), 0.005)
