"""What a covariance means, in words, and when it means that nothing was measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from lenscal.calibration.calibration import Calibration
from lenscal.calibration.swapped import seen_from_behind
from lenscal.errors import DegenerateGeometryError
from lenscal.pose import Pose

#: Relative σ(d) from which f and D are said not to be separable.
_WARN: Final = 0.01
#: Relative σ(d) from which d is not measured at all.
_REFUSE: Final = 0.3
#: σ of the principal point, as a share of the sensor's diagonal, that is worth a warning.
_WANDERING: Final = 0.02


def diagnose(calibration: Calibration) -> tuple[str, ...]:
    """Say what the data could not show.

    Parameters
    ----------
    calibration
        The result, with its covariance.

    Returns
    -------
    tuple of str
        Sentences; none when all is well.

    Raises
    ------
    DegenerateGeometryError
        When not even the order of magnitude of d is known.
    """
    relative = calibration.sigma("image_distance_mm") / calibration.image_distance_mm
    if relative > _REFUSE:
        raise DegenerateGeometryError(inseparable(calibration.poses, relative))
    sensor = calibration.camera.sensor
    sentences = []
    if relative > _WARN:
        sentences.append(_separability(calibration, relative))
    wandering = max(calibration.sigma(f"principal_point_{axis}_px") for axis in "xy")
    if wandering > _WANDERING * np.hypot(sensor.width_px, sensor.height_px):
        sentences.append(
            f"the principal point is only known to ±{wandering:.0f} px; tilt the target further "
            "and about more axes, or hold the principal point fixed"
        )
    sentences.extend(_numbered_backwards(calibration))
    return tuple(sentences)


def inseparable(poses: Sequence[Pose], relative_sigma: float) -> str:
    """Say that the focal length and the distance cannot be told apart at all.

    Parameters
    ----------
    poses
        The views.
    relative_sigma
        σ(d)/d; infinite when not even its sign is known.

    Returns
    -------
    str
        One sentence.
    """
    known = f"(σ {100 * relative_sigma:.0f} %)" if np.isfinite(relative_sigma) else "at all"
    return (
        "f and T_z are inseparable: the target plane is parallel to the sensor, or all but, in "
        f"every view (largest tilt {largest_tilt_deg(poses):.1f}°), so that the image distance is "
        f"not known {known}; tilt the target by 30° or more"
    )


def largest_tilt_deg(poses: Sequence[Pose]) -> float:
    """Give the largest angle between the optical axis and the normal of a target.

    Parameters
    ----------
    poses
        ``camera_from_target`` of the views.

    Returns
    -------
    float
        In degrees, 0 to 90.
    """
    cosines = [abs(float(pose.rotation[2, 2])) for pose in poses]
    return float(np.degrees(np.arccos(min(1.0, *cosines, 1.0))))


def _separability(calibration: Calibration, relative: float) -> str:
    tilt = largest_tilt_deg(calibration.poses)
    sentence = (
        f"f and D cannot be told apart at this tilt (at most {tilt:.0f}°): σ(f) "
        f"{100 * relative:.1f} %"
    )
    if calibration.focus_view is not None:
        ratio = calibration.sigma("magnification") / calibration.magnification
        sentence += f", but d/D is good to {100 * ratio:.2g} %"
    return f"{sentence}; tilt the target by 30° or more"


def _numbered_backwards(calibration: Calibration) -> list[str]:
    """Name the views whose target shows its back while that of the others shows its front."""
    used = [
        (view, seen_from_behind(pose))
        for view, (pose, mask) in enumerate(
            zip(calibration.poses, calibration.inliers, strict=True)
        )
        if mask.any()
    ]
    behind = [view for view, back in used if back]
    # A world whose z axis points at the camera is a matter of taste, if all views have it so.
    return [
        f"view {view}: its rows or columns look numbered from the other end, because its target "
        "would be seen from behind; its pose is that of the mirror image"
        for view in (behind if 2 * len(behind) < len(used) else [])
    ]
