"""Tsai's two-stage solution: radial alignment gives orientation, then d, T_z and κ1 follow.

Source: R. Y. Tsai, A versatile camera calibration technique (1987), sections II-C (coplanar) and
II-D (non-coplanar points). Radial distortion, d and T_z move an image point along its radius only,
so that the direction of the radius alone fixes the rotation and T_x, T_y — and, when the points
leave one plane, the scale factor.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from lenscal.arrays import FloatArray
from lenscal.calibration.diagnosis import inseparable
from lenscal.calibration.initial import on_a_line
from lenscal.camera import Camera
from lenscal.errors import DegenerateGeometryError
from lenscal.pose import Pose
from lenscal.sensor import Sensor

#: Extent across a plane over extent in it, under which points count as coplanar.
_PLANE: Final = 1e-3
#: Image height of the world origin over the spread of the image, under which T_y is too near zero.
_NEAR_AXIS: Final = 0.1
#: Relative σ of d in the linear solution from which d and T_z are not separable.
_INSEPARABLE: Final = 0.3
#: Fewest points that the linear systems take.
_LEAST_COPLANAR: Final = 5
_LEAST_IN_SPACE: Final = 7


class TwoStage(NamedTuple):
    """The two-stage solution.

    Parameters
    ----------
    camera
        The camera; its sensor has the scale factor that was found.
    camera_from_world
        The pose.
    coplanar
        Whether the points lie in one plane.
    origin_mm
        (3,) the point of the world that the linear system was solved about, where the world's own
        origin would not do; None where it did.
    """

    camera: Camera
    camera_from_world: Pose
    coplanar: bool
    origin_mm: FloatArray | None


def two_stage(
    points_mm: FloatArray,
    pixels: FloatArray,
    sensor: Sensor,
    principal_point_px: FloatArray,
    *,
    free_scale_factor: bool = True,
) -> TwoStage:
    """Solve both stages.

    Parameters
    ----------
    points_mm
        (N, 3) points in the world.
    pixels
        (N, 2) where they were seen.
    sensor
        The sensor.
    principal_point_px
        (2,) held fixed.
    free_scale_factor
        Whether points in space correct the scale factor of the sensor; those in a plane never do.

    Returns
    -------
    TwoStage
        Camera and pose.

    Raises
    ------
    DegenerateGeometryError
        When there are too few points, they lie on a line, or d and T_z cannot be told apart.
    """
    coplanar = _is_coplanar(points_mm)
    least = _LEAST_COPLANAR if coplanar else _LEAST_IN_SPACE
    if len(points_mm) < least:
        kind = "coplanar points" if coplanar else "points in space"
        raise DegenerateGeometryError(
            f"{len(points_mm)} points are too few: Tsai's method needs at least {least} {kind}"
        )
    image = (pixels - principal_point_px) * sensor.sample_pitch_mm
    own_from_world, moved = _own_frame(points_mm, image, coplanar)
    points = own_from_world.transform(points_mm)
    if coplanar:
        rotation, shift_xy = _orientation_coplanar(points, image)
        stretch = 1.0
    else:
        rotation, shift_xy, stretch = _orientation_in_space(points, image)
        stretch = stretch if free_scale_factor else 1.0
        image = image / (stretch, 1.0)
    pose, distance, k1 = _distances(points, image, rotation, shift_xy)
    actual = Sensor(
        sensor.width_px,
        sensor.height_px,
        sensor.pitch_x_mm,
        sensor.pitch_y_mm,
        sensor.scale_factor / stretch,
    )
    camera = Camera(actual, distance, k1, principal_point_px)
    origin = own_from_world.inverse().translation_mm if moved else None
    return TwoStage(camera, pose @ own_from_world, coplanar, origin)


def _is_coplanar(points_mm: FloatArray) -> bool:
    if len(points_mm) < 3 or on_a_line(points_mm):
        raise DegenerateGeometryError(
            f"the {len(points_mm)} points lie on a line; spread them over a plane or in space"
        )
    extents = np.linalg.svd(points_mm - points_mm.mean(axis=0), compute_uv=False)
    return len(extents) < 3 or bool(extents[2] < _PLANE * extents[0])


def _own_frame(points_mm: FloatArray, image: FloatArray, coplanar: bool) -> tuple[Pose, bool]:
    """Give a frame that the linear systems can work in: plane z = 0, origin off the x axis.

    The caller's own frame is kept where it will do, because the solution of the linear system
    depends on it a little. Tells, too, whether T_y would have been near zero.
    """
    frame = Pose.identity()
    if coplanar and np.abs(points_mm[:, 2]).max() > _PLANE * np.linalg.norm(
        np.ptp(points_mm, axis=0)
    ):
        middle = points_mm.mean(axis=0)
        axes = np.linalg.svd(points_mm - middle)[2]
        axes[2] *= np.linalg.det(axes)
        frame = Pose(axes, -axes @ middle)
    points = frame.transform(points_mm)
    design = np.column_stack([points, np.ones(len(points))])
    origin_height = np.linalg.lstsq(design, image[:, 1], rcond=None)[0][3]
    near_axis = bool(abs(origin_height) < _NEAR_AXIS * np.ptp(image[:, 1]))
    if near_axis:
        # T_y divides the linear system; a point far from the axis makes a better origin.
        far = points[np.argmax(np.abs(image[:, 1]))]
        frame = Pose(np.eye(3), -far) @ frame
    return frame, near_axis


def _orientation_coplanar(points: FloatArray, image: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Stage one for a plane: five unknowns r1, r2, T_x, r4, r5, each over T_y."""
    (x, y, _), (u, v) = points.T, image.T
    design = np.column_stack([v * x, v * y, v, -u * x, -u * y])
    r1, r2, t_x, r4, r5 = np.linalg.lstsq(_finite(design), u, rcond=None)[0]
    sum_of_squares = r1**2 + r2**2 + r4**2 + r5**2
    determinant = r1 * r5 - r4 * r2
    # The smaller root of T_y⁴ det² − T_y² S + 1 = 0, in the form that does not cancel.
    root = np.sqrt(max(sum_of_squares**2 - 4 * determinant**2, 0.0))
    t_y = np.sqrt(2.0 / (sum_of_squares + root))
    first, second = t_y * np.array([r1, r2]), t_y * np.array([r4, r5])
    shift = t_y * np.array([t_x, 1.0])
    if not _on_the_right_side(points[:, :2] @ np.stack([first, second]).T + shift, image):
        first, second, shift = -first, -second, -shift
    # The signs of r3 and r6 are known but for one: the wrong one puts the target behind the camera.
    r3 = np.sqrt(max(1 - first @ first, 0.0))
    r6 = -np.copysign(np.sqrt(max(1 - second @ second, 0.0)), first @ second)
    rotation = _rotation(np.array([*first, r3]), np.array([*second, r6]))
    if _linear_distances(points, image, rotation, shift)[0] < 0:
        rotation = _rotation(np.array([*first, -r3]), np.array([*second, -r6]))
    return rotation, shift


