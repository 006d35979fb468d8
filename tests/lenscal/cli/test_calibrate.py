import json
import os
from dataclasses import replace

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from lenscal.calibration.table import CalibrationTable
from lenscal.camera import Camera
from lenscal.camera_mount import CameraMount
from lenscal.cli.calibrate import calibrate
from lenscal.document import read_document
from lenscal.errors import CalibrationError, DetectionError, FileError, InputError, UnitError
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


SENSOR, BOARD = Sensor(1224, 1024, 0.0069, 0.0069), Chessboard(12, 9, 3.0)
TILTS = ((0, 0), (22, 0), (-22, 0), (0, 22), (0, -22))
#: Where the camera sits on the hand of a robot, and the target in its base.
MOUNTING = (
    Pose.from_rotation_vector((0.02, -0.01, 0.5), (10.0, 20.0, 80.0)),
    Pose.from_rotation_vector((1.0, 0.2, -0.1), (400.0, 50.0, 20.0)),
)


def _views(rng, mounting=None):
    """Seen at 420 mm with 0.1 px of noise; by a robot that stands where it says, if any."""
    camera = Camera(SENSOR, 60.0)
    views = []
    for tilt in TILTS:
        pose = Pose.from_rotation_vector(np.radians([*tilt, 5.0]), (0.0, 0.0, 420.0))
        pixels = camera.project(pose.transform(BOARD.points_mm))
        observation = Observation.of(
            BOARD, BOARD.ids(), pixels + rng.normal(0.0, 0.1, pixels.shape)
        )
        hand = None
        if mounting is not None:
            hand_from_camera, base_from_target = mounting
            hand = base_from_target @ pose.inverse() @ hand_from_camera.inverse()
        views.append(View(observation, hand, iris=3.0))
    return tuple(views)


@pytest.fixture
def session(tmp_path):
    views = _views(np.random.default_rng(0))
    good = SettingRecord(LensSetting(10.0, 1.0), views)
    lost = SettingRecord(LensSetting(20.0, 1.0), views, focus_view=None)
    return Recording(Head(SENSOR, BOARD), (good, lost)).save(tmp_path / "session")


@pytest.fixture
def robot_session(tmp_path):
    """Three settings of the same lens."""
    rng = np.random.default_rng(0)
    records = tuple(
        SettingRecord(LensSetting(10.0, focus), _views(rng, MOUNTING)) for focus in (1.0, 2.0, 3.0)
    )
    head = Head(SENSOR, BOARD, LensSetting(10.0, 1.0), *MOUNTING)
    return Recording(head, records).save(tmp_path / "robot-session")


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
    assert answer["robot_repeatability_mm"] is None
    assert answer["robot_repeatability_mrad"] is None
    assert answer["failures"][0]["zoom"] == 20.0
    assert (tmp_path / "elsewhere.json").exists()


def test_figures_of_photographs(photographs, tmp_path):
    request = ("--images", photographs, "--target", "chessboard:9x6:25mm")
    folder = tmp_path / "figures"
    result = _run(*request, "--plots", folder)
    names = ["summary.png", "views-1.png", "views-2.png"]
    assert result.stdout.endswith(f"figures written to {folder}: {', '.join(names)}\n")
    assert sorted(path.name for path in folder.iterdir()) == names
    answer = json.loads(_run(*request, "--plots", folder, "--json").stdout)
    assert answer["figures"] == [str(folder / name) for name in names]


def test_figure_of_a_session(session, tmp_path):
    result = _run(session, "--plots", tmp_path / "figures")
    assert f"figures written to {tmp_path / 'figures'}: table.png" in result.stdout
    assert cv2.imread(str(tmp_path / "figures" / "table.png")).shape[1] == 2250
    answer = json.loads(_run(session, "--plots", tmp_path / "more", "--json").stdout)
    names = ["table.png", "summary.png", "views-1.png"]
    assert answer["figures"] == [str(tmp_path / "more" / name) for name in names]


def _cells(result):
    """The printed table, by heading; σ are called by what they stand behind."""
    headings = "zoom focus d/D ±% D ±D d f offset ±offset standoff ±standoff rms corners".split()
    lines = [line.split() for line in result.stdout.splitlines()[1:]]
    return [dict(zip(headings, line, strict=True)) for line in lines if len(line) == 14]


