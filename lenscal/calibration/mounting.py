"""How the camera sits on the hand and where the target lies: what ties the views of a robot.

With X = ``camera_from_hand``, Y = ``base_from_target`` and the hand at B = ``base_from_hand``, each
view is ``camera_from_target`` = X · B⁻¹ · Y — as far as the robot stands where it says. It does not
quite. The pose of each view therefore stays free, and its *slip*, X⁻¹ · ``camera_from_target`` ·
Y⁻¹ · B, a small motion in the frame of the hand, is held to zero by the robot's repeatability.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from lenscal.arrays import FloatArray
from lenscal.pose import Pose

#: Where the parameters of a mounting stand in a step: rotation vector and translation of X, of Y.
TURN_X, SHIFT_X, TURN_Y, SHIFT_Y = (slice(i, i + 3) for i in range(0, 12, 3))
#: How many there are.
COUNT = 12


@dataclass(frozen=True, slots=True, eq=False)
class Mounting:
    """Camera on hand, and target in the robot's base.

    Parameters
    ----------
    camera_from_hand
        X, for the setting at hand: its translation moves with the projection centre.
    base_from_target
        Y.
    """

    camera_from_hand: Pose
    base_from_target: Pose

    def moved(self, step: FloatArray) -> Mounting:
        """Take a step.

        Parameters
        ----------
        step
            (12,) rotation vectors, applied on the left of the rotations alone, and additions to the
            translations.

        Returns
        -------
        Mounting
            The new mounting.
        """
        x, y = self.camera_from_hand, self.base_from_target
        return Mounting(
            Pose(turns(step[TURN_X]) @ x.rotation, x.translation_mm + step[SHIFT_X]),
            Pose(turns(step[TURN_Y]) @ y.rotation, y.translation_mm + step[SHIFT_Y]),
        )

    def step_to(self, other: Mounting) -> FloatArray:
        """Tell which step leads to another mounting.

        Parameters
        ----------
        other
            The other one.

        Returns
        -------
        FloatArray
            (12,) such that ``self.moved(step)`` is the other.
        """
        steps = []
        for mine, its in (
            (self.camera_from_hand, other.camera_from_hand),
            (self.base_from_target, other.base_from_target),
        ):
            turn = Rotation.from_matrix(its.rotation @ mine.rotation.T).as_rotvec()
            steps += [turn, its.translation_mm - mine.translation_mm]
        return np.concatenate(steps)

    def camera_from_target(self, base_from_hand: Pose) -> Pose:
        """Tell where the target is before the camera if the robot stands where it says.

        Parameters
        ----------
        base_from_hand
            The pose of the hand.

        Returns
        -------
        Pose
            X · B⁻¹ · Y.
        """
        return self.camera_from_hand @ base_from_hand.inverse() @ self.base_from_target


#: Stands where no robot carried the camera; nothing depends on it there.
UNKNOWN: Final = Mounting(Pose.identity(), Pose.identity())


def turns(vectors: FloatArray) -> FloatArray:
    """Turn rotation vectors into matrices.

    Parameters
    ----------
    vectors
        (..., 3).

    Returns
    -------
    FloatArray
        (..., 3, 3).
    """
    matrices: FloatArray = Rotation.from_rotvec(vectors).as_matrix()
    return matrices
