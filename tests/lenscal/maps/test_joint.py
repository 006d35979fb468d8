"""A lens whose distance and ratio change smoothly, seen at 4 × 4 settings, two of them squarely."""

from dataclasses import replace

import numpy as np
import pytest

from lenscal.calibration.sweep import calibrate_recording
from lenscal.camera import Camera
from lenscal.errors import InputError, MapError
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.joint import refine_lens_map
from lenscal.maps.lens_map import LensMap
from lenscal.pose import Pose
from lenscal.recording import FocusResult, Head, Observation, Recording, SettingRecord, View
from lenscal.sensor import Sensor
from lenscal.setting import LensSetting
from lenscal.target import Chessboard

SENSOR = Sensor(1224, 1024, 0.0069, 0.0069)
BOARD = Chessboard(13, 10, 3.0)
ZOOMS, FOCUSES = (10.0, 20.0, 30.0, 40.0), (1.0, 2.0, 3.0, 4.0)
HAND_FROM_CAMERA = Pose.from_rotation_vector((0.02, -0.01, 0.5), (10.0, 20.0, 80.0))
BASE_FROM_TARGET = Pose.from_rotation_vector((1.0, 0.2, -0.1), (400.0, 50.0, 20.0))
STANDOFF_MM = 420.0
TURNED = ((22, 0), (-22, 0), (0, 22), (0, -22))
#: Settings that are seen squarely only.
SQUARE = (5, 10)


def _distance_mm(zoom, focus):
    return 450.0 + 2.0 * zoom + 8.0 * focus


def _ratio(zoom, focus):
    return 0.13 * np.exp(0.008 * zoom + 0.02 * focus)


def _record(zoom, focus, rng, tilts):
    distance = _distance_mm(zoom, focus)
    camera = Camera(SENSOR, _ratio(zoom, focus) * distance, 3e-4, (620.0, 505.0))
    reference_from_camera = Pose(np.eye(3), (0.1, 0.0, STANDOFF_MM - distance))
    sharp = Pose(np.eye(3), (0.0, 0.0, STANDOFF_MM))
    poses = [sharp @ Pose.from_rotation_vector((*np.radians(tilt), 0.0)) for tilt in tilts]
    views = []
    for reference_from_target in poses:
        hand = BASE_FROM_TARGET @ reference_from_target.inverse() @ HAND_FROM_CAMERA.inverse()
        slip = Pose.from_rotation_vector(
            1e-4 * rng.standard_normal(3), 0.02 * rng.standard_normal(3)
        )
        camera_from_target = (
            hand @ slip @ HAND_FROM_CAMERA @ reference_from_camera
        ).inverse() @ BASE_FROM_TARGET
        exact = camera.project(camera_from_target.transform(BOARD.points_mm))
        inside = SENSOR.contains(exact)
        seen = exact[inside] + 0.05 * rng.standard_normal((inside.sum(), 2))
        views.append(View(Observation.of(BOARD, BOARD.ids()[inside], seen), hand, 3.0))
    found = FocusResult(STANDOFF_MM, 0.02, 0.9, 1.0, np.zeros(0), np.zeros(0))
    return SettingRecord(LensSetting(zoom, focus), tuple(views), focus=found)


def _recording(seed, square=()):
    rng = np.random.default_rng(seed)
    head = Head(SENSOR, BOARD, LensSetting(10.0, 1.0), HAND_FROM_CAMERA, BASE_FROM_TARGET)
    settings = [(zoom, focus) for zoom in ZOOMS for focus in FOCUSES]
    records = [
        _record(*setting, rng, ((0, 0),) if number in square else ((0, 0), *TURNED))
        for number, setting in enumerate(settings)
    ]
    return Recording(head, tuple(records))


def _plane():
    return np.meshgrid(np.linspace(10, 40, 13), np.linspace(1, 4, 9))


@pytest.mark.parametrize("with_robot", [False, True])
def test_where_settings_are_well_determined_nothing_changes(with_robot):
    recording = _recording(0)
    table = calibrate_recording(recording, use_robot=with_robot)
    rows = table.to_dataframe()
    if not with_robot:
        rows = rows.drop(columns=["standoff_mm", "sigma_standoff_mm", "nodal_offset_mm"])
    smoothed = fit_lens_map(rows, sensor=SENSOR)
    joint = refine_lens_map(smoothed, recording, use_robot=with_robot)
    for quantity in ("magnification", "object_distance_mm", "focal_length_mm"):
        apart = joint.value(quantity, *_plane()) - smoothed.value(quantity, *_plane())
        assert (np.abs(apart) < 0.2 * smoothed.sigma(quantity, *_plane())).all(), quantity


def test_settings_that_cannot_be_calibrated_hold_the_map_up():
    """Seen squarely they know d/D; alone they have no answer, in the joint map they are samples."""
    recording = _recording(1, SQUARE)
    table = calibrate_recording(recording, use_robot=False)
    rows = table.to_dataframe().drop(columns=["standoff_mm", "nodal_offset_mm"])
    assert len(rows) == 14
    smoothed = fit_lens_map(rows, sensor=SENSOR)
    joint = refine_lens_map(smoothed, recording, use_robot=False)
    assert len(joint.samples) == 16
    for number in SQUARE:
        setting = recording.settings[number].setting
        at = setting.zoom, setting.focus
        assert joint.sigma("magnification", *at) < smoothed.sigma("magnification", *at)
        error = joint.magnification(*at) / _ratio(*at) - 1
        assert abs(error) < 3e-4
    distance = joint.object_distance_mm(*_plane())
    error = (distance - _distance_mm(*_plane())) / joint.sigma("object_distance_mm", *_plane())
    assert np.sqrt(np.mean(error**2)) < 2.0


def test_a_joint_map_is_saved_and_loaded(tmp_path):
    recording = _recording(2)
    joint = refine_lens_map(fit_lens_map(calibrate_recording(recording)), recording)
    again = LensMap.load(joint.save(tmp_path / "map.json"))
    np.testing.assert_allclose(
        again.standoff_mm(*_plane()), joint.standoff_mm(*_plane()), rtol=1e-9
    )


def test_what_cannot_be_refined_is_named():
    recording = _recording(3)
    table = calibrate_recording(recording)
    lens_map = fit_lens_map(table)
    with pytest.raises(MapError, match="standoffs cannot be refined without the robot"):
        refine_lens_map(lens_map, recording, use_robot=False)
    with pytest.raises(MapError, match="without a sensor, so it has no camera to refine"):
        refine_lens_map(fit_lens_map(table.to_dataframe()), recording)
    lost = tuple(replace(record, focus_view=None) for record in recording.settings)
    with pytest.raises(InputError, match="no setting that can be asked"):
        refine_lens_map(lens_map, replace(recording, settings=lost))
