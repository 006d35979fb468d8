"""What the views of one setting say about it, told at a camera that is believed from elsewhere.

A setting whose views do not determine its camera still knows something: frontal views know d/D to
hundredths of a per cent, though D and d hardly at all. Calibrated by itself it has no answer. Here
its normal equations are laid out at a given camera, say that of a lens map, and solved for one
step: value and covariance of every quantity, as large as they come. To first order that is all the
corners have to say, and a smooth map takes it from there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from lenscal.arrays import BoolArray, FloatArray
from lenscal.calibration.bundle import solve_once
from lenscal.calibration.calibration import Repeatability
from lenscal.calibration.initial import state_before
from lenscal.calibration.mounting import COUNT
from lenscal.calibration.projection import (
    CENTRE_X,
    DECENTRING_1,
    PERSPECTIVE,
    RADIAL,
    SCALE_FACTOR,
)
from lenscal.calibration.rejection import Selection, fit_robustly
from lenscal.calibration.rig_constrained import fit_with_robot
from lenscal.calibration.slips import MountingPrior, Slips
from lenscal.calibration.uncertainty import FocusPlane, evaluate_quantities, quantity_names
from lenscal.calibration.views import Views
from lenscal.camera import Camera
from lenscal.errors import DegenerateGeometryError
from lenscal.pose import Pose

#: σ of ln D before anything is seen: it keeps answers finite that are hardly determined.
_REACH: Final = 1.0
#: Quantities that are positive, and linear in their logarithm where they are hardly known.
_POSITIVE: Final = (
    "image_distance_mm",
    "object_distance_mm",
    "magnification",
    "focal_length_mm",
    "standoff_mm",
)


@dataclass(frozen=True, slots=True, eq=False)
class SettingSummary:
    """All that the views of a setting say, to first order about a camera.

    Parameters
    ----------
    names
        (Q,) the quantities, as `Calibration.quantities`.
    values
        (Q,) where one step from the camera leads; positive ones are led by their logarithm. D is
        believed to lie within a factor of e or so of where it was.
    covariance
        (Q, Q) about there; of relative errors times the value where quantities are positive.
    noise_px
        σ of one observed coordinate.
    rms_px
        Root mean square distance of prediction and observation at the camera itself, the poses
        fitted.
    corners
        How many were used.
    """

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    noise_px: float
    rms_px: float
    corners: int

    def value(self, name: str) -> float:
        """Give a quantity.

        Parameters
        ----------
        name
            Among `names`.

        Returns
        -------
        float
            Its value.
        """
        return float(self.values[self.names.index(name)])


@dataclass(frozen=True, slots=True, eq=False)
class RobotWord:
    """What a robot says of the views of a setting.

    Parameters
    ----------
    hands
        ``base_from_hand`` of each view as reported, or None.
    repeatability
        Of the robot.
    prior
        What other settings know of the mounting.
    hand_from_camera
        The reference camera in the hand, or None.
    """

    hands: tuple[Pose | None, ...]
    repeatability: Repeatability
    prior: MountingPrior | None = None
    hand_from_camera: Pose | None = None


def summarise_views(
    camera: Camera,
    points_mm: Sequence[FloatArray],
    pixels: Sequence[FloatArray],
    focus_view: int,
    robot: RobotWord | None = None,
) -> SettingSummary:
    """Ask the views of a setting what they say, seen from a camera.

    Parameters
    ----------
    camera
        The camera; d, principal point and κ1 are asked for, the rest is held.
    points_mm
        One (N, 3) array a view, z = 0.
    pixels
        One (N, 2) array a view.
    focus_view
        The view D is measured to.
    robot
        What a robot says of the views; None without.

    Returns
    -------
    SettingSummary
        Values and covariance.

    Raises
    ------
    DegenerateGeometryError
        When a view cannot be placed, or the robot's poses do not go with the pictures.
    """
    element_pitch = np.array([camera.sensor.pitch_x_mm, camera.sensor.pitch_y_mm])
    views = Views.pad(points_mm, pixels, element_pitch)
    selection = _placed(camera, views, focus_view)
    held = np.zeros(len(selection.state.intrinsics), dtype=bool)
    asked = ~held
    asked[[SCALE_FACTOR]] = False
    asked[DECENTRING_1:RADIAL] = False
    asked[RADIAL + 1 :] = False
    weights = selection.inliers.astype(float)
    if robot is None:
        solution = solve_once(views, selection.state, asked, weights)
        state = selection.state
        plane = FocusPlane(
            state.rotations[focus_view], state.placements[focus_view], views.middles_mm[focus_view]
        )
        joint = solution.covariance.joint(focus_view)
        step = np.concatenate([solution.shared_step, solution.pose_steps[focus_view]])
    else:
        fitted = fit_with_robot(
            views,
            selection,
            held,
            robot.hands,
            repeatability=robot.repeatability,
            prior=robot.prior,
        )
        state = fitted.state
        slips = Slips.of(
            robot.hands,
            views.middles_mm,
            fitted.noise_px,
            (robot.repeatability.rotation_rad, robot.repeatability.translation_mm),
            fitted.believed,
            robot.prior,
        )
        every = np.concatenate([asked, np.ones(COUNT, dtype=bool)])
        solution = solve_once(views, state, every, weights, slips)
        plane = FocusPlane(
            state.rotations[focus_view],
            state.placements[focus_view],
            views.middles_mm[focus_view],
            state.mounting,
            robot.hands[focus_view],
            robot.hand_from_camera,
        )
        joint, step = solution.covariance.shared, solution.shared_step
    noise_px = _noise(solution.cost, selection.inliers, int(asked.sum()))
    values, covariance = evaluate_quantities(state.intrinsics, plane, joint, noise_px)
    names = quantity_names(len(state.intrinsics), plane)
    positive = np.isin(names, _POSITIVE)
    unit = np.where(positive, values, 1.0)
    change, relative = _kept_in_reach(
        names.index("object_distance_mm"),
        _along(state.intrinsics, plane, step) / unit,
        covariance / np.outer(unit, unit),
    )
    led = np.where(positive, values * np.exp(np.where(positive, change, 0.0)), values + change)
    scale = np.where(positive, led, 1.0)
    return SettingSummary(
        names,
        led,
        scale[:, None] * relative * scale,
        noise_px,
        float(np.sqrt(solution.start_squares / max(int(selection.inliers.sum()), 1))),
        int(selection.inliers.sum()),
    )


def _placed(camera: Camera, views: Views, focus_view: int) -> Selection:
    """Fit the poses to the camera, robustly."""
    start, usable = state_before(camera, views)
    if not usable.all():
        raise DegenerateGeometryError(
            f"view {int(np.argmin(usable))} cannot be placed: it shows fewer than four points, or "
            "they lie on a line"
        )
    selection = fit_robustly(views, start, np.zeros(len(start.intrinsics), dtype=bool))
    if not selection.inliers[focus_view].any():
        raise DegenerateGeometryError(
            f"the focus view (view {focus_view}) does not go with the camera that is believed"
        )
    return selection


def _noise(cost: float, inliers: BoolArray, asked: int) -> float:
    """σ of a pixel once the step is taken."""
    fitted = asked + 6 * int(inliers.any(axis=1).sum())
    return float(np.sqrt(max(cost, 0.0) / max(2 * int(inliers.sum()) - fitted, 1)))


def _along(intrinsics: FloatArray, plane: FocusPlane, step: FloatArray) -> FloatArray:
    """(Q,) derivative of the quantities along a step, times the step."""
    size = 1e-4 * min(1.0, 1.0 / max(float(np.abs(step[PERSPECTIVE] / intrinsics[0])), 1e-12))
    ends = []
    for sign in (1.0, -1.0):
        moved = intrinsics + sign * size * step[: len(intrinsics)]
        camera = np.concatenate([[1.0 / moved[PERSPECTIVE]], moved[CENTRE_X:]])
        of_plane = plane.quantities(
            moved[None, PERSPECTIVE], sign * size * step[None, len(intrinsics) :]
        )
        ends.append(np.concatenate([camera, of_plane[0]]))
    derivative: FloatArray = (ends[0] - ends[1]) / (2 * size)
    return derivative


def _kept_in_reach(
    distance: int, change: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Believe that D is within a factor of e or so of the camera's; what is determined stays."""
    gain = covariance[:, distance] / (covariance[distance, distance] + _REACH**2)
    return change - gain * change[distance], covariance - np.outer(gain, covariance[distance])
