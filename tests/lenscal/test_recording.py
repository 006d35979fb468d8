import numpy as np
import pytest

from lenscal.errors import FileError, InputError
from lenscal.journal import JournalWriter, read_journal
from lenscal.plate import parse_target
from lenscal.pose import Pose
from lenscal.recording import (
    JOURNAL,
    FocusResult,
    Head,
    Observation,
    Recording,
    SettingRecord,
    View,
    head_to_json,
    setting_to_json,
)
from lenscal.sensor import Sensor
from lenscal.setting import ApproachSide, LensSetting

TARGET = parse_target("chessboard:4x3:5mm")


@pytest.fixture
def recording() -> Recording:
    head = Head(
        Sensor(512, 480, 0.023, 0.01375, 0.70642),
        TARGET,
        LensSetting(98.0, 131.0, 20.0),
        Pose.from_rotation_vector([0.1, 0.2, 0.3], [1, 2, 3]),
        None,
        {"lens": "a lens"},
        {"zoom": [1.0]},
        2e-4,
        0.05,
    )
    seen = Observation.of(TARGET, np.array([0, 5]), np.array([[1.5, 2.5], [1 / 3, 4.0]]))
    curve = np.arange(5.0), np.arange(5.0) ** 2
    focus = FocusResult(370.1, 0.2, 0.9, 100.0, *curve, ("noted",), "tenengrad", 3, 2e-3)
    records = [
        SettingRecord(
            LensSetting(90.0, 60.0, 20.0),
            (View(seen, Pose.identity(), 20.0, "frames/0000/00.png"), View(seen)),
            0,
            focus,
            ApproachSide.FROM_ABOVE,
            ("all well",),
            temperature_c=31.25,
            focus_part=3,
            view_part=2,
        ),
        SettingRecord(LensSetting(92.0, 60.0), (), None, None, notes=("not focused",)),
    ]
    return Recording(head, tuple(records))


def test_a_recording_round_trips_to_the_bit(recording, tmp_path):
    loaded = Recording.load(recording.save(tmp_path / "a"))
    assert (loaded.save(tmp_path / "b") / JOURNAL).read_bytes() == (
        tmp_path / "a" / JOURNAL
    ).read_bytes()
    assert loaded.head.sensor == recording.head.sensor
    assert loaded.head.reference_setting == recording.head.reference_setting
    assert (loaded.head.hand_eye_sigma_rad, loaded.head.hand_eye_sigma_mm) == (2e-4, 0.05)
    view = loaded.settings[0].views[0]
    np.testing.assert_array_equal(view.observation.points_mm, TARGET.points_mm[[0, 5]])
    assert loaded.settings[0].approach is ApproachSide.FROM_ABOVE
    assert loaded.settings[0].focus.curve.shape == (5, 2)
    focus = loaded.settings[0].focus
    assert (focus.measure, focus.fine, focus.vergence_per_mm) == ("tenengrad", 3, 2e-3)
    assert loaded.settings[1].views == ()
    known, unknown = loaded.settings
    assert (known.temperature_c, known.focus_part, known.view_part) == (31.25, 3, 2)
    assert (unknown.temperature_c, unknown.focus_part, unknown.view_part) == (None, None, None)


def test_a_recording_from_before_temperatures_and_parts_is_read(recording, tmp_path):
    with JournalWriter(tmp_path / JOURNAL) as journal:
        journal.append(head_to_json(recording.head))
        entry = setting_to_json(recording.settings[0])
        for late in ("temperature_c", "focus_part", "view_part"):
            del entry[late]
        journal.append(entry)
    (record,) = Recording.load(tmp_path).settings
    assert len(record.views) == 2
    assert (record.temperature_c, record.focus_part, record.view_part) == (None, None, None)


def test_a_torn_last_line_costs_only_itself(recording, tmp_path):
    journal = recording.save(tmp_path) / JOURNAL
    whole = journal.read_bytes()
    second = whole.index(b"\n", whole.index(b"\n") + 1) + 1
    for cut in (second + 1, second + 40, len(whole) - 1):
        journal.write_bytes(whole[:cut])
        assert len(Recording.load(tmp_path).settings) == 1


def test_an_altered_line_is_an_error(recording, tmp_path):
    journal = recording.save(tmp_path) / JOURNAL
    journal.write_bytes(journal.read_bytes().replace(b"all well", b"all fine"))
    with pytest.raises(FileError, match="was altered: line 2 is not as it was written"):
        Recording.load(tmp_path)


def test_a_missing_line_is_an_error(recording, tmp_path):
    journal = recording.save(tmp_path) / JOURNAL
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(lines[0] + lines[2])
    with pytest.raises(FileError, match="was altered: line 2"):
        Recording.load(tmp_path)


def test_an_empty_folder_holds_no_recording(tmp_path):
    with pytest.raises(
        FileError, match="No such file .*give the folder that a session was recorded"
    ):
        Recording.load(tmp_path)
    (tmp_path / JOURNAL).write_bytes(b"")
    with pytest.raises(FileError, match="holds no recording: it does not begin with a whole head"):
        Recording.load(tmp_path)


def test_a_newer_recording_is_refused(recording, tmp_path):
    with JournalWriter(tmp_path / JOURNAL) as journal:
        journal.append({**head_to_json(recording.head), "version": 99})
    with pytest.raises(FileError, match="recorded by a newer version .form 99"):
        Recording.load(tmp_path)


def test_nothing_is_overwritten(recording, tmp_path):
    recording.save(tmp_path)
    with pytest.raises(FileError, match="holds a recording already"):
        recording.save(tmp_path)
    with pytest.raises(FileError, match="cannot begin the journal .*File exists"):
        JournalWriter(tmp_path / JOURNAL)


def test_every_entry_of_a_writer_is_on_the_disk_at_once(tmp_path):
    with JournalWriter(tmp_path / "j") as journal:
        for number in range(3):
            journal.append({"value": number})
            assert [e["value"] for e in read_journal(tmp_path / "j")] == list(range(number + 1))


def test_an_observation_needs_one_of_each():
    with pytest.raises(InputError, match="but has 1 ids, 2 points and 1 pixels"):
        Observation(np.array([0]), np.zeros((2, 3)), np.zeros((1, 2)))


def test_the_focus_view_must_be_there():
    with pytest.raises(
        InputError, match=r"focus_view 0 is not among the 0 views .*zoom 1, focus 2"
    ):
        SettingRecord(LensSetting(1, 2), (), focus_view=0)
