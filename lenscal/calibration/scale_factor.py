"""When views of flat targets can show the horizontal scale factor, and when they only seem to.

A plane shows the camera two constraints, through the images of its circular points, and these
depend on the plane's orientation alone: neither moving the target nor turning it in its own plane
adds any. So one view, or many with parallel planes, cannot tell the scale factor from a principal
point and a perspective that are not known either. Without perspective nothing shows it at all: each
affine image of a target is that of one in some tilt. Tilts that differ by a few degrees suffice in
between, and σ says how well.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.calibration.calibration import Calibration
from lenscal.errors import DegenerateGeometryError

#: Largest relative σ of a scale factor that is worth having.
WORTHLESS: Final = 0.01
#: Angle between planes under which they count as parallel.
_PARALLEL_DEG: Final = 0.5
_WHAT_TO_DO: Final = (
    "give several views whose tilts differ by 10° or more, or points in space (calibrate_tsai), or "
    "state the scale factor with the sensor and leave free_scale_factor out"
)


def refuse_one_orientation(rotations: FloatArray) -> None:
    """Refuse to estimate the scale factor from a plane in a single orientation.

    To be called with what a fit ended at, settled or not: it tilts parallel planes alike, whatever
    scale factor it believes in. First values do not, for want of the distortion. Not for views
    whose camera was moved by a robot: a known way shows the scale of both axes.

    Parameters
    ----------
    rotations
        (V, 3, 3) camera from target, of the views that are used. With none, nothing is refused.

    Raises
    ------
    DegenerateGeometryError
        When there is one view, or the planes of all are parallel.
    """
    if len(rotations) == 1:
        raise DegenerateGeometryError(
            f"one view of a flat target cannot show the scale factor; {_WHAT_TO_DO}"
        )
    widest = largest_angle_deg(rotations)
    if len(rotations) and widest < _PARALLEL_DEG:
        raise DegenerateGeometryError(
            f"{len(rotations)} views with parallel target planes (within {widest:.2f}°) cannot "
            f"show the scale factor, as one view cannot; {_WHAT_TO_DO}"
        )


def refuse_unseen_scale_factor(calibration: Calibration) -> None:
    """Refuse a scale factor that the views do not determine.

    Parameters
    ----------
    calibration
        The result of a fit in which it was free, with its covariance.

    Raises
    ------
    DegenerateGeometryError
        When its relative σ is more than 1 %.
    """
    relative = scale_factor_doubt(calibration)
    rotations = np.stack([pose.rotation for pose in calibration.poses])
    if relative > WORTHLESS:
        raise DegenerateGeometryError(
            f"the views do not show the scale factor: it is only known to {100 * relative:.2g} %, "
            f"and {100 * WORTHLESS:g} % is the most that is of use (their planes differ by at "
            f"most {largest_angle_deg(rotations):.1f}°); {_WHAT_TO_DO}"
        )


def scale_factor_doubt(calibration: Calibration) -> float:
    """Give the relative standard deviation of the scale factor.

    Parameters
    ----------
    calibration
        A result with covariance.

    Returns
    -------
    float
        σ over value; zero when it was held fixed.
    """
    return calibration.sigma("scale_factor") / calibration.camera.sensor.scale_factor


def largest_angle_deg(rotations: FloatArray) -> float:
    """Give the largest angle between the planes of two views.

    Parameters
    ----------
    rotations
        (V, 3, 3) camera from target.

    Returns
    -------
    float
        In degrees, 0 to 90; a plane has no front. Zero for a single view.
    """
    normals = rotations[:, :, 2]
    sines = np.linalg.norm(np.cross(normals[:, None], normals[None]), axis=-1)
    # The sine, because the cosine of a small angle is one for half the digits.
    return float(np.degrees(np.arcsin(min(1.0, sines.max(initial=0.0)))))
