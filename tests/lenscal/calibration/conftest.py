"""Worlds whose truth is known, and the reference data."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from lenscal.camera import Camera
from lenscal.pose import Pose
from lenscal.sensor import Sensor
from lenscal.target import Chessboard, Target

#: Sensor of the main lens: 8.4 × 7.1 mm.
SENSOR = Sensor(2448, 2048, 0.00345, 0.00345)
BOARD = Chessboard(14, 10, 2.5)
TILTS_DEG = ((0, 0), (25, 0), (-25, 0), (0, 25), (0, -25), (17, 17))


@dataclass(frozen=True, eq=False)
class World:
    """A camera, and what it sees without noise."""

    camera: Camera
    poses: tuple[Pose, ...]
    points: tuple[np.ndarray, ...]
    pixels: tuple[np.ndarray, ...]

    def noisy(
        self, rng: np.random.Generator, sigma_px: float, outliers: float = 0.0
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Pixels with noise, some of them nonsense; and which ones those are."""
        size = (self.camera.sensor.width_px, self.camera.sensor.height_px)
        pixels, nonsense = [], []
        for exact in self.pixels:
            seen = exact + sigma_px * rng.standard_normal(exact.shape)
            bad = rng.random(len(seen)) < outliers
            seen[bad] = rng.uniform((0, 0), size, (bad.sum(), 2))
            pixels.append(seen)
            nonsense.append(bad)
        return pixels, nonsense


def _look(
    camera: Camera,
    distance_mm: float,
    tilts_deg: Sequence[tuple[float, float]] = TILTS_DEG,
    board: Target = BOARD,
) -> World:
    poses, points, pixels = [], [], []
    for view, (about_x, about_y) in enumerate(tilts_deg):
        pose = Pose.from_rotation_vector(
            np.radians([about_x, about_y, 3.0 * view]), [0.3, -0.2, distance_mm]
        )
        seen = camera.project(pose.transform(board.points_mm))
        inside = camera.sensor.contains(seen)
        poses.append(pose)
        points.append(board.points_mm[inside])
        pixels.append(seen[inside])
    return World(camera, tuple(poses), tuple(points), tuple(pixels))


@pytest.fixture
def look() -> Callable[..., World]:
    """Make a world: look(camera, distance_mm, tilts_deg, board)."""
    return _look


@pytest.fixture
def tele() -> World:
    """The main lens: d = 130 mm, 3.6° field of view, tilts up to 25°."""
    return _look(Camera(SENSOR, 130.0, 2e-4, SENSOR.centre_px + np.array([30, -20])), 650.0)


@pytest.fixture
def wide() -> World:
    """A wide lens with strong distortion."""
    camera = Camera(SENSOR, 6.0, 5e-3, SENSOR.centre_px + np.array([30, -20]))
    return _look(camera, 50.0, board=Chessboard(14, 10, 4.0))
