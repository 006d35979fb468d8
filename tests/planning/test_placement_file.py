"""The table [placement] of a task file, and what `lenscal plan` makes of it."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from lenscal.camera_mount import CameraMount
from lenscal.cli.calibrate import calibrate
from lenscal.document import write_document
from lenscal.errors import CalibrationError, FileError, InputError, PlanningError
from lenscal.pose import Pose
from lenscal.recording import Recording
from lenscal.sequence import Sequence
from lenscal.setting import ApproachSide
from planning import cli
from planning.placement_file import mount_of_session
from planning.task_file import load_cell


@pytest.fixture(scope="module")
def data(request):
    return request.config.rootpath / "data"


@pytest.fixture
def folder(data, tmp_path):
    """The task of the data folder, with its files beside it."""
    shutil.copy(data / "part.stl", tmp_path)
    shutil.copytree(data / "vicon-1990", tmp_path / "vicon-1990")
    shutil.copy(data / "task.toml", tmp_path)
    return tmp_path


def change(folder, old, new):
    text = (folder / "task.toml").read_text()
    assert old in text
    (folder / "task.toml").write_text(text.replace(old, new))


def run(folder, *words):
    arguments = [str(folder / "task.toml"), "-o", str(folder / "plan.json"), *map(str, words)]
    return CliRunner().invoke(cli.plan, arguments, catch_exceptions=False)


def test_a_cell_as_it_is_written(data) -> None:
    cell = load_cell(data / "task.toml")
    head = Recording.load(data / "vicon-1990" / "session").head
    assert cell.mount.anchors_offsets
    assert cell.mount.identity == head.identity
    np.testing.assert_array_equal(cell.mount.hand_from_camera.matrix, head.hand_from_camera.matrix)
    # The part lies where the board lay, seen from its other side.
    turned = head.base_from_target @ Pose.from_rotation_vector([np.pi, 0, 0])
    np.testing.assert_allclose(cell.base_from_part.matrix, turned.matrix, atol=1e-12)
    sigmas = np.sqrt(np.diag(cell.part_covariance))
    np.testing.assert_allclose(sigmas, np.repeat([np.radians(0.0115), 0.05], 3))
    assert cell.repeatability.translation_mm == 0.02
    np.testing.assert_allclose(cell.reach.high_mm, [1300, 800, 1300])
    assert (cell.reach.tilt_limit_deg, cell.iris, cell.approach) == (45, 20, None)


def test_what_is_left_out_is_known_exactly(folder) -> None:
    text = (folder / "task.toml").read_text()
    head, _, _ = text.partition("part_sigma")
    (folder / "task.toml").write_text(head + 'approach = "from_above"\n')
    cell = load_cell(folder / "task.toml")
    assert (cell.part_covariance, cell.repeatability, cell.reach) == (None, None, None)
    assert cell.approach is ApproachSide.FROM_ABOVE


def test_plan_writes_the_sequence_and_the_placements(folder) -> None:
    done = run(folder, "--placements", folder / "placements.csv")
    assert done.exit_code == 0
    # This map tells everything that a placement asks for.
    assert "note:" not in done.output
    assert "next: lenscal rig run" in done.output
    sequence = Sequence.load(folder / "sequence.json")
    assert len(sequence) > 6
    assert (folder / "placements.csv").read_text().count("\n") == len(sequence) + 1


def test_plan_names_what_is_out_of_reach_and_what_the_map_does_not_tell(folder) -> None:
    path = folder / "vicon-1990" / "map.json"
    older = json.loads(path.read_text())
    for name in ("nodal_x_mm", "nodal_y_mm"):
        del older["surfaces"][name]
    body = {key: older[key] for key in older.keys() - {"lenscal", "version", "sha256"}}
    write_document(path, "lens-map", older["version"], body)
    change(folder, '"1.3 m"], tilt_deg', '"60 cm"], tilt_deg')
    done = run(folder, "--sequence", folder / "some" / "s.json")
    assert "note: the lens map does not map the lateral wander" in done.output
    assert "is left out: z = " in done.output
    assert len(Sequence.load(folder / "some" / "s.json")) > 1


def test_without_a_cell_there_is_no_sequence(folder) -> None:
    text = (folder / "task.toml").read_text()
    (folder / "task.toml").write_text(text.partition("[placement]")[0])
    assert load_cell(folder / "task.toml") is None
    assert run(folder).exit_code == 0
    assert not (folder / "sequence.json").exists()
    with pytest.raises(PlanningError, match="does not say where the robot stands; add a table"):
        run(folder, "--sequence", folder / "s.json")


def test_a_hand_eye_file_takes_the_place_of_a_session(folder) -> None:
    mount = mount_of_session(Recording.load(folder / "vicon-1990" / "session"))
    mount.save(folder / "hand_eye.json")
    change(folder, '"vicon-1990/session"', '"hand_eye.json"')
    cell = load_cell(folder / "task.toml")
    np.testing.assert_array_equal(cell.mount.covariance, mount.covariance)
    CameraMount(
        mount.hand_from_camera, mount.covariance, mount.reference_setting, {"rig": "number 7"}
    ).save(folder / "hand_eye.json")
    with pytest.raises(PlanningError, match="is of another rig than the lens map: its rig is 'num"):
        run(folder)
    assert not (folder / "sequence.json").exists()


def test_the_hand_eye_that_calibrate_writes_places_the_camera(folder, tmp_path) -> None:
    """One setting of the session will do: its rig stated the mounting."""
    session = Recording.load(folder / "vicon-1990" / "session")
    Recording(session.head, session.settings[:1]).save(tmp_path / "short")
    arguments = [str(tmp_path / "short"), "--mount", str(folder / "mount.json")]
    done = CliRunner().invoke(calibrate, arguments, catch_exceptions=False)
    assert (
        f"camera on the hand at zoom 72.5325, focus 100, iris 100, as the rig stated it: "
        f"{folder / 'mount.json'} (σ up to 0.050 mm and 0.200 mrad)"
    ) in done.output
    stated = Sequence.load(_placed(folder, "vicon-1990/session"))
    sequence = Sequence.load(_placed(folder, "mount.json"))
    assert len(sequence) == len(stated) > 6
    for one, other in zip(stated.stations, sequence.stations, strict=True):
        np.testing.assert_array_equal(one.base_from_hand.matrix, other.base_from_hand.matrix)
    blind = replace(session.head, hand_eye_sigma_mm=None)
    Recording(blind, session.settings[:1]).save(tmp_path / "blind")
    with pytest.raises(CalibrationError, match="blind never was at the reference setting, zoom 72"):
        CliRunner().invoke(
            calibrate, [str(tmp_path / "blind"), *arguments[1:]], catch_exceptions=False
        )


def _placed(folder, hand_eye):
    text = (folder / "task.toml").read_text()
    line = next(line for line in text.splitlines() if line.startswith("hand_eye"))
    (folder / "task.toml").write_text(text.replace(line, f'hand_eye = "{hand_eye}"'))
    assert run(folder).exit_code == 0
    return folder / "sequence.json"


def test_a_session_that_does_not_know_its_mounting(data) -> None:
    recording = Recording.load(data / "vicon-1990" / "session")
    blind = replace(recording, head=replace(recording.head, hand_from_camera=None))
    with pytest.raises(
        PlanningError, match="does not say how the camera sits on the hand, and how"
    ):
        mount_of_session(blind)
    vague = replace(recording, head=replace(recording.head, hand_eye_sigma_mm=None))
    with pytest.raises(
        PlanningError, match="such as `lenscal calibrate SESSION --mount mount.json`"
    ):
        mount_of_session(vague)


@pytest.mark.parametrize(
    ("old", "new", "error", "message"),
    [
        ('translation = "0.05 mm"', "translation = 0.05", InputError, "part_sigma.*needs its unit"),
        ('"60 cm", "10 cm"', '"60", "10 cm"', InputError, "'60' has no unit"),
        ('"vicon-1990/session"', '"none.json"', FileError, "cannot read .*none.json"),
        ("tilt_deg = 45", "tilt_deg = 450", InputError, "placement.reach.tilt_deg: "),
        ('translation = "0.02 mm"', 'translation = "-1 mm"', InputError, "repeatability.translat"),
        ("iris = 20", 'iris = 20\napproach = "sideways"', InputError, "placement.approach: "),
    ],
)
def test_cells_that_are_not_understood(folder, old, new, error, message) -> None:
    change(folder, old, new)
    with pytest.raises(error, match=message):
        load_cell(folder / "task.toml")
