"""The table ``[placement]`` of a task file: the robot cell that a plan is to be carried out in.

Like all of the file, lengths carry their unit::

    [placement]
    hand_eye = "vicon-1990/session"       # the folder of a session, or a hand-eye .json
    iris = 20
    base_from_part = { rotation_vector_deg = [0, 0, -8], translation = ["60 cm", "10 cm", "20 cm"] }
    part_sigma = { rotation_deg = 0.01, translation = "0.05 mm" }       # left out: known exactly
    repeatability = { rotation_deg = 0.006, translation = "0.02 mm" }   # left out: without error
    reach = { low = ["-10 cm", "-60 cm", "25 cm"], high = ["1.3 m", "80 cm", "1 m"], tilt_deg = 45 }
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from lenscal.arrays import FloatArray
from lenscal.calibration.calibration import Repeatability
from lenscal.calibration.mount import stated_mount
from lenscal.camera_mount import CameraMount
from lenscal.errors import PlanningError
from lenscal.handwritten import Handwritten, LengthMm, PointMm, PoseSpec
from lenscal.pose import Pose
from lenscal.reach import Reach
from lenscal.recording import Recording
from lenscal.setting import ApproachSide
from planning.robot_cell import RobotCell

LengthNotNegativeMm = Annotated[LengthMm, Field(ge=0)]


class ScatterSpec(Handwritten):
    """How far a pose scatters: σ about each axis and along each.

    Parameters
    ----------
    rotation_deg
        In degrees.
    translation
        A length with its unit.
    """

    rotation_deg: float = Field(ge=0)
    translation: LengthNotNegativeMm


class ReachSpec(Handwritten):
    """A `Reach` as it is written.

    Parameters
    ----------
    low, high
        Opposite corners of the box for the hand, in the base frame.
    tilt_deg
        Largest angle between the hand and straight down.
    """

    low: PointMm
    high: PointMm
    tilt_deg: float = Field(default=180.0, ge=0, le=180)


class PlacementSpec(Handwritten):
    """A `RobotCell` as it is written.

    Parameters
    ----------
    hand_eye
        The folder of a session, whose rig stated how the camera sits on the hand, or a hand-eye
        calibration as JSON; beside the task file.
    base_from_part
        Where the part lies.
    part_sigma
        How well that is known; None for exactly.
    repeatability
        Of the robot; None for without error.
    reach
        What the hand can reach; None where nobody knows.
    iris
        Iris setting for the pictures; None to leave the iris as it stands.
    approach
        From which side the motors of the lens arrive; None for that of the map's samples.
    """

    hand_eye: Path
    base_from_part: PoseSpec
    part_sigma: ScatterSpec | None = None
    repeatability: ScatterSpec | None = None
    reach: ReachSpec | None = None
    iris: float | None = None
    approach: ApproachSide | None = None

    def build(self, folder: Path) -> RobotCell:
        """Read what is named and make the cell.

        Parameters
        ----------
        folder
            Where the names of files begin.

        Returns
        -------
        RobotCell
            The cell in mm and radians.

        Raises
        ------
        FileError
            When the hand-eye calibration cannot be read.
        PlanningError
            When the session does not say how the camera sits on the hand, or how well that is
            known.
        """
        part, robot, reach = self.part_sigma, self.repeatability, self.reach
        return RobotCell(
            _mount(folder / self.hand_eye),
            Pose.from_rotation_vector(
                self.base_from_part.rotation_vector_rad, self.base_from_part.translation
            ),
            None if part is None else _covariance(part),
            None
            if robot is None
            else Repeatability(
                rotation_rad=np.radians(robot.rotation_deg), translation_mm=robot.translation
            ),
            None
            if reach is None
            else Reach(np.array(reach.low), np.array(reach.high), reach.tilt_deg),
            self.iris,
            self.approach,
        )


def _covariance(scatter: ScatterSpec) -> FloatArray:
    return np.diag(np.repeat([np.radians(scatter.rotation_deg) ** 2, scatter.translation**2], 3))


def _mount(path: Path) -> CameraMount:
    return mount_of_session(Recording.load(path)) if path.is_dir() else CameraMount.load(path)


def mount_of_session(recording: Recording) -> CameraMount:
    """Take the mounting that the rig of a session stated.

    Parameters
    ----------
    recording
        The session.

    Returns
    -------
    CameraMount
        From which the offsets of the session's lens map are counted.

    Raises
    ------
    PlanningError
        When the rig did not state it, or not how well it is known.
    """
    found = stated_mount(recording)
    if found is None:
        raise PlanningError(
            f"the session {recording.folder} does not say how the camera sits on the hand, and how "
            "well that is known; name a hand-eye calibration instead, such as "
            "`lenscal calibrate SESSION --mount mount.json` writes"
        )
    return found
