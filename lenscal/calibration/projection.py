"""The camera model as the solvers see it: pixels and their analytic derivatives, all views at once.

A pose is expressed by what an image shows well. With R the rotation, P a target point relative to
the view's own middle point, and (a, b, s) the *placement* of that middle — its ideal image position
in mm and its magnification —

    ideal = (s (R P)_xy + (a, b)) / (1 + s (R P)_z / d),

which is the pinhole with translation (a, b, d) / s. What d and the distance cannot show apart, they
share in s; d itself enters through 1/d alone, the strength of perspective, so that the solvers walk
along the valley of equal d/D in a straight line, and a lens without perspective is 1/d = 0, not an
infinity. Distortion maps distorted to undistorted (`lenscal.camera`); its inverse is differentiated
by the implicit function theorem.

Arrays hold coordinates before points, (V, 2, M), so that every coordinate of all points lies in one
piece; a calibration spends its time here.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from lenscal.arrays import BoolArray, FloatArray
from lenscal.camera import Camera
from lenscal.sensor import Sensor

#: Where each intrinsic parameter stands in the vector; radial coefficients, κ1 first, follow.
PERSPECTIVE, CENTRE_X, CENTRE_Y, SCALE_FACTOR, DECENTRING_1, DECENTRING_2, RADIAL = range(7)

#: Newton steps that the inversion of the distortion may take; it converges quadratically.
_NEWTON_STEPS: Final = 20
#: Step of Newton's method, as a share of the size of the image, after which the next would be
#: rounding: convergence is quadratic.
_LAST_STEP: Final = 1e-8


class Projection(NamedTuple):
    """Pixels and how they move.

    Parameters
    ----------
    pixels
        (V, 2, M) where the points appear; NaN behind the camera and beyond the distortion's fold.
    jacobian
        (V, k + 6, 2, M) derivatives by the k free intrinsic parameters, by a rotation vector
        applied on the left, and by the placement; finite everywhere.
    """

    pixels: FloatArray
    jacobian: FloatArray


def intrinsics_of(camera: Camera) -> FloatArray:
    """Write a camera as a vector.

    Parameters
    ----------
    camera
        The camera.

    Returns
    -------
    FloatArray
        (K,) 1/d, principal point, scale factor, decentring, κ1 and the further radial terms.
    """
    return np.array(
        [
            1.0 / camera.image_distance_mm,
            *camera.centre_px,
            camera.sensor.scale_factor,
            *camera.decentring,
            camera.k1_per_mm2,
            *camera.radial,
        ]
    )


def camera_of(intrinsics: FloatArray, sensor: Sensor) -> Camera:
    """Make a camera of a vector.

    Parameters
    ----------
    intrinsics
        (K,) as `intrinsics_of` writes it.
    sensor
        The sensor; its scale factor is replaced by that of the vector.

    Returns
    -------
    Camera
        The camera.
    """
    actual = Sensor(
        sensor.width_px,
        sensor.height_px,
        sensor.pitch_x_mm,
        sensor.pitch_y_mm,
        float(intrinsics[SCALE_FACTOR]),
    )
    decentring = intrinsics[[DECENTRING_1, DECENTRING_2]]
    return Camera(
        actual,
        float(1.0 / intrinsics[PERSPECTIVE]),
        float(intrinsics[RADIAL]),
        intrinsics[[CENTRE_X, CENTRE_Y]],
        tuple(float(c) for c in intrinsics[RADIAL + 1 :]),
        (float(decentring[0]), float(decentring[1])),
    )


def project(
    points_mm: FloatArray,
    intrinsics: FloatArray,
    rotations: FloatArray,
    placements: FloatArray,
    element_pitch_mm: FloatArray,
) -> FloatArray:
    """Project the points of all views.

    Parameters
    ----------
    points_mm
        (V, 3, M) target points relative to the middle of their view.
    intrinsics
        (K,) as `intrinsics_of` writes it.
    rotations
        (V, 3, 3) camera from target.
    placements
        (V, 3) a, b in mm on the sensor, and the magnification s.
    element_pitch_mm
        (2,) spacing of the sensor's elements; the scale factor is among the intrinsics.

    Returns
    -------
    FloatArray
        (V, 2, M) where the points appear; NaN behind the camera and beyond the distortion's fold.
    """
    ideal, _, in_front = _pinhole(rotations @ points_mm, placements, intrinsics[PERSPECTIVE])
    distorted, settled = _distort(ideal, intrinsics)
    return _to_pixels(distorted, in_front & settled, intrinsics, element_pitch_mm)


def project_with_derivatives(
    points_mm: FloatArray,
    intrinsics: FloatArray,
    rotations: FloatArray,
    placements: FloatArray,
    element_pitch_mm: FloatArray,
    free: BoolArray,
) -> Projection:
    """Project the points of all views, with derivatives.

    Parameters
    ----------
    points_mm
        (V, 3, M) target points relative to the middle of their view.
    intrinsics
        (K,) as `intrinsics_of` writes it.
    rotations
        (V, 3, 3) camera from target.
    placements
        (V, 3) a, b in mm on the sensor, and the magnification s.
    element_pitch_mm
        (2,) spacing of the sensor's elements; the scale factor is among the intrinsics.
    free
        (K,) by which intrinsics to differentiate.

    Returns
    -------
    Projection
        Pixels and derivatives.
    """
    perspective = intrinsics[PERSPECTIVE]
    rotated = rotations @ points_mm
    ideal, inverse_depth, in_front = _pinhole(rotated, placements, perspective)
    distorted, settled = _distort(ideal, intrinsics)
    pixels = _to_pixels(distorted, in_front & settled, intrinsics, element_pitch_mm)
    (xx, xy), (yx, yy) = _inverse_slope(distorted, intrinsics)
    pitch_x, pitch_y = element_pitch_mm * (intrinsics[SCALE_FACTOR], 1.0)

    # Columns are first written as the movement of the ideal point, on the sensor in mm.
    indices = np.flatnonzero(free)
    jacobian = np.zeros((len(rotations), len(indices) + 6, *ideal.shape[1:]))
    for column, index in enumerate(indices):
        if index == PERSPECTIVE:
            depth = rotated[:, 2] * placements[:, None, 2] * inverse_depth
            jacobian[:, column] = -ideal * depth[:, None]
        elif index >= DECENTRING_1:
            # u(x, κ) is held at the ideal point, so that dx/dκ = −(∂u/∂x)⁻¹ ∂u/∂κ.
            jacobian[:, column] = -_distortion_term(distorted, int(index))
    _ideal_by_pose(jacobian[:, -6:], rotated, ideal, inverse_depth, placements, perspective)
    across, down = jacobian[:, :, 0], jacobian[:, :, 1]
    moved_x = (xx / pitch_x)[:, None] * across + (xy / pitch_x)[:, None] * down
    moved_y = (yx / pitch_y)[:, None] * across + (yy / pitch_y)[:, None] * down
    jacobian[:, :, 0], jacobian[:, :, 1] = moved_x, moved_y
    for column, index in enumerate(indices):
        if index in (CENTRE_X, CENTRE_Y):
            jacobian[:, column, index - CENTRE_X] = 1.0
        elif index == SCALE_FACTOR:
            jacobian[:, column, 0] = -distorted[:, 0] / (pitch_x * intrinsics[SCALE_FACTOR])
    return Projection(pixels, jacobian)


def _pinhole(
    rotated: FloatArray, placements: FloatArray, perspective: float
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Ideal image points (V, 2, M), one over the relative depth (V, M), and whether it is > 0."""
    scale = placements[:, 2, None]
    depth = 1.0 + (scale * perspective) * rotated[:, 2]
    in_front = depth > 0
    inverse_depth = in_front / np.where(in_front, depth, 1.0)
    ideal = (scale[:, None] * rotated[:, :2] + placements[:, :2, None]) * inverse_depth[:, None]
    return ideal, inverse_depth, in_front


