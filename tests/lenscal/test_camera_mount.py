import json

import numpy as np
import pytest

from lenscal.camera_mount import CameraMount, differences
from lenscal.document import digest
from lenscal.errors import FileError, InputError
from lenscal.pose import Pose
from lenscal.setting import LensSetting

POSE = Pose.from_rotation_vector([0.1, 0.2, 1.5], [30, -20, 80])
COVARIANCE = np.diag([1e-8, 2e-8, 3e-8, 0.01, 0.02, 0.3])
SETTING = LensSetting(72.5, 100, 100)


def test_a_mounting_is_read_back(tmp_path):
    mount = CameraMount(POSE, COVARIANCE, SETTING, {"lens": "L"})
    read = CameraMount.load(mount.save(tmp_path / "hand_eye.json"))
    np.testing.assert_array_equal(read.hand_from_camera.matrix, POSE.matrix)
    np.testing.assert_array_equal(read.covariance, COVARIANCE)
    assert (read.reference_setting, read.identity) == (SETTING, {"lens": "L"})
    assert not read.anchors_offsets


def test_what_a_rig_states_anchors_the_offsets():
    mount = CameraMount.stated(POSE, SETTING, {}, 2e-4, 0.05)
    np.testing.assert_allclose(np.sqrt(np.diag(mount.covariance)), [2e-4] * 3 + [0.05] * 3)
    assert mount.anchors_offsets


def test_a_covariance_that_is_none():
    for bad in (-COVARIANCE, COVARIANCE + np.eye(6, k=1) * 1e-4):
        with pytest.raises(InputError, match="covariance of a mounting must be symmetric with"):
            CameraMount(POSE, bad, SETTING)


def test_a_sealed_file_that_says_too_little(tmp_path):
    body = {"identity": {}}
    path = tmp_path / "h.json"
    path.write_text(
        json.dumps({"lenscal": "hand-eye", "version": 1, "sha256": digest(body), **body})
    )
    with pytest.raises(FileError, match="h.json is no whole hand-eye calibration"):
        CameraMount.load(path)


def test_only_what_both_state_is_compared():
    one = {"lens": "a", "camera": "b", "rig": "r"}
    assert differences(one, {"lens": "a", "camera": "c", "begun": "today"}) == ["camera"]
    assert differences(one, {}) == []
