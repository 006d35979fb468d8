"""Carrying a session out: each setting is focused, seen from all sides, and written down."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Final

import cv2

from lenscal.detection import detect
from lenscal.document import Json, reason
from lenscal.errors import (
    DetectionError,
    FileError,
    FocusError,
    InputError,
    OutOfRangeError,
    SessionError,
)
from lenscal.journal import JournalWriter
from lenscal.pose import Pose
from lenscal.progress import Progress
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
from lenscal.rig.interfaces import Frame, Rig
from lenscal.session.aim import hand_pose
from lenscal.session.autofocus import autofocus
from lenscal.session.exposure import expose
from lenscal.session.plan import SessionPlan
from lenscal.session.plate_parts import board_to_look_at, detect_boards, offers_choice
from lenscal.session.plate_parts import points_of_interest as points_of_interest
from lenscal.session.survey import survey_disks
from lenscal.setting import LensSetting

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
    recorded before stays. On a plate with several disks or boards each setting is given those that
    suit its magnification; which, is in its record.

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
    points_of_interest(rig.target)  # refuses a target without a disk or a board
    path = _fresh_folder(Path(folder))
    head = Head(
        sensor=rig.camera.sensor,
        target=rig.target,
        reference_setting=rig.reference_setting,
        hand_from_camera=rig.hand_from_camera,
        hand_eye_sigma_rad=rig.hand_eye_sigma_rad,
        hand_eye_sigma_mm=rig.hand_eye_sigma_mm,
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
            record = _visit(plan, rig, setting, frames)
            journal.append(setting_to_json(record))
            records.append(record)
            if progress is not None:
                progress(number + 1, len(settings), str(setting))
    return Recording(head, tuple(records), path)


@dataclass(frozen=True, slots=True)
class _Sight:
    """What the views look at; parts and magnification are None where the plate has no choice."""

    point_mm: tuple[float, float]
    focus_part: int | None = None
    view_part: int | None = None
    magnification: float | None = None


def _visit(plan: SessionPlan, rig: Rig, setting: LensSetting, frames: Path | None) -> SettingRecord:
    """Focus at one setting and take its views; trouble becomes a note."""
    reached = rig.lens.move_to(setting.with_iris(plan.autofocus.iris), plan.approach)
    try:
        focus, sight = _focus(plan, rig, setting)
        reached = rig.lens.move_to(setting.with_iris(plan.views.iris), plan.approach)
        rig.positioner.move_to(hand_pose(rig, focus.distance_mm, sight.point_mm))
        expose(rig.camera)
    except (FocusError, OutOfRangeError) as error:
        return SettingRecord(
            reached,
            (),
            focus_view=None,
            approach=plan.approach,
            notes=(f"not focused: {error}",),
            temperature_c=rig.temperature_c,
        )
    views, notes = [], []
    focus_view = None
    for number, placement in enumerate(plan.views.placements()):
        standoff_mm = focus.distance_mm + placement.displacement_mm
        try:
            pose = hand_pose(rig, standoff_mm, sight.point_mm, placement.turn)
            view = _take(rig, pose, sight, frames and frames / f"{number:02d}.png")
        except (DetectionError, InputError) as error:  # not found, or out of reach
            notes.append(f"view {number} left out: {error}")
            continue
        if number == 0:
            focus_view = 0
        views.append(view)
    return SettingRecord(
        reached,
        tuple(views),
        focus_view,
        focus,
        approach=plan.approach,
        notes=tuple(notes),
        temperature_c=rig.temperature_c,
        focus_part=sight.focus_part,
        view_part=sight.view_part,
    )


def _focus(plan: SessionPlan, rig: Rig, setting: LensSetting) -> tuple[FocusResult, _Sight]:
    """Find the sharpest standoff; on a plate with a choice, with the parts that suit it."""
    search = partial(
        autofocus,
        rig,
        measure=plan.autofocus.measure,
        extensions=plan.autofocus.extensions,
        repeatability_mm=plan.autofocus.repeatability,
        approach=plan.approach,
    )
    if not offers_choice(rig.target):
        focus_point_mm, view_point_mm = points_of_interest(rig.target)
        return search(plan.autofocus.standoffs_mm(), point_mm=focus_point_mm), _Sight(view_point_mm)
    survey = survey_disks(rig, plan, setting)
    focus = search(survey.standoffs_mm, point_mm=survey.disk.centre_mm)
    magnification = survey.magnification(focus.distance_mm)
    board = board_to_look_at(rig.target, rig.camera.sensor, magnification)
    return focus, _Sight(board.centre_mm, survey.disk.number, board.number, magnification)


def _take(rig: Rig, pose: Pose, sight: _Sight, file: Path | None) -> View:
    """Take one view: move, grab, keep, detect."""
    base_from_hand = rig.positioner.move_to(pose)
    frame = rig.camera.grab()
    if file is not None:
        _keep(frame, file)
    image = frame.as_8_bit()
    if sight.magnification is None:
        observation: Observation = detect(image, rig.target)
    else:
        observation = detect_boards(image, rig.target, rig.camera.sensor, sight.magnification)
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
