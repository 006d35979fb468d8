"""Placement: from a planned viewpoint to a pose of the robot's hand, and how well it will be met.

The plan says where the projection centre shall be. The robot carries the camera of the *reference*
setting, for which hand-eye was calibrated; at the chosen setting the projection centre lies the
nodal offset behind that of the reference camera (section 1.5.2 of the paper)::

    base_from_hand = base_from_part · part_from_camera · camera_from_reference · reference_from_hand

The derivation, and that of the covariances, is in ``docs/placement.md``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from lenscal.arrays import FloatArray, frozen_array
from lenscal.camera_mount import CameraMount, differences
from lenscal.errors import OutOfRangeError, PlanningError
from lenscal.pose import Pose
from lenscal.setting import ApproachSide, LensSetting
from planning.fixed_lens import FixedLens
from planning.nodal import NodalPoint, nodal_point
from planning.placement_covariance import motion_covariance, seen_at
from planning.robot_cell import RobotCell

if TYPE_CHECKING:
    import pandas as pd

    from lenscal.maps.lens_map import LensMap

#: The roles in which the lens map and the hand-eye calibration must agree: the offsets are those of
#: the lens on its camera, whichever robot carried them.
_OF_LENS: Final = ("lens", "camera", "rig")


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Where the hand goes for one viewpoint, and how well the camera will stand there.

    Parameters
    ----------
    viewpoint
        Row of the plan.
    setting
        Zoom, focus and iris.
    approach
        From which side the motors of the lens arrive.
    part_from_camera
        The planned pose of the camera.
    base_from_hand
        The pose of the hand.
    nodal
        The projection centre at the setting, and with it the standoff that the robot sets.
    sharp_covariance
        (6, 6) of the small motion, in the frame of the camera, that takes the camera that was
        planned to the one that will stand there: rotation vector in rad, and translation in mm of
        the point where the axis meets the sharp plane. Along the axis σ of the standoff counts:
        errors of D and of the offset are one and the same.
    centre_covariance
        (6, 6) of the same motion with the translation of the projection centre. Along the axis σ of
        the offset counts, which is much larger; D is wrong by as much, and nothing in the image
        notices.
    """

    viewpoint: int
    setting: LensSetting
    approach: ApproachSide
    part_from_camera: Pose
    base_from_hand: Pose
    nodal: NodalPoint
    sharp_covariance: FloatArray
    centre_covariance: FloatArray

    def __post_init__(self) -> None:
        for name in ("sharp_covariance", "centre_covariance"):
            object.__setattr__(self, name, frozen_array(name, getattr(self, name), (6, 6)))

    @property
    def standoff_mm(self) -> float:
        """D − offset: from the reference projection centre to the sharp plane."""
        return self.nodal.standoff_mm

    @property
    def sigma_rotation_rad(self) -> FloatArray:
        """(3,) σ of the rotation about the axes of the camera."""
        return np.asarray(np.sqrt(np.diag(self.sharp_covariance)[:3]))

    @property
    def sigma_sharp_mm(self) -> FloatArray:
        """(3,) σ of the place of the sharp point along the axes of the camera; z is sharpness."""
        return np.asarray(np.sqrt(np.diag(self.sharp_covariance)[3:]))

    @property
    def sigma_centre_mm(self) -> FloatArray:
        """(3,) σ of the place of the projection centre along the axes of the camera."""
        return np.asarray(np.sqrt(np.diag(self.centre_covariance)[3:]))


@dataclass(frozen=True, slots=True)
class Unreachable:
    """A viewpoint that the robot cannot go to.

    Parameters
    ----------
    viewpoint
        Row of the plan.
    reason
        What is beyond reach and by how much.
    """

    viewpoint: int
    reason: str


class Placeable(Protocol):
    """A table of viewpoints that hands can be placed for: of one target or of several."""

    @property
    def lens(self) -> LensMap | FixedLens:
        """The lens that was planned with."""

    @property
    def viewpoints(self) -> pd.DataFrame:
        """One row per viewpoint: zoom, focus, iris and the pose of the camera."""

    @property
    def poses(self) -> tuple[Pose, ...]:
        """part_from_camera of each viewpoint, in the order of the table."""

    @property
    def why_empty(self) -> str:
        """Why there is no viewpoint; empty when there are some."""

    @property
    def made_from(self) -> dict[str, str]:
        """Digests of what the plan was made from."""


@dataclass(frozen=True, slots=True, eq=False)
class Placements:
    """A plan turned into poses of the hand.

    Parameters
    ----------
    placements
        One per viewpoint that can be reached, in the order of the plan.
    unreachable
        The other viewpoints.
    cell
        What they were computed with.
    plan
        The plan.
    notes
        What a user should know, in words.
    """

    placements: Sequence[Placement]
    unreachable: Sequence[Unreachable]
    cell: RobotCell
    plan: Placeable
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.placements)


