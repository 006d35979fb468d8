"""Hand-eye calibration: how the camera, at the reference setting, sits on the hand.

A closed form of AX = XB takes the poses of the camera as they are. The refinement goes back to the
pixels: camera, mounting and poses are fitted together, and the robot's slips are weighed by its
repeatability, so that the result knows how good it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, frozen_array
from lenscal.calibration.calibration import Calibration, Repeatability, RobotEvidence
from lenscal.calibration.hand_eye_equation import solve_hand_eye_equation
from lenscal.calibration.mounting import SHIFT_X, TURN_X
from lenscal.calibration.refine import calibrate_views
from lenscal.pose import Pose
from lenscal.sensor import Sensor


@dataclass(frozen=True, slots=True, eq=False)
class HandEye:
    """The camera on the hand, with its evidence.

    Parameters
    ----------
    hand_from_camera
        The result, refined on the pixels.
    base_from_target
        Where the target was.
    covariance
        (6, 6) of `hand_from_camera`: a rotation vector in the frame of the hand, in rad, and the
        translation in mm. Its largest part is that of D, along the optical axis.
    closed_form
        The solution of AX = XB that the method gave.
    method
        Its name.
    calibration
        The camera, and what was learnt of the robot.
    """

    hand_from_camera: Pose
    base_from_target: Pose
    covariance: FloatArray
    closed_form: Pose
    method: str
    calibration: Calibration

    def __post_init__(self) -> None:
        covariance = frozen_array("covariance", self.covariance, (6, 6))
        object.__setattr__(self, "covariance", covariance)

    @property
    def sigma_rotation_rad(self) -> FloatArray:
        """(3,) standard deviations about the axes of the hand."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[:3]))

    @property
    def sigma_translation_mm(self) -> FloatArray:
        """(3,) standard deviations along the axes of the hand."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[3:]))


def solve_hand_eye(
    points_mm: Sequence[npt.ArrayLike],
    pixels: Sequence[npt.ArrayLike],
    hand_poses: Sequence[Pose | None],
    sensor: Sensor,
    *,
    method: str = "tsai-lenz",
    repeatability: Repeatability | None = None,
    principal_point_px: npt.ArrayLike | None = None,
    radial_terms: int = 1,
    decentring: bool = False,
) -> HandEye:
    """Find how the camera sits on the hand.

    Some ten views do well, the target near the sharp plane in all of them, the hand turned by 20°
    and more about different axes, and moved along the optical axis.

    Parameters
    ----------
    points_mm
        One (N, 3) array a view: the points seen there, in the target frame, z = 0.
    pixels
        One (N, 2) array a view: where they were seen.
    hand_poses
        ``base_from_hand`` of each view as the robot reported it, or None; at least three.
    sensor
        The sensor.
    method
        Of the closed form, among `lenscal.calibration.hand_eye_equation.METHODS`. The refined
        result does not depend on it.
    repeatability
        Of the robot; None to estimate it from these views.
    principal_point_px
        (2,) where it is known and to be held fixed; None to estimate it.
    radial_terms
        How many radial coefficients are estimated.
    decentring
        Whether p1 and p2 are estimated.

    Returns
    -------
    HandEye
        The result with its evidence.

    Raises
    ------
    InputError
        When views, points, pixels and poses do not match, or the method is not known.
    CalibrationError
        When the views do not determine a camera, or the robot's poses and the pictures do not go
        together; `DegenerateGeometryError` when the hand was turned too little.
    ConvergenceError
        When the fit does not settle.
    """
    calibration = calibrate_views(
        points_mm,
        pixels,
        sensor,
        focus_view=None,
        principal_point_px=principal_point_px,
        radial_terms=radial_terms,
        decentring=decentring,
        hand_poses=hand_poses,
        repeatability=repeatability,
    )
    robot = cast(RobotEvidence, calibration.robot)
    believed = [
        (pose, hand)
        for pose, hand, used in zip(calibration.poses, hand_poses, robot.believed, strict=True)
        if used and hand is not None
    ]
    closed_form = solve_hand_eye_equation(
        [pose for pose, _ in believed], [hand for _, hand in believed], method
    )
    camera_from_hand = robot.mounting.camera_from_hand
    inverse = _inversion(camera_from_hand)
    places = np.r_[TURN_X, SHIFT_X]
    covariance = robot.mounting_covariance[np.ix_(places, places)]
    return HandEye(
        camera_from_hand.inverse(),
        robot.mounting.base_from_target,
        inverse @ covariance @ inverse.T,
        closed_form,
        method,
        calibration,
    )


def _inversion(camera_from_hand: Pose) -> FloatArray:
    """(6, 6) derivative of the inverse of a pose, both by left rotation vector and translation."""
    back = camera_from_hand.rotation.T
    x, y, z = camera_from_hand.translation_mm
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.block([[-back, np.zeros((3, 3))], [-back @ cross, -back]])
