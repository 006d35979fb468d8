"""The cell that a plan is carried out in: robot, mounting and part, and how well all is known."""

from __future__ import annotations

from dataclasses import dataclass

from lenscal.arrays import FloatArray, frozen_array
from lenscal.calibration.calibration import Repeatability
from lenscal.camera_mount import CameraMount
from lenscal.pose import Pose
from lenscal.reach import Reach
from lenscal.setting import ApproachSide


@dataclass(frozen=True, slots=True, eq=False)
class RobotCell:
    """What stands where, and how well that is known.

    Parameters
    ----------
    mount
        How the reference camera sits on the hand.
    base_from_part
        Where the part lies.
    part_covariance
        (6, 6) of a small motion of the part in its own frame: rotation vector in rad, translation
        in mm; None for a place that is known exactly.
    repeatability
        How far the hand stands from where it says; None for a robot without error.
    reach
        What the hand can reach; None where nobody knows.
    iris
        Iris setting for plans that choose none; None to leave the iris as it stands.
    approach
        From which side the motors of the lens arrive; None for that of the map's samples.
    """

    mount: CameraMount
    base_from_part: Pose
    part_covariance: FloatArray | None = None
    repeatability: Repeatability | None = None
    reach: Reach | None = None
    iris: float | None = None
    approach: ApproachSide | None = None

    def __post_init__(self) -> None:
        if self.part_covariance is not None:
            covariance = frozen_array("part_covariance", self.part_covariance, (6, 6))
            object.__setattr__(self, "part_covariance", covariance)
