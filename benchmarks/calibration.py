"""How fast and how accurate a calibration is, beside `cv2.calibrateCamera` and mrcal.

Speed: a simulated sweep of 12 × 12 settings of a zoom, 6 views of 140 corners each, with 0.1 px of
noise and 1 % of the corners anywhere in the image, and the same without those. Ours rejects bad
corners and gives the covariance; cv2 does neither; mrcal rejects, and is run with the stages of its
own `mrcal-calibrate-cameras`, but without a covariance and told the focal length to start from.
All get the same pixels in one run and on one thread, in alternating order; cpu time, fastest round.
The sweep is made by our model, of which cv2's one radial term cannot follow the wide end; compare
the accuracy of models below, not here.
mrcal runs in a Python of its own (Debian: mrcal, python3-mrcal); without one it is skipped.

Accuracy: many copies of a wide, a medium and a long lens, without distortion, made by our model
and made by that of cv2; both calibrate d, the principal point and one radial coefficient. The
distortion is 0.2 % at the corner, so that neither model is blamed for the higher orders of the
other. cv2 takes float32 alone, so both get pixels rounded to it.

    OMP_NUM_THREADS=1 python benchmarks/calibration.py [--copies 400] [--rounds 3] [--profile]
"""

from __future__ import annotations

import argparse
import cProfile
import itertools
import json
import os
import pstats
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from lenscal.arrays import FloatArray
from lenscal.calibration.refine import calibrate_views
from lenscal.camera import Camera, OpenCVCamera
from lenscal.pose import Pose
from lenscal.sensor import Sensor
from lenscal.target import Chessboard

