"""A calibrated setting as a row of the table, and the evidence behind it."""

from __future__ import annotations

import numpy as np

from lenscal.calibration.calibration import Calibration, RobotEvidence, axial_distance_mm
from lenscal.calibration.pupil import PupilDiameter, entrance_pupil_diameter
from lenscal.calibration.table import PAIRS, QUANTITIES
from lenscal.document import Json
from lenscal.errors import CalibrationError
from lenscal.recording import Head, SettingRecord

Row = dict[str, float | str]


def row_of(head: Head, record: SettingRecord, calibration: Calibration) -> Row:
    """Write a calibration as a row.

    Parameters
    ----------
    head
        What holds for all settings.
    record
        The setting.
    calibration
        What was made of it, with a focus view.

    Returns
    -------
    dict
        By name of column; what is not there is not known.
    """
    sharpest = np.nan if record.focus is None else record.focus.sigma_mm
    row: Row = {
        "zoom": record.setting.zoom,
        "focus": record.setting.focus,
        "iris": np.nan if record.setting.iris is None else record.setting.iris,
        "temperature_c": np.nan if record.temperature_c is None else record.temperature_c,
        "principal_point_x_px": float(calibration.camera.centre_px[0]),
        "principal_point_y_px": float(calibration.camera.centre_px[1]),
        "rms_px": calibration.rms_px,
        "views": sum(bool(used.any()) for used in calibration.inliers),
        "corners": sum(int(used.sum()) for used in calibration.inliers),
        "rejected_corners": sum(int((~used).sum()) for used in calibration.inliers),
        "approach": record.approach.value,
        "sigma_sharpest_mm": sharpest,
    }
    known = [quantity for quantity in QUANTITIES if quantity in calibration.quantities]
    for quantity in known:
        row[quantity] = calibration.value(quantity)
        row[f"sigma_{quantity}"] = calibration.sigma(quantity) or np.nan
    for a, b in PAIRS:
        if a in known and b in known:
            row[f"cov_{a}_{b}"] = float(calibration.covariance([a, b])[0, 1])
    if "standoff_mm" not in known:
        row |= _from_stated_mounting(head, record, calibration)
    if "standoff_mm" in row:
        row["sigma_standoff_mm"] = float(np.hypot(row["sigma_standoff_mm"], sharpest))
    return row | _from_the_focus_curve(record, calibration)


def _from_the_focus_curve(record: SettingRecord, calibration: Calibration) -> Row:
    """Tell how clear the peak was, and the entrance pupil where the curve tells it."""
    if record.focus is None:
        return {}
    row: Row = {
        "sharpest_confidence": record.focus.confidence,
        "pupil_iris": np.nan if record.focus.iris is None else record.focus.iris,
    }
    pupil = _pupil(record, calibration)
    if isinstance(pupil, PupilDiameter):
        row["entrance_pupil_diameter_mm"] = pupil.diameter_mm
        row["sigma_entrance_pupil_diameter_mm"] = pupil.sigma_mm
    return row


def _pupil(record: SettingRecord, calibration: Calibration) -> PupilDiameter | str:
    """Measure the entrance pupil, or say why it is not known."""
    if record.focus is None:
        return "no autofocus was recorded, so the entrance pupil is not known"
    try:
        return entrance_pupil_diameter(
            record.focus,
            calibration.camera.sensor,
            object_distance_mm=calibration.object_distance_mm,
            image_distance_mm=calibration.image_distance_mm,
            covariance_mm2=calibration.covariance(["object_distance_mm", "image_distance_mm"]),
        )
    except CalibrationError as error:
        return str(error)


def _from_stated_mounting(head: Head, record: SettingRecord, calibration: Calibration) -> Row:
    """Take the standoff from the mounting as the rig states it; its own error is not known."""
    standoff = standoff_mm(head, record)
    if np.isnan(standoff):
        return {}
    row: Row = {
        "standoff_mm": standoff,
        "sigma_standoff_mm": 0.0,
        "nodal_offset_mm": calibration.object_distance_mm - standoff,
        # The nodal offset inherits the error of D: the standoff is known so much better.
        "sigma_nodal_offset_mm": float(
            np.hypot(calibration.sigma("object_distance_mm"), head.hand_eye_sigma_mm or 0.0)
        ),
    }
    for a, b in PAIRS:
        if "standoff_mm" in (a, b):
            row[f"cov_{a}_{b}"] = 0.0
        elif "nodal_offset_mm" in (a, b):
            pair = ["object_distance_mm" if q == "nodal_offset_mm" else q for q in (a, b)]
            row[f"cov_{a}_{b}"] = float(calibration.covariance(pair)[0, 1])
    return row


def evidence_of(record: SettingRecord, calibration: Calibration) -> Json:
    """Write down what stands behind a row.

    Parameters
    ----------
    record
        The setting.
    calibration
        What was made of it.

    Returns
    -------
    dict
        What JSON can hold.
    """
    names = list(calibration.quantities)
    pupil = _pupil(record, calibration)
    return {
        "zoom": record.setting.zoom,
        "focus": record.setting.focus,
        "noise_px": calibration.noise_px,
        "quantities": names,
        "covariance": calibration.covariance(names).tolist(),
        "poses": [pose.matrix.tolist() for pose in calibration.poses],
        "robot": None if calibration.robot is None else _robot(calibration.robot),
        "rms_px_of_views": [
            float(np.sqrt((r[i] ** 2).sum(axis=1).mean())) if i.any() else None
            for r, i in zip(calibration.residuals_px, calibration.inliers, strict=True)
        ],
        "rejected": [
            {
                "view": r.view,
                "point_id": None
                if r.point is None
                else int(record.views[r.view].observation.ids[r.point]),
                "residual_px": r.residual_px if np.isfinite(r.residual_px) else None,
                "reason": r.reason,
            }
            for r in calibration.rejected
        ],
        "entrance_pupil_unknown": pupil if isinstance(pupil, str) else None,
        "warnings": list(calibration.warnings),
    }


def _robot(robot: RobotEvidence) -> Json:
    return {
        "camera_from_hand": robot.mounting.camera_from_hand.matrix.tolist(),
        "base_from_target": robot.mounting.base_from_target.matrix.tolist(),
        "mounting_covariance": robot.mounting_covariance.tolist(),
        "repeatability_rad": robot.repeatability.rotation_rad,
        "repeatability_mm": robot.repeatability.translation_mm,
        "slips": [
            row.tolist() if believed else None
            for row, believed in zip(robot.slips, robot.believed, strict=True)
        ],
    }


def standoff_mm(head: Head, record: SettingRecord) -> float:
    """Tell how far the reference projection centre stood from the target plane in the focus view.

    Parameters
    ----------
    head
        With the hand-eye calibration and the place of the target.
    record
        The setting.

    Returns
    -------
    float
        Along the optical axis in mm, from the robot's poses alone; NaN where there are none.
    """
    hand = None if record.focus_view is None else record.views[record.focus_view].base_from_hand
    if hand is None or head.hand_from_camera is None or head.base_from_target is None:
        return np.nan
    reference_from_target = (hand @ head.hand_from_camera).inverse() @ head.base_from_target
    return axial_distance_mm(reference_from_target)
