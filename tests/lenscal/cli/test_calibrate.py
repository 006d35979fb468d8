import json

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from lenscal.calibration.table import CalibrationTable
from lenscal.camera import Camera
from lenscal.cli.calibrate import calibrate
from lenscal.document import read_document
from lenscal.errors import DetectionError, FileError, InputError
from lenscal.pose import Pose
from lenscal.recording import Head, Observation, Recording, SettingRecord, View
from lenscal.sensor import Sensor
from lenscal.setting import LensSetting
from lenscal.target import Chessboard


@pytest.fixture
def photographs(reference_data):
    return f"{reference_data}/opencv-chessboard/left*.jpg"


def _run(*arguments):
    return CliRunner().invoke(calibrate, [str(a) for a in arguments], catch_exceptions=False)


def test_photographs_as_json(photographs):
    result = _run("--images", photographs, "--target", "chessboard:9x6:25mm", "--json")
    answer = json.loads(result.stdout)
    assert answer["focal_length_px"] == pytest.approx(534.0, rel=0.005)
    assert len(answer["principal_point_px"]) == 2
    assert answer["rms_px"] < 0.2
    assert 0.3 < answer["sigma"]["focal_length_px"] < 0.8
    assert any(item["view"] == "left02.jpg" for item in answer["rejected"])
    assert "mm" not in result.stdout


def test_photographs_as_words(photographs, tmp_path):
    target = ("--target", "chessboard:9x6:25mm")
    result = _run("--images", photographs, *target, "--pitch-um", 10, "-o", tmp_path / "c.yml")
    assert "f                533.3" in result.stdout
    assert " mm\n" in result.stdout
    assert "left02.jpg, corner 45" in result.stdout
    storage = cv2.FileStorage(str(tmp_path / "c.yml"), cv2.FILE_STORAGE_READ)
    matrix = storage.getNode("camera_matrix").mat()
    assert matrix[0, 0] == pytest.approx(533.3, abs=0.2)
    assert storage.getNode("distortion_coefficients").mat()[0, 0] == pytest.approx(-0.29, abs=0.02)
    without_pitch = _run("--images", photographs, *target, "-o", tmp_path / "c.json")
    assert " mm" not in without_pitch.stdout
    document = read_document(tmp_path / "c.json", "camera", 1)
    assert document["focal_length_px"] == pytest.approx(533.3, abs=0.2)


@pytest.fixture
def session(tmp_path):
    sensor, board = Sensor(1224, 1024, 0.0069, 0.0069), Chessboard(12, 9, 3.0)
    camera, rng = Camera(sensor, 60.0), np.random.default_rng(0)
    views = []
    for tilt in ((0, 0), (22, 0), (-22, 0), (0, 22)):
        pose = Pose.from_rotation_vector(np.radians([*tilt, 0]), (0.0, 0.0, 420.0))
        pixels = camera.project(pose.transform(board.points_mm))
        pixels = pixels + rng.normal(0.0, 0.1, pixels.shape)
        views.append(View(Observation.of(board, board.ids(), pixels)))
    good = SettingRecord(LensSetting(10.0, 1.0), tuple(views))
    lost = SettingRecord(LensSetting(20.0, 1.0), tuple(views), focus_view=None)
    return Recording(Head(sensor, board), (good, lost)).save(tmp_path / "session")


def test_a_session_becomes_a_table(session):
    result = _run(session)
    assert f"1 of 2 settings calibrated: {session / 'table.csv'}" in result.stdout
    assert "left out: zoom 20, focus 1: its focus view was lost" in result.stdout
    table = CalibrationTable.load(session / "table.csv")
    assert table.to_dataframe()["object_distance_mm"][0] == pytest.approx(420.0, rel=0.01)


def test_a_session_as_json(session, tmp_path):
    result = _run(session, "-o", tmp_path / "elsewhere.csv", "--json")
    answer = json.loads(result.stdout)
    assert answer["settings"] == 1
    assert answer["failures"][0]["zoom"] == 20.0
    assert (tmp_path / "elsewhere.json").exists()


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ((), InputError, "name either a SESSION folder or --images"),
        (("run1", "--images", "*.png"), InputError, "name either a SESSION folder or --images"),
        (("run1", "--target", "disk:6mm"), InputError, "a session knows its target and its sens"),
        (("--images", "*.png"), InputError, "say what the photographs show: --target"),
        (("--images", "*.png", "--target", "tiles"), InputError, "cannot read the target 'tiles'"),
        (
            ("--images", "/nowhere/*.png", "--target", "chessboard:9x6:25mm"),
            FileError,
            "no images match '/nowhere/.*png': there is no folder",
        ),
        (
            ("--images", "*.png", "--target", "chessboard:9x6:25mm", "--pitch-um", "0"),
            InputError,
            "--pitch-um must be a positive number, but is 0",
        ),
        (
            ("--images", "*.png", "--target", "chessboard:9x6:25mm", "-o", "camera.txt"),
            FileError,
            "a camera is written as .json, .yml or .yaml, but 'camera.txt' was named",
        ),
        (("/nowhere",), FileError, "cannot read /nowhere/journal.jsonl"),
    ],
)
def test_wrong_requests_are_told(arguments, error, words):
    with pytest.raises(error, match=words):
        _run(*arguments)


def test_images_without_the_target_or_of_different_sizes(tmp_path):
    for name, size in (("a.png", (48, 64)), ("b.png", (48, 64))):
        cv2.imwrite(str(tmp_path / name), np.zeros(size, np.uint8))
    request = ("--images", tmp_path / "*.png", "--target", "chessboard:9x6:25mm")
    with pytest.raises(DetectionError, match="was found in none of the 2 images"):
        _run(*request)
    cv2.imwrite(str(tmp_path / "c.png"), np.zeros((50, 50), np.uint8))
    with pytest.raises(InputError, match="the images are of different sizes: most are 64 × 48"):
        _run(*request)


def test_help_has_an_example():
    assert "lenscal calibrate --images 'DIR/left*.jpg'" in _run("--help").stdout
