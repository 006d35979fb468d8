"""From a fit to a calibration: noise, covariance, diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from lenscal.arrays import BoolArray, FloatArray
from lenscal.calibration.bundle import covariance, residuals
from lenscal.calibration.calibration import Calibration, RobotEvidence
from lenscal.calibration.diagnosis import diagnose, inseparable
from lenscal.calibration.projection import PERSPECTIVE, camera_of
from lenscal.calibration.rejection import Selection
from lenscal.calibration.rig_constrained import RobotFit
from lenscal.calibration.uncertainty import FocusPlane, evaluate_quantities, quantity_names
from lenscal.calibration.views import Views
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
    missed = residuals(views, state)
    squares = float((missed**2).sum(axis=1)[inliers].sum())
    used = inliers.any(axis=1)
    freedom = 2 * int(inliers.sum()) - int(free.sum()) - 6 * int(used.sum())
    if freedom <= 0:
        raise DegenerateGeometryError(
            f"{int(inliers.sum())} points in {int(used.sum())} views are too few for the "
            f"{int(free.sum()) + 6 * int(used.sum())} parameters asked for; add views or "
            "points, or hold the principal point fixed"
        )
    noise_px = float(np.sqrt(squares / freedom))
    refuse_nonsense(missed, inliers, sensor)
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
    seen = _Seen(views, selection, missed, sensor, noise_px, focus_view)
    return _with_warnings(_calibration(seen, plane, joint), notes)


class Reference(NamedTuple):
    """What a robot's quantities are counted from.

    Parameters
    ----------
    focus_view
        The view D is measured to, or None.
    focus_hand
        ``base_from_hand`` of that view as reported, or None.
    hand_from_camera
        The reference camera in the hand, or None where it is not known.
    hand_eye_sigma
        σ of its rotation in rad and of its place in mm.
    """

    focus_view: int | None
    focus_hand: Pose | None
    hand_from_camera: Pose | None
    hand_eye_sigma: tuple[float, float] = (0.0, 0.0)


def conclude_with_robot(
    views: Views,
    selection: Selection,
    sensor: Sensor,
    robot: RobotFit,
    reference: Reference,
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
    reference
        What D, nodal offset and standoff are counted from.

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
    missed = residuals(views, robot.state)
    refuse_nonsense(missed, selection.inliers, sensor)
    _refuse_inside_out(views, selection, sensor, robot.noise_px)
    notes = []
    focus_view, focus_hand = reference.focus_view, reference.focus_hand
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
            reference.hand_from_camera,
            reference.hand_eye_sigma,
        )
    shared = robot.covariance.shared
    count = len(state.intrinsics)
    evidence = RobotEvidence(
        state.mounting,
        noise_px**2 * shared[count:, count:],
        robot.slips,
        robot.believed,
        robot.repeatability,
        robot.redundancy,
    )
    seen = _Seen(views, selection, missed, sensor, noise_px, None if plane is None else focus_view)
    return _with_warnings(_calibration(seen, plane, shared, evidence), (*notes, *robot.notes))


class _Seen(NamedTuple):
    """What was fitted, before it is known how well."""

    views: Views
    selection: Selection
    missed: FloatArray
    sensor: Sensor
    noise_px: float
    focus_view: int | None


def _calibration(
    seen: _Seen, plane: FocusPlane | None, joint: FloatArray, robot: RobotEvidence | None = None
) -> Calibration:
    state, present = seen.selection.state, seen.views.present
    values, quantity_covariance = evaluate_quantities(state.intrinsics, plane, joint, seen.noise_px)
    return Calibration(
        camera=camera_of(state.intrinsics, seen.sensor),
        poses=state.poses(seen.views.middles_mm),
        pixels=tuple(q[:, p].T for q, p in zip(seen.views.pixels, present, strict=True)),
        residuals_px=tuple(r[:, p].T for r, p in zip(seen.missed, present, strict=True)),
        inliers=tuple(i[p] for i, p in zip(seen.selection.inliers, present, strict=True)),
        rejected=seen.selection.rejections,
        noise_px=seen.noise_px,
        focus_view=seen.focus_view,
        quantities=quantity_names(len(state.intrinsics), plane),
        quantity_covariance=quantity_covariance,
        quantity_values=values,
        robot=robot,
    )


def _with_warnings(calibration: Calibration, notes: Sequence[str]) -> Calibration:
    warnings = (*notes, *diagnose(calibration))
    return replace(calibration, warnings=warnings) if warnings else calibration


def refuse_nonsense(missed: FloatArray, inliers: BoolArray, sensor: Sensor) -> None:
    """Refuse views that no camera explains.

    Parameters
    ----------
    missed
        (V, 2, M) what a fit left of all observations, in px.
    inliers
        (V, M) which of them were used.
    sensor
        The sensor.

    Raises
    ------
    CalibrationError
        When the points miss by more than any detector does.
    """
    squared = (missed**2).sum(axis=1)[inliers]
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
