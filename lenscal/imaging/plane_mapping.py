"""Which point of a flat target every pixel looks at: the exact inverse of projection."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.camera import Camera
from lenscal.pose import Pose
from lenscal.sensor import Window

#: Points of the plane deeper than this many mm are taken for none at all; where there is no point,
#: this is its coordinate, far off any target.
BEYOND_MM: Final = 1e5


class PlanePoints(NamedTuple):
    """What the pixels of a window see of the plane of a target.

    Parameters
    ----------
    position_mm
        (height, width, 2) points (x, y) in the target frame; `BEYOND_MM` where the ray does not
        meet the plane in front of the camera.
    depth_mm
        (height, width) z of those points in the camera frame; infinite where there is none.
    """

    position_mm: FloatArray
    depth_mm: FloatArray


def points_on_plane(camera: Camera, camera_from_target: Pose, window: Window) -> PlanePoints:
    """Follow the ray of every pixel centre of a window to the plane z = 0 of the target.

    Distortion runs from distorted to undistorted coordinates, so this is closed form.

    Parameters
    ----------
    camera
        The camera.
    camera_from_target
        Where the target is.
    window
        The pixels; they may lie beyond the sensor.

    Returns
    -------
    PlanePoints
        Points on the plane, and their depths.
    """
    pixels = np.zeros((window.height, window.width, 2))
    pixels[..., 0] = window.left + np.arange(window.width)
    pixels[..., 1] = window.top + np.arange(window.height)[:, None]
    undistorted_mm = camera.undistort((pixels - camera.centre_px) * camera.sensor.sample_pitch_mm)
    # A plane point (x, y, 0) is seen along x·r1 + y·r2 + t, so the inverse of that matrix turns the
    # ray (undistorted, d) into (x, y, 1) over the ray's stretch.
    target_to_ray = np.column_stack(
        [camera_from_target.rotation[:, :2], camera_from_target.translation_mm]
    )
    ray_to_target = _inverse_or_nothing(target_to_ray)
    x, y = undistorted_mm[..., 0], undistorted_mm[..., 1]
    d = camera.image_distance_mm
    inverse_stretch = x * ray_to_target[2, 0] + y * ray_to_target[2, 1] + d * ray_to_target[2, 2]
    met = inverse_stretch > d / BEYOND_MM
    stretch = 1.0 / np.where(met, inverse_stretch, 1.0)
    position = np.zeros((*x.shape, 2))
    for axis, (along_x, along_y, along_z) in enumerate(ray_to_target[:2]):
        coordinate = (x * along_x + y * along_y + d * along_z) * stretch
        position[..., axis] = np.where(met, coordinate, BEYOND_MM)
    return PlanePoints(position, np.where(met, d * stretch, np.inf))


def _inverse_or_nothing(matrix: FloatArray) -> FloatArray:
    """Invert a 3 × 3 matrix; a plane seen edge-on, which is singular, is seen nowhere: zeros."""
    if abs(np.linalg.det(matrix)) < 1e-12 * np.linalg.norm(matrix[:, 2]):
        return np.zeros((3, 3))
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)
