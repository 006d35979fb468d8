import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lenscal.calibration.sweep import (
    Job,
    SweepOptions,
    calibrate_recording,
    calibrate_setting,
    calibration_of,
)
from lenscal.calibration.table import COLUMNS, CORRELATED, VERSION, CalibrationTable
from lenscal.calibration.table_row import standoff_mm as standoff_of
from lenscal.camera import Camera
from lenscal.document import read_document, write_document
from lenscal.errors import CalibrationError, FileError, InputError
from lenscal.pose import Pose
from lenscal.recording import FocusResult, Head, Observation, Recording, SettingRecord, View
from lenscal.sensor import Sensor
from lenscal.setting import ApproachSide, LensSetting
from lenscal.target import Chessboard

SENSOR = Sensor(1224, 1024, 0.0069, 0.0069)
BOARD = Chessboard(12, 9, 3.0)
HAND_FROM_CAMERA = Pose.from_rotation_vector((0.02, -0.01, 0.5), (10.0, 20.0, 80.0))
BASE_FROM_TARGET = Pose.from_rotation_vector((1.0, 0.2, -0.1), (400.0, 50.0, 20.0))
TILTS = ((0, 0), (22, 0), (-22, 0), (0, 22), (0, -22))
#: Image distance, object distance, and how far the projection centre lies behind the reference's.
TRUTH = {(10.0, 1.0): (60.0, 420.0, 0.0), (20.0, 1.0): (90.0, 520.0, 75.0)}


def _record(setting, rng, noise_px=0.1):
    distance, object_distance, offset = TRUTH[setting]
    camera = Camera(SENSOR, distance, 3e-4, (620.0, 505.0))
    camera_from_reference = Pose(np.eye(3), (0.0, 0.0, offset))
    views = []
    for about_x, about_y in TILTS:
        camera_from_target = Pose.from_rotation_vector(
            np.radians([about_x, about_y, 5.0]), (0.2, -0.1, object_distance)
        )
        exact = camera.project(camera_from_target.transform(BOARD.points_mm))
        pixels = exact + noise_px * rng.standard_normal(exact.shape)
        reference_from_target = camera_from_reference.inverse() @ camera_from_target
        base_from_hand = (
            BASE_FROM_TARGET @ reference_from_target.inverse() @ HAND_FROM_CAMERA.inverse()
        )
        inside = SENSOR.contains(exact)
        observation = Observation.of(BOARD, BOARD.ids()[inside], pixels[inside])
        views.append(View(observation, base_from_hand, iris=3.0))
    return SettingRecord(
        LensSetting(*setting),
        tuple(views),
        focus=FocusResult(object_distance - offset, 0.2, 0.9, 1.0, np.zeros(0), np.zeros(0)),
        approach=ApproachSide.FROM_ABOVE,
    )


@pytest.fixture
def recording():
    rng = np.random.default_rng(0)
    head = Head(SENSOR, BOARD, LensSetting(10.0, 1.0), HAND_FROM_CAMERA, BASE_FROM_TARGET)
    return Recording(head, tuple(_record(setting, rng) for setting in TRUTH))


@pytest.fixture
def table(recording):
    return calibrate_recording(recording)


def test_every_setting_is_calibrated_within_its_errors(table):
    rows = table.to_dataframe()
    assert list(rows.columns) == list(COLUMNS)
    for (zoom, focus), (image, objective, offset) in TRUTH.items():
        row = rows[(rows.zoom == zoom) & (rows.focus == focus)].iloc[0]
        truth = {
            "image_distance_mm": image,
            "object_distance_mm": objective,
            "magnification": image / objective,
            "focal_length_mm": 1 / (1 / image + 1 / objective),
            "nodal_offset_mm": offset,
        }
        for name, value in truth.items():
            assert abs(row[name] - value) < 4 * row[f"sigma_{name}"], name
        assert row["standoff_mm"] == pytest.approx(objective - offset, abs=0.01)
        assert row["sigma_nodal_offset_mm"] == pytest.approx(
            row["sigma_object_distance_mm"], rel=0.05
        )
        assert row["sigma_sharpest_mm"] == 0.2
        assert row["sigma_standoff_mm"] == pytest.approx(0.2, rel=0.02)
        assert abs(row["nodal_x_mm"]) < 4 * row["sigma_nodal_x_mm"]
        assert abs(row["nodal_y_mm"]) < 4 * row["sigma_nodal_y_mm"]
        assert row["approach"] == "from_above"
        assert (row["views"], row["rejected_corners"]) == (5, 0)


