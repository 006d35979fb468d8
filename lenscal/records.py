"""What is seen and noted in a session: views, focus, and one record for every setting visited."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lenscal.arrays import FloatArray, IntArray, frozen_array
from lenscal.document import Json
from lenscal.errors import InputError
from lenscal.pose import Pose
from lenscal.sensor import Sensor
from lenscal.setting import ApproachSide, LensSetting
from lenscal.target import Target


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
    temperature_c
        Of the lens in °C, or of the camera where the lens does not tell; None when not known.
    focus_part, view_part
        On a plate with several disks or boards: which part, counted from 0, was focused on, and
        which the views look at. None where there was no choice or none was made.
    """

    setting: LensSetting
    views: tuple[View, ...]
    focus_view: int | None = 0
    focus: FocusResult | None = None
    approach: ApproachSide = ApproachSide.FROM_BELOW
    notes: tuple[str, ...] = ()
    temperature_c: float | None = None
    focus_part: int | None = None
    view_part: int | None = None

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
    hand_eye_sigma_rad, hand_eye_sigma_mm
        How well `hand_from_camera` is known: σ of the rotation about each axis and of each
        coordinate; None where the rig does not say.
    """

    sensor: Sensor
    target: Target
    reference_setting: LensSetting | None = None
    hand_from_camera: Pose | None = None
    base_from_target: Pose | None = None
    identity: dict[str, str] = field(default_factory=dict)
    plan: Json = field(default_factory=dict)
    hand_eye_sigma_rad: float | None = None
    hand_eye_sigma_mm: float | None = None
