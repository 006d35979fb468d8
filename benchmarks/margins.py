"""What the margins of all requirements cost, beside projecting the target's corners with numpy.

100 000 viewpoints in the visibility region of the paper's part, 20 lens states, target T with four
corners and feature L. The peer: numpy's pinhole projection of all 8 million points — each turned,
shifted and divided — and, stricter, one that turns the corners once for each viewpoint and only
divides and scales for each state. Distance to the boundary of the region is the region's, and
clearance depends on how many views come near to the part: both are printed apart. CPU seconds, one
thread, everything in one run, the fastest of three rounds. Wanted are at most six times the peer;
on two shared cores, in two runs, all cost 4.0 and 4.7 times it (15 and 20 times the stricter one),
all but clearance 2.2 and 2.5 times.

    OMP_NUM_THREADS=1 python benchmarks/margins.py [--viewpoints 100000] [--states 20] [--rounds 3]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from lenscal.arrays import FloatArray
from lenscal.camera import Camera
from lenscal.sensor import Sensor
from planning.camera_body import CameraBody
from planning.enclosure import example_part
from planning.judgement import judge
from planning.lens_states import LensStates
from planning.requirements.clearance import Clearance
from planning.requirements.depth_of_field import DepthOfField
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.incidence import Incidence
from planning.requirements.margin import Requirement
from planning.requirements.resolution import Resolution
from planning.requirements.unvignetted import Unvignetted
from planning.requirements.visibility import Visibility
from planning.views import Subject, Views
from planning.visibility.methods import visibility_region

SENSOR = Sensor(512, 480, 0.023, 0.01375, scale_factor=0.70642)
#: Front and radius of the paper's lens as the simulated rig has it, in mm.
BODY = CameraBody.barrel(front_mm=235.0, radius_mm=30.0, length_mm=200.0)


def lens_states(count: int, k1: float) -> LensStates:
    """Like the paper's lens: D from 500 to 720 mm, standoffs near 380 mm."""
    rng = np.random.default_rng(0)
    distance = rng.uniform(500, 720, count)
    standoff = rng.uniform(360, 390, count)
    cameras = tuple(
        Camera(
            SENSOR,
            float(ratio * d),
            float(rng.uniform(-k1, k1)),
            SENSOR.centre_px + rng.uniform(-9, 9, 2),
        )
        for d, ratio in zip(distance, rng.uniform(0.19, 0.33, count), strict=True)
    )
    offset = np.stack([0 * distance, 0 * distance, standoff - distance], axis=-1)
    return LensStates(cameras, distance, offset, distance / 30)


def cpu(work: Callable[[], object], rounds: int) -> float:
    """CPU seconds of the fastest round."""
    times = []
    for _ in range(rounds):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def project_all(views: Views, corners: FloatArray) -> FloatArray:
    """Project V × S × N points, each through its own pinhole camera; a block at a time."""
    scale, shift = pinholes(views.states)
    sums = 0.0
    for start in range(0, len(views.positions_mm), 1000):
        part = slice(start, start + 1000)
        turned = views.rotations[part].transpose(0, 1, 3, 2)[:, :, None]
        away = (corners - views.positions_mm[part][:, :, None])[..., None]
        away = np.broadcast_to(away, (len(away), len(scale), *away.shape[2:]))
        camera = np.matmul(turned, away)[..., 0]
        pixels = camera[..., :2] / camera[..., 2:] * scale[:, None] + shift[:, None]
        sums += float(pixels[0, 0, 0, 0])
    return np.array(sums)


def project_strictly(views: Views, corners: FloatArray) -> FloatArray:
    """Project the same, with the corners turned once for each viewpoint."""
    scale, shift = pinholes(views.states)
    sums = 0.0
    for start in range(0, len(views.positions_mm), 1000):
        part = slice(start, start + 1000)
        camera = (corners - views.positions_mm[part]) @ views.rotations[part, 0]
        ideal = camera[..., :2] / camera[..., 2:]
        pixels = ideal[:, None] * scale[:, None] + shift[:, None]
        sums += float(pixels[0, 0, 0, 0])
    return np.array(sums)


def pinholes(states: LensStates) -> tuple[FloatArray, FloatArray]:
    """(S, 2) image distances and principal points in px."""
    return (
        np.stack([camera.image_distance_px for camera in states.cameras]),
        np.stack([camera.centre_px for camera in states.cameras]),
    )


def main() -> None:
    """Print one line per requirement."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--viewpoints", type=int, default=100_000)
    parser.add_argument("--states", type=int, default=20)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--k1", type=float, default=4e-4, help="largest |κ1| in mm⁻²; 0: pinhole")
    given = parser.parse_args()
    part = example_part()
    region = visibility_region(part.scene, part.target, part.workspace, audit_points=0)
    subject = Subject(part.target, part.feature, part.scene, region)
    rng = np.random.default_rng(1)
    places = np.zeros((0, 3))
    low, high = region.solid.bounds_mm
    while len(places) < given.viewpoints:
        tried = rng.uniform(low, high, (20_000, 3))
        distance = np.linalg.norm(tried, axis=1)
        kept = (distance > 400) & (distance < 800)
        places = np.concatenate([places, tried[kept][region.contains(tried[kept])]])
    states = lens_states(given.states, given.k1)
    aim = part.target.centroid_mm
    views = Views.looking_at(places[: given.viewpoints], aim, (1, 0.1, 0), states, subject)
    requirements: list[Requirement] = [
        Resolution(3, 0.254, "x"),
        FieldOfView(25.4, "x"),
        DepthOfField(2.0, 2.0),
        Incidence(60),
        Visibility(),
        Unvignetted(),
        Clearance(BODY, 10.0),
    ]
    corners = part.target.vertices_mm
    projected = cpu(lambda: project_all(views, corners), given.rounds)
    strictly = cpu(lambda: project_strictly(views, corners), given.rounds)
    count = given.viewpoints * given.states
    print(
        f"{given.viewpoints} viewpoints × {given.states} states; region of "
        f"{len(region.solid.faces)} faces, part of {len(part.scene.triangles_mm)}; CPU seconds"
    )
    print(f"numpy projects {count * len(corners):.3g} points      {projected:7.2f}")
    print(f"with corners turned once per viewpoint {strictly:7.2f}")
    distance = cpu(lambda: region.distance_to_boundary(views.positions_mm), 1)
    print(f"distance to the region's boundary      {distance:7.2f}  (the region's own)")
    # The views keep that distance once it is known.
    _ = views.region_distance_mm
    known = [requirement for requirement in requirements if requirement.name != "clearance"]
    for requirement in requirements:
        spent = cpu(lambda r=requirement: judge([r], views), given.rounds)  # type: ignore[misc]
        share = judge([requirement], views).margins[0].share
        print(f"  {requirement.name:<37s}{spent:7.2f}  {(share >= 0).mean():5.0%} hold")
    together = cpu(lambda: judge(known, views), given.rounds)
    everything = cpu(lambda: judge(requirements, views), given.rounds)
    for name, spent in (("all but clearance", together), ("all", everything)):
        print(
            f"{name:<39s}{spent:7.2f}  without that distance: {spent / projected:.2f} × numpy, "
            f"{spent / strictly:.1f} × the stricter"
        )


if __name__ == "__main__":
    main()
