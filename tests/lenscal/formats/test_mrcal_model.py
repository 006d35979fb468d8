import ast

import numpy as np
import pytest

from lenscal.errors import FileError
from lenscal.formats.mrcal_model import read_mrcal, write_mrcal


def test_focal_length_is_the_image_distance(tmp_path, one):
    path, worst = write_mrcal(tmp_path / "c.cameramodel", one.camera, one.setting)
    content = ast.literal_eval(path.read_text())
    assert content["intrinsics"][0] == pytest.approx(120 / (0.023 * 0.70642))
    assert content["intrinsics"][1] == pytest.approx(120 / 0.01375)
    assert content["imagersize"] == [512, 480]
    assert f"{worst:.2g} px" in path.read_text().splitlines()[0]


def test_a_camera_comes_back(tmp_path, one, largest_difference_px):
    path, worst = write_mrcal(tmp_path / "c.cameramodel", one.camera)
    camera, lost, _ = read_mrcal(path, 0.01375)
    np.testing.assert_allclose(camera.matrix, one.camera.matrix, rtol=1e-14)
    assert largest_difference_px(one.camera, camera) <= worst + lost + 1e-9


def test_models_of_mrcal_are_read(reference_data):
    folder = reference_data / "mrcal"
    camera, lost, _ = read_mrcal(folder / "cam0.opencv8.cameramodel", 0.004)
    assert camera.image_distance_px == pytest.approx([1761.181055, 1761.250444])
    assert camera.centre_px == pytest.approx([1965.706996, 1087.518797])
    assert lost < 0.5
    camera, lost, _ = read_mrcal(folder / "pinhole-narrow-yawed-left.cameramodel", 0.004)
    assert camera.image_distance_px == pytest.approx([2405.678127, 2453.362582])
    assert lost == 0
    with pytest.raises(FileError, match="SPLINED_STEREOGRAPHIC.*mrcal-convert-lensmodel"):
        read_mrcal(folder / "cam0.splined.cameramodel", 0.004)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t[:250], r"c.cameramodel.*: no dictionary of plain values.*cut short"),
        (lambda t: "__import__('os').getcwd()", "no dictionary of plain values"),
        (lambda t: "[1, 2]", "holds no dictionary"),
        (lambda t: t.replace("'lensmodel'", "'model'"), "lacks the field lensmodel"),
        (lambda t: t.replace("OPENCV5", "OPENCV8"), "intrinsics must be a list of 12 numbers"),
        (lambda t: t.replace("[512, 480]", "[512]"), "imagersize must be a list of 2 numbers"),
        (lambda t: t.replace("[512, 480]", "[512, '480 px']"), r"imagersize\[1\] must be a finite"),
    ],
)
def test_garbled_files(tmp_path, one, change, message):
    path, _ = write_mrcal(tmp_path / "c.cameramodel", one.camera)
    path.write_text(change(path.read_text()))
    with pytest.raises(FileError, match=message):
        read_mrcal(path, 0.01)
