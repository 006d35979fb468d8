import numpy as np
import pytest

from lenscal.calibration.photographs import calibrate_photographs
from lenscal.detection import load_images
from lenscal.errors import DetectionError
from lenscal.target import Chessboard


def test_real_photographs(reference_data):
    images = load_images(str(reference_data / "opencv-chessboard" / "left*.jpg"))
    result = calibrate_photographs(images, Chessboard(9, 6, 25.0))
    summary = result.summary()
    assert summary["focal_length_px"] == pytest.approx(534.0, rel=0.005)
    assert summary["focal_length_px"] == pytest.approx(533.9, abs=1.2)
    assert 0.3 < summary["sigma"]["focal_length_px"] < 0.8
    assert summary["rms_px"] < 0.2
    views = [item["view"] for item in summary["rejected"]]
    assert max(set(views), key=views.count) == "left02.jpg"
    assert "image_distance_mm" not in summary
    assert set(summary["distortion"]) <= set(summary["sigma"])


def test_the_pitch_only_sets_the_millimetres(reference_data):
    images = load_images(str(reference_data / "opencv-chessboard" / "left*.jpg"))[:6]
    target = Chessboard(9, 6, 25.0)
    without, with_pitch = (
        calibrate_photographs(images, target, pitch).summary() for pitch in (None, 0.005)
    )
    assert with_pitch["focal_length_px"] == pytest.approx(without["focal_length_px"], rel=1e-8)
    assert with_pitch["distortion"]["k1"] == pytest.approx(without["distortion"]["k1"], rel=1e-6)
    assert with_pitch["sigma"]["k1"] == pytest.approx(without["sigma"]["k1"], rel=1e-6)
    assert with_pitch["image_distance_mm"] == pytest.approx(
        0.005 * with_pitch["focal_length_px"], rel=1e-12
    )


def test_a_photograph_without_the_target_is_named(reference_data):
    images = load_images(str(reference_data / "opencv-chessboard" / "left*.jpg"))[2:7]
    images.append(("blank.png", np.full((480, 640), 128, np.uint8)))
    result = calibrate_photographs(images, Chessboard(9, 6, 25.0))
    assert result.without_target == ("blank.png",)
    rejected = result.summary()["rejected"]
    assert {"view": "blank.png", "reason": "the target was not found"} in rejected


def test_no_photograph_with_the_target_is_an_error():
    images = [("blank.png", np.full((480, 640), 128, np.uint8))] * 2
    with pytest.raises(DetectionError, match="was found in none of the 2 images; check the counts"):
        calibrate_photographs(images, Chessboard(9, 6, 25.0))
