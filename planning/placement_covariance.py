"""How the errors of mounting, robot and part move the camera; see ``docs/placement.md``."""

from __future__ import annotations

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.camera_mount import CameraMount
from lenscal.pose import Pose
from planning.robot_cell import RobotCell


def motion_covariance(
    cell: RobotCell, part_from_reference: Pose, centre_mm: FloatArray
) -> FloatArray:
    """Add up what mounting, robot and part do to the reference camera.

    Parameters
    ----------
    cell
        Their errors.
    part_from_reference
        Where the reference camera shall stand.
    centre_mm
        (3,) the projection centre of the setting in the frame of the reference camera.

    Returns
    -------
    FloatArray
        (6, 6) of the small motion of the reference camera in its own frame: rotation vector in rad
        and translation of its origin in mm.
    """
    total = _of_mount(cell.mount, centre_mm)
    if cell.repeatability is not None:
        slip = np.repeat(
            [cell.repeatability.rotation_rad**2, cell.repeatability.translation_mm**2], 3
        )
        carried = _adjoint(cell.mount.hand_from_camera.inverse())
        total = total + carried @ np.diag(slip) @ carried.T
    if cell.part_covariance is not None:
        carried = _adjoint(part_from_reference.inverse())
        total = total + carried @ cell.part_covariance @ carried.T
    return total


def _of_mount(mount: CameraMount, centre_mm: FloatArray) -> FloatArray:
    back = mount.hand_from_camera.rotation.T
    if mount.anchors_offsets:
        # The session found the projection centre itself on the hand, so that only the direction
        # of the axis is in error: a rotation about that centre.
        rotation = back @ mount.covariance[:3, :3] @ back.T
        lever = np.concatenate([np.eye(3), _cross(centre_mm)])
        found: FloatArray = lever @ rotation @ lever.T
        return found
    # exp(δθ) R and t + δt: seen from the camera both are only turned.
    turned = np.kron(np.eye(2), back)
    whole: FloatArray = turned @ mount.covariance @ turned.T
    return whole


def _adjoint(a_from_b: Pose) -> FloatArray:
    """(6, 6) that takes a small motion in frame b to the same motion in frame a."""
    rotation = a_from_b.rotation
    return np.block(
        [
            [rotation, np.zeros((3, 3))],
            [_cross(a_from_b.translation_mm) @ rotation, rotation],
        ]
    )


def seen_at(covariance: FloatArray, point_mm: FloatArray) -> FloatArray:
    """Tell the translation of a point instead of that of the origin.

    Parameters
    ----------
    covariance
        (6, 6) of a small motion.
    point_mm
        (3,) the point.

    Returns
    -------
    FloatArray
        (6, 6) of the rotation and the translation of that point.
    """
    lever = np.eye(6)
    lever[3:, :3] = -_cross(point_mm)
    moved: FloatArray = lever @ covariance @ lever.T
    return moved


def _cross(vector: FloatArray) -> FloatArray:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
