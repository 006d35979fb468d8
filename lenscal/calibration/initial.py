"""First values for many views of a flat target: homographies, then the one unknown they leave.

With the principal point in the middle of the frame buffer and no distortion, a homography gives the
pose once d is known. Zhang's closed form for d fails where perspective is weak, so its answer only
stands among a few others, and the one that predicts the pixels best is taken.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import cv2
import numpy as np

from lenscal.arrays import BoolArray, FloatArray
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
#: Points of a view by which first values are compared.
_ENOUGH: Final = 30
#: Extent across over extent along, under which points lie on a line.
_LINE: Final = 1e-3


def homographies(views: Views) -> tuple[FloatArray, BoolArray]:
    """Fit a homography to every view, robustly where some of its corners are bad.

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
    plane, seen, present = views.points_mm[:, :2], views.pixels, views.present
    found = (present.sum(axis=1) >= 4) & _spread_out(plane, present) & _spread_out(seen, present)
    matrices = np.tile(np.eye(3), (len(present), 1, 1))
    matrices[found] = _direct_linear(plane[found], seen[found], present[found])
    extent = np.linalg.norm(
        np.ptp(np.where(present[:, None], seen, _means(seen, present)), axis=2), axis=1
    )
    missed = _misses(matrices, plane, seen, present)
    for view in np.flatnonzero(found & ~(missed <= _TOLERANCE * extent)):
        matrix, _ = cv2.findHomography(
            plane[view][:, present[view]].T,
            seen[view][:, present[view]].T,
            cv2.RANSAC,
            ransacReprojThreshold=_TOLERANCE * float(extent[view]),
        )
        found[view] = matrix is not None and bool(np.isfinite(matrix).all())
        matrices[view] = matrix if found[view] else np.eye(3)
    return matrices, found


def _means(points: FloatArray, present: BoolArray) -> FloatArray:
    """(V, 2, 1) mean of the points that are there."""
    count = np.maximum(present.sum(axis=1), 1)
    means: FloatArray = (points * present[:, None]).sum(axis=2, keepdims=True)
    return np.asarray(means / count[:, None, None])


def _spread_out(points: FloatArray, present: BoolArray) -> BoolArray:
    """(V,) whether the points of each view are neither on a line nor in one place."""
    centred = (points - _means(points, present)) * present[:, None]
    least, most = np.linalg.eigvalsh(centred @ centred.mT).T
    return np.asarray(least > _LINE**2 * most)


def _direct_linear(plane: FloatArray, seen: FloatArray, present: BoolArray) -> FloatArray:
    """(V, 3, 3) homographies by the direct linear transform, each side normalised first."""
    to_unit, unit_plane = _normalised(plane, present)
    to_image, unit_seen = _normalised(seen, present)
    homogeneous = np.concatenate([unit_plane, present[:, None].astype(float)], axis=1)
    across, down = unit_seen[:, :1] * homogeneous, unit_seen[:, 1:] * homogeneous
    square = homogeneous @ homogeneous.mT
    normal = np.zeros((len(plane), 9, 9))
    normal[:, :3, :3] = normal[:, 3:6, 3:6] = square
    normal[:, :3, 6:] = -across @ homogeneous.mT
    normal[:, 3:6, 6:] = -down @ homogeneous.mT
    normal[:, 6:, :3], normal[:, 6:, 3:6] = normal[:, :3, 6:].mT, normal[:, 3:6, 6:].mT
    normal[:, 6:, 6:] = across @ across.mT + down @ down.mT
    unit = np.linalg.eigh(normal)[1][:, :, 0].reshape(-1, 3, 3)
    matrices: FloatArray = np.linalg.inv(to_image) @ unit @ to_unit
    return np.asarray(matrices / np.linalg.norm(matrices, axis=(1, 2), keepdims=True))


def _normalised(points: FloatArray, present: BoolArray) -> tuple[FloatArray, FloatArray]:
    """(V, 3, 3) that bring the points of each view to middle 0 and size 1, and those points."""
    means = _means(points, present)
    centred = (points - means) * present[:, None]
    size = np.sqrt((centred**2).sum(axis=(1, 2)) / np.maximum(present.sum(axis=1), 1))
    size = np.where(size > 0, size, 1.0)
    transforms = np.zeros((len(points), 3, 3))
    transforms[:, 0, 0] = transforms[:, 1, 1] = 1 / size
    transforms[:, :2, 2] = -means[..., 0] / size[:, None]
    transforms[:, 2, 2] = 1.0
    return transforms, centred / size[:, None, None]


