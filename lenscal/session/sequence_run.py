"""Carrying a sequence out: go there, set the lens from the recorded side, take the picture.

The folder holds ``journal.jsonl``, one sealed entry per picture after the head, and ``frames/``,
lossless. What is in the journal is on the disk; a run that was broken off is taken up again.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Final

import cv2

from lenscal.camera_mount import differences
from lenscal.document import Json, reason
from lenscal.errors import (
    DeviceError,
    FileError,
    FocusError,
    LensCalError,
    OutOfRangeError,
    SessionError,
)
from lenscal.journal import JournalWriter
from lenscal.progress import Progress
from lenscal.recording import JOURNAL
from lenscal.rig.interfaces import Frame, Rig
from lenscal.sequence import Sequence, Station
from lenscal.session.exposure import expose
from lenscal.session.pictures import VERSION, Picture, SequenceRun, picture_to_json

_FRAMES: Final = "frames"


def run_sequence(
    sequence: Sequence,
    rig: Rig,
    folder: Path | str,
    *,
    progress: Progress | None = None,
    clock: Callable[[], float] = time.time,
) -> SequenceRun:
    """Take the picture of every station; a run that was broken off is taken up where it stopped.

    Before anything moves, all settings are held against the travel of the lens and all poses
    against the reach of the robot, as far as it can tell.

    Parameters
    ----------
    sequence
        What to do.
    rig
        What to do it with.
    folder
        Where the pictures go: a new folder, or that of the same sequence on the same rig.
    progress
        Told after each picture.
    clock
        Seconds since 1970, for the dates on the record.

    Returns
    -------
    SequenceRun
        What is on the disk now.

    Raises
    ------
    SessionError
        When the sequence is for another rig, or the folder holds something else.
    OutOfRangeError
        When a setting is beyond the travel or a pose beyond reach; nothing has moved then, if the
        robot can tell without moving.
    DeviceError, FocusError
        When a device fails or the light does not do; the pictures taken before stay.
    FileError
        When the folder cannot be written to.
    """
    _for_this_rig(sequence, rig)
    for station in sequence.stations:
        try:
            rig.lens.travel.check(station.setting)
            rig.positioner.check(station.base_from_hand)
        except OutOfRangeError as error:
            message = f"{station.name}: {error}"
            raise OutOfRangeError(message, error.given, error.allowed) from error
    path = Path(folder)
    done = _begun(path, sequence, rig)
    try:
        (path / _FRAMES).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"cannot make the folder {path}: {reason(error)}") from error
    taken = [] if done is None else list(done.pictures)
    with JournalWriter(path / JOURNAL, resume=done is not None) as journal:
        if done is None:
            journal.append(_head(sequence, rig, clock()))
        for number in range(len(taken), len(sequence)):
            station = sequence.stations[number]
            try:
                picture, more = _take(station, number, rig, path)
            except LensCalError as error:
                raise _where(error, station, number, len(sequence), path) from error
            journal.append(picture_to_json(picture, station) | more | {"taken": _date(clock())})
            taken.append(picture)
            if progress is not None:
                progress(number + 1, len(sequence), station.name)
    return SequenceRun.load(path)


def _for_this_rig(sequence: Sequence, rig: Rig) -> None:
    mine = rig.identities()
    for role in differences(sequence.identity, mine):
        raise SessionError(
            f"the sequence is for another rig: its {role} is {sequence.identity[role]!r}, but "
            f"{mine[role]!r} is connected; plan again with the hand-eye calibration of this rig"
        )


def _begun(path: Path, sequence: Sequence, rig: Rig) -> SequenceRun | None:
    """What the folder holds of this very sequence already; anything else is refused."""
    if not (path / JOURNAL).exists():
        return None
    try:
        done = SequenceRun.load(path)
    except FileError as error:
        raise SessionError(
            f"{path} holds something else already ({error}); choose another folder"
        ) from error
    if done.sequence_digest != sequence.digest:
        raise SessionError(
            f"{path} holds the pictures of another sequence; choose another folder, or move that "
            "one away"
        )
    for role in differences(done.identity, rig.identities()):
        raise SessionError(
            f"{path} was begun with another rig: its {role} was {done.identity[role]!r}; "
            "choose another folder"
        )
    return done


def _take(station: Station, number: int, rig: Rig, path: Path) -> tuple[Picture, Json]:
    """Move, set the lens, expose, keep the frame; the journal comes after."""
    hand = rig.positioner.move_to(station.base_from_hand)
    setting = rig.lens.move_to(station.setting, station.approach)
    exposure_s = expose(rig.camera)
    frame = rig.camera.grab()
    name = f"{_FRAMES}/{number:04d}.png"
    _keep(frame, path / name)
    picture = Picture(number, station.name, setting, hand, exposure_s, frame.bit_depth, name)
    return picture, {"temperature_c": rig.temperature_c}


def _keep(frame: Frame, file: Path) -> None:
    try:
        written = cv2.imwrite(str(file), frame.image)
    except cv2.error:
        written = False
    if not written:
        raise FileError(f"cannot keep the frame {file}; is the disk full?")


def _where(
    error: LensCalError, station: Station, number: int, count: int, path: Path
) -> LensCalError:
    """Say at which station it happened and what is safe; the kind of error stays."""
    message = (
        f"{station.name}: {error} ({number} of {count} pictures are in {path}; the same command "
        "goes on from there)"
    )
    if isinstance(error, OutOfRangeError):
        return OutOfRangeError(message, error.given, error.allowed)
    for kind in (DeviceError, FocusError, FileError):
        if isinstance(error, kind):
            return kind(message)
    return SessionError(message)


def _head(sequence: Sequence, rig: Rig, now: float) -> Json:
    return {
        "entry": "sequence",
        "version": VERSION,
        "sequence_sha256": sequence.digest,
        "made_from": dict(sequence.made_from),
        "stations": len(sequence),
        "sensor": asdict(rig.camera.sensor),
        "identity": {**rig.identities(), "lenscal": version("lenscal")},
        "begun": _date(now),
    }


def _date(now: float) -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(now))
