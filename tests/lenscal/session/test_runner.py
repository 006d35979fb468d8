import numpy as np
import pytest

from lenscal.errors import FileError, InputError, OutOfRangeError, SessionError
from lenscal.plate import parse_target
from lenscal.recording import JOURNAL, Recording
from lenscal.rig.simulated import SimulatedRig
from lenscal.session.aim import hand_pose
from lenscal.session.plan import SessionPlan
from lenscal.session.runner import points_of_interest, run_session


def small_plan(**changes):
    content = {
        "zoom": (98.0, 105.0),
        "focus": (100.0,),
        "autofocus": {"nearest": "364 mm", "farthest": "382 mm", "step": "1.5 mm", "iris": 100},
        "views": {"tilted": 3, "tilt_deg": 25, "iris": 20},
    }
    return SessionPlan.model_validate({**content, **changes})


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    rig = SimulatedRig.preset("vicon-1990", seed=5)
    told = []
    folder = tmp_path_factory.mktemp("session") / "first"
    recording = run_session(
        small_plan(), rig, folder, progress=lambda *news: told.append(news), clock=lambda: 0.0
    )
    return rig, recording, told


def test_every_setting_has_its_views_and_its_focus(recorded):
    rig, recording, told = recorded
    assert [(s.setting.zoom, s.setting.focus) for s in recording.settings] == [
        (98, 100),
        (105, 100),
    ]
    for record in recording.settings:
        assert len(record.views) == 4
        assert record.focus_view == 0
        assert record.notes == ()
        truth = rig.truth(record.setting)
        assert record.focus.distance_mm == pytest.approx(truth.standoff_mm, abs=0.3)
    assert told == [(1, 2, "zoom 98, focus 100"), (2, 2, "zoom 105, focus 100")]


def test_the_iris_is_open_to_focus_and_closed_for_views(recorded):
    _, recording, _ = recorded
    for record in recording.settings:
        assert record.focus.iris == 100
        assert {view.iris for view in record.views} == {20}
        assert record.setting.iris == 20


def test_the_views_look_at_the_board_from_where_the_plan_says(recorded):
    """The untilted view faces the board at the sharpest standoff; the others are 25° off it."""
    rig, recording, _ = recorded
    for record in recording.settings:
        normals = []
        for view in record.views:
            target_from_camera = (
                rig.base_from_target.inverse() @ view.base_from_hand @ rig.hand_from_camera
            )
            normals.append(target_from_camera.rotation[:, 2])
            # The axis meets the middle of the board at the standoff.
            reach = target_from_camera.transform([0.0, 0.0, record.focus.distance_mm])
            np.testing.assert_allclose(reach, 0, atol=1e-6)
        tilts = np.rad2deg(np.arccos(np.clip(np.array(normals) @ [0, 0, 1], -1, 1)))
        np.testing.assert_allclose(tilts, [0, 25, 25, 25], atol=1e-4)


def test_what_is_on_the_disk_is_what_was_returned(recorded):
    _, recording, _ = recorded
    loaded = Recording.load(recording.folder)
    assert loaded.head.identity["begun"] == "1970-01-01T00:00:00Z"
    assert SessionPlan.model_validate(loaded.head.plan) == small_plan()
    for ours, theirs in zip(recording.settings, loaded.settings, strict=True):
        for a, b in zip(ours.views, theirs.views, strict=True):
            np.testing.assert_array_equal(a.observation.pixels, b.observation.pixels)
            assert (recording.folder / b.frame).is_file()


def test_a_second_session_in_the_same_folder_is_refused(recorded):
    rig, recording, _ = recorded
    before = (recording.folder / JOURNAL).read_bytes()
    with pytest.raises(SessionError, match="holds another session already; choose another folder"):
        run_session(small_plan(), rig, recording.folder)
    assert (recording.folder / JOURNAL).read_bytes() == before


def test_a_setting_beyond_the_travel_stops_before_anything_moves(tmp_path):
    rig = SimulatedRig.preset("vicon-1990")
    before = rig.lens.setting
    with pytest.raises(OutOfRangeError, match="zoom 300 lies outside the travel"):
        run_session(small_plan(zoom=(98.0, 300.0)), rig, tmp_path / "s")
    assert rig.lens.setting == before
    assert not (tmp_path / "s").exists()


def test_a_setting_that_cannot_be_focused_is_passed_over_with_its_reason(tmp_path):
    search = {
        "nearest": "340 mm",
        "farthest": "350 mm",
        "step": "2 mm",
        "iris": 100,
        "extensions": 0,
    }
    rig = SimulatedRig.preset("vicon-1990")
    recording = run_session(small_plan(autofocus=search, zoom=(105.0,)), rig, tmp_path / "s")
    (record,) = recording.settings
    assert record.views == ()
    assert record.notes[0].startswith("not focused: ")
    assert Recording.load(tmp_path / "s").settings[0].notes == record.notes


