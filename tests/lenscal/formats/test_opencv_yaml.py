import cv2
import numpy as np

from lenscal.camera import Camera
from lenscal.formats.opencv_yaml import write_opencv_yaml
from lenscal.sensor import Sensor


def test_opencv_reads_back_the_same_numbers(tmp_path):
    camera = Camera(Sensor(640, 480, 0.01, 0.01), 5.3, 1e-3, (342.1, 233.9), (), (1e-4, -2e-4))
    path = write_opencv_yaml(tmp_path / "camera.yml", camera)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    expected = camera.to_opencv()
    np.testing.assert_array_equal(storage.getNode("camera_matrix").mat(), expected.matrix)
    distortion = storage.getNode("distortion_coefficients").mat().ravel()
    np.testing.assert_array_equal(distortion, expected.distortion)
    assert storage.getNode("image_width").real() == 640
    assert "worst error of the conversion" in path.read_text()
