"""How far a calibrated camera may mispredict an image point, because its intrinsics are uncertain.

The intrinsics move a pixel by P = ∂pixel/∂intrinsics at a fixed scene point. But a camera frame is
known by the calibration alone: a turn of the camera looks like a shift of the principal point, and
whoever uses the camera finds its pose with the same intrinsics. So only that part of P counts which
no rigid motion takes back over the image. With G = ∂pixel/∂motion, all points of a grid stacked,

    P' = P(pixel) − G(pixel) (GᵀG)⁻¹ GᵀP,    covariance of the pixel = P' Σ P'ᵀ.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from lenscal.arrays import BoolArray, FloatArray, frozen_array, positive
from lenscal.calibration.calibration import Calibration
from lenscal.camera import Camera
from lenscal.errors import InputError

#: Points per side of the grid over the image that the rigid motion is fitted to.
_GRID: Final = 25


class ProjectionSigmaMap(NamedTuple):
    """Projection uncertainty over an image.

    Parameters
    ----------
    x_px, y_px
        (rows, columns) pixel positions, from edge to edge of the image.
    sigma_px
        (rows, columns) σ there in the worst direction.
    """

    x_px: FloatArray
    y_px: FloatArray
    sigma_px: FloatArray


def projection_sigma_px(
    calibration: Calibration, pixels: npt.ArrayLike, distance_mm: float | None = None
) -> FloatArray:
    """Tell how uncertain the projection is at some pixels, to first order.

    Parameters
    ----------
    calibration
        A calibration with covariance.
    pixels
        (..., 2) where scene points are seen, in px; beyond the image is allowed.
    distance_mm
        None for a scene at infinity, where the camera may turn but a shift does nothing. Otherwise
        the scene is a plane across the axis at this distance, and the camera may turn and shift:
        an error of d then looks like one of the distance, and nothing is left of it. Every finite
        distance gives the same answer, as the shift that is fitted grows with it.

    Returns
    -------
    FloatArray
        (...) σ in px in the direction in which it is largest; zero for a camera held fixed, NaN
        beyond the radius at which the distortion folds.

    Raises
    ------
    CalibrationError
        When the calibration has no covariance.
    InputError
        When a pixel is not finite, or the distance is not positive.
    """
    points = frozen_array("pixels", pixels, ("...", 2))
    shifts = distance_mm is not None
    if distance_mm is not None:
        positive("distance_mm", distance_mm, "mm")
    camera = calibration.camera
    known = {name: i for i, name in enumerate(_names(camera)) if name in calibration.quantities}
    covariance = calibration.covariance(list(known))

    grid = _grid(camera, _GRID, _GRID, margin=0.5 / _GRID)
    grid = grid[_has_ray(camera, grid)]
    columns = list(known.values())
    motion = np.linalg.lstsq(
        _by_motion(camera, grid, shifts).reshape(2 * len(grid), -1),
        _by_intrinsics(camera, grid)[..., columns].reshape(2 * len(grid), -1),
        rcond=None,
    )[0]
    by_motion = _by_motion(camera, points, shifts)
    left = _by_intrinsics(camera, points)[..., columns] - by_motion @ motion
    along, across = left[..., 0, :], left[..., 1, :]
    xx, yy, xy = (
        ((a @ covariance) * b).sum(axis=-1)
        for a, b in ((along, along), (across, across), (along, across))
    )
    # The larger eigenvalue of the 2 × 2 covariance.
    variance = (xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)
    sigma_px: FloatArray = np.sqrt(np.maximum(variance, 0.0))
    return np.where(_has_ray(camera, points), sigma_px, np.nan)


def projection_sigma_map(
    calibration: Calibration, distance_mm: float | None = None, columns: int = 61
) -> ProjectionSigmaMap:
    """Map the projection uncertainty over the image.

    Parameters
    ----------
    calibration
        A calibration with covariance.
    distance_mm
        Distance of the scene, or None for infinity; see `projection_sigma_px`.
    columns
        Places across the width, 2 or more; those down the height are spaced about alike.

    Returns
    -------
    ProjectionSigmaMap
        Positions and σ.

    Raises
    ------
    CalibrationError
        When the calibration has no covariance.
    InputError
        When the distance is not positive, or there are fewer than two columns.
    """
    if columns < 2:
        raise InputError(f"a map needs 2 columns or more, but columns is {columns}")
    sensor = calibration.camera.sensor
    rows = max(2, round(columns * sensor.height_px / sensor.width_px))
    places = _grid(calibration.camera, columns, rows, margin=0.0).reshape(rows, columns, 2)
    sigma_px = projection_sigma_px(calibration, places, distance_mm)
    return ProjectionSigmaMap(places[..., 0], places[..., 1], sigma_px)


def _names(camera: Camera) -> list[str]:
    """Name the quantities of the camera in the order of `_by_intrinsics`."""
    radial = [f"k{i}_per_mm{2 * i}" for i in range(1, len(camera.radial) + 2)]
    centre = ["principal_point_x_px", "principal_point_y_px"]
    return ["image_distance_mm", *centre, "scale_factor", "p1_per_mm", "p2_per_mm", *radial]


def _grid(camera: Camera, columns: int, rows: int, margin: float) -> FloatArray:
    """(rows · columns, 2) pixels, `margin` (a share of the size) away from the image's edges."""
    share_x, share_y = (np.linspace(margin, 1 - margin, count) for count in (columns, rows))
    shares = np.stack(np.meshgrid(share_x, share_y), axis=-1).reshape(-1, 2)
    size = np.array([camera.sensor.width_px, camera.sensor.height_px])
    pixels: FloatArray = shares * size - 0.5
    return pixels


