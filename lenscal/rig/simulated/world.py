"""The world that lens, camera and positioner share: where everything truly is, and when."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lenscal.imaging.texture import TargetSurface
from lenscal.pose import Pose
from lenscal.rig.simulated.lens_truth import LensTruth
from lenscal.rig.simulated.motors import LensMotors
from lenscal.rig.simulated.workpiece import Workpiece
from lenscal.rig.simulated.zoom_lens import ZoomLens
from lenscal.setting import LensSetting


@dataclass(frozen=True, slots=True)
class PoseNoise:
    """How far a pose scatters.

    Parameters
    ----------
    translation_mm
        Standard deviation of each coordinate.
    rotation_rad
        Standard deviation of the rotation about each axis.
    """

    translation_mm: float
    rotation_rad: float

    def draw(self, rng: np.random.Generator) -> Pose:
        """Draw a small motion.

        Parameters
        ----------
        rng
            Source of randomness.

        Returns
        -------
        Pose
            To be put to the right of a pose: an error in its own frame.
        """
        translation = self.translation_mm * rng.standard_normal(3)
        return Pose.from_rotation_vector(self.rotation_rad * rng.standard_normal(3), translation)


@dataclass(slots=True, eq=False)
class World:
    """The state of a simulated rig and its hidden truth.

    Parameters
    ----------
    lens
        Description of the lens on its camera.
    surface
        The target as light meets it.
    hand_from_camera
        True place of the camera at the reference setting in the hand.
    base_from_target
        True place of the target.
    base_from_hand
        True place of the hand now.
    motors
        The motors of the lens: where they are believed to stand, and where the glass is.
    rng
        Source of all randomness.
    clock_s
        Seconds since the rig was switched on. Moving and exposing advance it; nothing sleeps.
    workpiece
        What lies on the bench instead of the target, or None.
    """

    lens: ZoomLens
    surface: TargetSurface
    hand_from_camera: Pose
    base_from_target: Pose
    base_from_hand: Pose
    motors: LensMotors
    rng: np.random.Generator
    clock_s: float = 0.0
    workpiece: Workpiece | None = None

    def advance(self, duration_s: float) -> None:
        """Let time pass.

        Parameters
        ----------
        duration_s
            How much.
        """
        self.clock_s += duration_s

    @property
    def true_setting(self) -> LensSetting:
        """Where the glass really is now."""
        return self.motors.true_setting(self.clock_s)

    def lens_truth(self) -> LensTruth:
        """Compute the truth about the lens as its glass stands.

        Returns
        -------
        LensTruth
            The truth.

        Raises
        ------
        OutOfRangeError
            When nothing is sharp there, see `ZoomLens.truth`.
        """
        return self.lens.truth(self.true_setting)

    def camera_from_target(self) -> Pose:
        """Tell where the target is as the lens stands.

        Returns
        -------
        Pose
            The truth.
        """
        return self.base_from_camera().inverse() @ self.base_from_target

    def base_from_camera(self) -> Pose:
        """Tell where the camera is as the lens stands.

        The projection centre of a setting lies its nodal offset behind that of the reference
        setting, for which the place of the camera in the hand is given.

        Returns
        -------
        Pose
            The truth.
        """
        offset_mm = self.lens.nodal_offset_mm(self.true_setting)
        reference_from_camera = Pose(np.eye(3), np.array([0.0, 0.0, -offset_mm]))
        return self.base_from_hand @ self.hand_from_camera @ reference_from_camera