def _misses(
    matrices: FloatArray, plane: FloatArray, seen: FloatArray, present: BoolArray
) -> FloatArray:
    """(V,) longest distance in px of a point from where its homography puts it."""
    mapped = matrices[:, :, :2] @ plane + matrices[:, :, 2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        missed = np.linalg.norm(mapped[:, :2] / mapped[:, 2:] - seen, axis=1)
    longest: FloatArray = np.where(present, missed, 0.0).max(axis=1, initial=0.0)
    return longest


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
    perspectives = np.array(tried)
    rotations, placements = _poses(on_sensor, perspectives)
    best = _best(_thinned(views), intrinsics, perspectives, rotations, placements)
    intrinsics[PERSPECTIVE] = perspectives[best]
    return State(intrinsics, rotations[best], placements[best])


def state_before(camera: Camera, views: Views) -> tuple[State, BoolArray]:
    """Find first values for all poses before a known camera.

    Parameters
    ----------
    camera
        The camera.
    views
        The observations.

    Returns
    -------
    state : State
        The camera with those poses.
    found : BoolArray
        (V,) whether a view has a pose: four points or more, not on a line.
    """
    centre, pitch = camera.centre_px, camera.sensor.sample_pitch_mm
    on_sensor = (views.pixels.mT - centre) * pitch
    undistorted = (camera.undistort(on_sensor) / pitch + centre).mT
    matrices, found = homographies(replace(views, pixels=undistorted))
    matrices = _to_sensor(camera.sensor, centre) @ matrices
    rotations, placements = _poses(matrices, np.array([1.0 / camera.image_distance_mm]))
    return State(intrinsics_of(camera), rotations[0], placements[0]), found


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


def _poses(on_sensor: FloatArray, perspectives: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Take the homographies apart for each of some 1/d: rotations (C, V, 3, 3), placements."""
    columns = np.repeat(on_sensor[None], len(perspectives), axis=0)
    columns[:, :, :2] *= perspectives[:, None, None, None]
    # The middle of the view lies in front of the camera.
    columns *= np.sign(columns[:, :, 2:, 2:])
    first, second = columns[..., 0], columns[..., 1]
    size = np.sqrt(np.linalg.norm(first, axis=-1) * np.linalg.norm(second, axis=-1))
    frames = np.stack([first, second, np.cross(first, second) / size[..., None]], axis=-1)
    left, _, right = np.linalg.svd(frames)
    middles = on_sensor[:, :2, 2] / on_sensor[:, 2:, 2]
    placements = np.zeros((*size.shape, 3))
    placements[..., :2] = middles
    placements[..., 2] = size / (perspectives[:, None] * columns[..., 2, 2])
    return left @ right, placements


def _best(
    views: Views,
    intrinsics: FloatArray,
    perspectives: FloatArray,
    rotations: FloatArray,
    placements: FloatArray,
) -> int:
    """Which of some first values predicts the pixels best, by the middling point."""
    rotated = rotations @ views.points_mm
    scale = placements[..., 2, None]
    depth = 1.0 + scale * perspectives[:, None, None] * rotated[:, :, 2]
    depth = np.where(depth > 0, depth, np.nan)[:, :, None]
    ideal = (scale[..., None] * rotated[:, :, :2] + placements[..., :2, None]) / depth
    pitch = views.element_pitch_mm * (intrinsics[SCALE_FACTOR], 1.0)
    centre = intrinsics[[CENTRE_X, CENTRE_Y], None]
    missed = np.linalg.norm(ideal / pitch[:, None] + centre - views.pixels, axis=2)
    missed = np.where(np.isnan(missed), np.inf, missed)
    return int(np.argmin(np.median(missed[:, views.present], axis=1)))


def _thinned(views: Views) -> Views:
    """Take every so-manieth point: enough to compare first values by."""
    stride = max(1, views.present.shape[1] // _ENOUGH)
    return Views(
        views.points_mm[:, :, ::stride],
        views.middles_mm,
        views.pixels[:, :, ::stride],
        views.present[:, ::stride],
        views.element_pitch_mm,
    )