def _orientation_in_space(
    points: FloatArray, image: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Stage one in space: seven unknowns, which show the horizontal stretch too."""
    u, v = image.T
    design = np.column_stack([v[:, None] * points, v, -u[:, None] * points])
    solution = np.linalg.lstsq(_finite(design), u, rcond=None)[0]
    t_y = 1.0 / np.linalg.norm(solution[4:])
    stretch = float(np.linalg.norm(solution[:3]) * t_y)
    first, second = solution[:3] * t_y / stretch, solution[4:] * t_y
    shift = t_y * np.array([solution[3] / stretch, 1.0])
    if not _on_the_right_side(points @ np.stack([first, second]).T + shift, image):
        first, second, shift = -first, -second, -shift
    return _rotation(first, second), shift, stretch


def _finite(design: FloatArray) -> FloatArray:
    """Refuse a radial alignment that does not determine its unknowns."""
    scaled = design / np.maximum(np.linalg.norm(design, axis=0), np.finfo(float).tiny)
    extents = np.linalg.svd(scaled, compute_uv=False)
    if extents[-1] < 1e-9 * extents[0]:
        raise DegenerateGeometryError(
            "the directions of the image points do not determine the orientation: they lie on a "
            "line through the principal point, or in too few places; spread them over the image"
        )
    return design


def _on_the_right_side(camera_xy: FloatArray, image: FloatArray) -> bool:
    """Tell whether points appear on the side of the axis where they are; the majority decides."""
    return float(np.sign((camera_xy * image).sum(axis=1)).sum()) > 0


def _rotation(first: FloatArray, second: FloatArray) -> FloatArray:
    """Nearest rotation whose first rows these are, noise apart."""
    left, _, right = np.linalg.svd(np.stack([first, second, np.cross(first, second)]))
    nearest: FloatArray = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return nearest


def _linear_distances(
    points: FloatArray, image: FloatArray, rotation: FloatArray, shift: FloatArray
) -> tuple[float, float, float]:
    """Stage two without distortion: d, T_z, and the relative σ of d."""
    across = points @ rotation[1] + shift[1]
    along = points @ rotation[2]
    v = image[:, 1]
    design = np.column_stack([across, -v])
    (distance, depth), *_ = np.linalg.lstsq(design, along * v, rcond=None)
    error = design @ (distance, depth) - along * v
    normal = design.T @ design
    spread = np.sqrt(max(np.linalg.det(normal), np.finfo(float).tiny) / normal[1, 1])
    sigma = np.linalg.norm(error) / np.sqrt(max(len(v) - 2, 1)) / spread
    return float(distance), float(depth), float(sigma / max(abs(distance), np.finfo(float).tiny))


def _distances(
    points: FloatArray, image: FloatArray, rotation: FloatArray, shift: FloatArray
) -> tuple[Pose, float, float]:
    """Stage two: d, T_z and κ1 that minimise the undistorted error."""
    distance, depth, relative_sigma = _linear_distances(points, image, rotation, shift)
    guess = Pose(rotation, np.array([*shift, depth]))
    if not (distance > 0 and depth > 0):
        raise DegenerateGeometryError(inseparable([guess], np.inf))
    if relative_sigma > _INSEPARABLE:
        raise DegenerateGeometryError(inseparable([guess], relative_sigma))
    turned = points @ rotation.T + (*shift, 0.0)
    squared = (image**2).sum(axis=1, keepdims=True)
    reach = float(squared.max())

    def error(parameters: FloatArray) -> FloatArray:
        # T_z / d, the well-known ratio, stands for T_z; κ1 is counted in its effect at the rim; and
        # the logarithm of 1/d keeps d positive.
        log_perspective, ratio, rim = parameters
        ideal = turned[:, :2] / (turned[:, 2:] * np.exp(log_perspective) + ratio)
        miss: FloatArray = (ideal - image * (1 + rim * squared / reach)).ravel()
        return miss

    start = np.array([-np.log(distance), depth / distance, 0.0])
    scale = (1.0, depth / distance, 1e-2)
    log_perspective, ratio, rim = least_squares(
        error, start, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14, x_scale=scale
    ).x
    perspective = np.exp(log_perspective)
    pose = Pose(rotation, np.array([*shift, ratio / perspective]))
    return pose, float(1.0 / perspective), float(rim / reach)