def _to_pixels(
    distorted: FloatArray, valid: BoolArray, intrinsics: FloatArray, element_pitch_mm: FloatArray
) -> FloatArray:
    pitch = (element_pitch_mm * (intrinsics[SCALE_FACTOR], 1.0))[:, None]
    pixels: FloatArray = distorted / pitch + intrinsics[[CENTRE_X, CENTRE_Y], None]
    if not valid.all():
        pixels[np.broadcast_to(~valid[:, None], pixels.shape)] = np.nan
    return pixels


def _ideal_by_pose(
    jacobian: FloatArray,
    rotated: FloatArray,
    ideal: FloatArray,
    inverse_depth: FloatArray,
    placements: FloatArray,
    perspective: float,
) -> None:
    """Write the derivatives (V, 6, 2, M) of the ideal point by rotation vector and placement."""
    x, y, z = rotated[:, 0], rotated[:, 1], rotated[:, 2]
    weight = placements[:, 2, None] * inverse_depth
    # A small rotation ω moves a rotated point by ω × point; its depth, by ω_x y − ω_y x.
    nearer = (weight * perspective)[:, None] * ideal
    jacobian[:, 0] = -nearer * y[:, None]
    jacobian[:, 1] = nearer * x[:, None]
    jacobian[:, 0, 1] -= weight * z
    jacobian[:, 1, 0] += weight * z
    jacobian[:, 2, 0] = -weight * y
    jacobian[:, 2, 1] = weight * x
    jacobian[:, 3, 0] = jacobian[:, 4, 1] = inverse_depth
    foreshortened = rotated[:, :2] - (perspective * z)[:, None] * ideal
    jacobian[:, 5] = inverse_depth[:, None] * foreshortened


