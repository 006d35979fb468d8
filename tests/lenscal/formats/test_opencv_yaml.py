import json

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lenscal.camera import Camera
from lenscal.errors import FileError
from lenscal.formats.distortion import camera_from_matrix
from lenscal.formats.opencv_yaml import read_opencv, write_opencv_json, write_opencv_yaml
from lenscal.sensor import Sensor

CAMERA = Camera(Sensor(640, 480, 0.01, 0.01), 5.3, 1e-3, (342.1, 233.9), (), (1e-4, -2e-4))
WRITERS = pytest.mark.parametrize(
    ("write", "ending"), [(write_opencv_yaml, "yml"), (write_opencv_json, "json")]
)


@WRITERS
def test_opencv_reads_back_the_same_numbers(tmp_path, write, ending):
    path, worst = write(tmp_path / f"camera.{ending}", CAMERA)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    expected = CAMERA.to_opencv()
    np.testing.assert_array_equal(storage.getNode("camera_matrix").mat(), expected.matrix)
    distortion = storage.getNode("distortion_coefficients").mat().ravel()
    np.testing.assert_array_equal(distortion, expected.distortion)
    assert storage.getNode("image_width").real() == 640
    assert worst == expected.worst_error_px
    assert storage.getNode("conversion_error_px").real() == worst


def test_the_worst_error_stands_in_the_file_in_words(tmp_path):
    path, worst = write_opencv_yaml(tmp_path / "camera.yml", CAMERA)
    assert f"worst error of the conversion to OpenCV's model: {worst:.2g} px" in path.read_text()


@WRITERS
def test_focal_length_is_the_image_distance(tmp_path, one, write, ending):
    path, _ = write(tmp_path / f"c.{ending}", one.camera, one.setting)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    matrix = storage.getNode("camera_matrix").mat()
    assert matrix[0, 0] == pytest.approx(120 / (0.023 * 0.70642), rel=1e-15)
    assert matrix[1, 1] == pytest.approx(120 / 0.01375, rel=1e-15)
    assert storage.getNode("lens_zoom").real() == 98


@WRITERS
def test_a_camera_comes_back(tmp_path, one, largest_difference_px, write, ending):
    path, worst = write(tmp_path / f"c.{ending}", one.camera)
    camera, lost, _ = read_opencv(path, 0.01375)
    np.testing.assert_allclose(camera.matrix, one.camera.matrix, rtol=1e-14)
    assert camera.image_distance_mm == pytest.approx(120, rel=1e-14)
    assert largest_difference_px(one.camera, camera) <= worst + lost + 1e-9


@given(st.floats(-0.25, 0.25), st.floats(-0.08, 0.08), st.floats(-1e-2, 1e-2))
def test_opencv_and_the_camera_that_was_read_agree(k1, k2, p1):
    """The loss stated holds, for OpenCV's own projection."""
    coefficients = np.array([k1, k2, p1, -p1 / 2, 0.01])
    matrix = np.array([[700, 0, 330.5], [0, 710, 237.25], [0, 0, 1.0]])
    camera, lost, _ = camera_from_matrix(matrix, coefficients, (640, 480), 0.005)
    ideal = np.array([[x, y] for x in (-0.4, -0.1, 0.3) for y in (-0.3, 0.05, 0.25)])
    points = np.column_stack([ideal, np.ones(len(ideal))])
    theirs = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, coefficients)[0][:, 0]
    # The loss is that at a grid of pixels, which misses its maximum by little.
    inside = camera.sensor.contains(theirs)
    error = np.linalg.norm(camera.project(points) - theirs, axis=-1)[inside]
    assert (error <= 1.2 * lost + 1e-9).all()


def test_a_real_calibration_is_read(reference_data):
    camera, lost, _ = read_opencv(
        reference_data / "opencv-chessboard" / "left_intrinsics.yml", 0.0075
    )
    assert camera.image_distance_px == pytest.approx([535.91573396] * 2)
    assert camera.centre_px == pytest.approx([342.28315473, 235.57082910])
    assert 0.1 < lost < 0.3  # decentring of the other direction is not quite ours


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t[:200], r"camera.yml.*was the file cut short"),
        (lambda t: t.replace("image_width: 640", "image_width: wide"), "image_width must be a pos"),
        (lambda t: t.replace("image_width: 640", "image_width: 640.5"), "must be a whole number"),
        (
            lambda t: t.replace("camera_matrix", "matrix"),
            "camera.yml lacks the field camera_matrix",
        ),
        (lambda t: t.replace("rows: 3", "rows: 2"), "states 2 × 3 numbers, but 9 stand there"),
        (
            lambda t: t.replace("data: [ 5", "data: [ x5"),
            r"camera_matrix.data\[0\] must be a finite",
        ),
        (lambda t: t.replace("data: [ 5", "data: [ -5"), "wanted is a camera matrix"),
        (lambda t: "hello", "holds no names and values"),
        (lambda t: t.replace("!!opencv-matrix", "!!python/object/apply:os.getcwd"), "no YAML"),
    ],
)
def test_garbled_files(tmp_path, change, message):
    path, _ = write_opencv_yaml(tmp_path / "camera.yml", CAMERA)
    path.write_text(change(path.read_text()))
    with pytest.raises(FileError, match=message):
        read_opencv(path, 0.01)


def test_a_json_that_was_cut_short(tmp_path):
    path, _ = write_opencv_json(tmp_path / "camera.json", CAMERA)
    path.write_text(path.read_text()[:150])
    with pytest.raises(FileError, match=r"camera.json, line \d+: no JSON .*cut short"):
        read_opencv(path, 0.01)
    path.write_text(json.dumps({"image_width": 640}))
    with pytest.raises(FileError, match="lacks the field image_height; there are image_width"):
        read_opencv(path, 0.01)
    with pytest.raises(FileError, match="cannot read .*none.yml: No such file"):
        read_opencv(tmp_path / "none.yml", 0.01)
