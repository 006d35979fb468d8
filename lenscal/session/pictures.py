"""What a run of a sequence leaves: pictures, and where robot and lens stood for each."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from lenscal.document import Json
from lenscal.errors import FileError
from lenscal.journal import read_journal
from lenscal.pose import Pose
from lenscal.recording import JOURNAL
from lenscal.sequence import Station
from lenscal.setting import LensSetting

VERSION: Final = 1


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """One picture of a run.

    Parameters
    ----------
    station
        Number of the station in the sequence.
    name
        Of the station.
    setting
        Where the motors of the lens stood, as read back.
    base_from_hand
        Where the robot said it stood.
    exposure_s
        Exposure time in seconds.
    bit_depth
        White is 2^bit_depth − 1 in the file.
    frame
        The PNG file in the folder of the run.
    """

    station: int
    name: str
    setting: LensSetting
    base_from_hand: Pose
    exposure_s: float
    bit_depth: int
    frame: str


@dataclass(frozen=True, slots=True, eq=False)
class SequenceRun:
    """The pictures of a sequence, all of them or up to where it was broken off.

    Parameters
    ----------
    folder
        Where they are.
    sequence_digest
        Of the sequence.
    identity
        Of the rig.
    stations
        How many pictures there are to be.
    pictures
        Those that are taken.
    """

    folder: Path
    sequence_digest: str
    identity: dict[str, str]
    stations: int
    pictures: tuple[Picture, ...]

    @classmethod
    def load(cls, folder: Path | str) -> SequenceRun:
        """Read a run from its folder.

        Parameters
        ----------
        folder
            The folder.

        Returns
        -------
        SequenceRun
            All pictures whose entries are whole.

        Raises
        ------
        FileError
            When there is no run, it was altered, or it is from a newer version.
        """
        folder = Path(folder)
        entries = list(read_journal(folder / JOURNAL))
        if not entries or entries[0].get("entry") != "sequence":
            raise FileError(f"{folder} holds no pictures of a sequence; choose another folder")
        head = entries[0]
        if not isinstance(head.get("version"), int) or head["version"] > VERSION:
            raise FileError(
                f"{folder} was written by a newer version (form {head.get('version')}; this "
                f"lenscal reads up to {VERSION}): install a newer one"
            )
        return cls(
            folder,
            head["sequence_sha256"],
            head["identity"],
            head["stations"],
            tuple(_picture(e) for e in entries[1:]),
        )


def picture_to_json(picture: Picture, station: Station) -> Json:
    """Turn a picture into a journal entry.

    Parameters
    ----------
    picture
        The picture.
    station
        What was asked for.

    Returns
    -------
    dict
        What JSON can hold.
    """
    return {
        "entry": "picture",
        "station": picture.station,
        "name": picture.name,
        "asked": asdict(station.setting),
        "setting": asdict(picture.setting),
        "approach": station.approach.value,
        "base_from_hand": picture.base_from_hand.to_dict(),
        "exposure_s": picture.exposure_s,
        "bit_depth": picture.bit_depth,
        "frame": picture.frame,
    }


def _picture(entry: Json) -> Picture:
    return Picture(
        entry["station"],
        entry["name"],
        LensSetting(**entry["setting"]),
        Pose.from_dict(entry["base_from_hand"]),
        entry["exposure_s"],
        entry["bit_depth"],
        entry["frame"],
    )
