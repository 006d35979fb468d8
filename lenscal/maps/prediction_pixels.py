"""What a wrong camera does in the image."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.camera import Camera
from lenscal.pose import Pose
from lenscal.sensor import Sensor

#: Points per side of the image to which the pose is refitted.
_GRID: Final = 7
#: Gauss-Newton steps of that; it starts within pixels.
_STEPS: Final = 3
#: Where a target stands whose distance does not matter.
_SOMEWHERE_MM: Final = 1000.0
#: Step of the derivatives in radians, and in D for translations.
_STEP: Final = 1e-6


def pixel_errors(
    sensor: Sensor, measured: Mapping[str, FloatArray], predicted: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Compare the predicted cameras with the measured ones in pixels.

    Parameters
    ----------
    sensor
        The sensor of both.
    measured, predicted
        (N,) values of image_distance_mm, and of object_distance_mm, principal point, κ1 and
        scale_factor where they are known, by name. Without object distances both look at a target
        equally far away.

    Returns
    -------
    dict
        (N,) error_centre_px, error_corner_px, refitted_centre_px and refitted_corner_px, the
        corners being the worst of four; NaN where a value is missing or the distortion folds.
    """
    count = len(measured["image_distance_mm"])
    rows = [
        _one(sensor, *({n: float(v[i]) for n, v in part.items()} for part in (measured, predicted)))
        for i in range(count)
    ]
    names = ("error_centre_px", "error_corner_px", "refitted_centre_px", "refitted_corner_px")
    return dict(zip(names, np.array(rows).T, strict=True))


def _one(
    sensor: Sensor, measured: Mapping[str, float], predicted: Mapping[str, float]
) -> tuple[float, float, float, float]:
    if not np.isfinite([*measured.values(), *predicted.values()]).all():
        return (np.nan,) * 4
    own, other = _camera(sensor, measured), _camera(sensor, predicted)
    across = np.linspace(0.0, sensor.width_px - 1.0, _GRID)
    down = np.linspace(0.0, sensor.height_px - 1.0, _GRID)
    pixels = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    corners = [0, _GRID - 1, _GRID * (_GRID - 1), _GRID**2 - 1]
    rays = own.unproject(pixels)
    plane = rays / rays[:, 2:] * measured.get("object_distance_mm", _SOMEWHERE_MM)
    plane[:, 2] = predicted.get("object_distance_mm", _SOMEWHERE_MM)
    found = []
    for seen in (other.project(plane), _refitted(other, plane, pixels)):
        moved = np.linalg.norm(seen - pixels, axis=-1)
        found += [float(moved[_GRID**2 // 2]), float(moved[corners].max())]
    return found[0], found[1], found[2], found[3]


def _camera(sensor: Sensor, values: Mapping[str, float]) -> Camera:
    centre = sensor.centre_px
    return Camera(
        replace(sensor, scale_factor=values.get("scale_factor", sensor.scale_factor)),
        values["image_distance_mm"],
        values.get("k1_per_mm2", 0.0),
        np.array([values.get(f"principal_point_{a}_px", centre[i]) for i, a in enumerate("xy")]),
    )


def _refitted(camera: Camera, points_mm: FloatArray, pixels: FloatArray) -> FloatArray:
    """Pixels of points after the pose was fitted to where they were seen."""
    scale = np.array([1.0, 1.0, 1.0, *[float(points_mm[0, 2])] * 3])

    def moved(pose: FloatArray) -> FloatArray:
        rotation, translation = pose[:3] * scale[:3], pose[3:] * scale[3:]
        return camera.project(Pose.from_rotation_vector(rotation, translation).transform(points_mm))

    pose = np.zeros(6)
    for _ in range(_STEPS):
        seen = moved(pose)
        if not np.isfinite(seen).all():
            break
        slopes = np.stack(
            [
                (moved(pose + step) - moved(pose - step)).ravel() / (2 * _STEP)
                for step in _STEP * np.eye(6)
            ],
            axis=-1,
        )
        if not np.isfinite(slopes).all():
            break
        pose = pose + np.linalg.lstsq(slopes, (pixels - seen).ravel(), rcond=None)[0]
    return moved(pose)
