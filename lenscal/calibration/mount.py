"""The mounting of the camera on the hand that goes with a session: as stated, or measured."""

from __future__ import annotations

from lenscal.calibration.calibration import Repeatability
from lenscal.calibration.hand_eye import solve_hand_eye
from lenscal.camera_mount import CameraMount
from lenscal.errors import CalibrationError
from lenscal.recording import Recording


def stated_mount(recording: Recording) -> CameraMount | None:
    """Take the mounting that the rig of a session stated.

    Parameters
    ----------
    recording
        The session.

    Returns
    -------
    CameraMount or None
        From which the offsets of the session's lens map are counted; None where the rig did not
        state it, or not how well it is known.
    """
    head = recording.head
    if head.hand_from_camera is None or head.reference_setting is None:
        return None
    if head.hand_eye_sigma_rad is None or head.hand_eye_sigma_mm is None:
        return None
    return CameraMount.stated(
        head.hand_from_camera,
        head.reference_setting,
        head.identity,
        head.hand_eye_sigma_rad,
        head.hand_eye_sigma_mm,
    )


def measured_mount(recording: Recording, repeatability: Repeatability | None = None) -> CameraMount:
    """Calibrate hand-eye by the views that a session took at its reference setting.

    Parameters
    ----------
    recording
        The session, with the poses that the robot reported.
    repeatability
        Of the robot; None to estimate it from these views.

    Returns
    -------
    CameraMount
        The mounting with its covariance. The offsets of the session's lens map are not counted from
        it where the rig stated another.

    Raises
    ------
    CalibrationError
        When the session has no reference setting, or did not visit it with a robot, or its views do
        not tell how the camera sits on the hand.
    """
    head, reference = recording.head, recording.head.reference_setting
    if reference is None:
        raise CalibrationError(
            f"the session {recording.folder} does not say for which setting hand-eye is to be "
            "calibrated; state reference_setting in the description of the rig and record again"
        )
    wanted = reference.zoom, reference.focus
    found = [r for r in recording.settings if (r.setting.zoom, r.setting.focus) == wanted]
    if not found:
        raise CalibrationError(
            f"the session {recording.folder} never was at the reference setting, {reference}; add "
            "it to the plan of the session"
        )
    views = found[0].views
    if all(view.base_from_hand is None for view in views):
        raise CalibrationError(
            f"the session {recording.folder} holds no poses of a robot at {reference}; hand-eye "
            "calibration needs them"
        )
    solved = solve_hand_eye(
        [view.observation.points_mm for view in views],
        [view.observation.pixels for view in views],
        [view.base_from_hand for view in views],
        head.sensor,
        repeatability=repeatability,
    )
    return CameraMount(solved.hand_from_camera, solved.covariance, reference, head.identity)