def test_displaced_views_face_the_board_from_farther_or_nearer(tmp_path):
    views = {"displacements": ["-3 mm", "1.5 mm"], "tilted": 2, "tilt_deg": 20, "iris": 20}
    rig = SimulatedRig.preset("vicon-1990", seed=2)
    plan = small_plan(zoom=(98.0,), views=views, keep_frames=False)
    (record,) = run_session(plan, rig, tmp_path / "s").settings
    assert (len(record.views), record.focus_view, record.notes) == (5, 0, ())
    first = record.views[0].base_from_hand @ rig.hand_from_camera
    for view, displacement_mm in zip(record.views[1:3], (-3.0, 1.5), strict=True):
        moved = first.inverse() @ view.base_from_hand @ rig.hand_from_camera
        np.testing.assert_allclose(moved.matrix[:3, :3], np.eye(3), atol=1e-9)
        np.testing.assert_allclose(moved.translation_mm, [0, 0, -displacement_mm], atol=1e-9)
    # What is nearer appears larger: by 3 mm and 1.5 mm of D.
    sizes = [np.ptp(view.observation.pixels[:, 0]) for view in record.views[:3]]
    distance_mm = rig.truth(record.setting).object_distance_mm
    expected = [distance_mm / (distance_mm + d) for d in (-3.0, 1.5)]
    np.testing.assert_allclose(np.array(sizes[1:]) / sizes[0], expected, rtol=1e-3)


def test_a_view_out_of_reach_is_left_out_with_its_reason(tmp_path):
    views = {"displacements": ["1.5 m"], "tilted": 2, "tilt_deg": 55, "iris": 20}
    rig = SimulatedRig.preset("vicon-1990", seed=2)
    plan = small_plan(zoom=(98.0,), views=views, keep_frames=False)
    (record,) = run_session(plan, rig, tmp_path / "s").settings
    assert len(record.views) == 1
    assert "view 1 left out: z = " in record.notes[0]
    assert "view 2 left out: the hand cannot tilt 55.0 degrees" in record.notes[1]


def test_a_setting_at_which_nothing_is_sharp_is_passed_over(tmp_path):
    rig = SimulatedRig.preset("machine-vision")
    search = {"nearest": "0.4 m", "farthest": "0.6 m", "step": "20 mm", "iris": 75}
    plan = small_plan(zoom=(0.0,), focus=(0.0,), autofocus=search)
    (record,) = run_session(plan, rig, tmp_path / "s").settings
    assert record.notes[0].startswith("not focused: no disk of the plate can be seen from 400 to ")


def test_the_temperature_goes_on_record(recorded):
    rig, recording, _ = recorded
    first, second = (record.temperature_c for record in recording.settings)
    assert 22 < first < second <= rig.camera.temperature_c < 40
    loaded = Recording.load(recording.folder)
    assert [record.temperature_c for record in loaded.settings] == [first, second]


def test_a_plate_without_a_choice_has_none_on_record(recorded):
    _, recording, _ = recorded
    assert {(r.focus_part, r.view_part) for r in recording.settings} == {(None, None)}


def test_each_setting_gets_the_disk_and_the_board_that_suit_its_magnification(tmp_path):
    """The first disk and the largest board of the plate would be too large here."""
    rig = SimulatedRig.preset("machine-vision", seed=3)
    search = {"nearest": "0.35 m", "farthest": "0.5 m", "step": "20 mm", "iris": 75}
    views = {"tilted": 2, "tilt_deg": 20, "iris": 20}
    plan = small_plan(zoom=(800.0,), focus=(6800.0,), autofocus=search, views=views)
    folder = tmp_path / "s"
    (record,) = run_session(plan.model_copy(update={"keep_frames": False}), rig, folder).settings
    assert record.notes == ()
    assert record.focus.distance_mm == pytest.approx(rig.truth(record.setting).standoff_mm, abs=0.3)
    (loaded,) = Recording.load(folder).settings
    for kept in (record, loaded):
        parts = [rig.target.parts[part][0].spec for part in (kept.focus_part, kept.view_part)]
        assert parts == ["disk:20mm", "charuco:13x10:10mm:7.5mm:DICT_4X4_250:65"]
    assert len(loaded.views) == 3
    for view in loaded.views:
        # All corners of that board, and the points of the plate that their ids stand for.
        assert set(view.observation.ids) >= set(rig.target.first_id(2) + np.arange(108))
        middle = view.observation.points_mm[:, :2].mean(axis=0)
        np.testing.assert_allclose(middle, [270, -165], atol=20)


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(SessionError, match="cannot make the folder .*file/s: "):
        run_session(small_plan(), SimulatedRig.preset("vicon-1990"), tmp_path / "file" / "s")


def test_a_target_without_a_disk_cannot_be_focused_on():
    with pytest.raises(SessionError, match="needs a plate with a disk .* is chessboard:9x6:25mm"):
        points_of_interest(parse_target("chessboard:9x6:25mm"))
    focus, view = points_of_interest(parse_target("charuco:17x13:3mm:2.25mm@0,0+disk:6mm@0,27"))
    assert (focus, view) == ((0.0, 27.0), (0.0, 0.0))


def test_a_frame_that_cannot_be_kept_stops_the_session(tmp_path, monkeypatch):
    rig, plan = SimulatedRig.preset("vicon-1990"), small_plan(zoom=(105.0,))
    monkeypatch.setattr("lenscal.session.runner.cv2.imwrite", lambda *_: False)
    with pytest.raises(FileError, match=r"cannot keep the frame .*00\.png; is the disk full"):
        run_session(plan, rig, tmp_path / "full")
    (tmp_path / "blocked").mkdir()
    (tmp_path / "blocked" / "frames").write_text("")
    with pytest.raises(FileError, match=r"cannot keep the frame .*00\.png: "):
        run_session(plan, rig, tmp_path / "blocked")


@pytest.mark.parametrize("standoff_mm", [0.0, -370.0, np.nan])
def test_a_target_behind_the_camera_cannot_be_aimed_at(standoff_mm):
    rig = SimulatedRig.preset("vicon-1990")
    with pytest.raises(InputError, match="a standoff must be positive, .* lie behind the camera"):
        hand_pose(rig, standoff_mm)
