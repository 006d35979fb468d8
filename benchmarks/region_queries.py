"""What it costs to audit a region and to ask it, beside sampling the target with rays.

    python benchmarks/region_queries.py [bodies]

The scene is random tetrahedra (2,500 by default: 10,000 faces) in a slab above a 10 × 10 mm target,
the workspace a box of 100³ mm. The peer, in the same run: Embree (embreex) with 100³ viewpoints and
16 samples of the target. CPU seconds; compare them only within one run. The bar of 0.15 for
membership is stated for 10,000 open triangles: they cost a sampler twice as much as tetrahedra.
"""

from __future__ import annotations

import sys
import time

import numpy as np
import trimesh
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from planning.scene import Scene
from planning.solid import box_workspace
from planning.target import Target
from planning.visibility.audit import random_viewpoints
from planning.visibility.exact_test import ExactTest
from planning.visibility.methods import visibility_region

SQUARE = np.array([[-5.0, -5, 0], [5, -5, 0], [5, 5, 0], [-5, 5, 0]])


def tetrahedra(count: int) -> trimesh.Trimesh:
    """Random tetrahedra in a slab above the target, as one mesh."""
    generator = np.random.default_rng(0)
    middles = generator.uniform([-30, -30, 5], [30, 30, 30], (count, 1, 3))
    corners = middles + 0.4 * generator.normal(size=(count, 4, 3))
    inside_out = np.linalg.det(corners[:, 1:] - corners[:, :1]) < 0
    corners[inside_out, 2:] = corners[inside_out, :1:-1]
    faces = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 3], [1, 2, 3]])
    return trimesh.Trimesh(
        corners.reshape(-1, 3),
        (4 * np.arange(count)[:, None, None] + faces).reshape(-1, 3),
        process=False,
    )


def sampling(triangles: np.ndarray) -> float:
    """CPU seconds of 100³ viewpoints × 16 samples."""
    embree = rtcore_scene.EmbreeScene()
    TriangleMesh(embree, np.ascontiguousarray(triangles, dtype=np.float32))
    across = np.linspace(-49, 49, 100, dtype=np.float32)
    up = np.linspace(1, 99, 100, dtype=np.float32)
    grid = np.stack(np.meshgrid(up, across, across, indexing="ij")[::-1], -1).reshape(-1, 3).copy()
    share = np.full(len(grid), 0.999, dtype=np.float32)
    start = time.process_time()
    for x in np.linspace(-3.75, 3.75, 4):
        for y in np.linspace(-3.75, 3.75, 4):
            embree.run(grid, np.array([x, y, 0], np.float32) - grid, share, query="OCCLUDED")
    return time.process_time() - start


def main() -> None:
    """Print one line for each thing that is timed."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 2_500
    scene, target = Scene([tetrahedra(count)]), Target(SQUARE)
    workspace = box_workspace((-50, -50, 0), (50, 50, 100))
    marks = [time.process_time()]

    def lap() -> float:
        marks.append(time.process_time())
        return marks[-1] - marks[-2]

    region = visibility_region(scene, target, workspace, audit_points=0)
    build = lap()
    print(f"build: {build:.2f} s, {len(region.solid.faces)} faces of {4 * count}")
    test = ExactTest(scene)
    points = random_viewpoints(workspace, region.solid, 10_000, np.random.default_rng(0))
    audit = region.audit.with_viewpoints(region, points, test.sees(points, target))
    cost = lap()
    print(f"audit of 10,000: {cost:.2f} s, {cost / build:.0%} of the build (at most 30%)")
    print(f"    {audit.disagreements} disagreements, {audit.visible} visible")
    points = np.random.default_rng(1).uniform([-50, -50, 0], [50, 50, 100], (1_000_000, 3))
    lap()
    region.contains(points)
    asked = lap()
    peer = sampling(scene.triangles_mm)
    print(
        f"contains, a million: {asked:.2f} s, {asked / peer:.3f} of sampling ({peer:.2f} s; 0.15)"
    )
    lap()
    region.distance_to_boundary(points[:10_000])
    print(f"distance to the boundary, 10,000: {lap():.2f} s")
    for few in (1, 100):
        lap()
        for _ in range(20):
            test.sees(points[:few], target)
        print(f"exact test of {few}, scene prepared: {1e3 * lap() / 20:.1f} ms")
    points = random_viewpoints(workspace, region.solid, 100_000, np.random.default_rng(2))
    audit = region.audit.with_viewpoints(region, points, test.sees(points, target))
    print(f"100,000 viewpoints: {audit.disagreements} disagreements, {audit.visible} visible")


if __name__ == "__main__":
    main()