def test_the_focus_curve_gives_the_pupil_or_the_reason_why_not(recording, table):
    """The first setting is given the curve of a pupil of 12 mm; the other has none."""
    image, objective, _ = TRUTH[(10.0, 1.0)]
    old = recording.settings[0].focus
    standoffs = np.linspace(old.distance_mm - 20, old.distance_mm + 20, 15)
    z = standoffs - old.distance_mm + objective
    blur_px = 3 * np.pi**2 / 32 * 12.0 * image * (1 / z - 1 / objective) / SENSOR.pitch_x_mm
    curve = {"curve_standoff_mm": standoffs, "curve_sharpness": (4 + blur_px**2) ** -0.5}
    first = replace(recording.settings[0], focus=replace(old, **curve))
    measured = calibrate_recording(replace(recording, settings=(first, recording.settings[1])))
    rows = measured.to_dataframe()
    assert (rows["sharpest_confidence"] == 0.9).all()
    assert (rows["pupil_iris"] == 1.0).all()
    diameter, sigma = rows.loc[
        0, ["entrance_pupil_diameter_mm", "sigma_entrance_pupil_diameter_mm"]
    ]
    assert abs(diameter - 12.0) < 3 * np.hypot(
        sigma, 12.0 * rows["sigma_object_distance_mm"][0] / objective
    )
    assert 0.01 * 12 < sigma < 0.03 * 12
    assert rows["entrance_pupil_diameter_mm"].isna()[1]
    assert measured.evidence[0]["entrance_pupil_unknown"] is None
    assert "has 0 pictures about its peak" in measured.evidence[1]["entrance_pupil_unknown"]
    blind = replace(recording.settings[0], focus=None)
    lost = calibrate_recording(replace(recording, settings=(blind,)))
    assert lost.rows[["sharpest_confidence", "pupil_iris"]].isna().all().all()
    assert "no autofocus was recorded" in lost.evidence[0]["entrance_pupil_unknown"]


def min_first(*names):
    """The columns name the quantity first that comes first."""
    return "_".join(sorted(names, key=CORRELATED.index))


def test_covariances_belong_together(table):
    row = table.to_dataframe().iloc[0]
    shared = row["cov_magnification_object_distance_mm"]
    limit = row["sigma_magnification"] * row["sigma_object_distance_mm"]
    assert 0 < abs(shared) <= limit
    assert row["cov_object_distance_mm_nodal_offset_mm"] == pytest.approx(
        row["sigma_object_distance_mm"] ** 2, rel=0.05
    )
    # Standoff is D minus offset, and so are its covariances.
    for name in ("magnification", "object_distance_mm", "image_distance_mm"):
        of_distance = (
            row["sigma_object_distance_mm"] ** 2
            if name == "object_distance_mm"
            else row[f"cov_{min_first(name, 'object_distance_mm')}"]
        )
        expected = of_distance - row[f"cov_{name}_nodal_offset_mm"]
        scale = row[f"sigma_{name}"] * row["sigma_object_distance_mm"]
        assert row[f"cov_{name}_standoff_mm"] == pytest.approx(expected, abs=1e-9 * scale)


def test_a_failed_setting_is_left_out_with_its_reason(recording):
    """A recording with holes: one setting lost its focus view, one has a single poor view."""
    good, other = recording.settings
    lost = replace(other, focus_view=None)
    poor = replace(good, setting=LensSetting(30, 1), views=good.views[:1])
    table = calibrate_recording(replace(recording, settings=(good, lost, poor)))
    assert len(table) == 1
    reasons = [(f.zoom, f.reason) for f in table.failures]
    assert reasons[0] == (20.0, "its focus view was lost, so that D is not known")
    assert reasons[1][0] == 30.0


def _with_nonsense_in_the_focus_view(record):
    views = list(record.views)
    first = views[0].observation
    nonsense = np.random.default_rng(1).uniform(0, 1000, first.pixels.shape)
    views[0] = replace(views[0], observation=replace(first, pixels=nonsense))
    return replace(record, views=tuple(views))


def test_a_rejected_focus_view_fails_the_setting_without_a_robot(recording):
    record = _with_nonsense_in_the_focus_view(recording.settings[0])
    outcome = calibrate_setting(recording.head, Job(record), SweepOptions(use_robot=False))
    assert outcome == "its focus view was rejected, so that D is not known"


def test_the_robot_knows_the_plane_of_a_rejected_focus_view(recording):
    record = _with_nonsense_in_the_focus_view(recording.settings[0])
    row, evidence = calibrate_setting(recording.head, Job(record), SweepOptions())
    error = row["object_distance_mm"] - TRUTH[(10.0, 1.0)][1]
    assert abs(error) < 4 * row["sigma_object_distance_mm"]
    assert "view 0 was rejected; D is to where the robot says its plane was" in evidence["warnings"]


