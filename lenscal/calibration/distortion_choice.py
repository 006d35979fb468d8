"""How many distortion terms the views can carry, by cross-validation.

The views are dealt into folds. Each model is fitted without one fold; the poses of that fold are
then fitted with the camera held fixed, and what is left of its residuals counts. The simplest model
that is not worse than the best by more than the noise of the comparison is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray
from lenscal.calibration.calibration import Calibration
from lenscal.calibration.refine import calibrate_views, fit_poses
from lenscal.errors import CalibrationError, ConvergenceError
from lenscal.sensor import Sensor

_FOLDS: Final = 5
#: Views that have to be there before any but the simplest model is tried.
_LEAST_VIEWS: Final = 4


class DistortionModel(NamedTuple):
    """Which distortion terms are estimated.

    Parameters
    ----------
    radial_terms
        Count of radial coefficients.
    decentring
        Whether p1 and p2 are among them.
    """

    radial_terms: int
    decentring: bool


#: From simple to rich.
MODELS: Final = (
    DistortionModel(1, False),
    DistortionModel(2, False),
    DistortionModel(1, True),
    DistortionModel(2, True),
    DistortionModel(3, True),
)


def choose_distortion(
    points_mm: Sequence[npt.ArrayLike], pixels: Sequence[npt.ArrayLike], sensor: Sensor
) -> DistortionModel:
    """Choose the distortion terms that predict views they were not fitted to.

    Parameters
    ----------
    points_mm
        One (N, 3) array a view.
    pixels
        One (N, 2) array a view.
    sensor
        The sensor.

    Returns
    -------
    DistortionModel
        κ1 alone with fewer than four views.
    """
    reference = calibrate_views(points_mm, pixels, sensor, focus_view=None, radial_terms=2)
    # All models are judged on the same corners: those that a middling one believes.
    believed = [
        (np.asarray(p)[i], np.asarray(q)[i])
        for p, q, i in zip(points_mm, pixels, reference.inliers, strict=True)
        if i.any()
    ]
    if len(believed) < _LEAST_VIEWS:
        return MODELS[0]
    losses = {model: _held_out(believed, sensor, model) for model in MODELS}
    best = min(MODELS, key=lambda model: float(losses[model].mean()))
    if not np.isfinite(losses[best]).all():
        return MODELS[0]
    return next(model for model in MODELS if _as_good(losses[model], losses[best]))


def _held_out(
    views: list[tuple[FloatArray, FloatArray]], sensor: Sensor, model: DistortionModel
) -> FloatArray:
    """(V,) mean squared residual of each view under a camera that never saw it."""
    losses = np.full(len(views), np.inf)
    folds = min(_FOLDS, len(views))
    for fold in range(folds):
        held = [i for i in range(len(views)) if i % folds == fold]
        kept = [view for i, view in enumerate(views) if i % folds != fold]
        try:
            fitted: Calibration = calibrate_views(
                *_split(kept),
                sensor,
                focus_view=None,
                radial_terms=model.radial_terms,
                decentring=model.decentring,
                reject_outliers=False,
            )
        except (CalibrationError, ConvergenceError):
            return losses
        missed = fit_poses(fitted.camera, *_split([views[i] for i in held]))
        losses[held] = [(m**2).sum(axis=1).mean() for m in missed]
    return losses


def _split(
    views: list[tuple[FloatArray, FloatArray]],
) -> tuple[list[FloatArray], list[FloatArray]]:
    return [points for points, _ in views], [pixels for _, pixels in views]


def _as_good(loss: FloatArray, best: FloatArray) -> bool:
    """Tell whether a loss exceeds the best by no more than one standard error of the difference."""
    with np.errstate(invalid="ignore"):
        difference = loss - best
    error = difference.std(ddof=1) / np.sqrt(len(difference))
    return bool(difference.mean() <= error)
