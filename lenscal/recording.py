"""What a session leaves: settings visited, where the robot stood, what was seen.

On disk a recording is a folder. Its ``journal.jsonl`` holds one entry a line, each with a checksum
and a running number: first the head (plan, identities, frames), then one entry per finished
setting. Frames lie beside it as PNG. A journal whose last line is torn by a crash is read up to
there; one that was altered is refused.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from lenscal.arrays import FloatArray, IntArray, frozen_array
from lenscal.document import Json, write_whole
from lenscal.errors import FileError, InputError
from lenscal.journal import journal_line, read_journal
from lenscal.plate import parse_target
from lenscal.pose import Pose
from lenscal.sensor import Sensor
from lenscal.setting import ApproachSide, LensSetting
from lenscal.target import Target

JOURNAL: Final = "journal.jsonl"
VERSION: Final = 1


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """Points of a target found in one image.

    Parameters
    ----------
    ids
        (N,) ids of the points, as the target counts them.
    points_mm
        (N, 3) the points in the target frame.
    pixels
        (N, 2) where they were found.

    Raises
    ------
    InputError
        When the shapes disagree or a value is not finite.
    """

    ids: IntArray
    points_mm: FloatArray
    pixels: FloatArray

    def __post_init__(self) -> None:
        ids = np.array(self.ids, dtype=np.int64)
        ids.setflags(write=False)
        points = frozen_array("points_mm", self.points_mm, ("N", 3))
        pixels = frozen_array("pixels", self.pixels, ("N", 2))
        if not len(ids) == len(points) == len(pixels):
            raise InputError(
                f"an observation needs one id, one point and one pixel each, but has {len(ids)} "
                f"ids, {len(points)} points and {len(pixels)} pixels"
            )
        for name, value in {"ids": ids, "points_mm": points, "pixels": pixels}.items():
            object.__setattr__(self, name, value)

    @classmethod
    def of(cls, target: Target, ids: IntArray, pixels: FloatArray) -> Observation:
        """Look the points up that were found.

        Parameters
        ----------
        target
            The target.
        ids
            (N,) ids of the points found.
        pixels
            (N, 2) where.

        Returns
        -------
        Observation
            With the points of the target.
        """
        return cls(ids, target.points_mm[np.asarray(ids, dtype=np.int64)], pixels)

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True, slots=True, eq=False)
class FocusResult:
    """The sharpest distance of a setting, and how it was found.

    Parameters
    ----------
    distance_mm
        The sharpest standoff: reference projection centre to target plane, along the axis.
    sigma_mm
        Its standard deviation.
    confidence
        0 to 1: how clear the peak was.
    iris
        The iris it was searched at.
    curve_standoff_mm, curve_sharpness
        (N,) each: the focus curve.
    notes
        What was out of the ordinary, in words.
    measure
        What sharpness was measured by, a value of `lenscal.session.sharpness.Measure`.
    fine
        How many points, at the end of the curve, are of the fine sweep that was fitted; 0 where the
        record does not say.
    vergence_per_mm
        1/z in the middle of the fine sweep, z counted from the true projection centre, as the
        growth of the disk in the image shows it; None where the record does not say.
    """

    distance_mm: float
    sigma_mm: float
    confidence: float
    iris: float | None
    curve_standoff_mm: FloatArray
    curve_sharpness: FloatArray
    notes: tuple[str, ...] = ()
    measure: str = "edge_width"
    fine: int = 0
    vergence_per_mm: float | None = None

    @property
    def curve(self) -> FloatArray:
        """(N, 2) the focus curve: standoff in mm and sharpness."""
        return np.stack([self.curve_standoff_mm, self.curve_sharpness], axis=-1)

    def __post_init__(self) -> None:
        for name in ("curve_standoff_mm", "curve_sharpness"):
            object.__setattr__(self, name, frozen_array(name, getattr(self, name), ("N",)))


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One picture of the target at one setting.

    Parameters
    ----------
    observation
        What was found in it.
    base_from_hand
        Where the robot said it stood, or None without a robot.
    iris
        The iris it was taken at.
    frame
        Name of the image file in the recording's folder, or None when it was not kept.
    """

    observation: Observation
    base_from_hand: Pose | None = None
    iris: float | None = None
    frame: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class SettingRecord:
    """Everything seen at one setting.

    Parameters
    ----------
    setting
        Zoom and focus as read back from the controller.
    views
        The pictures in which the target was found.
    focus_view
        Index of the untilted view at the sharpest distance, or None when it was lost.
    focus
        How that distance was found, or None where nothing was focused.
    approach
        From which side the motors came.
    notes
        What was out of the ordinary, in words.
    """

    setting: LensSetting
    views: tuple[View, ...]
    focus_view: int | None = 0
    focus: FocusResult | None = None
    approach: ApproachSide = ApproachSide.FROM_BELOW
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.focus_view is not None and not 0 <= self.focus_view < len(self.views):
            raise InputError(
                f"focus_view {self.focus_view} is not among the {len(self.views)} views of "
                f"the setting ({self.setting})"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Head:
    """What holds for all settings of a recording.

    Parameters
    ----------
    sensor
        The sensor of the camera.
    target
        The target that was looked at.
    reference_setting
        The setting for which hand-eye was calibrated.
    hand_from_camera
        The camera at the reference setting in the frame of the hand, as the rig states it.
    base_from_target
        The target in the frame of the robot's base, as the rig states it.
    identity
        Names, serial numbers and versions of the devices.
    plan
        The plan of the session as it was carried out.
    """

    sensor: Sensor
    target: Target
    reference_setting: LensSetting | None = None
    hand_from_camera: Pose | None = None
    base_from_target: Pose | None = None
    identity: dict[str, str] = field(default_factory=dict)
    plan: Json = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A session's result, complete or up to where it was broken off.

    Parameters
    ----------
    head
        What holds for all settings.
    settings
        One record per finished setting, in the order visited.
    folder
        Where the frames lie, or None.
    """

    head: Head
    settings: tuple[SettingRecord, ...]
    folder: Path | None = None

    @classmethod
    def load(cls, path: Path | str) -> Recording:
        """Read a recording from its folder.

        Parameters
        ----------
        path
            The folder.

        Returns
        -------
        Recording
            All settings whose entries are whole.

        Raises
        ------
        FileError
            When there is no journal, it was altered, or it is from a newer version.
        """
        folder = Path(path)
        entries = list(read_journal(folder / JOURNAL))
        if not entries or entries[0].get("entry") != "head":
            raise FileError(
                f"{folder / JOURNAL} holds no recording: it does not begin with a whole head; "
                "was the session broken off at once?"
            )
        version = entries[0].get("version")
        if not isinstance(version, int) or version > VERSION:
            raise FileError(
                f"{folder} was recorded by a newer version (form {version}; this lenscal reads up "
                f"to {VERSION}): install a newer one"
            )
        head = head_from_json(entries[0])
        settings = [e for e in entries[1:] if e.get("entry") == "setting"]
        return cls(head, tuple(setting_from_json(e, head.target) for e in settings), folder)

    def save(self, path: Path | str) -> Path:
        """Write the journal of this recording; frames are not copied.

        Parameters
        ----------
        path
            The folder; it must not hold another recording.

        Returns
        -------
        Path
            The folder.

        Raises
        ------
        FileError
            When the folder holds a recording already.
        """
        journal = Path(path) / JOURNAL
        if journal.exists():
            raise FileError(f"{path} holds a recording already; choose another folder")
        entries = [head_to_json(self.head), *(setting_to_json(s) for s in self.settings)]
        write_whole(journal, "".join(journal_line(i, entry) for i, entry in enumerate(entries)))
        return Path(path)


def head_to_json(head: Head) -> Json:
    """Turn a head into a journal entry.

    Parameters
    ----------
    head
        The head.

    Returns
    -------
    dict
        What JSON can hold.
    """
    return {
        "entry": "head",
        "version": VERSION,
        "sensor": dataclasses.asdict(head.sensor),
        "target": head.target.spec,
        "reference_setting": _optional(head.reference_setting, dataclasses.astuple),
        "hand_from_camera": _optional(head.hand_from_camera, _matrix),
        "base_from_target": _optional(head.base_from_target, _matrix),
        "identity": head.identity,
        "plan": head.plan,
    }


def head_from_json(entry: Json) -> Head:
    """Read a head from its journal entry.

    Parameters
    ----------
    entry
        The entry.

    Returns
    -------
    Head
        The head.
    """
    return Head(
        sensor=Sensor(**entry["sensor"]),
        target=parse_target(entry["target"]),
        reference_setting=_optional(entry["reference_setting"], lambda v: LensSetting(*v)),
        hand_from_camera=_optional(entry["hand_from_camera"], Pose.from_matrix),
        base_from_target=_optional(entry["base_from_target"], Pose.from_matrix),
        identity=entry["identity"],
        plan=entry["plan"],
    )


def setting_to_json(record: SettingRecord) -> Json:
    """Turn the record of one setting into a journal entry.

    Parameters
    ----------
    record
        The record.

    Returns
    -------
    dict
        What JSON can hold.
    """
    focus = record.focus
    return {
        "entry": "setting",
        "setting": dataclasses.astuple(record.setting),
        "approach": record.approach.value,
        "focus_view": record.focus_view,
        "notes": list(record.notes),
        "focus": focus
        and {
            "distance_mm": focus.distance_mm,
            "sigma_mm": focus.sigma_mm,
            "confidence": focus.confidence,
            "iris": focus.iris,
            "curve_standoff_mm": focus.curve_standoff_mm.tolist(),
            "curve_sharpness": focus.curve_sharpness.tolist(),
            "notes": list(focus.notes),
        },
        "views": [
            {
                "ids": view.observation.ids.tolist(),
                "pixels": view.observation.pixels.tolist(),
                "base_from_hand": _optional(view.base_from_hand, _matrix),
                "iris": view.iris,
                "frame": view.frame,
            }
            for view in record.views
        ],
    }


def setting_from_json(entry: Json, target: Target) -> SettingRecord:
    """Read the record of one setting from its journal entry.

    Parameters
    ----------
    entry
        The entry.
    target
        The target that its points belong to.

    Returns
    -------
    SettingRecord
        The record.
    """
    views = tuple(
        View(
            Observation.of(target, view["ids"], np.reshape(view["pixels"], (-1, 2))),
            _optional(view["base_from_hand"], Pose.from_matrix),
            view["iris"],
            view["frame"],
        )
        for view in entry["views"]
    )
    focus = entry["focus"]
    return SettingRecord(
        setting=LensSetting(*entry["setting"]),
        views=views,
        focus_view=entry["focus_view"],
        focus=focus and FocusResult(**{**focus, "notes": tuple(focus["notes"])}),
        approach=ApproachSide(entry["approach"]),
        notes=tuple(entry["notes"]),
    )


def _matrix(pose: Pose) -> list[list[float]]:
    rows: list[list[float]] = pose.matrix.tolist()
    return rows


def _optional(value: Any, convert: Any) -> Any:
    return None if value is None else convert(value)