def test_a_robot_that_makes_no_sense_is_done_without(recording):
    record = recording.settings[0]
    hands = [view.base_from_hand for view in record.views]
    views = tuple(replace(view, base_from_hand=hands[i - 2]) for i, view in enumerate(record.views))
    row, evidence = calibrate_setting(
        recording.head, Job(replace(record, views=views)), SweepOptions()
    )
    assert evidence["robot"] is None
    assert any(w.startswith("the poses of the robot were not used: ") for w in evidence["warnings"])
    assert row["object_distance_mm"] > 0


def test_the_stated_mounting_serves_where_the_robot_was_left_out(recording):
    rows = calibrate_recording(recording, use_robot=False).to_dataframe()
    for row in rows.to_dict("records"):
        _, objective, offset = TRUTH[(row["zoom"], row["focus"])]
        assert row["standoff_mm"] == pytest.approx(objective - offset, abs=1e-6)
        assert row["sigma_standoff_mm"] == row["sigma_sharpest_mm"]
        assert row["sigma_nodal_offset_mm"] == row["sigma_object_distance_mm"]
        assert row["cov_magnification_nodal_offset_mm"] == pytest.approx(
            row["cov_magnification_object_distance_mm"]
        )
        assert np.isnan(row["nodal_x_mm"])


def test_a_free_scale_factor_has_a_column(recording):
    wrong = replace(recording.head.sensor, scale_factor=1.1)
    table = calibrate_recording(
        replace(recording, head=replace(recording.head, sensor=wrong)), free_scale_factor=True
    )
    rows = table.to_dataframe()
    error = (rows["scale_factor"] - 1.0).abs()
    assert (error < 4 * rows["sigma_scale_factor"]).all()
    assert (rows["sigma_scale_factor"] < 1e-3).all()


