"""What a session leaves: settings visited, where the robot stood, what was seen.

On disk a recording is a folder. Its ``journal.jsonl`` holds one entry a line, each with a checksum
and a running number: first the head (plan, identities, frames), then one entry per finished
setting. Frames lie beside it as PNG. A journal whose last line is torn by a crash is read up to
there; one that was altered is refused.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from lenscal.document import Json, write_whole
from lenscal.errors import FileError
from lenscal.journal import journal_line, read_journal
from lenscal.plate import parse_target
from lenscal.pose import Pose
from lenscal.records import FocusResult as FocusResult
from lenscal.records import Head as Head
from lenscal.records import Observation as Observation
from lenscal.records import SettingRecord as SettingRecord
from lenscal.records import View as View
from lenscal.sensor import Sensor
from lenscal.setting import ApproachSide, LensSetting
from lenscal.target import Target

JOURNAL: Final = "journal.jsonl"
VERSION: Final = 1


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
        "hand_eye_sigma_rad": head.hand_eye_sigma_rad,
        "hand_eye_sigma_mm": head.hand_eye_sigma_mm,
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
        hand_eye_sigma_rad=entry.get("hand_eye_sigma_rad"),
        hand_eye_sigma_mm=entry.get("hand_eye_sigma_mm"),
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
        "temperature_c": record.temperature_c,
        "focus_part": record.focus_part,
        "view_part": record.view_part,
        "focus": focus
        and {
            "distance_mm": focus.distance_mm,
            "sigma_mm": focus.sigma_mm,
            "confidence": focus.confidence,
            "iris": focus.iris,
            "curve_standoff_mm": focus.curve_standoff_mm.tolist(),
            "curve_sharpness": focus.curve_sharpness.tolist(),
            "notes": list(focus.notes),
            "measure": focus.measure,
            "fine": focus.fine,
            "vergence_per_mm": focus.vergence_per_mm,
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
        # Older journals lack what follows.
        temperature_c=entry.get("temperature_c"),
        focus_part=entry.get("focus_part"),
        view_part=entry.get("view_part"),
    )


def _matrix(pose: Pose) -> list[list[float]]:
    rows: list[list[float]] = pose.matrix.tolist()
    return rows


def _optional(value: Any, convert: Any) -> Any:
    return None if value is None else convert(value)
