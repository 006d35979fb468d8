"""First-order optics: equations (3) to (8) of the paper, blur and depth of field.

All lengths are the perspective ones, what a calibration sees: the object distance D reaches to the
entrance pupil, the image distance is d = D · (d/D), the focal length f follows from (3a). Every
function broadcasts. Source: Tarabanis, Tsai and Abrams (1990), sections 1.3 and 1.4.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from lenscal.arrays import FloatArray
from lenscal.sensor import Axis, Sensor

Number = npt.ArrayLike


def focal_length_mm(object_distance_mm: Number, image_distance_mm: Number) -> FloatArray:
    """Apply the Gaussian lens law, (3a) and (7a): 1/f = 1/D + 1/d.

    Parameters
    ----------
    object_distance_mm
        D in mm.
    image_distance_mm
        d in mm.

    Returns
    -------
    FloatArray
        f in mm.
    """
    return _array(1.0 / (1.0 / _array(object_distance_mm) + 1.0 / _array(image_distance_mm)))


def magnification(object_distance_mm: Number, image_distance_mm: Number) -> FloatArray:
    """Give the magnification ratio, (3b) and (7b): d/D.

    Parameters
    ----------
    object_distance_mm
        D in mm.
    image_distance_mm
        d in mm.

    Returns
    -------
    FloatArray
        The ratio d/D.
    """
    return _array(_array(image_distance_mm) / _array(object_distance_mm))


def object_distance_mm(magnification: Number, focal_length_mm: Number) -> FloatArray:
    """Solve directly for the object distance, (4a) and (8a): D = (1 + 1/m) f.

    Parameters
    ----------
    magnification
        m = w/l for resolution (4a), m = I_min/L for the field of view (8a).
    focal_length_mm
        f in mm.

    Returns
    -------
    FloatArray
        D in mm: the farthest that resolves (4a), the nearest that is not truncated (8a).
    """
    return _array((1.0 + 1.0 / _array(magnification)) * _array(focal_length_mm))


def image_distance_mm(magnification: Number, focal_length_mm: Number) -> FloatArray:
    """Solve directly for the image distance, (4b) and (8b): d = (1 + m) f.

    Parameters
    ----------
    magnification
        m = w/l for resolution (4b), m = I_min/L for the field of view (8b).
    focal_length_mm
        f in mm.

    Returns
    -------
    FloatArray
        d in mm.
    """
    return _array((1.0 + _array(magnification)) * _array(focal_length_mm))


def resolution_limit(sensor: Sensor, pixels: float, length_mm: float, axis: Axis = "any") -> float:
    """Give the smallest magnification that resolves a feature, w/l of (9) and (10).

    Parameters
    ----------
    sensor
        The sensor; its frame-buffer samples count.
    pixels
        How many samples the feature must cover.
    length_mm
        The size l of the feature in mm.
    axis
        The image axis along which it lies, or "any".

    Returns
    -------
    float
        w/l.
    """
    return pixels * sensor.sample_spacing_mm(axis) / length_mm


def field_of_view_limit(sensor: Sensor, length_mm: float, axis: Axis = "any") -> float:
    """Give the largest magnification that does not truncate a feature, I_min/L of (11) and (12).

    Parameters
    ----------
    sensor
        The sensor.
    length_mm
        The size L of the feature in mm.
    axis
        The image axis along which it lies, or "any".

    Returns
    -------
    float
        I_min/L.
    """
    return sensor.extent_mm(axis) / length_mm


def blur_diameter_mm(
    depth_mm: Number,
    object_distance_mm: Number,
    image_distance_mm: Number,
    entrance_pupil_diameter_mm: Number,
) -> FloatArray:
    """Give the diameter of the circle of confusion: a·d·|1/z − 1/D|.

    Exact for a thick lens when D and d are the perspective ones, because the cone of rays stands on
    the entrance pupil and the projection centre lies in it.

    Parameters
    ----------
    depth_mm
        z of the point along the optical axis, from the projection centre, in mm.
    object_distance_mm
        D of the sharp plane in mm.
    image_distance_mm
        d in mm.
    entrance_pupil_diameter_mm
        a in mm.

    Returns
    -------
    FloatArray
        Diameter on the sensor in mm.
    """
    vergence = np.abs(1.0 / _array(depth_mm) - 1.0 / _array(object_distance_mm))
    return _array(_array(entrance_pupil_diameter_mm) * _array(image_distance_mm) * vergence)


def depth_of_field_mm(
    object_distance_mm: Number,
    image_distance_mm: Number,
    entrance_pupil_diameter_mm: Number,
    blur_diameter_mm: Number,
) -> tuple[FloatArray, FloatArray]:
    """Give the nearest and the farthest depth at which a point is blurred by no more than allowed.

    Parameters
    ----------
    object_distance_mm
        D of the sharp plane in mm.
    image_distance_mm
        d in mm.
    entrance_pupil_diameter_mm
        a in mm.
    blur_diameter_mm
        The permitted circle of confusion c on the sensor in mm.

    Returns
    -------
    near_mm, far_mm : FloatArray
        Depths along the axis in mm; far is infinite beyond the hyperfocal distance.
    """
    slack = _array(blur_diameter_mm) / (
        _array(entrance_pupil_diameter_mm) * _array(image_distance_mm)
    )
    vergence = 1.0 / _array(object_distance_mm)
    far_vergence = vergence - slack
    reaches_infinity = far_vergence <= 0
    far = np.where(reaches_infinity, np.inf, 1.0 / np.where(reaches_infinity, 1.0, far_vergence))
    return _array(1.0 / (vergence + slack)), _array(far)


def _array(value: Number) -> FloatArray:
    return np.asarray(value, dtype=np.float64)