SENSOR = Sensor(2448, 2048, 0.00345, 0.00345)
COLUMNS, ROWS = 14, 10
TILTS_DEG = ((0, 0), (25, 0), (-25, 0), (0, 25), (0, -25), (17, 17))
CENTRE_PX = SENSOR.centre_px + np.array([30.0, -20.0])
NOISE_PX = 0.1
#: Share of the image's width that the board spans.
SPAN = 0.7
#: Distortion of the wide and the long end in mm⁻², 6 % and 0.3 % at the corner of the image.
STRONG_PER_MM2, WEAK_PER_MM2 = 2e-3, 1e-4
#: 0.2 % at the corner.
MILD_PER_MM2 = 0.002 / 5.5**2
EQUAL_PARAMETERS = (
    cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
)
#: The stages of mrcal-calibrate-cameras for one camera, without the warp of the board.
MRCAL = """
import json, sys, time
import mrcal, numpy as np
data = np.load(sys.argv[1])
size = np.array([data["size"]], dtype=np.int32)
def calibrate(pixels, square, focal):
    views = len(pixels)
    pairs = np.column_stack([np.arange(views), np.zeros(views)]).astype(np.int32)
    triples = np.column_stack([pairs, -np.ones(views)]).astype(np.int32)
    seed = dict(imagersizes=size, focal_estimate=focal, indices_frame_camera=pairs,
                observations=pixels, object_spacing=square)
    intrinsics, extrinsics, frames = mrcal.seed_stereographic(**seed)
    def optimize(intrinsics, model, core, distortion, final):
        return mrcal.optimize(
            intrinsics, extrinsics, frames, None, pixels, triples, None, None, model,
            imagersizes=size, do_optimize_intrinsics_core=core,
            do_optimize_intrinsics_distortions=distortion, do_optimize_calobject_warp=False,
            calibration_object_spacing=square, do_apply_outlier_rejection=final,
            do_apply_regularization=final, verbose=False)
    optimize(intrinsics, "LENSMODEL_STEREOGRAPHIC", False, False, False)
    optimize(intrinsics, "LENSMODEL_STEREOGRAPHIC", True, False, False)
    intrinsics = np.concatenate([intrinsics, np.full((1, 4), 1e-7)], axis=1)
    optimize(intrinsics, "LENSMODEL_OPENCV4", True, True, True)
    optimize(intrinsics, "LENSMODEL_OPENCV4", True, True, True)
    return intrinsics[0]
jobs = list(zip(data["pixels"], data["square_mm"] / 1000.0, data["focal_px"]))
seconds, found = [], []
for _ in range(int(sys.argv[2])):
    copies = [(np.array(p), s, f) for p, s, f in jobs]
    start = time.process_time()
    found = [calibrate(*copy) for copy in copies]
    seconds.append(time.process_time() - start)
print(json.dumps({"seconds": seconds, "found": np.array(found).tolist()}))
"""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A camera, the poses of a board before it, and what it sees without noise."""

    camera: Camera
    board: Chessboard
    poses: tuple[Pose, ...]
    pixels: tuple[FloatArray, ...]

    @property
    def points(self) -> list[FloatArray]:
        """Points of every view."""
        return [self.board.points_mm] * len(self.poses)

    def noisy(self, rng: np.random.Generator, outliers: float) -> list[FloatArray]:
        """See it once, in float32 precision."""
        seen = []
        for exact in self.pixels:
            pixels = exact + NOISE_PX * rng.standard_normal(exact.shape)
            bad = rng.random(len(pixels)) < outliers
            size = SENSOR.width_px, SENSOR.height_px
            pixels[bad] = rng.uniform((0, 0), size, (int(bad.sum()), 2))
            seen.append(pixels.astype(np.float32).astype(np.float64))
        return seen


def scene(image_distance_mm: float, object_distance_mm: float, k1_per_mm2: float) -> Scene:
    """Put a board that fills the view before a camera, in six poses."""
    camera = Camera(SENSOR, image_distance_mm, k1_per_mm2, CENTRE_PX)
    width_mm = SPAN * SENSOR.width_mm * object_distance_mm / image_distance_mm
    board = Chessboard(COLUMNS, ROWS, width_mm / (COLUMNS - 1))
    poses = tuple(
        Pose.from_rotation_vector(
            np.radians([about_x, about_y, 3.0 * view]), [0.0, 0.0, object_distance_mm]
        )
        for view, (about_x, about_y) in enumerate(TILTS_DEG)
    )
    pixels = tuple(camera.project(pose.transform(board.points_mm)) for pose in poses)
    if not all(SENSOR.contains(p).all() for p in pixels):
        raise SystemExit(f"the board does not fit the view at d {image_distance_mm:.1f} mm")
    return Scene(camera, board, poses, pixels)


def sweep() -> list[Scene]:
    """Step a zoom from 6 to 130 mm, with distortion that fades and d that breathes with focus."""
    scenes = []
    for zoom, focus in itertools.product(np.linspace(0, 1, 12), repeat=2):
        image_distance_mm = 6.0 * (118.0 / 6.0) ** zoom * (1 + 0.1 * focus)
        k1_per_mm2 = STRONG_PER_MM2 * (WEAK_PER_MM2 / STRONG_PER_MM2) ** zoom
        distance_mm = image_distance_mm * 20.0 * 0.2**focus
        scenes.append(scene(float(image_distance_mm), float(distance_mm), float(k1_per_mm2)))
    return scenes


def ours(scene: Scene, pixels: Sequence[FloatArray]) -> Camera:
    """Calibrate, with rejection and covariance."""
    return calibrate_views(scene.points, pixels, SENSOR).camera


def opencv(scene: Scene, pixels: Sequence[FloatArray], flags: int) -> OpenCVCamera:
    """Calibrate with cv2."""
    # Of the matrix, FIX_ASPECT_RATIO reads the ratio of its diagonal alone: square samples.
    _, matrix, distortion, _, _ = cv2.calibrateCamera(
        [p.astype(np.float32) for p in scene.points],
        [p.astype(np.float32)[:, None] for p in pixels],
        (SENSOR.width_px, SENSOR.height_px),
        np.eye(3),
        np.zeros(5),
        flags=flags,
    )
    return OpenCVCamera(np.asarray(matrix, float), np.asarray(distortion, float).ravel(), 0.0)


def axis_of(camera: Camera | OpenCVCamera) -> FloatArray:
    """(3,) f and principal point in px."""
    return np.array([camera.matrix[0, 0], *camera.matrix[:2, 2]])


def slopes_of(camera: Camera | OpenCVCamera) -> FloatArray:
    """(N, 2) where the pixels of a grid over the image look."""
    across, down = np.linspace(0, SENSOR.width_px - 1, 25), np.linspace(0, SENSOR.height_px - 1, 21)
    grid = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    if isinstance(camera, Camera):
        rays = camera.unproject(grid)
        return rays[:, :2] / rays[:, 2:]
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-14)
    slopes = cv2.undistortPoints(grid[:, None], camera.matrix, camera.distortion, criteria=criteria)
    return np.asarray(slopes, float)[:, 0]


def compare_speed(outliers: float, rounds: int, python: Path) -> None:
    """Calibrate the sweep with everything there is, and print cpu times and errors."""
    scenes, rng = sweep(), np.random.default_rng(0)
    seen = [scene.noisy(rng, outliers) for scene in scenes]
    truth = np.array([axis_of(scene.camera) for scene in scenes])
    solvers: dict[str, Callable[[Scene, Sequence[FloatArray]], Camera | OpenCVCamera]] = {
        "ours": ours,
        "cv2, its default flags": partial(opencv, flags=0),
        "cv2, as many parameters": partial(opencv, flags=EQUAL_PARAMETERS),
    }
    times_s: dict[str, list[float]] = {name: [] for name in solvers}
    found: dict[str, FloatArray] = {}
    for turn in range(rounds):
        for name in list(solvers)[:: 1 if turn % 2 == 0 else -1]:
            start = time.process_time()
            cameras = [solvers[name](s, p) for s, p in zip(scenes, seen, strict=True)]
            times_s[name].append(time.process_time() - start)
            found[name] = np.array([axis_of(camera) for camera in cameras])
    peer = run_mrcal(scenes, seen, rounds, python)
    if peer is not None:
        times_s["mrcal, OPENCV4"], found["mrcal, OPENCV4"] = peer
    print(
        f"\n{len(scenes)} settings × {len(TILTS_DEG)} views × {COLUMNS * ROWS} corners, "
        f"{outliers:.0%} outliers; medians of the errors\n\n"
        f"{'':24} {'cpu s':>7} {'ms each':>8} {'ours / it':>9} {'f, rel.':>8} {'c_x px':>7} "
        f"{'c_y px':>7}"
    )
    for name, taken_s in times_s.items():
        errors = np.abs(found[name] - truth)
        errors[:, 0] /= truth[:, 0]
        focal, c_x, c_y = np.median(errors, axis=0)
        print(
            f"{name:24} {min(taken_s):7.2f} {1e3 * min(taken_s) / len(scenes):8.2f} "
            f"{min(times_s['ours']) / min(taken_s):9.2f} {focal:8.1e} {c_x:7.2f} {c_y:7.2f}"
        )
    if peer is None:
        print(f"mrcal is not installed for {python}, skipped")


def run_mrcal(
    scenes: Sequence[Scene], seen: Sequence[Sequence[FloatArray]], rounds: int, python: Path
) -> tuple[list[float], FloatArray] | None:
    """Run mrcal in the Python that has it: cpu seconds of all rounds; f and principal points."""
    try:
        subprocess.run([python, "-I", "-c", "import mrcal"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    corners = np.array(seen).reshape(len(seen), len(TILTS_DEG), ROWS, COLUMNS, 2)
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "corners.npz"
        np.savez(
            data,
            size=[SENSOR.width_px, SENSOR.height_px],
            pixels=np.concatenate([corners, np.ones((*corners.shape[:-1], 1))], axis=-1),
            square_mm=[scene.board.square_mm for scene in scenes],
            focal_px=[scene.camera.image_distance_px[0] for scene in scenes],
        )
        command = [str(python), "-I", "-c", MRCAL, str(data), str(rounds)]
        # Its seed warns on stderr of poses that it refines later.
        done = subprocess.run(command, check=True, capture_output=True, text=True)
    result = json.loads(done.stdout.splitlines()[-1])
    return result["seconds"], np.array(result["found"])[:, [0, 2, 3]]


def compare_accuracy(copies: int) -> None:
    """Calibrate many copies of three lenses with both, and print the ratio of median errors."""
    print(
        f"\nmedian error over {copies} copies, ours / cv2 with as many parameters\n\n"
        f"{'d mm':>5} {'world':18} {'outliers':>8} {'f':>7} {'c_x':>7} {'c_y':>7} {'map':>7}"
    )
    for image_distance_mm, world, outliers in itertools.product(
        (6.0, 25.0, 130.0), ("no distortion", "our model", "their model"), (0.0, 0.05)
    ):
        k1_per_mm2 = 0.0 if world == "no distortion" else MILD_PER_MM2
        seen = scene(image_distance_mm, 5 * image_distance_mm, k1_per_mm2)
        truth: Camera | OpenCVCamera = seen.camera
        if world == "their model":
            seen, truth = made_by_opencv(seen)
        rng = np.random.default_rng(1)
        errors: tuple[list[FloatArray], list[FloatArray]] = ([], [])
        for _ in range(copies):
            pixels = seen.noisy(rng, outliers)
            errors[0].append(errors_of(ours(seen, pixels), truth))
            errors[1].append(errors_of(opencv(seen, pixels, EQUAL_PARAMETERS), truth))
        ratios = np.median(errors[0], axis=0) / np.median(errors[1], axis=0)
        print(
            f"{image_distance_mm:5.0f} {world:18} {outliers:8.0%} "
            + " ".join(f"{ratio:7.3g}" for ratio in ratios)
        )


def made_by_opencv(seen: Scene) -> tuple[Scene, OpenCVCamera]:
    """Let cv2's model take the pictures: distortion of the same size, the other way round."""
    camera = seen.camera
    distortion = np.zeros(5)
    distortion[0] = -camera.k1_per_mm2 * camera.image_distance_mm**2
    pixels = []
    for pose in seen.poses:
        turn, _ = cv2.Rodrigues(pose.rotation)
        points = seen.board.points_mm
        image, _ = cv2.projectPoints(points, turn, pose.translation_mm, camera.matrix, distortion)
        pixels.append(np.asarray(image, float)[:, 0])
    return replace(seen, pixels=tuple(pixels)), OpenCVCamera(camera.matrix, distortion, 0.0)


