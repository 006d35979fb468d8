"""How the reference camera sits on the hand of one rig: a hand-eye calibration to be used.

It names the rig that it was made on, so that nobody places a camera with the mounting of another.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray, frozen_array
from lenscal.document import read_document, write_document
from lenscal.errors import FileError, InputError
from lenscal.pose import Pose
from lenscal.setting import LensSetting

KIND: Final = "hand-eye"
VERSION: Final = 1

#: What of the identities of a rig tells it from others.
ROLES: Final = ("lens", "camera", "positioner", "rig")


@dataclass(frozen=True, slots=True, eq=False)
class CameraMount:
    """The camera at the reference setting in the frame of the hand, and how well that is known.

    Parameters
    ----------
    hand_from_camera
        The mounting.
    covariance
        (6, 6) of it: a rotation vector in the frame of the hand, in rad, and the translation in mm,
        as `lenscal.calibration.hand_eye.HandEye` states it; zeros where nobody knows.
    reference_setting
        The setting that it holds for.
    identity
        Names of the devices: ``lens``, ``camera``, ``positioner``, ``rig``.
    anchors_offsets
        Whether the nodal offsets of the lens map are counted from this very mounting, as those of
        a session are from the one that its rig stated. Then they hold its error of translation with
        the opposite sign, and where the camera is sent it cancels.

    Raises
    ------
    InputError
        When the covariance is not symmetric or has a negative variance.
    """

    hand_from_camera: Pose
    covariance: FloatArray
    reference_setting: LensSetting
    identity: Mapping[str, str] = field(default_factory=dict)
    anchors_offsets: bool = False

    def __post_init__(self) -> None:
        covariance = frozen_array("covariance", self.covariance, (6, 6))
        scale = np.sqrt(np.abs(np.diag(covariance)))
        symmetric = np.abs(covariance - covariance.T) <= 1e-9 * np.outer(scale, scale)
        if not symmetric.all() or np.diag(covariance).min() < 0:
            raise InputError(
                "the covariance of a mounting must be symmetric with variances on its diagonal; "
                "give that of HandEye.covariance"
            )
        object.__setattr__(self, "covariance", covariance)
        object.__setattr__(self, "identity", dict(self.identity))

    @classmethod
    def stated(
        cls,
        hand_from_camera: Pose,
        reference_setting: LensSetting,
        identity: Mapping[str, str],
        sigma_rad: float,
        sigma_mm: float,
    ) -> CameraMount:
        """Make the mounting that the rig of a session stated.

        Parameters
        ----------
        hand_from_camera
            As stated.
        reference_setting
            The setting that it holds for.
        identity
            Of the rig.
        sigma_rad, sigma_mm
            σ of the rotation about each axis, and of each coordinate.

        Returns
        -------
        CameraMount
            From which the offsets of that session are counted.
        """
        variances = np.repeat([sigma_rad**2, sigma_mm**2], 3)
        return cls(hand_from_camera, np.diag(variances), reference_setting, identity, True)

    def save(self, path: Path | str) -> Path:
        """Write the mounting.

        Parameters
        ----------
        path
            The JSON file.

        Returns
        -------
        Path
            The file.
        """
        body = {
            "hand_from_camera": self.hand_from_camera.to_dict(),
            "covariance_rad_mm": self.covariance.tolist(),
            "reference_setting": dataclasses.asdict(self.reference_setting),
            "identity": dict(self.identity),
            "anchors_offsets": self.anchors_offsets,
        }
        return write_document(path, KIND, VERSION, body)

    @classmethod
    def load(cls, path: Path | str) -> CameraMount:
        """Read a mounting.

        Parameters
        ----------
        path
            The file.

        Returns
        -------
        CameraMount
            What was saved.

        Raises
        ------
        FileError
            When the file cannot be used.
        """
        body = read_document(path, KIND, VERSION)
        try:
            return cls(
                Pose.from_dict(body["hand_from_camera"]),
                np.array(body["covariance_rad_mm"]),
                LensSetting(**body["reference_setting"]),
                body["identity"],
                body["anchors_offsets"],
            )
        except (KeyError, TypeError, ValueError) as error:
            raise FileError(f"{path} is no whole hand-eye calibration: {error}") from error


def differences(one: Mapping[str, str], other: Mapping[str, str]) -> list[str]:
    """Name the roles in which two rigs are not the same.

    Parameters
    ----------
    one, other
        Identities by role; what only one of them states is not compared.

    Returns
    -------
    list of str
        Those of `ROLES` that both state differently.
    """
    return [r for r in ROLES if r in one and r in other and one[r] != other[r]]