def place_plan(plan: Placeable, cell: RobotCell) -> Placements:
    """Find where the hand has to go for every viewpoint of a plan.

    Parameters
    ----------
    plan
        The plan.
    cell
        What stands where.

    Returns
    -------
    Placements
        Viewpoints out of reach are among its `unreachable`.

    Raises
    ------
    PlanningError
        When there is nothing to place, the lens map does not tell where the projection centre is,
        the hand-eye calibration is of another rig or setting, the side to arrive from is not known,
        or no viewpoint can be reached.
    """
    if not len(plan.viewpoints):
        raise PlanningError(f"there is nothing to place: the plan is empty ({plan.why_empty})")
    lens, approach = placeable(plan.lens, cell)
    placed: list[Placement] = []
    beyond: list[Unreachable] = []
    for row, part_from_camera in enumerate(plan.poses):
        viewpoint = plan.viewpoints.iloc[row]
        iris = float(viewpoint.get("iris", np.nan))
        setting = LensSetting(
            float(viewpoint["zoom"]),
            float(viewpoint["focus"]),
            iris if np.isfinite(iris) else cell.iris,
        )
        placement = place(lens, setting, part_from_camera, cell, approach, row)
        try:
            if cell.reach is not None:
                cell.reach.check(placement.base_from_hand)
        except OutOfRangeError as error:
            beyond.append(Unreachable(row, str(error).removesuffix("; nothing was moved")))
        else:
            placed.append(placement)
    if not placed:
        raise PlanningError(
            f"the robot reaches none of the {len(beyond)} viewpoints; viewpoint 0: "
            f"{beyond[0].reason}; move the part or enlarge the reach"
        )
    return Placements(tuple(placed), tuple(beyond), cell, plan, placed[0].nodal.notes)


def placeable(lens: LensMap | FixedLens, cell: RobotCell) -> tuple[LensMap, ApproachSide]:
    """Make sure that a lens can be placed in a cell, before it is planned for.

    Parameters
    ----------
    lens
        The lens that is planned with.
    cell
        What stands where.

    Returns
    -------
    lens : LensMap
        The lens map, with nodal offsets.
    approach : ApproachSide
        From which side the motors of the lens arrive.

    Raises
    ------
    PlanningError
        When the lens map does not tell where the projection centre is, the hand-eye calibration is
        of another rig or setting, or the side to arrive from is not known.
    """
    known = _with_offsets(lens)
    _same_rig(known, cell.mount)
    return known, cell.approach or _approach_of(known)


def place(
    lens: LensMap,
    setting: LensSetting,
    part_from_camera: Pose,
    cell: RobotCell,
    approach: ApproachSide,
    viewpoint: int = 0,
) -> Placement:
    """Find where the hand has to go so that the projection centre is where it is wanted.

    Parameters
    ----------
    lens
        The lens map, with standoffs.
    setting
        The setting.
    part_from_camera
        The wanted pose of the camera at that setting.
    cell
        What stands where.
    approach
        From which side the motors of the lens arrive.
    viewpoint
        Its number in the plan.

    Returns
    -------
    Placement
        The pose of the hand, reachable or not, and its covariances.
    """
    nodal = nodal_point(lens, setting.zoom, setting.focus)
    reference_from_camera = Pose(np.eye(3), nodal.centre_mm)
    part_from_reference = part_from_camera @ reference_from_camera.inverse()
    base_from_hand = (
        cell.base_from_part @ part_from_reference @ cell.mount.hand_from_camera.inverse()
    )
    motion = motion_covariance(cell, part_from_reference, nodal.centre_mm)
    sharp = seen_at(motion, nodal.sharp_point_mm)
    centre = seen_at(motion, nodal.centre_mm)
    lateral = nodal.sigma_lateral_mm**2
    sharp[3:, 3:] += np.diag([*lateral, nodal.sigma_standoff_mm**2])
    centre[3:, 3:] += np.diag([*lateral, nodal.sigma_offset_mm**2])
    return Placement(
        viewpoint, setting, approach, part_from_camera, base_from_hand, nodal, sharp, centre
    )


def _with_offsets(lens: LensMap | FixedLens) -> LensMap:
    if isinstance(lens, FixedLens):
        raise PlanningError(
            "a fixed lens has no nodal offsets to place it by; calibrate it with a robot and plan "
            "with its lens map"
        )
    if not lens.has_standoff:
        raise PlanningError(
            "the lens map has no standoffs and nodal offsets, so that nobody knows where its "
            "projection centre is on the hand; record a session with a robot and fit the map again"
        )
    return lens


def _same_rig(lens: LensMap, mount: CameraMount) -> None:
    different = [r for r in differences(lens.identity, mount.identity) if r in _OF_LENS]
    if different:
        role = different[0]
        raise PlanningError(
            f"the hand-eye calibration is of another rig than the lens map: its {role} is "
            f"{mount.identity[role]!r}, that of the map {lens.identity[role]!r}; "
            "give the one that was made on this rig"
        )
    wanted, given = lens.reference_setting, mount.reference_setting
    if wanted is not None and (wanted.zoom, wanted.focus) != (given.zoom, given.focus):
        raise PlanningError(
            f"the hand-eye calibration holds for {given}, but the offsets of the lens map are "
            f"counted from {wanted}; calibrate hand-eye at that setting"
        )


def _approach_of(lens: LensMap) -> ApproachSide:
    samples = lens.samples
    sides = sorted(set(samples["approach"])) if "approach" in samples else []
    if len(sides) != 1:
        said = f"both sides ({', '.join(sides)})" if sides else "a side that it does not state"
        raise PlanningError(
            f"the lens map was calibrated from {said}; state with approach from which side the "
            "motors of the lens shall arrive"
        )
    return ApproachSide(sides[0])