def errors_of(found: Camera | OpenCVCamera, truth: Camera | OpenCVCamera) -> FloatArray:
    """(4,) f, c_x, c_y in px, and rms over the image of where pixels look, in px."""
    axis = np.abs(axis_of(found) - axis_of(truth))
    off = axis_of(truth)[0] * np.linalg.norm(slopes_of(found) - slopes_of(truth), axis=1)
    return np.array([*axis, np.sqrt(np.mean(off**2))])


def profile() -> None:
    """Show where our time goes in the sweep."""
    scenes, rng = sweep(), np.random.default_rng(0)
    seen = [scene.noisy(rng, 0.01) for scene in scenes]
    profiler = cProfile.Profile()
    with profiler:
        for one, pixels in zip(scenes, seen, strict=True):
            ours(one, pixels)
    pstats.Stats(profiler).sort_stats("tottime").print_stats(25)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--copies", type=int, default=400, help="copies of each world; 0 for none")
    parser.add_argument("--rounds", type=int, default=3, help="how often each solver is timed")
    parser.add_argument("--profile", action="store_true", help="profile our side, and stop")
    parser.add_argument("--mrcal-python", type=Path, default=Path("/usr/bin/python3"))
    arguments = parser.parse_args()
    if os.environ.get("OMP_NUM_THREADS") != "1":
        parser.error("threads cost cpu time; set OMP_NUM_THREADS=1")
    cv2.setNumThreads(1)
    if arguments.profile:
        profile()
        return
    for outliers in (0.01, 0.0):
        compare_speed(outliers, arguments.rounds, arguments.mrcal_python)
    if arguments.copies:
        compare_accuracy(arguments.copies)


if __name__ == "__main__":
    main()
