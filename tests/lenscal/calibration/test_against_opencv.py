"""Accuracy beside `cv2.calibrateCamera`: the same corners and an equal number of parameters.

Both estimate d, the principal point, one radial coefficient and the poses; samples are square. Both
get the same values: pixels are rounded to float32, the only type that cv2 takes, which moves them
by 0.0001 px at most against noise of 0.1 px. Distortion is mild, 0.2 % at the corner of the image,
so that the higher orders in which the two models differ stay below 0.05 px there, and neither is
blamed for the other's.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from lenscal.calibration.refine import calibrate_views
from lenscal.camera import Camera
from lenscal.sensor import Sensor
from lenscal.target import Chessboard

SENSOR = Sensor(2448, 2048, 0.00345, 0.00345)
IMAGE_DISTANCE_MM = 25.0
#: At the corner of the image, 5.5 mm from the axis.
MILD_PER_MM2 = 0.002 / 5.5**2
NOISE_PX = 0.1
COPIES = 100
PARAMETERS = ("focal length", "principal point x", "principal point y", "distortion map")
EQUAL_PARAMETERS = (
    cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
)


class _Rays:
    """A camera as both models can be compared: matrix, and where pixels look."""

    def __init__(self, matrix: np.ndarray, slopes: np.ndarray) -> None:
        self.matrix, self.slopes = matrix, slopes

    @classmethod
    def of_ours(cls, camera: Camera) -> "_Rays":
        rays = camera.unproject(_grid())
        return cls(camera.matrix, rays[:, :2] / rays[:, 2:])

    @classmethod
    def of_opencv(cls, matrix: np.ndarray, distortion: np.ndarray) -> "_Rays":
        criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-14)
        slopes = cv2.undistortPoints(_grid()[:, None], matrix, distortion, criteria=criteria)
        return cls(matrix, slopes[:, 0])

    def errors(self, truth: "_Rays") -> list[float]:
        """Of f and the principal point in px; rms over the image of the map to rays, in px."""
        focal = truth.matrix[0, 0]
        off = focal * np.linalg.norm(self.slopes - truth.slopes, axis=1)
        return [
            abs(self.matrix[0, 0] - focal),
            *np.abs(self.matrix[:2, 2] - truth.matrix[:2, 2]),
            float(np.sqrt(np.mean(off**2))),
        ]


def _grid() -> np.ndarray:
    across, down = np.linspace(0, 2447, 25), np.linspace(0, 2047, 21)
    return np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)


def _opencv(points: Sequence[np.ndarray], pixels: Sequence[np.ndarray]) -> _Rays:
    # Of the matrix given, FIX_ASPECT_RATIO reads the ratio of its diagonal alone: square samples.
    _, matrix, distortion, _, _ = cv2.calibrateCamera(
        [p.astype(np.float32) for p in points],
        [p.astype(np.float32)[:, None] for p in pixels],
        (SENSOR.width_px, SENSOR.height_px),
        np.eye(3),
        None,
        flags=EQUAL_PARAMETERS,
    )
    return _Rays.of_opencv(matrix, distortion)


@pytest.fixture(scope="module", params=["no distortion", "our model", "their model"])
def world_and_truth(request: pytest.FixtureRequest, look: Callable[..., Any]) -> tuple[Any, _Rays]:
    """Six views of 140 corners, made by either model."""
    k1_per_mm2 = 0.0 if request.param == "no distortion" else MILD_PER_MM2
    centre_px = SENSOR.centre_px + np.array([30, -20])
    camera = Camera(SENSOR, IMAGE_DISTANCE_MM, k1_per_mm2, centre_px)
    world = look(camera, 125.0, board=Chessboard(14, 10, 2.5))
    assert [len(p) for p in world.points] == [140] * 6
    if request.param != "their model":
        return world, _Rays.of_ours(camera)
    distortion = np.array([-MILD_PER_MM2 * IMAGE_DISTANCE_MM**2, 0.0, 0.0, 0.0, 0.0])
    pixels = tuple(
        cv2.projectPoints(
            points, cv2.Rodrigues(p.rotation)[0], p.translation_mm, camera.matrix, distortion
        )[0][:, 0]
        for points, p in zip(world.points, world.poses, strict=True)
    )
    return replace(world, pixels=pixels), _Rays.of_opencv(camera.matrix, distortion)


def _errors(
    world: Any, truth: _Rays, copies: int, outliers: float
) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    ours, theirs = [], []
    for _ in range(copies):
        pixels, _ = world.noisy(rng, NOISE_PX, outliers)
        pixels = [p.astype(np.float32).astype(float) for p in pixels]
        found = calibrate_views(world.points, pixels, SENSOR)
        ours.append(_Rays.of_ours(found.camera).errors(truth))
        theirs.append(_opencv(world.points, pixels).errors(truth))
    return np.array(ours), np.array(theirs)


def test_the_models_differ_by_less_than_the_noise(world_and_truth: tuple[Any, _Rays]):
    """The premise: without noise, our model explains their world."""
    world, truth = world_and_truth
    found = calibrate_views(world.points, world.pixels, SENSOR)
    assert found.rms_px < 0.1 * NOISE_PX
    assert _Rays.of_ours(found.camera).errors(truth)[3] < 0.1 * NOISE_PX


def test_clean_corners_are_used_as_well_as_opencv_does(world_and_truth: tuple[Any, _Rays]):
    """No more than 1.03 of its rms error; the same for the median, and 0.04 more left to chance.

    Both solve nearly the same least-squares problem, so their errors go together copy by copy, and
    a ratio is far better known than its parts. Drawing 100 of 400 copies again and again puts the
    standard error of a ratio of medians at 0.02; over 400 copies no median is above 1.01.
    """
    ours, theirs = _errors(*world_and_truth, COPIES, 0.0)
    rms = np.sqrt((ours**2).mean(axis=0) / (theirs**2).mean(axis=0))
    median = np.median(ours, axis=0) / np.median(theirs, axis=0)
    assert rms.max() <= 1.03, dict(zip(PARAMETERS, rms, strict=True))
    assert median.max() <= 1.07, dict(zip(PARAMETERS, median, strict=True))


def test_bad_corners_do_half_the_harm_or_less(world_and_truth: tuple[Any, _Rays]):
    """5 % of the corners lie anywhere in the image."""
    ours, theirs = _errors(*world_and_truth, 60, 0.05)
    ratios = np.median(ours, axis=0) / np.median(theirs, axis=0)
    assert ratios.max() <= 0.5, dict(zip(PARAMETERS, ratios, strict=True))
