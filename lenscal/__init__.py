"""Calibration of programmable zoom lenses.

rig ──Frame──▶ session ──Recording──▶ calibration ──CalibrationTable──▶ maps ──LensMap──▶ planning

The names below are the public face; each loads its module when it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lenscal.calibration.calibration import Calibration, Repeatability
    from lenscal.calibration.hand_eye import HandEye, solve_hand_eye
    from lenscal.calibration.projection_uncertainty import projection_sigma_px
    from lenscal.calibration.refine import calibrate_views
    from lenscal.calibration.sweep import calibrate_recording
    from lenscal.calibration.table import CalibrationTable
    from lenscal.calibration.tsai import calibrate_tsai
    from lenscal.camera import Camera
    from lenscal.detection import detect
    from lenscal.maps.consistency import check_consistency
    from lenscal.maps.contours import SettingCurve
    from lenscal.maps.fit import fit_lens_map
    from lenscal.maps.inverse import SettingSolution
    from lenscal.maps.joint import refine_lens_map
    from lenscal.maps.lens_map import LensMap
    from lenscal.maps.validation import cross_validate
    from lenscal.plate import parse_target
    from lenscal.pose import Pose
    from lenscal.recording import FocusResult, Recording
    from lenscal.sensor import Sensor
    from lenscal.session.autofocus import autofocus, autofocus_lens
    from lenscal.session.plan import SessionPlan
    from lenscal.session.runner import run_session
    from lenscal.setting import LensSetting

_HOME = {
    "Calibration": "lenscal.calibration.calibration",
    "CalibrationTable": "lenscal.calibration.table",
    "Camera": "lenscal.camera",
    "FocusResult": "lenscal.recording",
    "HandEye": "lenscal.calibration.hand_eye",
    "LensMap": "lenscal.maps.lens_map",
    "LensSetting": "lenscal.setting",
    "Pose": "lenscal.pose",
    "Recording": "lenscal.recording",
    "Repeatability": "lenscal.calibration.calibration",
    "Sensor": "lenscal.sensor",
    "SessionPlan": "lenscal.session.plan",
    "SettingCurve": "lenscal.maps.contours",
    "SettingSolution": "lenscal.maps.inverse",
    "autofocus": "lenscal.session.autofocus",
    "autofocus_lens": "lenscal.session.autofocus",
    "calibrate_recording": "lenscal.calibration.sweep",
    "calibrate_tsai": "lenscal.calibration.tsai",
    "calibrate_views": "lenscal.calibration.refine",
    "check_consistency": "lenscal.maps.consistency",
    "cross_validate": "lenscal.maps.validation",
    "detect": "lenscal.detection",
    "fit_lens_map": "lenscal.maps.fit",
    "parse_target": "lenscal.plate",
    "refine_lens_map": "lenscal.maps.joint",
    "projection_sigma_px": "lenscal.calibration.projection_uncertainty",
    "run_session": "lenscal.session.runner",
    "solve_hand_eye": "lenscal.calibration.hand_eye",
}

__all__ = [
    "Calibration",
    "CalibrationTable",
    "Camera",
    "FocusResult",
    "HandEye",
    "LensMap",
    "LensSetting",
    "Pose",
    "Recording",
    "Repeatability",
    "Sensor",
    "SessionPlan",
    "SettingCurve",
    "SettingSolution",
    "autofocus",
    "autofocus_lens",
    "calibrate_recording",
    "calibrate_tsai",
    "calibrate_views",
    "check_consistency",
    "cross_validate",
    "detect",
    "fit_lens_map",
    "parse_target",
    "projection_sigma_px",
    "refine_lens_map",
    "run_session",
    "solve_hand_eye",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module 'lenscal' has no attribute {name!r}; it has {', '.join(__all__)}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