def test_the_printed_table_is_that_of_the_file(robot_session):
    result = _run(robot_session)
    rows = CalibrationTable.load(robot_session / "table.csv").rows
    printed = _cells(result)
    assert len(printed) == 3
    for cells, (_, row) in zip(printed, rows.iterrows(), strict=True):
        assert float(cells["D"]) == pytest.approx(row["object_distance_mm"], abs=0.006)
        assert float(cells["offset"]) == pytest.approx(row["nodal_offset_mm"], abs=0.006)
        assert float(cells["±offset"]) == pytest.approx(row["sigma_nodal_offset_mm"], abs=0.006)
        assert float(cells["standoff"]) == pytest.approx(row["standoff_mm"], abs=6e-4)
        assert cells["±standoff"] == "–"  # no autofocus said how sharp it was
        assert int(cells["corners"]) == row["corners"] == 5 * 108
    assert max(len(line) for line in result.stdout.splitlines()[:4]) <= 110


def test_without_a_robot_its_columns_are_empty(session):
    result = _run(session)
    (cells,) = _cells(result)
    assert {cells[name] for name in ("offset", "±offset", "standoff", "±standoff")} == {"–"}
    assert "robot:" not in result.stdout


def test_the_repeatability_of_the_robot_is_told(robot_session):
    answer = json.loads(_run(robot_session, "--json").stdout)
    translation_mm = answer["robot_repeatability_mm"]
    rotation_mrad = answer["robot_repeatability_mrad"]
    # It stands where it says but for the pixels' noise, 0.1 px × 7 µm ≪ what robots do.
    assert 0 < translation_mm < 0.05
    assert 0 < rotation_mrad < 0.3
    line = f"robot: {translation_mm:.3f} mm, {rotation_mrad:.2f} mrad (estimated)"
    assert line in _run(robot_session).stdout.splitlines()


def test_a_repeatability_that_is_given_is_used(robot_session):
    given = ("--robot-repeatability", "50 um, 0.4mrad")
    assert "robot: 0.050 mm, 0.40 mrad (as given)" in _run(robot_session, *given).stdout
    answer = json.loads(_run(robot_session, *given, "--json").stdout)
    assert answer["robot_repeatability_mm"] == pytest.approx(0.05)
    assert answer["robot_repeatability_mrad"] == pytest.approx(0.4)
    urad = _run(robot_session, "--robot-repeatability", "0.05mm,400µrad").stdout
    assert "robot: 0.050 mm, 0.40 mrad (as given)" in urad


def test_a_robot_can_be_left_aside(robot_session):
    result = _run(robot_session, "--no-robot")
    table = CalibrationTable.load(robot_session / "table.csv")
    assert [entry["robot"] for entry in table.evidence] == [None] * 3
    assert "robot:" not in result.stdout


def test_the_scale_factor_is_estimated_when_asked_for(robot_session):
    assert "scale factor" not in _run(robot_session).stdout
    result = _run(robot_session, "--free-scale-factor")
    rows = CalibrationTable.load(robot_session / "table.csv").rows
    assert (np.abs(rows["scale_factor"] - 1) < 5 * rows["sigma_scale_factor"]).all()
    values, sigma = rows["scale_factor"], rows["sigma_scale_factor"].median()
    line = f"scale factor: {values.min():.5f} to {values.max():.5f}, each ± {sigma:.5f} or so"
    assert line in result.stdout.splitlines()


def test_figures_of_a_session_with_a_robot_hold_its_slips(robot_session, tmp_path):
    result = _run(robot_session, "--plots", tmp_path / "figures")
    assert result.stdout.endswith("figures: table.png, robot-slips.png, summary.png, views-1.png\n")
    assert (tmp_path / "figures" / "robot-slips.png").exists()


