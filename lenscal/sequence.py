"""A sequence: where a rig is to go, how its lens is to be set there, picture by picture.

``lenscal plan`` writes it and ``lenscal rig run`` carries it out, so that planning needs no rig.
"""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Sequence as Ordered
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

from lenscal.arrays import positive
from lenscal.document import Json, digest, read_document, write_document
from lenscal.errors import FileError, InputError
from lenscal.pose import Pose
from lenscal.setting import ApproachSide, LensSetting

KIND: Final = "sequence"
VERSION: Final = 1


@dataclass(frozen=True, slots=True, eq=False)
class Station:
    """One picture to be taken.

    Parameters
    ----------
    name
        What people call it.
    setting
        Zoom, focus and iris; an iris of None leaves the iris as it stands.
    approach
        The side from which the motors of the lens were calibrated to arrive.
    base_from_hand
        Where the hand of the robot goes.
    standoff_mm
        From the reference projection centre to what is to be sharp, along the axis; for a person
        with a ruler, the robot does not need it.
    sigma_standoff_mm
        Its standard deviation.

    Raises
    ------
    InputError
        When the standoff is not positive.
    """

    name: str
    setting: LensSetting
    approach: ApproachSide
    base_from_hand: Pose
    standoff_mm: float
    sigma_standoff_mm: float

    def __post_init__(self) -> None:
        positive("standoff_mm", self.standoff_mm, "mm")


@dataclass(frozen=True, slots=True, eq=False)
class Sequence:
    """Stations in the order in which they are visited, for one rig.

    Parameters
    ----------
    stations
        At least one.
    identity
        The rig whose poses these are: names of its devices by role.
    made_from
        Digests of what stands behind it, by name.

    Raises
    ------
    InputError
        When there is no station.
    """

    stations: Ordered[Station]
    identity: Mapping[str, str] = field(default_factory=dict)
    made_from: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "stations", tuple(self.stations))
        object.__setattr__(self, "identity", dict(self.identity))
        object.__setattr__(self, "made_from", dict(self.made_from))
        if not self.stations:
            raise InputError("a sequence needs at least one station, but has none")

    def __len__(self) -> int:
        return len(self.stations)

    @property
    def digest(self) -> str:
        """SHA-256 of all that the sequence says, in hexadecimal."""
        return digest(self._body())

    def save(self, path: Path | str) -> Path:
        """Write the sequence.

        Parameters
        ----------
        path
            The JSON file.

        Returns
        -------
        Path
            The file.
        """
        return write_document(path, KIND, VERSION, self._body())

    @classmethod
    def load(cls, path: Path | str) -> Sequence:
        """Read a sequence.

        Parameters
        ----------
        path
            The file.

        Returns
        -------
        Sequence
            What was saved.

        Raises
        ------
        FileError
            When the file is missing, cut short, altered, of another kind, or from a newer version.
        """
        body = read_document(path, KIND, VERSION)
        try:
            stations = [_station(words) for words in body["stations"]]
            return cls(stations, body["identity"], body["made_from"])
        except (KeyError, TypeError, ValueError) as error:
            raise FileError(f"{path} is no whole sequence: {error!r}") from error

    def _body(self) -> Json:
        return {
            "identity": self.identity,
            "made_from": self.made_from,
            "stations": [
                {
                    "name": s.name,
                    "setting": asdict(s.setting),
                    "approach": s.approach.value,
                    "base_from_hand": s.base_from_hand.to_dict(),
                    "standoff_mm": s.standoff_mm,
                    "sigma_standoff_mm": s.sigma_standoff_mm,
                }
                for s in self.stations
            ],
        }


def _station(words: Mapping[str, Any]) -> Station:
    return Station(
        words["name"],
        LensSetting(**words["setting"]),
        ApproachSide(words["approach"]),
        Pose.from_dict(words["base_from_hand"]),
        words["standoff_mm"],
        words["sigma_standoff_mm"],
    )
