"""The diameter of the entrance pupil, from how fast the focus curve of a setting falls.

A plane at distance z is blurred by a disk of diameter c = a·d·|1/z − 1/D| on the sensor. The
sharpness that a session records by its edge width is one over w, in 1/px, and w² grows by c² times
a constant: its slope against (1/z − 1/D)² is (a·d)². Derivation: ``docs/derivations.md``, "The
entrance pupil".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray, frozen_array
from lenscal.errors import CalibrationError
from lenscal.records import FocusResult
from lenscal.sensor import Sensor

#: Relative σ of every diameter that does not average out: pupils are not round, what blurs the
#: sharp plane is no disk, and w² is not quite a parabola where the blur is as large as a pixel.
SHAPE_SIGMA: Final = 0.01
#: The measure of sharpness that is one over a width in px.
_MEASURE: Final = "edge_width"
#: Width of an edge that a disk blurs, over the diameter of the disk.
_WIDTH_OF_DISK: Final = 3 * np.pi**2 / 32
#: Pictures this sharp, relative to the sharpest, are taken: beyond, the blur outgrows the ring in
#: which sharpness is measured.
_LEAST_SHARPNESS: Final = 0.35
#: Pictures that are needed, and how many times its σ the curvature has to be.
_LEAST_PICTURES: Final = 7
_LEAST_SIGNIFICANCE: Final = 4.0


@dataclass(frozen=True, slots=True)
class PupilDiameter:
    """What a focus curve says of the entrance pupil.

    Parameters
    ----------
    diameter_mm
        a.
    sigma_mm
        Its standard deviation: scatter of the curve, error of D and d, and `SHAPE_SIGMA`.
    iris
        The iris that the curve was taken at; None for a lens that does not tell.
    """

    diameter_mm: float
    sigma_mm: float
    iris: float | None


def entrance_pupil_diameter(
    focus: FocusResult,
    sensor: Sensor,
    *,
    object_distance_mm: float,
    image_distance_mm: float,
    covariance_mm2: npt.ArrayLike = ((0.0, 0.0), (0.0, 0.0)),
) -> PupilDiameter:
    """Measure the entrance pupil at the iris of the autofocus.

    Parameters
    ----------
    focus
        The autofocus, with its curve; the coarse sweep counts as much as the fine one.
    sensor
        Gives the size of the pixels.
    object_distance_mm, image_distance_mm
        D and d of the setting.
    covariance_mm2
        (2, 2) their covariance.

    Returns
    -------
    PupilDiameter
        The diameter at the iris that is part of it.

    Raises
    ------
    CalibrationError
        When sharpness was not measured by edge width, or the curve has too few pictures about its
        peak or does not bend.
    """
    if focus.measure != _MEASURE:
        raise CalibrationError(
            f"the focus curve was measured by {focus.measure}, which tells no width of an edge; "
            f"focus by {_MEASURE} to learn the entrance pupil"
        )
    near = _near_the_peak(focus.curve_sharpness)
    if near.sum() < _LEAST_PICTURES:
        raise CalibrationError(
            f"the focus curve has {near.sum()} pictures about its peak, but {_LEAST_PICTURES} are "
            "needed to learn the entrance pupil; focus in smaller steps"
        )
    # The calibrated D belongs to the place where the autofocus left the camera.
    z = focus.curve_standoff_mm[near] - focus.distance_mm + object_distance_mm
    slope, sigma = _slope(1 / z - 1 / object_distance_mm, focus.curve_sharpness[near])
    if not slope > _LEAST_SIGNIFICANCE * sigma:
        fall = 100 * (1 - focus.curve_sharpness.min() / focus.curve_sharpness.max())
        raise CalibrationError(
            f"the focus curve does not tell the entrance pupil: its sharpness falls by {fall:.0f} "
            "% and scatters too much for that; open the iris or search a longer range"
        )
    width_mm2 = float(np.sqrt(slope)) * effective_pitch_mm(sensor.sample_pitch_mm)
    diameter = width_mm2 / _WIDTH_OF_DISK / image_distance_mm
    # 1/z − 1/D goes as 1/D² for a step of the camera, so that a goes as D²/d.
    gradient = np.array([2 / object_distance_mm, -1 / image_distance_mm])
    distances = gradient @ frozen_array("covariance_mm2", covariance_mm2, (2, 2)) @ gradient
    relative = float(np.sqrt((sigma / (2 * slope)) ** 2 + distances + SHAPE_SIGMA**2))
    return PupilDiameter(diameter, relative * diameter, focus.iris)


def effective_pitch_mm(sample_pitch_mm: FloatArray) -> float:
    """Give the pixel in which a disk of blur has the width that is measured along a whole rim.

    Parameters
    ----------
    sample_pitch_mm
        (2,) spacing of samples along x and y.

    Returns
    -------
    float
        In mm: the pitch where both are equal; otherwise mean N² over mean N, N being the pitch
        across the rim, (p_x² cos² φ + p_y² sin² φ)^½.
    """
    angle = np.linspace(0.0, np.pi / 2, 65)[:-1] + np.pi / 256
    across = np.hypot(sample_pitch_mm[0] * np.cos(angle), sample_pitch_mm[1] * np.sin(angle))
    return float((across**2).mean() / across.mean())


def _near_the_peak(sharpness: FloatArray) -> npt.NDArray[np.bool_]:
    peak = sharpness.max(initial=0.0)
    near: npt.NDArray[np.bool_] = sharpness > _LEAST_SHARPNESS * peak
    return near


def _slope(vergence: FloatArray, sharpness: FloatArray) -> tuple[float, float]:
    """Fit 1/S² by a parabola in 1/z − 1/D: its second coefficient and the σ of that."""
    scale = float(np.abs(vergence).max())
    # Relative errors are alike all along the curve, so a squared width weighs by its reciprocal.
    design = np.vander(vergence / scale, 3, increasing=True) * sharpness[:, None] ** 2
    coefficients = np.linalg.lstsq(design, np.ones(len(sharpness)))[0]
    residual = 1 - design @ coefficients
    variance = float(residual @ residual) / (len(sharpness) - 3)
    spread = variance * np.linalg.pinv(design.T @ design)[2, 2]
    return float(coefficients[2]) / scale**2, float(np.sqrt(spread)) / scale**2
