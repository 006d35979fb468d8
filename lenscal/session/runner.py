"""Carrying a session out: each setting is focused, seen from all sides, and written down."""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Final

import cv2

from lenscal.detection import detect
from lenscal.document import Json, reason
from lenscal.errors import DetectionError, FileError, FocusError, SessionError
from lenscal.journal import JournalWriter
from lenscal.plate import Plate
from lenscal.pose import Pose
from lenscal.progress import Progress
from lenscal.recording import (
    JOURNAL,
    Head,
    Observation,
    Recording,
    SettingRecord,
    View,
    head_to_json,
    setting_to_json,
)
from lenscal.rig.interfaces import Frame, Rig
from lenscal.session.aim import hand_pose
from lenscal.session.autofocus import autofocus
from lenscal.session.exposure import expose
from lenscal.session.plan import SessionPlan
from lenscal.setting import LensSetting
from lenscal.target import Disk, Target

_FRAMES: Final = "frames"


def run_session(
    plan: SessionPlan,
    rig: Rig,
    folder: Path | str,
    *,
    progress: Progress | None = None,
    clock: Callable[[], float] = time.time,
) -> Recording:
    """Visit every setting of a plan.

    A setting that cannot be focused or seen is recorded with the reason and passed over; what was
    recorded before stays.

    Parameters
    ----------
    plan
        What to do.
    rig
        What to do it with.
    folder
        Where to record; it must not hold a session yet.
    progress
        Told after each setting.
    clock
        Seconds since 1970, for the date on the record.

    Returns
    -------
    Recording
        What is on the disk now.

    Raises
    ------
    SessionError
        When the folder holds another session or cannot be written to.
    OutOfRangeError
        When a setting of the plan lies beyond the travel; nothing has moved then.
    """
    settings = plan.settings()
    for setting in settings:
        for iris in (plan.autofocus.iris, plan.views.iris):
            rig.lens.travel.check(setting.with_iris(iris))
    focus_point_mm, view_point_mm = points_of_interest(rig.target)
    path = _fresh_folder(Path(folder))
    head = Head(
        sensor=rig.camera.sensor,
        target=rig.target,
        reference_setting=rig.reference_setting,
        hand_from_camera=rig.hand_from_camera,
        base_from_target=rig.base_from_target,
        identity={
            **rig.identities(),
            "lenscal": version("lenscal"),
            "begun": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(clock())),
        },
        plan=_as_json(plan),
    )
    records = []
    with JournalWriter(path / JOURNAL) as journal:
        journal.append(head_to_json(head))
        for number, setting in enumerate(settings):
            frames = path / _FRAMES / f"{number:04d}" if plan.keep_frames else None
            record = _visit(plan, rig, setting, (focus_point_mm, view_point_mm), frames)
            journal.append(setting_to_json(record))
            records.append(record)
            if progress is not None:
                progress(number + 1, len(settings), str(setting))
    return Recording(head, tuple(records), path)


def points_of_interest(target: Target) -> tuple[tuple[float, float], tuple[float, float]]:
    """Tell where on a target to focus and where to look for calibration.

    Parameters
    ----------
    target
        A plate with a disk on it.

    Returns
    -------
    focus_point_mm, view_point_mm : tuple of float
        Middle of the disk, and middle of the largest other part, in the target frame.

    Raises
    ------
    SessionError
        When the target has no disk or nothing else.
    """
    parts = target.parts if isinstance(target, Plate) else ((target, (0.0, 0.0)),)
    disks = [centre for part, centre in parts if isinstance(part, Disk)]
    boards = [(part.size_mm, centre) for part, centre in parts if not isinstance(part, Disk)]
    if not disks or not boards:
        raise SessionError(
            f"a session needs a plate with a disk to focus on and a board to calibrate from, but "
            f"the target is {target.spec}; combine them, such as "
            "charuco:17x13:3mm:2.25mm@0,0+disk:6mm@0,27"
        )
    return disks[0], max(boards)[1]


def _visit(
    plan: SessionPlan,
    rig: Rig,
    setting: LensSetting,
    points_mm: tuple[tuple[float, float], tuple[float, float]],
    frames: Path | None,
) -> SettingRecord:
    """Focus at one setting and take its views; trouble becomes a note."""
    focus_point_mm, view_point_mm = points_mm
    reached = rig.lens.move_to(setting.with_iris(plan.autofocus.iris), plan.approach)
    try:
        focus = autofocus(
            rig,
            plan.autofocus.standoffs_mm(),
            point_mm=focus_point_mm,
            measure=plan.autofocus.measure,
            extensions=plan.autofocus.extensions,
            repeatability_mm=plan.autofocus.repeatability,
            approach=plan.approach,
        )
        reached = rig.lens.move_to(setting.with_iris(plan.views.iris), plan.approach)
        rig.positioner.move_to(hand_pose(rig, focus.distance_mm, view_point_mm))
        expose(rig.camera)
    except FocusError as error:
        return SettingRecord(
            reached, (), focus_view=None, approach=plan.approach, notes=(f"not focused: {error}",)
        )
    views, notes = [], []
    focus_view = None
    for number, turn in enumerate(plan.views.tilts()):
        pose = hand_pose(rig, focus.distance_mm, view_point_mm, turn)
        try:
            view = _take(rig, pose, frames and frames / f"{number:02d}.png")
        except DetectionError as error:
            notes.append(f"view {number} left out: {error}")
            continue
        if number == 0:
            focus_view = 0
        views.append(view)
    return SettingRecord(
        reached, tuple(views), focus_view, focus, approach=plan.approach, notes=tuple(notes)
    )


def _take(rig: Rig, pose: Pose, file: Path | None) -> View:
    """Take one view: move, grab, keep, detect."""
    base_from_hand = rig.positioner.move_to(pose)
    frame = rig.camera.grab()
    if file is not None:
        _keep(frame, file)
    observation: Observation = detect(frame.as_8_bit(), rig.target)
    name = None if file is None else "/".join(file.parts[-3:])
    return View(observation, base_from_hand, rig.lens.setting.iris, name)


def _keep(frame: Frame, file: Path) -> None:
    """Write a frame as PNG, all its bits."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        written = cv2.imwrite(str(file), frame.image)
    except OSError as error:
        raise FileError(f"cannot keep the frame {file}: {reason(error)}") from error
    if not written:
        raise FileError(f"cannot keep the frame {file}; is the disk full?")


def _fresh_folder(path: Path) -> Path:
    if (path / JOURNAL).exists():
        raise SessionError(
            f"{path} holds another session already; choose another folder, or move that one away"
        )
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SessionError(f"cannot make the folder {path}: {reason(error)}") from error
    return path


def _as_json(plan: SessionPlan) -> Json:
    content: Json = plan.model_dump(mode="json")
    return content
