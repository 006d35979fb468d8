"""How many views, how far and how tilted, for a wanted σ(D): a small study for the docs.

Worlds are calibrated with the robot's poses and a stated repeatability; what comes out is the σ
that the covariance promises, which the tests hold against re-noised copies. Three fields of view,
since it is the field that decides whether perspective shows D by itself; the board fills three
quarters of the image.

    OMP_NUM_THREADS=1 python benchmarks/displacements.py
"""

from __future__ import annotations

import itertools

import numpy as np

from lenscal.calibration.calibration import Repeatability
from lenscal.calibration.refine import calibrate_views
from lenscal.camera import Camera
from lenscal.pose import Pose
from lenscal.sensor import Sensor
from lenscal.target import Chessboard

SENSOR = Sensor(2448, 2048, 0.00345, 0.00345)
OBJECT_DISTANCE_MM = 600.0
NOISE_PX = 0.05
ROBOT = Repeatability(rotation_rad=1e-4, translation_mm=0.02)
#: Image distance of a wide, a normal and a long lens: 56°, 16° and 3.2° across.
LENSES_MM = {"56°": 8.0, "16°": 30.0, "3.2°": 150.0}
COLUMNS, ROWS = 14, 10


def sigma_percent(
    image_distance_mm: float,
    displacements_mm: tuple[float, ...],
    tilted: int,
    tilt_deg: float,
    rng: np.random.Generator,
) -> tuple[float, float]:
    """σ(D)/D in per cent, with the robot and without it (NaN where nothing determines D)."""
    camera = Camera(SENSOR, image_distance_mm)
    square = 0.75 * SENSOR.width_mm * OBJECT_DISTANCE_MM / image_distance_mm / (COLUMNS + 1)
    board = Chessboard(COLUMNS, ROWS, square)
    sharp = Pose(np.eye(3), (0, 0, OBJECT_DISTANCE_MM))
    azimuths = 0.35 + 2 * np.pi / max(tilted, 1) * np.arange(tilted)
    axes = np.stack([np.cos(azimuths), np.sin(azimuths), 0 * azimuths], axis=-1)
    poses = [Pose(np.eye(3), (0, 0, OBJECT_DISTANCE_MM + x)) for x in (0.0, *displacements_mm)]
    poses += [sharp @ Pose.from_rotation_vector(np.radians(tilt_deg) * axis) for axis in axes]
    points, pixels = [], []
    for pose in poses:
        seen = camera.project(pose.transform(board.points_mm))
        inside = SENSOR.contains(seen)
        points.append(board.points_mm[inside])
        pixels.append(seen[inside] + NOISE_PX * rng.standard_normal((inside.sum(), 2)))
    hand_from_camera = Pose.from_rotation_vector((0, 0, 1.0), (30.0, -20.0, 80.0))
    hands = [(hand_from_camera @ pose).inverse() for pose in poses]
    with_robot = calibrate_views(
        points,
        pixels,
        SENSOR,
        hand_poses=hands,
        hand_from_camera=hand_from_camera,
        repeatability=ROBOT,
    )
    free = calibrate_views(points, pixels, SENSOR)
    scale = 100 / OBJECT_DISTANCE_MM
    return tuple(scale * c.sigma("object_distance_mm") for c in (with_robot, free))


def main() -> None:
    """Print one table per field of view."""
    rng = np.random.default_rng(0)
    print(
        f"σ(D)/D in per cent at D = {OBJECT_DISTANCE_MM:g} mm, corners ± {NOISE_PX:g} px, robot "
        f"± {ROBOT.translation_mm:g} mm and ± {1e3 * ROBOT.rotation_rad:g} mrad: with the robot "
        "(without it)"
    )
    spreads = ((0, 0.0), (4, 3.0), (4, 10.0), (4, 30.0), (8, 10.0), (8, 30.0))
    for name, distance in LENSES_MM.items():
        print(f"\nfield of view {name}: displaced views and how far, ± mm")
        print("tilted      " + "".join(f"{f'{n} × {far:g}':>16s}" for n, far in spreads))
        for tilted, tilt in itertools.product((4, 8), (5.0, 10.0, 20.0, 30.0)):
            cells = []
            for count, far in spreads:
                ladder = np.linspace(-far, far, count) if count else np.zeros(0)
                tied, free = sigma_percent(distance, tuple(ladder), tilted, tilt, rng)
                cells.append(f"{tied:8.2f} ({free:5.2f})")
            print(f"{tilted} × {tilt:3.0f}°    " + "".join(f"{cell:>16s}" for cell in cells))


if __name__ == "__main__":
    main()