def _has_ray(camera: Camera, pixels: FloatArray) -> BoolArray:
    radius_mm = np.linalg.norm(_sensor_mm(camera, pixels), axis=-1)
    return np.asarray(radius_mm < camera.radius_limit_mm)


def _sensor_mm(camera: Camera, pixels: FloatArray) -> FloatArray:
    """(..., 2) distorted mm from the principal point."""
    position: FloatArray = (pixels - camera.centre_px) * camera.sensor.sample_pitch_mm
    return position


def _by_intrinsics(camera: Camera, pixels: FloatArray) -> FloatArray:
    """(..., 2, K) how the image of the point seen at a pixel moves, in the order of `_names`.

    The undistorted position u(x, κ) = d · X/Z of a fixed point gives dx by implicit
    differentiation, without inverting the distortion.
    """
    distorted = _sensor_mm(camera, pixels)
    x, y = distorted[..., 0], distorted[..., 1]
    squared, product = x**2 + y**2, 2 * x * y
    along_image = camera.undistort(distorted) / camera.image_distance_mm
    decentring = (
        np.stack([product, squared + 2 * y**2], axis=-1),
        np.stack([squared + 2 * x**2, product], axis=-1),
    )
    radial = (distorted * squared[..., None] ** i for i in range(1, len(camera.radial) + 2))
    by_ideal = _by_ideal(camera, distorted)
    moved = by_ideal @ np.stack([along_image, *(-t for t in (*decentring, *radial))], axis=-1)

    jacobian = np.zeros((*moved.shape[:-1], moved.shape[-1] + 3))
    jacobian[..., 0] = moved[..., 0]
    jacobian[..., 0, 1] = jacobian[..., 1, 2] = 1.0
    # The sample pitch along x is proportional to the scale factor.
    jacobian[..., 0, 3] = -x / (camera.sensor.sample_pitch_x_mm * camera.sensor.scale_factor)
    jacobian[..., 4:] = moved[..., 1:]
    return jacobian


def _by_motion(camera: Camera, pixels: FloatArray, shifts: bool) -> FloatArray:
    """(..., 2, 3 or 6) by a rotation vector, and by a translation over the axial distance."""
    undistorted = camera.undistort(_sensor_mm(camera, pixels))
    x, y = np.moveaxis(undistorted, -1, 0) / camera.image_distance_mm
    one, zero = np.ones_like(x), np.zeros_like(x)
    rows = [[-x * y, 1 + x**2, -y], [-1 - y**2, x * y, x]]
    if shifts:
        rows = [[*rows[0], one, zero, -x], [*rows[1], zero, one, -y]]
    slope = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    moved: FloatArray = _by_ideal(camera, _sensor_mm(camera, pixels)) @ (
        camera.image_distance_mm * slope
    )
    return moved


def _by_ideal(camera: Camera, distorted: FloatArray) -> FloatArray:
    """(..., 2, 2) derivative of the pixel by the undistorted position; NaN where it folds."""
    x, y = distorted[..., 0], distorted[..., 1]
    squared = x**2 + y**2
    gain, gain_slope = np.ones_like(squared), np.zeros_like(squared)
    for i, coefficient in enumerate((camera.k1_per_mm2, *camera.radial), 1):
        gain = gain + coefficient * squared**i
        gain_slope = gain_slope + 2 * i * coefficient * squared ** (i - 1)
    p1, p2 = camera.decentring
    slope_xx = gain + gain_slope * x**2 + 2 * p1 * y + 6 * p2 * x
    slope_yy = gain + gain_slope * y**2 + 6 * p1 * y + 2 * p2 * x
    slope_xy = gain_slope * x * y + 2 * p1 * x + 2 * p2 * y
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = (
            np.stack([slope_yy, -slope_xy, -slope_xy, slope_xx], axis=-1)
            / (slope_xx * slope_yy - slope_xy**2)[..., None]
        )
    by_pixel: FloatArray = (
        inverse.reshape(*distorted.shape, 2) / camera.sensor.sample_pitch_mm[:, None]
    )
    return by_pixel