def _distort(ideal: FloatArray, intrinsics: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Invert the distortion by Newton's method; tell where it settled.

    Points that never settle, because they lie beyond the fold of the polynomial, come back as the
    principal point.
    """
    radial, decentring = intrinsics[RADIAL:], intrinsics[DECENTRING_1:RADIAL]
    if not intrinsics[DECENTRING_1:].any():
        return ideal, np.ones_like(ideal[:, 0], dtype=bool)
    tolerance = _LAST_STEP * max(float(np.abs(ideal).max(initial=0.0)), 1e-3)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        distorted, moved = _distort_radially(ideal, radial, tolerance)
        if decentring.any():
            distorted, moved = _distort_fully(ideal, distorted, intrinsics, tolerance)
    settled = moved <= tolerance
    if not settled.all():
        distorted = np.where(settled[:, None], distorted, 0.0)
    return distorted, settled


def _distort_radially(
    ideal: FloatArray, radial: FloatArray, tolerance: float
) -> tuple[FloatArray, FloatArray]:
    """Solve r (1 + κ1 r² + …) = r_u for the share r / r_u."""
    squared_ideal = ideal[:, 0] ** 2 + ideal[:, 1] ** 2
    bend = radial[0] * squared_ideal
    # The first terms of the inverse series; far out, where it diverges, anything in between.
    share = np.clip(1.0 - bend + 3.0 * bend * bend, 0.5, 1.5)
    reach = float(np.sqrt(squared_ideal.max(initial=0.0)))
    for _ in range(_NEWTON_STEPS):
        gain, slope = _gain(share * share * squared_ideal, radial)
        step = (share * gain - 1.0) / slope
        share -= step
        np.abs(step, out=step)
        if not step.max(initial=0.0) * reach > tolerance:
            break
    return ideal * share[:, None], step * reach


def _distort_fully(
    ideal: FloatArray, start: FloatArray, intrinsics: FloatArray, tolerance: float
) -> tuple[FloatArray, FloatArray]:
    """Newton's method in two dimensions, from the solution for the radial terms."""
    radial = intrinsics[RADIAL:]
    distorted, moved = start, np.zeros_like(start[:, 0])
    for _ in range(_NEWTON_STEPS):
        x, y = distorted[:, 0], distorted[:, 1]
        gain, _ = _gain(x**2 + y**2, radial)
        undistorted = distorted * gain[:, None]
        for index in (DECENTRING_1, DECENTRING_2):
            undistorted += intrinsics[index] * _distortion_term(distorted, index)
        (xx, xy), (yx, yy) = _inverse_slope(distorted, intrinsics)
        u, v = undistorted[:, 0] - ideal[:, 0], undistorted[:, 1] - ideal[:, 1]
        step = np.stack([xx * u + xy * v, yx * u + yy * v], axis=1)
        distorted = distorted - step
        moved = np.abs(step).max(axis=1)
        if not moved.max(initial=0.0) > tolerance:
            break
    return distorted, moved


def _gain(squared: FloatArray, radial: FloatArray) -> tuple[FloatArray, FloatArray]:
    """1 + κ1 r² + κ2 r⁴ + … and the derivative of r times it."""
    terms = squared * radial[-1]
    gain, slope = terms, (2 * len(radial) + 1) * terms
    for power in range(len(radial) - 1, 0, -1):
        gain = (gain + radial[power - 1]) * squared
        slope = (slope + (2 * power + 1) * radial[power - 1]) * squared
    return gain + 1.0, slope + 1.0


def _inverse_slope(
    distorted: FloatArray, intrinsics: FloatArray
) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    """Inverse of ∂u/∂x, the slope of undistorted by distorted points; four times (V, M)."""
    x, y = distorted[:, 0], distorted[:, 1]
    radial = intrinsics[RADIAL:]
    p1, p2 = intrinsics[DECENTRING_1:RADIAL]
    squared = x**2 + y**2
    # Horner's scheme for the gain, and for twice its derivative by r².
    gain, slope = radial[-1] * squared, np.full_like(squared, 2 * len(radial) * radial[-1])
    for power in range(len(radial) - 1, 0, -1):
        gain = (gain + radial[power - 1]) * squared
        slope = slope * squared + 2 * power * radial[power - 1]
    gain = gain + 1.0
    xx = gain + slope * x * x
    yy = gain + slope * y * y
    xy = slope * x * y
    if p1 or p2:
        xx = xx + (2 * p1 * y + 6 * p2 * x)
        yy = yy + (6 * p1 * y + 2 * p2 * x)
        xy = xy + (2 * p1 * x + 2 * p2 * y)
    inverse = 1.0 / (xx * yy - xy * xy)
    return (yy * inverse, -xy * inverse), (-xy * inverse, xx * inverse)


def _distortion_term(distorted: FloatArray, index: int) -> FloatArray:
    """(V, 2, M) what a coefficient multiplies in x and in y."""
    x, y = distorted[:, 0], distorted[:, 1]
    if index == DECENTRING_1:
        return np.stack([2 * x * y, x**2 + 3 * y**2], axis=1)
    if index == DECENTRING_2:
        return np.stack([3 * x**2 + y**2, 2 * x * y], axis=1)
    squared = x**2 + y**2
    return distorted * (squared ** (index - RADIAL + 1))[:, None]
