"""Sequences carried out on a simulated rig that looks at its board, which is quick."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from lenscal.errors import DeviceError, FileError, FocusError, OutOfRangeError, SessionError
from lenscal.journal import JournalWriter, read_journal
from lenscal.pose import Pose
from lenscal.rig.simulated import SimulatedRig
from lenscal.sequence import Sequence, Station
from lenscal.session.aim import hand_pose
from lenscal.session.pictures import SequenceRun
from lenscal.session.sequence_run import run_sequence
from lenscal.setting import ApproachSide, LensSetting

SETTINGS = [LensSetting(98, 131, 20), LensSetting(102, 89, 20), LensSetting(100, 100, 20)]


@pytest.fixture
def rig():
    return SimulatedRig.preset("vicon-1990", seed=0)


@pytest.fixture
def sequence(rig):
    stations = [
        Station(
            f"viewpoint {k}", s, ApproachSide.FROM_ABOVE, hand_pose(rig, 370.0 + k), 370.0 + k, 0.05
        )
        for k, s in enumerate(SETTINGS)
    ]
    return Sequence(stations, rig.identities(), {"task": "abc"})


def fail_at(monkeypatch, device, method, number, error):
    """Let a method of a device fail when it is called for the n-th time."""
    calls = []
    original = getattr(type(device), method)

    def failing(self, *arguments, **words):
        calls.append(1)
        if len(calls) == number:
            raise error
        return original(self, *arguments, **words)

    monkeypatch.setattr(type(device), method, failing)
    return calls


def test_every_station_is_visited_as_asked_and_recorded(rig, sequence, tmp_path, monkeypatch):
    asked = []
    original = type(rig.lens).move_to
    monkeypatch.setattr(
        type(rig.lens),
        "move_to",
        lambda self, s, side: asked.append((s, side)) or original(self, s, side),
    )
    told = []
    done = run_sequence(
        sequence, rig, tmp_path / "a" / "b", progress=lambda *w: told.append(w), clock=lambda: 0.0
    )
    assert asked == [(s, ApproachSide.FROM_ABOVE) for s in SETTINGS]
    assert told == [(k + 1, 3, f"viewpoint {k}") for k in range(3)]
    assert [p.setting for p in done.pictures] == SETTINGS
    for picture, station in zip(done.pictures, sequence.stations, strict=True):
        image = cv2.imread(str(done.folder / picture.frame), cv2.IMREAD_UNCHANGED)
        assert (image.shape, image.dtype, picture.bit_depth) == ((480, 512), np.uint8, 8)
        assert 0.5 < np.percentile(image, 95) / 255 < 0.95, "exposed well"
        assert picture.base_from_hand.distance_to(station.base_from_hand) == (0, 0)
    head, first, *_ = read_journal(tmp_path / "a" / "b" / "journal.jsonl")
    assert head["made_from"] == {"task": "abc"}
    assert head["begun"] == first["taken"] == "1970-01-01T00:00:00Z"
    assert first["asked"] == {"zoom": 98, "focus": 131, "iris": 20}
    assert first["approach"] == "from_above"
    assert first["temperature_c"] > 20


def test_the_last_picture_is_what_the_camera_saw(rig, sequence, tmp_path, monkeypatch):
    """Lossless: the file is the frame."""
    frames = []
    original = type(rig.camera).grab
    monkeypatch.setattr(
        type(rig.camera),
        "grab",
        lambda self, *a: (frames.append(original(self, *a)), frames[-1])[1],
    )
    done = run_sequence(sequence, rig, tmp_path)
    image = cv2.imread(str(tmp_path / done.pictures[-1].frame), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(image, frames[-1].image)


def test_a_lost_device_loses_no_picture_and_the_run_goes_on(rig, sequence, tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        fail_at(patch, rig.lens, "move_to", 2, DeviceError("the lens does not answer"))
        with pytest.raises(
            DeviceError,
            match=r"viewpoint 1: the lens does not answer \(1 of 3 pictures are in .*; the sa",
        ):
            run_sequence(sequence, rig, tmp_path)
    assert len(SequenceRun.load(tmp_path).pictures) == 1
    before = (tmp_path / "frames" / "0000.png").stat().st_mtime_ns
    calls = fail_at(monkeypatch, rig.positioner, "move_to", 99, DeviceError(""))
    done = run_sequence(sequence, rig, tmp_path)
    assert [p.station for p in done.pictures] == [0, 1, 2]
    assert len(calls) == 2, "what is done is not done again"
    assert (tmp_path / "frames" / "0000.png").stat().st_mtime_ns == before
    assert len(run_sequence(sequence, rig, tmp_path).pictures) == 3, "done is done"
    assert len(calls) == 2


def test_each_kind_of_trouble_keeps_its_kind(rig, sequence, tmp_path, monkeypatch):
    for number, error in enumerate(
        (
            FocusError("too dark"),
            OutOfRangeError("cannot go there", 1.0, (2.0, 3.0)),
            SessionError("something else"),
        )
    ):
        with monkeypatch.context() as patch:
            fail_at(patch, rig.positioner, "move_to", 1, error)
            with pytest.raises(type(error), match=rf"viewpoint 0: {error} \(0 of 3 pictures"):
                run_sequence(sequence, rig, tmp_path / str(number))


def test_nothing_moves_when_a_station_cannot_be_reached(rig, sequence, tmp_path, monkeypatch):
    moved = fail_at(monkeypatch, rig.positioner, "move_to", 99, DeviceError(""))
    far = Pose(sequence.stations[0].base_from_hand.rotation, np.array([5000.0, 0, 500]))
    for change, message in (
        ({"base_from_hand": far}, "viewpoint 2: x = 5000.0 mm of the hand lies outside"),
        ({"setting": LensSetting(300, 100)}, "viewpoint 2: zoom 300 lies outside the travel 45 to"),
    ):
        bad = replace(sequence.stations[2], **change)
        asked = Sequence([*sequence.stations[:2], bad], sequence.identity)
        with pytest.raises(OutOfRangeError, match=message):
            run_sequence(asked, rig, tmp_path / "out")
    assert not moved
    assert not (tmp_path / "out").exists()


def test_a_sequence_for_another_rig_is_refused(sequence, tmp_path):
    other = SimulatedRig.preset("vicon-1990", seed=1)
    with pytest.raises(
        SessionError, match="for another rig: its rig is '.* seed 0', but '.* seed 1' is connected"
    ):
        run_sequence(sequence, other, tmp_path / "out")


def test_a_folder_that_holds_something_else_is_left_alone(rig, sequence, tmp_path):
    run_sequence(Sequence(sequence.stations[:1]), rig, tmp_path / "one")
    with pytest.raises(SessionError, match="holds the pictures of another sequence"):
        run_sequence(sequence, rig, tmp_path / "one")
    other = SimulatedRig.preset("vicon-1990", seed=1)
    with pytest.raises(SessionError, match="was begun with another rig: its rig was '.*seed 0'"):
        run_sequence(Sequence(sequence.stations[:1]), other, tmp_path / "one")
    journal = tmp_path / "two" / "journal.jsonl"
    journal.parent.mkdir()
    journal.write_text("")
    with pytest.raises(SessionError, match="holds something else already .*no pictures of a seq"):
        run_sequence(sequence, rig, journal.parent)
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="cannot make the folder .*file"):
        run_sequence(sequence, rig, tmp_path / "file")


def test_a_run_from_a_newer_version(tmp_path):
    with JournalWriter(tmp_path / "journal.jsonl") as journal:
        journal.append({"entry": "sequence", "version": 2})
    with pytest.raises(FileError, match="was written by a newer version .form 2; this lenscal"):
        SequenceRun.load(tmp_path)


def test_a_frame_that_cannot_be_kept(rig, sequence, tmp_path, monkeypatch):
    monkeypatch.setattr(cv2, "imwrite", lambda *_: False)
    with pytest.raises(FileError, match="viewpoint 0: cannot keep the frame .*is the disk full"):
        run_sequence(sequence, rig, tmp_path)
    assert not SequenceRun.load(tmp_path).pictures