@pytest.mark.parametrize(
    ("settings", "options", "workers"),
    [
        (47, (), None),
        (48, (), os.cpu_count()),
        (48, ("--workers", 1), 1),
        (47, ("--workers", 3), 3),
    ],
)
def test_large_sessions_are_shared_by_all_cores(tmp_path, monkeypatch, settings, options, workers):
    record = SettingRecord(LensSetting(10.0, 1.0), _views(np.random.default_rng(0)))
    records = [replace(record, setting=LensSetting(10.0, float(i))) for i in range(settings)]
    folder = Recording(Head(SENSOR, BOARD), tuple(records)).save(tmp_path / "large")
    asked = {}

    def calibrate_recording(recording, **keywords):
        asked.update(keywords)
        raise CalibrationError("enough is known")

    monkeypatch.setattr("lenscal.calibration.sweep.calibrate_recording", calibrate_recording)
    with pytest.raises(CalibrationError, match="enough is known"):
        _run(folder, *options)
    assert asked["workers"] == workers


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("0.02,0.1", UnitError, "the length '0.02' has no unit; write one of"),
        ("0.02mm,0.1", UnitError, "cannot read '0.1' as an angle; write a number and one of urad"),
        ("0.02mm,0.1mm", UnitError, "cannot read '0.1mm' as an angle"),
        ("0.02mrad,0.1mrad", UnitError, "unknown unit of length 'mrad'"),
        (
            "0.02mm",
            InputError,
            "cannot read the repeatability '0.02mm'; give a length and an angle",
        ),
        ("1mm,2mrad,3mrad", InputError, "such as 0.02mm,0.1mrad"),
        ("0mm,0.1mrad", InputError, "the translation of --robot-repeatability must be a positive"),
        ("0.02mm,-1mrad", InputError, "the rotation of --robot-repeatability must be a positive"),
    ],
)
def test_a_repeatability_needs_both_units(robot_session, text, error, words):
    with pytest.raises(error, match=words):
        _run(robot_session, "--robot-repeatability", text)
    assert not (robot_session / "table.csv").exists()


def test_a_repeatability_without_a_robot_is_refused(session, robot_session):
    with pytest.raises(InputError, match="the session holds no poses of a robot; leave --robot-r"):
        _run(session, "--robot-repeatability", "0.02mm,0.1mrad")
    with pytest.raises(InputError, match="--no-robot leaves aside the robot that --robot-repeat"):
        _run(robot_session, "--no-robot", "--robot-repeatability", "0.02mm,0.1mrad")


@pytest.mark.parametrize(
    "option",
    [("--no-robot",), ("--free-scale-factor",), ("--robot-repeatability", "0.02mm,0.1mrad")],
)
def test_options_of_sessions_are_refused_for_photographs(option):
    with pytest.raises(InputError, match="are for a session; leave them for photographs"):
        _run("--images", "*.png", "--target", "chessboard:9x6:25mm", *option)


def test_a_place_that_cannot_hold_figures_is_refused_before_the_work(session, tmp_path):
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(FileError, match="figures are written to a folder, but .* is a file"):
        _run(session, "--plots", file)
    with pytest.raises(FileError, match="cannot make the folder .*: Not a directory"):
        _run(session, "--plots", file / "below")
    assert not (session / "table.csv").exists()


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


def test_a_session_gives_the_mounting_that_it_measured(robot_session, tmp_path):
    """The rig does not say how well it knows the mounting, so the views of the reference do."""
    result = _run(robot_session, "--mount", tmp_path / "mount.json")
    assert "camera on the hand at zoom 10, focus 1, measured at the reference" in result.stdout
    mount = CameraMount.load(tmp_path / "mount.json")
    assert not mount.anchors_offsets
    assert mount.reference_setting == LensSetting(10.0, 1.0)
    difference = mount.hand_from_camera.inverse() @ MOUNTING[0]
    sigma = np.sqrt(np.diag(mount.covariance))
    assert np.linalg.norm(difference.rotation_vector) < 4 * np.linalg.norm(sigma[:3])
    assert np.linalg.norm(difference.translation_mm) < 4 * np.linalg.norm(sigma[3:])
    assert np.linalg.norm(sigma[3:]) < 10
    answer = json.loads(_run(robot_session, "--mount", tmp_path / "m.json", "--json").stdout)
    assert answer["mount"] == str(tmp_path / "m.json")


def test_a_session_that_cannot_tell_the_mounting(session, robot_session, tmp_path):
    mount = tmp_path / "mount.json"
    with pytest.raises(CalibrationError, match="does not say for which setting hand-eye is to be"):
        _run(session, "--mount", mount)
    recording = Recording.load(session)
    head = replace(recording.head, reference_setting=LensSetting(10.0, 1.0))
    Recording(head, recording.settings).save(tmp_path / "still")
    with pytest.raises(CalibrationError, match="holds no poses of a robot at zoom 10, focus 1; h"):
        _run(tmp_path / "still", "--mount", mount)
    recording = Recording.load(robot_session)
    head = replace(recording.head, reference_setting=LensSetting(11.0, 1.0))
    Recording(head, recording.settings).save(tmp_path / "elsewhere")
    with pytest.raises(CalibrationError, match="never was at the reference setting, zoom 11, f"):
        _run(tmp_path / "elsewhere", "--mount", mount)
    assert not mount.exists()
    with pytest.raises(InputError, match="--mount are for a session"):
        _run("--images", "x*.jpg", "--mount", mount)
