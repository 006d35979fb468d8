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
        self,
        rng: np.random.Generator,
        sigma_px: float,
        outliers: float = 0.0,
        stray_px: float | None = None,
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Pixels with noise, some of them nonsense; and which ones those are.

        Nonsense is anywhere in the image, or strays by ``stray_px`` from where it belongs.
        """
        size = (self.camera.sensor.width_px, self.camera.sensor.height_px)
        pixels, nonsense = [], []
        for exact in self.pixels:
            seen = exact + sigma_px * rng.standard_normal(exact.shape)
            bad = rng.random(len(seen)) < outliers
            if stray_px is None:
                seen[bad] = rng.uniform((0, 0), size, (bad.sum(), 2))
            else:
                seen[bad] += stray_px * rng.standard_normal((bad.sum(), 2))
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


@pytest.fixture(scope="session")
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


@dataclass(frozen=True, eq=False)
class RobotWorld:
    """What a camera on a robot sees, and where the robot says that it stood."""

    camera: Camera
    hand_from_camera: Pose  # of the reference camera, as stated
    base_from_target: Pose  # true
    camera_from_hand: Pose  # true, of this setting
    points: tuple[np.ndarray, ...]
    pixels: tuple[np.ndarray, ...]
    hands: tuple[Pose, ...]
    object_distance_mm: float
    nodal_mm: tuple[float, float, float]

    @property
    def nodal_offset_mm(self) -> float:
        return -self.nodal_mm[2]


HAND_FROM_CAMERA = Pose.from_rotation_vector([0.0, 0.0, np.pi / 2], [30.0, -20.0, 80.0])
BASE_FROM_TARGET = Pose.from_rotation_vector([np.pi, 0.1, 0.0], [600.0, 100.0, 200.0])


def _ride(
    rng: np.random.Generator,
    *,
    noise_px: float = 0.03,
    slip_mm: float = 0.02,
    slip_rad: float = 1e-4,
    image_distance_mm: float = 130.0,
    object_distance_mm: float = 660.0,
    nodal_mm: tuple[float, float, float] = (0.3, -0.2, -250.0),
    displacements_mm: Sequence[float] = (-3.0, -1.5, 1.5, 3.0),
    tilted: int = 5,
    tilt_deg: float = 20.0,
    board: Target = Chessboard(13, 10, 2.5),  # noqa: B008 - frozen
    sensor: Sensor = Sensor(512, 480, 0.023, 0.01375, 0.70642),  # noqa: B008 - frozen
) -> RobotWorld:
    """Look at a board from the sharp distance, from before and behind it, and tilted."""
    camera = Camera(sensor, image_distance_mm, 2e-4, sensor.centre_px + np.array([3, -2]))
    reference_from_camera = Pose(np.eye(3), nodal_mm)
    standoff = object_distance_mm + nodal_mm[2]
    azimuths = 0.35 + 2 * np.pi / max(tilted, 1) * np.arange(tilted)
    axes = np.stack([np.cos(azimuths), np.sin(azimuths), 0 * azimuths], axis=-1)
    away = [Pose(np.eye(3), (0, 0, standoff + by)) for by in (0.0, *displacements_mm)]
    turned = [Pose.from_rotation_vector(np.radians(tilt_deg) * axis) for axis in axes]
    points, pixels, hands = [], [], []
    for reference_from_target in [*away, *(away[0] @ turn for turn in turned)]:
        hand = BASE_FROM_TARGET @ reference_from_target.inverse() @ HAND_FROM_CAMERA.inverse()
        slip = Pose.from_rotation_vector(
            slip_rad * rng.standard_normal(3), slip_mm * rng.standard_normal(3)
        )
        base_from_camera = hand @ slip @ HAND_FROM_CAMERA @ reference_from_camera
        camera_from_target = base_from_camera.inverse() @ BASE_FROM_TARGET
        seen = camera.project(camera_from_target.transform(board.points_mm))
        inside = sensor.contains(seen)
        points.append(board.points_mm[inside])
        pixels.append(seen[inside] + noise_px * rng.standard_normal((inside.sum(), 2)))
        hands.append(hand)
    return RobotWorld(
        camera,
        HAND_FROM_CAMERA,
        BASE_FROM_TARGET,
        (HAND_FROM_CAMERA @ reference_from_camera).inverse(),
        tuple(points),
        tuple(pixels),
        tuple(hands),
        object_distance_mm,
        nodal_mm,
    )


@pytest.fixture(scope="session")
def ride() -> Callable[..., RobotWorld]:
    """Make a world with a robot in it: ride(rng, noise_px=…, slip_mm=…, …)."""
    return _ride
