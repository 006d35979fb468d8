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
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.camera import Camera
from lenscal.sensor import Sensor

#: Where each intrinsic parameter stands in the vector; radial coefficients, κ1 first, follow.
PERSPECTIVE, CENTRE_X, CENTRE_Y, SCALE_FACTOR, DECENTRING_1, DECENTRING_2, RADIAL = range(7)

#: Newton steps that the inversion of the distortion may take; it converges quadratically.
_NEWTON_STEPS: Final = 20


class Projection(NamedTuple):
    """Pixels and how they move.

    Parameters
    ----------
    pixels
        (V, M, 2) where the points appear; NaN behind the camera and beyond the distortion's fold.
    by_intrinsics
        (V, M, 2, K) derivatives by the intrinsic parameters.
    by_pose
        (V, M, 2, 6) derivatives by a rotation vector applied on the left and by the placement.
    """

    pixels: FloatArray
    by_intrinsics: FloatArray
    by_pose: FloatArray


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
) -> Projection:
    """Project the points of all views, with derivatives.

    Parameters
    ----------
    points_mm
        (V, M, 3) target points relative to the middle of their view.
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
    Projection
        Pixels and derivatives.
    """
    perspective = intrinsics[PERSPECTIVE]
    rotated = points_mm @ rotations.transpose(0, 2, 1)
    scale = placements[:, None, 2]
    depth = 1.0 + scale * perspective * rotated[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse_depth = np.where(depth > 0, 1.0 / depth, np.nan)
    ideal = (scale[..., None] * rotated[..., :2] + placements[:, None, :2]) * inverse_depth[
        ..., None
    ]

    distorted, inverse_slope, radial_terms, decentring_terms = _distort(ideal, intrinsics)
    pitch = element_pitch_mm * (intrinsics[SCALE_FACTOR], 1.0)
    pixels = distorted / pitch + intrinsics[[CENTRE_X, CENTRE_Y]]

    by_ideal = inverse_slope / pitch[:, None]
    ideal_by_pose = _ideal_by_pose(rotated, ideal, inverse_depth, scale, perspective)
    ideal_by_perspective = -ideal * (scale * rotated[..., 2] * inverse_depth)[..., None]
    by_intrinsics = np.zeros((*pixels.shape, len(intrinsics)))
    by_intrinsics[..., PERSPECTIVE] = _times(by_ideal, ideal_by_perspective[..., None])[..., 0]
    by_intrinsics[..., 0, CENTRE_X] = by_intrinsics[..., 1, CENTRE_Y] = 1.0
    by_intrinsics[..., 0, SCALE_FACTOR] = -distorted[..., 0] / (pitch[0] * intrinsics[SCALE_FACTOR])
    # u(x, κ) is held at the ideal point, so that dx/dκ = −(∂u/∂x)⁻¹ ∂u/∂κ.
    by_intrinsics[..., DECENTRING_1:RADIAL] = -_times(by_ideal, decentring_terms)
    by_intrinsics[..., RADIAL:] = -_times(by_ideal, radial_terms)
    return Projection(pixels, by_intrinsics, _times(by_ideal, ideal_by_pose))


def _ideal_by_pose(
    rotated: FloatArray,
    ideal: FloatArray,
    inverse_depth: FloatArray,
    scale: FloatArray,
    perspective: float,
) -> FloatArray:
    """(V, M, 2, 6) of the ideal image point by rotation vector and placement."""
    x, y, z = np.moveaxis(rotated, -1, 0)
    zero = np.zeros_like(x)
    # A small rotation ω moves a rotated point by ω × point.
    x_turn, y_turn, z_turn = (
        np.stack(rows, axis=-1) for rows in ([zero, z, -y], [-z, zero, x], [y, -x, zero])
    )
    jacobian = np.zeros((*ideal.shape, 6))
    weight = (scale * inverse_depth)[..., None]
    for axis, turn in enumerate((x_turn, y_turn)):
        jacobian[..., axis, :3] = weight * (turn - perspective * ideal[..., axis, None] * z_turn)
        jacobian[..., axis, 3 + axis] = inverse_depth
        jacobian[..., axis, 5] = inverse_depth * (
            rotated[..., axis] - perspective * ideal[..., axis] * z
        )
    return jacobian


def _distort(
    ideal: FloatArray, intrinsics: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Invert the distortion by Newton's method.

    Gives distorted points (…, 2), the inverse of the slope ∂u/∂x (…, 2, 2), and ∂u/∂κ for the
    radial (…, 2, n) and the decentring (…, 2, 2) coefficients.
    """
    radial, decentring = intrinsics[RADIAL:], intrinsics[DECENTRING_1:RADIAL]
    distorted = ideal
    tolerance = 1e-14 * np.nanmax(np.abs(ideal), initial=1e-3)
    moved = np.zeros(())
    for _ in range(_NEWTON_STEPS if intrinsics[DECENTRING_1:].any() else 0):
        undistorted, inverse_slope = _undistort(distorted, radial, decentring)
        step = _times(inverse_slope, (undistorted - ideal)[..., None])[..., 0]
        distorted = distorted - step
        moved = np.abs(step).max(axis=-1)
        if not np.nanmax(moved, initial=0.0) > tolerance:
            break
    # A point beyond the fold of the polynomial never settles.
    settled = np.where((moved <= 1e3 * tolerance)[..., None], distorted, np.nan)
    _, inverse_slope = _undistort(settled, radial, decentring)
    squared = (settled**2).sum(axis=-1)
    powers = np.stack([squared ** (i + 1) for i in range(len(radial))], axis=-1)
    return (
        settled,
        inverse_slope,
        settled[..., None] * powers[..., None, :],
        _decentring_terms(settled),
    )


def _undistort(
    distorted: FloatArray, radial: FloatArray, decentring: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Undistorted points and the inverse of their slope by the distorted ones."""
    x, y = distorted[..., 0], distorted[..., 1]
    squared = x**2 + y**2
    gain, gain_slope = np.ones_like(squared), np.zeros_like(squared)
    for power, coefficient in enumerate(radial):
        gain_slope = gain_slope + (power + 1) * coefficient * squared**power
        gain = gain + coefficient * squared ** (power + 1)
    undistorted = distorted * gain[..., None]
    p1, p2 = decentring
    slope_xx = gain + 2 * gain_slope * x**2 + 2 * p1 * y + 6 * p2 * x
    slope_yy = gain + 2 * gain_slope * y**2 + 6 * p1 * y + 2 * p2 * x
    slope_xy = 2 * gain_slope * x * y + 2 * p1 * x + 2 * p2 * y
    if decentring.any():
        undistorted = undistorted + _decentring_terms(distorted) @ decentring
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = (
            np.stack([slope_yy, -slope_xy, -slope_xy, slope_xx], axis=-1)
            / (slope_xx * slope_yy - slope_xy**2)[..., None]
        )
    return undistorted, inverse.reshape(*distorted.shape, 2)


def _decentring_terms(distorted: FloatArray) -> FloatArray:
    """(…, 2, 2) what p1 and p2 multiply in x and in y."""
    x, y = distorted[..., 0], distorted[..., 1]
    product = 2 * x * y
    along_x = np.stack([product, 3 * x**2 + y**2], axis=-1)
    along_y = np.stack([x**2 + 3 * y**2, product], axis=-1)
    return np.stack([along_x, along_y], axis=-2)


def _times(square: FloatArray, columns: FloatArray) -> FloatArray:
    """Multiply stacks of 2 × 2 with stacks of 2 × n, faster than matmul does it."""
    product: FloatArray = (
        square[..., :1] * columns[..., None, 0, :] + square[..., 1:] * columns[..., None, 1, :]
    )
    return product
