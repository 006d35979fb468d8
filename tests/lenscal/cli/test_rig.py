import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from lenscal.cli.main import program
from lenscal.errors import DeviceError, FileError, FocusError, InputError, UnitError


def look(out, **changes):
    options = {"zoom": 98, "focus": 100, "distance": "370 mm"} | changes
    words = [w for name, value in options.items() for w in (f"--{name.replace('_', '-')}", value)]
    words = [str(w) for w in words if w is not True]
    return CliRunner().invoke(
        program, ["rig", "look", *words, "-o", str(out)], catch_exceptions=False
    )


def test_a_frame_is_saved_and_told_of(tmp_path):
    out = tmp_path / "frame.png"
    result = look(out)
    assert result.output.startswith("zoom 98, focus 100, iris 100 at 370 mm, exposed for ")
    assert result.output.count("\n") == 1
    frame = cv2.imread(str(out), cv2.IMREAD_UNCHANGED)
    assert (frame.shape, frame.dtype) == ((480, 512), np.uint8)
    assert np.percentile(frame, 95) > 150


def test_more_than_8_bits_are_saved_in_16(tmp_path):
    from lenscal.rig.simulated import SimulatedRig

    rig = SimulatedRig.preset("machine-vision")
    setting = rig.lens.setting
    distance = f"{rig.truth(setting).standoff_mm} mm"
    out = tmp_path / "frame.png"
    look(out, preset="machine-vision", zoom=setting.zoom, focus=setting.focus, distance=distance)
    frame = cv2.imread(str(out), cv2.IMREAD_UNCHANGED)
    assert (frame.shape, frame.dtype) == ((2048, 2448), np.uint16)
    assert 0.6 < np.percentile(frame, 95) / 65535 < 0.9


def test_the_disk_can_be_looked_at(tmp_path):
    look(tmp_path / "disk.png", disk=True)
    frame = cv2.imread(str(tmp_path / "disk.png"), cv2.IMREAD_UNCHANGED)
    assert frame[240, 256] < 60


def test_the_target_can_be_tilted(tmp_path):
    look(tmp_path / "square.png", iris=20)
    look(tmp_path / "tilted.png", iris=20, tilt_deg=25)
    square, tilted = (
        cv2.imread(str(tmp_path / f"{name}.png"), cv2.IMREAD_UNCHANGED).astype(float)
        for name in ("square", "tilted")
    )
    assert np.abs(square - tilted).mean() > 10


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"distance": "370"}, UnitError, "the length '370' has no unit"),
        ({"distance": "370 ells"}, UnitError, "unknown unit 'ells'|ells"),
        ({"distance": "0 mm"}, InputError, "the distance must be positive, but is '0 mm'"),
        ({"zoom": 9}, InputError, "zoom 9 lies outside the travel"),
        ({"iris": 500}, InputError, "iris 500 lies outside the travel"),
        ({"preset": "none"}, InputError, "there is no simulated rig 'none'"),
    ],
)
def test_what_cannot_be_looked_at(tmp_path, changes, error, message):
    with pytest.raises(error, match=message):
        look(tmp_path / "frame.png", **changes)


def test_a_plate_inside_the_lens_is_a_collision(tmp_path):
    with pytest.raises(DeviceError, match="behind the front of the lens"):
        look(tmp_path / "frame.png", distance="5 mm")


def test_only_png_is_written(tmp_path):
    with pytest.raises(InputError, match="cannot write a frame to frame.jpg; end it in .png"):
        look(tmp_path / "frame.jpg")


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(FileError, match="cannot write the frame to .*; does the folder exist"):
        look(tmp_path / "none" / "frame.png")


def test_too_dark(tmp_path, monkeypatch):
    """With the lamp off, no exposure is long enough."""
    from lenscal.imaging.detector import Detector

    monkeypatch.setattr(
        Detector, "electrons", lambda self, light, *_: np.zeros_like(light, np.float32)
    )
    with pytest.raises(FocusError, match="the picture is too dark"):
        look(tmp_path / "frame.png")
