"""How long a frame takes, against a plain pipeline that does the same work in the same process.

The plain pipeline maps every sample back to the plate with numpy, looks it up with `cv2.remap`,
averages 4 × 4 samples per pixel, blurs with one `cv2.GaussianBlur` of the same second moment, and
adds shot and read noise with numpy. Its texture is drawn beforehand and is not timed; ours draws
what it needs within the time. Both run on one thread. Times are the fastest of five runs.

    python benchmarks/rendering.py
"""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable
from functools import partial

import cv2
import numpy as np

from lenscal.camera import Camera
from lenscal.imaging.detector import Detector, GreyImage
from lenscal.imaging.formation import render
from lenscal.imaging.texture import TargetSurface
from lenscal.plate import parse_target
from lenscal.pose import Pose
from lenscal.sensor import Sensor

PLATE = parse_target("charuco:17x13:3mm:2.25mm@0,0+disk:6mm@0,27")
SAMPLES = 4
OBJECT_MM, PUPIL_MM, BLUR_PX = 400.0, 8.0, 3.0
DETECTOR = Detector(20_000.0, 12.0, 64.0, 12, 64e6)
EXPOSURE_S, F_NUMBER = 0.01, 8.0
SENSORS = {
    "640 × 480": Sensor(640, 480, 0.0135, 0.0135),
    "2448 × 2048": Sensor(2448, 2048, 0.00345, 0.00345),
}


def scene(sensor: Sensor, tilt_deg: float) -> tuple[Camera, Pose]:
    """A camera that sees 55 mm of the plate, out of focus by 3 px, and where the plate is."""
    camera = Camera(sensor, OBJECT_MM * sensor.width_mm / 55.0, -1e-4)
    blur_mm = BLUR_PX * sensor.sample_pitch_x_mm
    vergence = 1 / OBJECT_MM - blur_mm / (PUPIL_MM * camera.image_distance_mm)
    tilt = np.radians(tilt_deg)
    return camera, Pose.from_rotation_vector([0.8 * tilt, 0.6 * tilt, 0.1], [0, 0, 1 / vergence])


def ours(camera: Camera, pose: Pose, rng: np.random.Generator) -> GreyImage:
    """Form, expose and read one frame."""
    irradiance = render(
        camera,
        pose,
        TargetSurface(PLATE),
        object_distance_mm=OBJECT_MM,
        entrance_pupil_diameter_mm=PUPIL_MM,
    )
    return DETECTOR.read(DETECTOR.electrons(irradiance, EXPOSURE_S, F_NUMBER), rng)


def plain(camera: Camera, pose: Pose, rng: np.random.Generator) -> Callable[[], GreyImage]:
    """Prepare the plain pipeline, with its texture drawn."""
    sensor, n = camera.sensor, SAMPLES
    texels_per_mm = n * camera.image_distance_mm / OBJECT_MM / sensor.sample_pitch_x_mm
    texture = (0.04 + 0.96 / 255 * PLATE.artwork(texels_per_mm)).astype(np.float32)
    middle = (np.array(texture.shape[::-1]) - 1) / 2
    plane_from_ray = np.linalg.inv(np.column_stack([pose.rotation[:, :2], pose.translation_mm]))

    def frame() -> GreyImage:
        u = (np.arange(sensor.width_px * n) + 0.5) / n - 0.5
        v = (np.arange(sensor.height_px * n) + 0.5) / n - 0.5
        x = ((u - camera.centre_px[0]) * sensor.sample_pitch_x_mm)[None, :]
        y = ((v - camera.centre_px[1]) * sensor.sample_pitch_y_mm)[:, None]
        gain = 1 + camera.k1_per_mm2 * (x**2 + y**2)
        x, y, d = x * gain, y * gain, camera.image_distance_mm
        a, b, c = (p * x + q * y + r * d for p, q, r in plane_from_ray)
        across = (a / c * texels_per_mm + middle[0]).astype(np.float32)
        down = (b / c * texels_per_mm + middle[1]).astype(np.float32)
        samples = cv2.remap(
            texture, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0.3
        )
        size = sensor.width_px, sensor.height_px
        pixels = cv2.resize(samples, size, interpolation=cv2.INTER_AREA)
        blurred = cv2.GaussianBlur(pixels, (0, 0), BLUR_PX / 4)
        electrons = blurred * (DETECTOR.electrons_per_second * EXPOSURE_S / F_NUMBER**2)
        noisy = rng.poisson(electrons) + rng.normal(0, DETECTOR.read_noise_e, electrons.shape)
        grey = np.rint(noisy / DETECTOR.electrons_per_dn + DETECTOR.black_level_dn)
        return np.clip(grey, 0, DETECTOR.saturation_dn).astype(np.uint16)

    return frame


def fastest(work: Callable[[], object], runs: int = 5) -> float:
    """Time some work in seconds."""
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    """Print the table."""
    cv2.setNumThreads(1)
    rng = np.random.default_rng(0)
    print(f"{'frame':>12} {'tilt':>5} {'ours 1/s':>9} {'plain 1/s':>9} {'ratio':>6} {'first':>6}")
    for name, sensor in SENSORS.items():
        for tilt_deg in (0.0, 25.0):
            camera, pose = scene(sensor, tilt_deg)
            reference = plain(camera, pose, rng)
            first = fastest(partial(ours, camera, pose, rng), runs=1)
            our_s = fastest(partial(ours, camera, pose, rng))
            plain_s = fastest(reference)
            print(
                f"{name:>12} {tilt_deg:>4.0f}° {1 / our_s:>9.2f} {1 / plain_s:>9.2f} "
                f"{our_s / plain_s:>6.2f} {first / our_s:>6.2f}"
            )
    camera, pose = scene(SENSORS["640 × 480"], 25.0)
    tracemalloc.start()
    ours(camera, pose, rng)
    print(f"memory of a frame of 640 × 480: {tracemalloc.get_traced_memory()[1] / 1e6:.0f} MB")


if __name__ == "__main__":
    main()
