"""First values for many views of a flat target: homographies, then the one unknown they leave.

With the principal point in the middle of the frame buffer and no distortion, a homography gives the
pose once d is known. Zhang's closed form for d fails where perspective is weak, so its answer only
stands among a few others, and the one that predicts the pixels best is taken.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from lenscal.arrays import BoolArray, FloatArray
from lenscal.calibration.bundle import residuals
from lenscal.calibration.projection import (
    CENTRE_X,
    CENTRE_Y,
    PERSPECTIVE,
    RADIAL,
    SCALE_FACTOR,
    intrinsics_of,
)
from lenscal.calibration.views import State, Views
from lenscal.camera import Camera
from lenscal.sensor import Sensor

#: Image distances to try, in diagonals of the sensor.
_TRIED: Final = np.geomspace(0.7, 200.0, 7)
#: Share of a view's extent by which a point may miss its homography: distortion, not nonsense.
_TOLERANCE: Final = 0.03
#: Extent across over extent along, under which points lie on a line.
_LINE: Final = 1e-3


def homographies(views: Views) -> tuple[FloatArray, BoolArray]:
    """Fit a homography to every view, robustly.

    Parameters
    ----------
    views
        The observations.

    Returns
    -------
    matrices
        (V, 3, 3) from (x, y) about the middle of the view in mm to pixels.
    found
        (V,) whether there is one: four points or more, not on a line.
    """
    matrices = np.tile(np.eye(3), (len(views.present), 1, 1))
    found = np.zeros(len(matrices), dtype=bool)
    for view, present in enumerate(views.present):
        plane, seen = views.points_mm[view, :2, present], views.pixels[view][:, present].T
        if len(plane) < 4 or on_a_line(plane) or on_a_line(seen):
            continue
        extent = np.linalg.norm(np.ptp(seen, axis=0))
        matrix, _ = cv2.findHomography(
            plane, seen, cv2.RANSAC, ransacReprojThreshold=_TOLERANCE * float(extent)
        )
        if matrix is not None and np.isfinite(matrix).all():
            matrices[view], found[view] = matrix, True
    return matrices, found


def on_a_line(points: FloatArray) -> bool:
    """Tell whether points lie on a line, or in one place.

    Parameters
    ----------
    points
        (N, 2) or (N, 3).

    Returns
    -------
    bool
        Whether their second principal extent is nothing.
    """
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(extents[1] <= _LINE * extents[0])


def initial_state(
    views: Views, matrices: FloatArray, sensor: Sensor, principal_point_px: FloatArray, terms: int
) -> State:
    """Find first values for the intrinsics and all poses.

    Parameters
    ----------
    views
        The observations.
    matrices
        (V, 3, 3) their homographies.
    sensor
        The sensor.
    principal_point_px
        (2,) where the axis is taken to meet the image.
    terms
        Count of radial coefficients, κ1 included; all start at zero.

    Returns
    -------
    State
        Parameters from which a fit converges.
    """
    on_sensor = _to_sensor(sensor, principal_point_px) @ matrices
    diagonal = float(np.hypot(sensor.width_mm, sensor.height_mm))
    closed_form = _perspective(on_sensor)
    tried = [*(1.0 / (diagonal * _TRIED)), *([closed_form] if closed_form > 0 else [])]
    intrinsics = np.zeros(RADIAL + terms)
    intrinsics[[CENTRE_X, CENTRE_Y]] = principal_point_px
    intrinsics[SCALE_FACTOR] = sensor.scale_factor
    states = [_with_perspective(intrinsics, on_sensor, perspective) for perspective in tried]
    return min(states, key=lambda state: _typical_miss(views, state))


def state_of(camera: Camera, matrices: FloatArray) -> State:
    """Find first values for all poses before a known camera.

    Parameters
    ----------
    camera
        The camera.
    matrices
        (V, 3, 3) homographies to undistorted pixels.

    Returns
    -------
    State
        The camera with those poses.
    """
    on_sensor = _to_sensor(camera.sensor, camera.centre_px) @ matrices
    return _with_perspective(intrinsics_of(camera), on_sensor, 1.0 / camera.image_distance_mm)


def _to_sensor(sensor: Sensor, principal_point_px: FloatArray) -> FloatArray:
    """(3, 3) from pixels to mm about the principal point."""
    matrix = np.diag([*sensor.sample_pitch_mm, 1.0])
    matrix[:2, 2] = -principal_point_px * sensor.sample_pitch_mm
    return matrix


def _perspective(on_sensor: FloatArray) -> float:
    """Zhang's two constraints a view, for 1/d² alone; zero when noise has made it negative."""
    scaled = on_sensor / np.linalg.norm(on_sensor[:, :2, :2], axis=(1, 2))[:, None, None]
    (x1, y1, w1), (x2, y2, w2) = scaled[:, :, 0].T, scaled[:, :, 1].T
    lengths = np.concatenate([x1 * x2 + y1 * y2, x1**2 + y1**2 - x2**2 - y2**2])
    depths = np.concatenate([w1 * w2, w1**2 - w2**2])
    # lengths / d² + depths = 0, for every view twice.
    inverse_square = -(lengths @ depths) / max(float(lengths @ lengths), np.finfo(float).tiny)
    return float(np.sqrt(max(inverse_square, 0.0)))


def _with_perspective(intrinsics: FloatArray, on_sensor: FloatArray, perspective: float) -> State:
    """Take the homographies apart for a given 1/d."""
    columns = np.diag([perspective, perspective, 1.0]) @ on_sensor
    # The middle of the view lies in front of the camera.
    columns *= np.sign(columns[:, 2:, 2:])
    first, second = columns[:, :, 0], columns[:, :, 1]
    size = np.sqrt(np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1))
    frames = np.stack([first, second, np.cross(first, second) / size[:, None]], axis=-1)
    left, _, right = np.linalg.svd(frames)
    rotations = left @ right
    distance = columns[:, 2, 2] / size
    placements = np.stack(
        [
            on_sensor[:, 0, 2] / on_sensor[:, 2, 2],
            on_sensor[:, 1, 2] / on_sensor[:, 2, 2],
            1.0 / (perspective * distance),
        ],
        axis=-1,
    )
    start = intrinsics.copy()
    start[PERSPECTIVE] = perspective
    return State(start, rotations, placements)


def _typical_miss(views: Views, state: State) -> float:
    """Median distance of prediction and observation, which bad corners do not move."""
    missed = np.linalg.norm(residuals(views, state), axis=1)[views.present]
    return float(np.median(np.where(np.isnan(missed), np.inf, missed)))
