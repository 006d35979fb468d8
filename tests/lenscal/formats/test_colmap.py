import dataclasses

import numpy as np
import pytest

from lenscal.camera import Camera
from lenscal.errors import FileError, InputError
from lenscal.formats.colmap import read_colmap, write_colmap


def test_focal_length_is_the_image_distance_and_pixels_begin_at_a_corner(tmp_path, one):
    path, _ = write_colmap(tmp_path / "cameras.txt", [one])
    words = path.read_text().splitlines()[-1].split()
    assert words[:4] == ["1", "FULL_OPENCV", "512", "480"]
    assert float(words[4]) == pytest.approx(120 / (0.023 * 0.70642))
    assert float(words[5]) == pytest.approx(120 / 0.01375)
    np.testing.assert_allclose([float(w) for w in words[6:8]], one.camera.centre_px + 0.5)


def test_the_middle_of_the_image_is_half_its_size(tmp_path, one):
    middle = Camera(one.camera.sensor, 120.0)
    path, _ = write_colmap(tmp_path / "c.txt", [dataclasses.replace(one, camera=middle)])
    assert path.read_text().splitlines()[-1].split()[6:8] == ["256.0", "240.0"]
    assert " PINHOLE " in path.read_text()


def test_cameras_come_back(tmp_path, several, largest_difference_px):
    path, worst = write_colmap(tmp_path / "cameras.txt", several)
    cameras = read_colmap(path, 0.01375)
    assert list(cameras) == [1, 2, 3, 4, 5, 6]
    for one, (camera, lost, _) in zip(several, cameras.values(), strict=True):
        np.testing.assert_allclose(camera.matrix, one.camera.matrix, rtol=1e-14, atol=1e-12)
        assert largest_difference_px(one.camera, camera) <= worst + lost + 1e-9
    assert f"zoom 7, focus 8; worst error of the conversion {worst:.2g}" in path.read_text()


def test_every_model_is_read(tmp_path):
    text = """# Camera list
    1 SIMPLE_PINHOLE 3072 2304 2559.69 1536 1152
    2 PINHOLE 3072 2304 2559.69 2560 1536 1152
    3 SIMPLE_RADIAL 3072 2304 2559.69 1536 1152 -0.0218531
    4 RADIAL 3072 2304 2559.69 1536 1152 -0.02 0.01
    5 OPENCV 3072 2304 2559.69 2560 1536 1152 -0.02 0.01 0.001 0.002
    """
    (tmp_path / "cameras.txt").write_text(text)
    cameras = read_colmap(tmp_path / "cameras.txt", 0.002)
    for camera, lost, _ in cameras.values():
        assert camera.centre_px == pytest.approx([1535.5, 1151.5])
        assert camera.image_distance_px[0] == pytest.approx(2559.69)
        assert lost < 0.2  # of decentring, which runs the other way there
    # Barrel from undistorted to distorted is a positive κ1 from distorted to undistorted.
    assert cameras[3].camera.k1_per_mm2 == pytest.approx(
        0.0218531 / (2559.69 * 0.002) ** 2, rel=0.01
    )


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1 PINHOLE 3072 2304 2559 2560 1536", r"line 2: PINHOLE has 4 parameters \(fx fy cx cy\)"),
        ("1 PINHOLE", "line 2: wanted are CAMERA_ID MODEL WIDTH HEIGHT"),
        ("1 FISHEYE 3 3 1", "line 2: the model 'FISHEYE' is not read; SIMPLE_PINHOLE"),
        ("1 SIMPLE_PINHOLE 3 3 f 1 1", "line 2: f must be a finite number, but is 'f'"),
        ("1 SIMPLE_PINHOLE 3 3 -4 1 1", "line 2: wanted is a camera matrix"),
        ("1 SIMPLE_PINHOLE 3 3 4 1 1\n1 SIMPLE_PINHOLE 3 3 4 1 1", "line 3: CAMERA_ID 1 stands"),
        ("", "holds no camera"),
    ],
)
def test_garbled_files(tmp_path, line, message):
    (tmp_path / "cameras.txt").write_text(f"# Camera list\n{line}\n")
    with pytest.raises(FileError, match=message):
        read_colmap(tmp_path / "cameras.txt", 0.01)


def test_nothing_to_export(tmp_path):
    with pytest.raises(InputError, match="there is no setting to export"):
        write_colmap(tmp_path / "cameras.txt", [])
