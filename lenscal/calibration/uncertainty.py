"""From the covariance of the solver's parameters to that of the quantities people ask for."""

from __future__ import annotations

from typing import Final

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.calibration.bundle import Covariance
from lenscal.calibration.projection import CENTRE_X, PERSPECTIVE, RADIAL
from lenscal.calibration.views import State, translations_mm

#: Quantities of the camera alone; higher radial coefficients follow, ``k2_per_mm4`` and so on.
_OF_CAMERA: Final = (
    "image_distance_mm",
    "principal_point_x_px",
    "principal_point_y_px",
    "scale_factor",
    "p1_per_mm",
    "p2_per_mm",
    "k1_per_mm2",
)
#: Quantities that need the focus view; the translation is that of the target's origin there.
_OF_FOCUS_VIEW: Final = (
    "object_distance_mm",
    "magnification",
    "focal_length_mm",
    "translation_x_mm",
    "translation_y_mm",
    "translation_z_mm",
)
#: Step of the differences in σ of each parameter: small against curvature, large against rounding.
_STEP: Final = 1e-3


def quantity_names(intrinsics_count: int, has_focus_view: bool) -> tuple[str, ...]:
    """Name the quantities whose covariance is known.

    Parameters
    ----------
    intrinsics_count
        Length of the intrinsics vector.
    has_focus_view
        Whether D can be told.

    Returns
    -------
    tuple of str
        Names with units.
    """
    higher = range(2, intrinsics_count - RADIAL + 1)
    radial = tuple(f"k{i}_per_mm{2 * i}" for i in higher)
    return _OF_CAMERA + radial + (_OF_FOCUS_VIEW if has_focus_view else ())


def quantity_covariance(
    state: State,
    middles_mm: FloatArray,
    covariance: Covariance,
    noise_px: float,
    focus_view: int | None,
) -> FloatArray:
    """Propagate the covariance of the parameters to the named quantities, to first order.

    Parameters
    ----------
    state
        The solution.
    middles_mm
        (V, 3) the middle of each view in the target frame.
    covariance
        Of its parameters, for unit noise.
    noise_px
        σ of one observed coordinate.
    focus_view
        The view whose plane D is measured to, or None.

    Returns
    -------
    FloatArray
        (Q, Q) in the order of `quantity_names`.
    """
    count = len(state.intrinsics)
    joint = covariance.shared if focus_view is None else covariance.joint(focus_view)
    deviations = noise_px * np.sqrt(np.maximum(np.diag(joint), 0.0))

    def evaluate(step: FloatArray) -> FloatArray:
        if focus_view is None:
            return _camera_quantities(state.intrinsics + step)
        pose_steps = np.zeros((len(state.placements), 6))
        pose_steps[focus_view] = step[count:]
        moved = state.moved(step[:count], pose_steps)
        focus = np.arange(len(pose_steps)) == focus_view
        return np.concatenate(
            [
                _camera_quantities(moved.intrinsics),
                _focus_quantities(moved.select(focus), middles_mm[focus]),
            ]
        )

    gradient = np.zeros((len(evaluate(np.zeros(len(joint)))), len(joint)))
    for index in np.flatnonzero(deviations > 0):
        step = np.zeros(len(joint))
        step[index] = _STEP * deviations[index]
        gradient[:, index] = (evaluate(step) - evaluate(-step)) / (2 * step[index])
    propagated: FloatArray = noise_px**2 * gradient @ joint @ gradient.T
    return (propagated + propagated.T) / 2


def _camera_quantities(intrinsics: FloatArray) -> FloatArray:
    return np.concatenate([[1.0 / intrinsics[PERSPECTIVE]], intrinsics[CENTRE_X:]])


def _focus_quantities(state: State, middle_mm: FloatArray) -> FloatArray:
    perspective = state.intrinsics[PERSPECTIVE]
    shift = translations_mm(perspective, state.rotations, state.placements, middle_mm)[0]
    normal = state.rotations[0, :, 2]
    distance = normal @ shift / normal[2]
    magnification = 1.0 / (perspective * distance)
    return np.array([distance, magnification, 1.0 / (1.0 / distance + perspective), *shift])
