"""How fast exact visibility regions are beside ray sampling, which is not exact.

The unit is a sampler: 100³ viewpoints × 16 points of the target, segments between them through
embreex. Scene and sampler are measured in CPU seconds in one run; the time of a sampler that stops
at the first hit stands beside it, and which share of the viewpoints that 16 samples call visible
does not see the whole target. The audit by 10,000 viewpoints, its preparation included, is given as
a share of the region's time, a million membership queries as a share of the sampler's. Scenes:
random triangles in a slab 5 to 30 above a 10 × 10 target in a box of 100³, and closed convex solids
of 1,280 faces. Peak memory is that of the process so far, so it is measured in a process of its own
for each scene.

    OMP_NUM_THREADS=1 python benchmarks/visibility.py [--scene NAME ...]
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial

import numpy as np
import trimesh
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from lenscal.arrays import FloatArray
from planning.scene import Scene
from planning.solid import box_workspace
from planning.target import Target
from planning.visibility.audit import random_viewpoints
from planning.visibility.exact_test import ExactTest
from planning.visibility.methods import visibility_region

SQUARE = np.array([[-5.0, -5, 0], [5, -5, 0], [5, 5, 0], [-5, 5, 0]])
NODES = 100
SAMPLES = 4


def soup(count: int, size: float) -> Scene:
    """Random triangles, from a seed."""
    generator = np.random.default_rng(0)
    across = generator.uniform(-30, 30, (2, count))
    centres = np.column_stack([*across, generator.uniform(5, 30, count)])
    corners = centres[:, None] + size * generator.normal(size=(count, 3, 3))
    faces = np.arange(3 * count).reshape(-1, 3)
    mesh = trimesh.Trimesh(corners.reshape(-1, 3), faces, process=False)
    return Scene([mesh], as_faces=True)


def spheres(count: int, radius: float) -> Scene:
    """Closed convex solids of 1,280 faces each on five rings, from a seed."""
    generator = np.random.default_rng(0)
    ball = trimesh.creation.icosphere(subdivisions=3)
    meshes = []
    for i in range(count):
        angle, ring = 2 * np.pi * i / count, 15 + (i % 5) * (6 if count > 7 else 0)
        height = 12 + 4 * generator.uniform(-1, 1)
        centre = [ring * np.cos(angle), ring * np.sin(angle), height]
        meshes.append(trimesh.Trimesh(radius * ball.vertices + centre, ball.faces, process=False))
    return Scene(meshes)


SCENES: dict[str, Callable[[], Scene]] = {
    "10,000 triangles, size 1.0": partial(soup, 10_000, 1.0),
    "10,000 triangles, size 0.3": partial(soup, 10_000, 0.3),
    "100,000 triangles, size 0.3": partial(soup, 100_000, 0.3),
    "100,000 triangles, size 0.1": partial(soup, 100_000, 0.1),
    "7 convex solids, 8,960 faces": partial(spheres, 7, 3.0),
    "80 convex solids, 102,400 faces": partial(spheres, 80, 1.0),
}


def sampled(triangles: FloatArray, viewpoints: FloatArray, stop_at_hit: bool) -> FloatArray:
    """Tell from which viewpoints no ray to a sample of the target is blocked."""
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, np.ascontiguousarray(triangles, dtype=np.float32))
    steps = (np.arange(SAMPLES) + 0.5) / SAMPLES * 10 - 5
    left = np.arange(len(viewpoints))
    sees = np.ones(len(viewpoints), dtype=bool)
    for x in steps:
        for y in steps:
            start = viewpoints[left]
            towards = np.array([x, y, 0], dtype=np.float32) - start
            far = np.full(len(left), 0.999, dtype=np.float32)
            free = np.asarray(scene.run(start, towards, far, query="OCCLUDED")) != 0
            sees[left[~free]] = False
            if stop_at_hit:
                left = left[free]
    return sees


def timed(task: Callable[[], object]) -> tuple[float, object]:
    """CPU seconds and result."""
    start = time.process_time()
    result = task()
    return time.process_time() - start, result


def measure(name: str) -> None:
    """Measure one scene and print its row."""
    scene = SCENES[name]()
    target, workspace = Target(SQUARE), box_workspace((-50, -50, 0), (50, 50, 100))
    memory_before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    build_s, region = timed(lambda: visibility_region(scene, target, workspace, audit_points=0))
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    across = np.linspace(-49, 49, NODES, dtype=np.float32)
    up = np.linspace(1, 99, NODES, dtype=np.float32)
    grid = np.stack(np.meshgrid(up, across, across, indexing="ij")[::-1], axis=-1)
    viewpoints = np.ascontiguousarray(grid.reshape(-1, 3))
    triangles = scene.triangles_mm
    sampler_s, sees = timed(lambda: sampled(triangles, viewpoints, stop_at_hit=False))
    stopping_s, _ = timed(lambda: sampled(triangles, viewpoints, stop_at_hit=True))
    wrong = np.nan
    if sees.any():
        called = viewpoints[sees].astype(np.float64)
        some = called[np.random.default_rng(0).permutation(len(called))[:2000]]
        wrong = 1 - region.contains(some).mean()
    million = np.random.default_rng(1).uniform([-50, -50, 0], [50, 50, 100], (1_000_000, 3))
    region.contains(million[:10])
    contains_s, _ = timed(lambda: region.contains(million))
    tried = random_viewpoints(workspace, region.solid, 10_000, np.random.default_rng(0))
    audit_s, audit = timed(
        lambda: region.audit.with_viewpoints(region, tried, ExactTest(scene).sees(tried, target))
    )
    print(
        f"{name:32} {build_s:8.2f} {sampler_s:8.2f} {build_s / sampler_s:7.2f} {stopping_s:9.2f} "
        f"{audit_s / build_s:7.2f} {audit.disagreements:8d} {contains_s / sampler_s:8.2f} "
        f"{region.volume_mm3 / workspace.volume_mm3:9.6f} {len(region.solid.faces):7d} "
        f"{100 * wrong:7.1f} {region.audit.repairs:7d} {memory - memory_before:6.0f} {memory:6.0f}",
        flush=True,
    )


def main() -> None:
    """Measure all scenes, each in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", action="append", choices=list(SCENES))
    parser.add_argument("--row", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.row:
        measure(given.scene[0])
        return
    print(f"one thread: OMP_NUM_THREADS={os.environ.get('OMP_NUM_THREADS', 'unset')}")
    print(
        f"{'':32} {'region s':>8} {'sampler':>8} {'ratio':>7} {'stops at':>9} "
        f"{'audit /':>7} {'audit':>8} {'contains':>8} {'visible':>9} "
        f"{'region':>7} {'sampler':>7} {'repairs':>7} {'memory':>6} {'peak':>6}\n"
        f"{'':32} {'CPU':>8} {'s CPU':>8} {'':>7} {'hit, s':>9} "
        f"{'region':>7} {'disagree':>8} {'/ sampl.':>8} {'share':>9} {'faces':>7} "
        f"{'wrong %':>7} {'':>7} {'MB':>6} {'MB':>6}",
        flush=True,
    )
    for name in given.scene or SCENES:
        subprocess.run([sys.executable, __file__, "--row", "--scene", name], check=True)


if __name__ == "__main__":
    main()
