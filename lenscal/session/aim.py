"""Where the hand has to be for the camera to look at a point of the target."""

from __future__ import annotations

import numpy as np

from lenscal.errors import InputError
from lenscal.pose import Pose
from lenscal.rig.interfaces import Rig


def hand_pose(
    rig: Rig,
    standoff_mm: float,
    point_mm: tuple[float, float] = (0.0, 0.0),
    turn: Pose | None = None,
) -> Pose:
    """Place the reference camera so that its axis meets a point of the target.

    Parameters
    ----------
    rig
        Gives hand-eye calibration and target pose, as they are known.
    standoff_mm
        Distance from the reference projection centre to the point, along the axis.
    point_mm
        (x, y) of the point in the target frame.
    turn
        Rotation of the target frame as the camera sees it; None for facing it squarely.

    Returns
    -------
    Pose
        ``base_from_hand``.

    Raises
    ------
    InputError
        When the standoff is not positive: the target would lie behind the camera.
    """
    if not standoff_mm > 0:
        raise InputError(
            f"a standoff must be positive, but is {standoff_mm:g} mm: the target would lie "
            "behind the camera"
        )
    to_point = Pose(np.eye(3), -np.array([*point_mm, 0.0]))
    away = Pose(np.eye(3), np.array([0.0, 0.0, standoff_mm]))
    camera_from_target = away @ (turn or Pose.identity()) @ to_point
    return rig.base_from_target @ camera_from_target.inverse() @ rig.hand_from_camera.inverse()