@pytest.mark.parametrize("version", range(1, VERSION))
def test_tables_of_older_versions_are_read(table, tmp_path, version):
    """They lack columns; what these hold is not known."""
    path = table.save(tmp_path / "table.csv")
    lacking = ["nodal_x_mm", "temperature_c", "pupil_iris", "entrance_pupil_diameter_mm"]
    rows = table.to_dataframe().drop(columns=lacking)
    path.write_text(rows.to_csv(index=False, lineterminator="\n"))
    body = read_document(path.with_suffix(".json"), "calibration-table", VERSION)
    del body["version"]
    body["csv_sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
    write_document(path.with_suffix(".json"), "calibration-table", version, body)
    again = CalibrationTable.load(path).to_dataframe()
    assert again[lacking].isna().all().all()
    pd.testing.assert_series_equal(again["magnification"], table.rows["magnification"])


def test_one_setting_is_calibrated_as_in_the_sweep(recording, table):
    setting = recording.settings[1].setting
    alone = calibration_of(recording, setting)
    row = table.to_dataframe().iloc[1]
    assert alone.value("standoff_mm") == row["standoff_mm"]
    assert alone.rms_px == row["rms_px"]
    with pytest.raises(InputError, match="zoom 7, focus 7 is not among the 2 settings"):
        calibration_of(recording, LensSetting(7.0, 7.0))


def test_no_setting_at_all_is_an_error(recording):
    lost = tuple(replace(record, focus_view=None) for record in recording.settings)
    with pytest.raises(
        CalibrationError, match="none of the 2 settings could be calibrated; the fi"
    ):
        calibrate_recording(replace(recording, settings=lost))
    with pytest.raises(InputError, match="the recording has no finished setting; record a session"):
        calibrate_recording(replace(recording, settings=()))


def test_without_a_robot_there_is_no_standoff(recording):
    head = replace(recording.head, hand_from_camera=None)
    rows = calibrate_recording(replace(recording, head=head)).to_dataframe()
    columns = ["standoff_mm", "nodal_offset_mm", "sigma_nodal_offset_mm", "sigma_standoff_mm"]
    assert rows[columns].isna().all().all()
    assert rows["cov_magnification_nodal_offset_mm"].isna().all()
    assert rows["object_distance_mm"].notna().all()
    assert np.isnan(standoff_of(head, recording.settings[0]))


def test_options_and_progress(recording):
    told = []
    table = calibrate_recording(
        recording,
        principal_point_px=(620.0, 505.0),
        radial_terms=0,
        progress=lambda done, total, last: told.append((done, total, last)),
    )
    rows = table.to_dataframe()
    assert (rows["k1_per_mm2"] == 0).all()
    assert (rows["principal_point_x_px"] == 620.0).all()
    assert rows["sigma_principal_point_x_px"].isna().all()
    assert told == [(1, 2, "zoom 10, focus 1"), (2, 2, "zoom 20, focus 1")]


def test_processes_give_the_same_table(recording, table):
    pd.testing.assert_frame_equal(
        calibrate_recording(recording, workers=2).to_dataframe(), table.to_dataframe()
    )


def test_a_table_comes_back_as_it_was(table, tmp_path):
    path = table.save(tmp_path / "new" / "table.csv")
    again = CalibrationTable.load(path)
    pd.testing.assert_frame_equal(again.to_dataframe(), table.to_dataframe())
    assert again.sensor == table.sensor
    assert again.reference_setting == table.reference_setting
    assert again.recording_sha256 == table.recording_sha256
    assert len(again.recording_sha256) == 64
    assert again.failures == table.failures
    assert again.evidence == table.evidence
    assert set(again.versions) == {"lenscal", "numpy", "scipy"}
    evidence = again.evidence[0]
    size = len(evidence["quantities"])
    assert np.shape(evidence["covariance"]) == (size, size)
    assert len(evidence["rms_px_of_views"]) == len(evidence["poses"]) == 5


def test_failures_are_saved_too(recording, tmp_path):
    lost = replace(recording.settings[1], focus_view=None)
    table = calibrate_recording(replace(recording, settings=(recording.settings[0], lost)))
    assert CalibrationTable.load(table.save(tmp_path / "t.csv")).failures == table.failures


def test_rejections_are_evidence(recording):
    record = recording.settings[0]
    views = list(record.views)
    observation = views[2].observation
    pixels = observation.pixels.copy()
    pixels[7] += 9.0
    # Ids are not positions: this board was seen without its first three corners.
    partial = Observation(observation.ids[3:], observation.points_mm[3:], pixels[3:])
    views[2] = replace(views[2], observation=partial)
    _, evidence = calibrate_setting(
        recording.head, Job(replace(record, views=tuple(views))), SweepOptions()
    )
    (rejected,) = evidence["rejected"]
    assert (rejected["view"], rejected["point_id"]) == (2, 7)
    assert rejected["residual_px"] == pytest.approx(9 * np.sqrt(2), abs=0.6)


def test_an_altered_table_is_refused(table, tmp_path):
    path = table.save(tmp_path / "table.csv")
    path.write_text(path.read_text().replace("from_above", "from_below"))
    with pytest.raises(FileError, match=r"is not the table that table.json was written with"):
        CalibrationTable.load(path)


def test_altered_evidence_is_refused(table, tmp_path):
    path = table.save(tmp_path / "table.csv")
    document = path.with_suffix(".json")
    document.write_text(document.read_text().replace('"noise_px": 0.', '"noise_px": 1.'))
    with pytest.raises(FileError, match="was altered after it was written"):
        CalibrationTable.load(path)


def test_missing_and_newer_files_are_refused(table, tmp_path):
    path = table.save(tmp_path / "table.csv")
    body = read_document(path.with_suffix(".json"), "calibration-table", VERSION)
    del body["version"]
    write_document(path.with_suffix(".json"), "calibration-table", VERSION + 1, body)
    with pytest.raises(
        FileError, match=f"has version {VERSION + 1} of the calibration-table form; this lenscal"
    ):
        CalibrationTable.load(path)
    with pytest.raises(FileError, match="a calibration table is a .csv file, but 'table.txt'"):
        table.save(tmp_path / "table.txt")
    table.save(path)
    path.unlink()
    with pytest.raises(FileError, match=r"cannot read .*table.csv: No such file"):
        CalibrationTable.load(path)


def test_columns_must_be_there(table):
    rows = table.to_dataframe().drop(columns=["rms_px"])
    with pytest.raises(InputError, match="a calibration table needs the columns rms_px too"):
        CalibrationTable(rows, SENSOR)


def test_the_table_is_not_changed_through_its_copies(table):
    frame = table.to_dataframe()
    frame["zoom"] = -1.0
    assert (table.to_dataframe()["zoom"] > 0).all()


def test_every_setting_of_the_shared_session_is_calibrated():
    """Forty settings from 3.5° to 1° of view, whose weakest parameters hardly show."""
    folder = Path(__file__).parents[3] / "data" / "vicon-1990"
    table = calibrate_recording(Recording.load(folder / "session"))
    assert table.failures == ()
    kept = CalibrationTable.load(folder / "table.csv").to_dataframe()
    found = table.to_dataframe()
    for quantity in ("magnification", "object_distance_mm", "standoff_mm"):
        sigma = kept[f"sigma_{quantity}"]
        assert ((found[quantity] - kept[quantity]).abs() < 0.05 * sigma).all(), quantity
