"""What a session asks of a lens, a camera and a positioner, whoever made them.

A driver subclasses one of the abstract classes and nothing else. Targets beyond the travel raise
before anything moves, every wait ends, and closing twice is harmless.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from lenscal.pose import Pose
from lenscal.sensor import Sensor
from lenscal.sensor import Window as Window
from lenscal.setting import ApproachSide, LensSetting, LensTravel
from lenscal.target import Target

Image = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One picture, and what the camera knows of it.

    Parameters
    ----------
    image
        (rows, columns) grey values.
    bit_depth
        White is 2^bit_depth − 1.
    time_s
        When the exposure began, on the camera's clock.
    window
        The part of the full image that it shows.
    """

    image: Image
    bit_depth: int
    time_s: float
    window: Window

    @property
    def saturation(self) -> int:
        """The grey value at which a pixel is full."""
        return int(2**self.bit_depth - 1)

    def as_8_bit(self) -> npt.NDArray[np.uint8]:
        """Scale the grey values to 8 bits, as detectors want them.

        Returns
        -------
        npt.NDArray[np.uint8]
            (rows, columns) grey values.
        """
        if self.bit_depth == 8:
            return self.image.astype(np.uint8)
        scaled = self.image.astype(np.float64) * (255 / self.saturation)
        return np.round(scaled).astype(np.uint8)


class Device(ABC):
    """Anything with a plug."""

    @property
    @abstractmethod
    def identity(self) -> str:
        """Maker, model and serial number, as one line."""

    def close(self) -> None:  # noqa: B027 - most devices hold nothing
        """Let go of the hardware; doing it twice is harmless."""


class Lens(Device):
    """A motorised lens."""

    @property
    def temperature_c(self) -> float | None:
        """Temperature of the lens in °C at this moment; None when it has no sensor."""
        return None

    @property
    @abstractmethod
    def travel(self) -> LensTravel:
        """How far the motors go."""

    @property
    @abstractmethod
    def setting(self) -> LensSetting:
        """Where the motors stand, as far as the controller can tell."""

    @abstractmethod
    def move_to(
        self, setting: LensSetting, approach: ApproachSide = ApproachSide.FROM_BELOW
    ) -> LensSetting:
        """Drive the motors and wait until they rest.

        Parameters
        ----------
        setting
            Where to; an iris of None leaves the iris alone.
        approach
            The side from which every motor ends its move.

        Returns
        -------
        LensSetting
            Where they stand, as read back.

        Raises
        ------
        OutOfRangeError
            When the setting lies beyond the travel; nothing has moved then.
        """


class CameraDevice(Device):
    """A camera that gives single frames."""

    @property
    def temperature_c(self) -> float | None:
        """Temperature of the camera in °C at this moment; None when it has no sensor."""
        return None

    @property
    @abstractmethod
    def sensor(self) -> Sensor:
        """The sensor and its frame buffer."""

    @property
    @abstractmethod
    def exposure_s(self) -> float:
        """Exposure time of the next frame in seconds."""

    @property
    @abstractmethod
    def exposure_range_s(self) -> tuple[float, float]:
        """Shortest and longest exposure time in seconds."""

    @abstractmethod
    def set_exposure_s(self, exposure_s: float) -> None:
        """Set the exposure time.

        Parameters
        ----------
        exposure_s
            In seconds.

        Raises
        ------
        OutOfRangeError
            When it lies outside `exposure_range_s`; nothing has changed then.
        """

    @abstractmethod
    def grab(self, window: Window | None = None) -> Frame:
        """Expose and read one frame, begun after this call.

        Parameters
        ----------
        window
            The part of the image wanted, or None for all of it.

        Returns
        -------
        Frame
            The picture.
        """


class Positioner(Device):
    """What carries the camera: a robot, a stage, or a patient person."""

    @property
    @abstractmethod
    def base_from_hand(self) -> Pose:
        """Where the hand is, as the positioner reports it."""

    def check(self, base_from_hand: Pose) -> None:
        """Refuse a pose beyond reach, before anything moves.

        A positioner that can tell only by trying does nothing here.

        Parameters
        ----------
        base_from_hand
            The pose that would be asked for.

        Raises
        ------
        OutOfRangeError
            When the pose is beyond reach.
        """

    @abstractmethod
    def move_to(self, base_from_hand: Pose) -> Pose:
        """Move the hand and wait until it rests.

        Parameters
        ----------
        base_from_hand
            Where to.

        Returns
        -------
        Pose
            Where it is, as reported.

        Raises
        ------
        OutOfRangeError
            When the pose is beyond reach; nothing has moved then.
        """


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """Lens, camera and positioner together, and what is known of how they are mounted.

    Parameters
    ----------
    lens, camera, positioner
        The devices.
    target
        The target in front of them.
    reference_setting
        The setting for which hand-eye was calibrated.
    hand_from_camera
        The camera at the reference setting in the frame of the hand: the hand-eye calibration.
    base_from_target
        The target in the frame of the base, as taught.
    identity
        Further names and serial numbers, to go on record.
    hand_eye_sigma_rad, hand_eye_sigma_mm
        How well `hand_from_camera` is known: σ of the rotation about each axis and of each
        coordinate, as `solve_hand_eye` states them; None where nobody knows.
    """

    lens: Lens
    camera: CameraDevice
    positioner: Positioner
    target: Target
    reference_setting: LensSetting
    hand_from_camera: Pose
    base_from_target: Pose
    identity: dict[str, str] = field(default_factory=dict)
    hand_eye_sigma_rad: float | None = None
    hand_eye_sigma_mm: float | None = None

    def identities(self) -> dict[str, str]:
        """Name every device, for the record.

        Returns
        -------
        dict
            Role to identity.
        """
        devices: dict[str, Device] = {
            "lens": self.lens,
            "camera": self.camera,
            "positioner": self.positioner,
        }
        return {**{role: device.identity for role, device in devices.items()}, **self.identity}

    @property
    def temperature_c(self) -> float | None:
        """Temperature of the lens in °C, or of the camera where the lens does not tell, or None."""
        own = self.lens.temperature_c
        return self.camera.temperature_c if own is None else own

    def close(self) -> None:
        """Let go of all devices."""
        for device in (self.lens, self.camera, self.positioner):
            device.close()
