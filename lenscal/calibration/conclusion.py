"""From a fit to a calibration: noise, covariance, diagnosis."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from lenscal.arrays import BoolArray
from lenscal.calibration.bundle import covariance, residuals
from lenscal.calibration.calibration import Calibration, RobotEvidence
from lenscal.calibration.diagnosis import diagnose, inseparable
from lenscal.calibration.projection import PERSPECTIVE, camera_of
from lenscal.calibration.rejection import Selection
from lenscal.calibration.rig_constrained import RobotFit
from lenscal.calibration.uncertainty import FocusPlane, evaluate_quantities, quantity_names
from lenscal.calibration.views import State, Views
from lenscal.errors import CalibrationError, ConvergenceError, DegenerateGeometryError
from lenscal.pose import Pose
from lenscal.sensor import Sensor

#: Noise, as a share of the diagonal of the frame buffer, that no detector makes.
_NONSENSE: Final = 0.02


def conclude(
    views: Views, selection: Selection, sensor: Sensor, free: BoolArray, focus_view: int | None
) -> Calibration:
    """Turn a fit without a robot into a calibration.

    Parameters
    ----------
    views
        All observations.
    selection
        The fit, with what it believed.
    sensor
        The sensor.
    free
        (K,) which intrinsics were estimated.
    focus_view
        The view D is measured to, or None.

    Returns
    -------
    Calibration
        The result.

    Raises
    ------
    CalibrationError
        When no camera explains the observations.
    DegenerateGeometryError
        When there are not more observations than parameters, or they do not determine the camera.
    ConvergenceError
        When the fit did not settle.
    """
    state, inliers = selection.state, selection.inliers
    squares = float((residuals(views, state) ** 2).sum(axis=1)[inliers].sum())
    used = inliers.any(axis=1)
    freedom = 2 * int(inliers.sum()) - int(free.sum()) - 6 * int(used.sum())
    if freedom <= 0:
        raise DegenerateGeometryError(
            f"{int(inliers.sum())} points in {int(used.sum())} views are too few for the "
            f"{int(free.sum()) + 6 * int(used.sum())} parameters asked for; add views or "
            "points, or hold the principal point fixed"
        )
    noise_px = float(np.sqrt(squares / freedom))
    refuse_nonsense(views, inliers, sensor, state)
    _refuse_inside_out(views, selection, sensor, noise_px)
    focus_view, notes = _focus_view(selection, focus_view)
    unit = covariance(views, state, free, inliers.astype(float))
    if focus_view is None:
        plane, joint = None, unit.shared
    else:
        plane = FocusPlane(
            state.rotations[focus_view], state.placements[focus_view], views.middles_mm[focus_view]
        )
        joint = unit.joint(focus_view)
    values, quantity_covariance = evaluate_quantities(state.intrinsics, plane, joint, noise_px)
    result = replace(
        _observed(views, selection, sensor, noise_px, focus_view),
        quantities=quantity_names(len(free), plane),
        quantity_covariance=quantity_covariance,
        quantity_values=values,
    )
    return replace(result, warnings=(*notes, *diagnose(result)))


def conclude_with_robot(
    views: Views,
    selection: Selection,
    sensor: Sensor,
    robot: RobotFit,
    focus_view: int | None,
    focus_hand: Pose | None,
    hand_from_camera: Pose | None,
) -> Calibration:
    """Turn a fit that a robot tied into a calibration.

    Parameters
    ----------
    views
        All observations.
    selection
        Which of them were believed.
    sensor
        The sensor.
    robot
        The fit.
    focus_view
        The view D is measured to, or None.
    focus_hand
        ``base_from_hand`` of that view as reported, or None.
    hand_from_camera
        The reference camera in the hand, or None where it is not known.

    Returns
    -------
    Calibration
        The result.

    Raises
    ------
    CalibrationError
        When no camera explains the observations.
    DegenerateGeometryError
        When they do not determine the camera.
    ConvergenceError
        When the fit did not settle.
    """
    selection = selection._replace(state=robot.state, settled=robot.settled)
    refuse_nonsense(views, selection.inliers, sensor, robot.state)
    _refuse_inside_out(views, selection, sensor, robot.noise_px)
    notes = []
    if focus_view is not None and not selection.inliers[focus_view].any():
        notes.append(f"view {focus_view} was rejected; D is to where the robot says its plane was")
    state, noise_px = robot.state, robot.noise_px
    plane = None
    if focus_view is not None and focus_hand is not None:
        plane = FocusPlane(
            state.rotations[focus_view],
            state.placements[focus_view],
            views.middles_mm[focus_view],
            state.mounting,
            focus_hand,
            hand_from_camera,
        )
    shared = robot.covariance.shared
    values, quantity_covariance = evaluate_quantities(state.intrinsics, plane, shared, noise_px)
    count = len(state.intrinsics)
    result = replace(
        _observed(views, selection, sensor, noise_px, None if plane is None else focus_view),
        quantities=quantity_names(count, plane),
        quantity_covariance=quantity_covariance,
        quantity_values=values,
        robot=RobotEvidence(
            state.mounting,
            noise_px**2 * shared[count:, count:],
            robot.slips,
            robot.believed,
            robot.repeatability,
            robot.redundancy,
        ),
    )
    return replace(result, warnings=(*notes, *robot.notes, *diagnose(result)))


def _observed(
    views: Views, selection: Selection, sensor: Sensor, noise_px: float, focus_view: int | None
) -> Calibration:
    """Camera, poses and residuals, without their uncertainty."""
    missed = residuals(views, selection.state)
    return Calibration(
        camera=camera_of(selection.state.intrinsics, sensor),
        poses=selection.state.poses(views.middles_mm),
        pixels=tuple(q[:, p].T for q, p in zip(views.pixels, views.present, strict=True)),
        residuals_px=tuple(r[:, p].T for r, p in zip(missed, views.present, strict=True)),
        inliers=tuple(i[p] for i, p in zip(selection.inliers, views.present, strict=True)),
        rejected=selection.rejections,
        noise_px=noise_px,
        focus_view=focus_view,
        quantities=(),
        quantity_covariance=None,
    )


def refuse_nonsense(views: Views, inliers: BoolArray, sensor: Sensor, state: State) -> None:
    """Refuse views that no camera explains.

    Parameters
    ----------
    views
        All observations.
    inliers
        (V, M) which of them were used.
    sensor
        The sensor.
    state
        The parameters fitted to them.

    Raises
    ------
    CalibrationError
        When the points miss by more than any detector does.
    """
    squared = (residuals(views, state) ** 2).sum(axis=1)[inliers]
    rms_px = float(np.sqrt(squared.mean() / 2))
    if not rms_px < _NONSENSE * np.hypot(sensor.width_px, sensor.height_px):
        raise CalibrationError(
            f"the views agree with no camera: at best, points miss by {rms_px:.0f} px; check "
            "that the target is described as it is, and that zoom and focus were left alone "
            "between the pictures"
        )


def _refuse_inside_out(views: Views, selection: Selection, sensor: Sensor, noise_px: float) -> None:
    state = selection.state
    if not state.intrinsics[PERSPECTIVE] > 0:
        flipped = replace(state, intrinsics=np.abs(state.intrinsics))
        raise DegenerateGeometryError(inseparable(flipped.poses(views.middles_mm), np.inf))
    if not selection.settled:
        raise ConvergenceError(
            "the fit did not settle; hold the principal point fixed or estimate fewer distortion "
            "terms",
            camera_of(state.intrinsics, sensor),
            noise_px,
            0,
        )


def _focus_view(selection: Selection, focus_view: int | None) -> tuple[int | None, tuple[str, ...]]:
    """Give up a focus view that was rejected, and say so."""
    if focus_view is None or selection.inliers[focus_view].any():
        return focus_view, ()
    return None, (f"the focus view (view {focus_view}) was rejected, so that D is not known",)
