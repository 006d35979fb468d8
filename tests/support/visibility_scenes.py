"""Random scenes for visibility: every kind of thing that a method can get wrong, from a seed.

`random_scene(kind, seed)` gives bodies, a target of about 10 mm and a workspace of about 100 mm.
Kinds that stand or fall with exact coincidence stay along the axes; others are turned at random.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import manifold3d
import numpy as np
import trimesh
from manifold3d import Manifold
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from planning.boolean import from_manifold, to_manifold
from planning.scene import Scene
from planning.solid import Solid, box_workspace
from planning.target import Target

SQUARE: Final = np.array([[-5.0, -5], [5, -5], [5, 5], [-5, 5]])
_ABOVE: Final = ((-50.0, -50.0, 0.0), (50.0, 50.0, 100.0))
_ALL_AROUND: Final = ((-50.0, -50.0, -50.0), (50.0, 50.0, 50.0))


@dataclass(frozen=True)
class VisibilityScene:
    """A scene with its question."""

    name: str
    scene: Scene
    target: Target
    workspace: Solid


@dataclass
class Parts:
    """What a builder gives: meshes, corners of the target, workspace, whether it may be turned."""

    meshes: list[trimesh.Trimesh]
    target: np.ndarray
    workspace: Solid
    turn: bool = True


def random_scene(kind: str, seed: int) -> VisibilityScene:
    """Make the scene of a kind and a seed."""
    generator = np.random.default_rng([sorted(KINDS).index(kind), seed])
    parts = KINDS[kind](generator)
    meshes, target, workspace = parts.meshes, parts.target, parts.workspace
    if parts.turn and seed % 2:
        turn = Rotation.random(random_state=seed).as_matrix()
        shift = 30 * generator.normal(size=3)
        meshes = [_mesh(m.vertices @ turn.T + shift, m.faces) for m in meshes]
        target = target @ turn.T + shift
        workspace = Solid(workspace.vertices_mm @ turn.T + shift, workspace.faces)
    return VisibilityScene(f"{kind} {seed}", Scene(meshes), Target(target), workspace)


# ── polygons ──────────────────────────────────────────────────────────────────────────────────────
def star_polygon(generator, corners: int, radius: float) -> np.ndarray:
    """A concave polygon about the origin, counter-clockwise."""
    steps = generator.uniform(0.5, 1.5, corners)
    angles = np.cumsum(steps) * 2 * np.pi / steps.sum()
    radii = radius * generator.uniform(0.35, 1.0, corners)
    return radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def tangled_polygon(generator, corners: int, radius: float) -> np.ndarray:
    """A simple polygon through random points, with gulfs within gulfs."""
    while True:
        points = radius * generator.uniform(-1, 1, (corners, 2))
        crossing = True
        for _ in range(500):
            crossing = _first_crossing(points)
            if not crossing:
                break
            i, j = crossing
            points[i + 1 : j + 1] = points[i + 1 : j + 1][::-1]
        following = np.roll(points, -1, axis=0)
        area = (points[:, 0] * following[:, 1] - points[:, 1] * following[:, 0]).sum() / 2
        if not crossing and abs(area) > 0.1 * radius**2:
            return points if area > 0 else points[::-1].copy()


def hooked_comb(generator, slots: int) -> np.ndarray:
    """A plate with slots from its upper edge that widen inside: gulfs within gulfs."""
    width, depth, lip = generator.uniform(2, 4), generator.uniform(8, 14), generator.uniform(2, 4)
    wide = width + generator.uniform(2, 5)
    pitch = wide + generator.uniform(1, 3)
    corners = [(0.0, 0.0), (slots * pitch + 2, 0.0), (slots * pitch + 2, 20.0)]
    for k in reversed(range(slots)):
        left = 2 + k * pitch
        corners += [
            (left + width, 20.0),
            (left + width, 20 - lip),
            (left + wide - 0.5, 20 - lip),
            (left + wide - 0.5, 20 - depth),
            (left, 20 - depth - generator.uniform(-1, 1)),
            (left, 20.0),
        ]
    outline = np.array([*corners, (0.0, 20.0)])
    return outline - outline.mean(axis=0)


def convex_polygon(generator, radius: float) -> np.ndarray:
    """A convex polygon of three to seven corners about the origin."""
    points = radius * generator.uniform(-1, 1, (7, 2))
    return points[ConvexHull(points).vertices]


def _first_crossing(points):
    following = np.roll(points, -1, axis=0)
    count = len(points)
    for i in range(count - 1):
        for j in range(i + 2, count if i else count - 1):
            a, b, c, d = points[i], following[i], points[j], following[j]
            if _side(a, b, c) * _side(a, b, d) < 0 and _side(c, d, a) * _side(c, d, b) < 0:
                return i, j
    return None


def _side(a, b, c) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


# ── bodies ────────────────────────────────────────────────────────────────────────────────────────
def prism(loops, low: float, high: float) -> trimesh.Trimesh:
    """Polygon with holes (the outline first, all counter-clockwise), from one height to another."""
    turned = [np.asarray(loops[0]), *(np.asarray(loop)[::-1] for loop in loops[1:])]
    flat = np.concatenate(turned)
    cap = np.asarray(manifold3d.triangulate(turned)).astype(np.int64)
    count, sides, start = len(flat), [], 0
    for loop in turned:
        here = start + np.arange(len(loop))
        there = np.roll(here, -1)
        sides += [np.stack([here, there, there + count], axis=-1)]
        sides += [np.stack([here, there + count, here + count], axis=-1)]
        start += len(loop)
    vertices = np.concatenate([np.column_stack([flat, np.full(count, z)]) for z in (low, high)])
    return _mesh(vertices, np.concatenate([cap[:, ::-1], cap + count, *sides]))


def _mesh(vertices, faces) -> trimesh.Trimesh:
    return trimesh.Trimesh(vertices, faces, process=False)


def _box(low, high) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[low, high])


def _hull(points) -> trimesh.Trimesh:
    return _mesh(*from_manifold(Manifold.hull_points(np.ascontiguousarray(points))))


def _united(meshes) -> trimesh.Trimesh:
    solids = [to_manifold("body", m.vertices, m.faces) for m in meshes]
    return _mesh(*from_manifold(Manifold.batch_boolean(solids, manifold3d.OpType.Add)))


def _flat(polygon) -> np.ndarray:
    return np.column_stack([polygon, np.zeros(len(polygon))])


def _tilted(mesh, generator, height: float, tilt: float) -> trimesh.Trimesh:
    """Turn a body about the origin by up to `tilt` (rad) and lift it."""
    turn = Rotation.from_rotvec(tilt * generator.uniform(-1, 1, 3)).as_matrix()
    shift = [*generator.uniform(-4, 4, 2), height]
    return _mesh(mesh.vertices @ turn.T + shift, mesh.faces)


def _above() -> Solid:
    return box_workspace(*_ABOVE)


# ── kinds ─────────────────────────────────────────────────────────────────────────────────────────
def _convex(generator) -> Parts:
    target = convex_polygon(generator, 5.0)
    bodies = [prism([target], -6.0, 0.0)]
    for _ in range(4):
        centre = generator.uniform([-20, -20, 6], [20, 20, 30])
        bodies.append(_hull(centre + 4 * generator.uniform(-1, 1, (6, 3))))
    return Parts(bodies, _flat(target), _above())


def _concave(generator) -> Parts:
    target = convex_polygon(generator, 5.0)
    bodies = [
        _tilted(prism([star_polygon(generator, 7, 14.0)], -2, 2), generator, 22, 0.6),
        _tilted(prism([star_polygon(generator, 9, 10.0)], -1, 1), generator, 10, 0.3),
    ]
    return Parts(bodies, _flat(target), _above())


def _holes_with_islands(generator) -> Parts:
    """A plate with windows, concave ones too; islands stand in one, an island has a hole itself."""
    quarter = np.array([[-7.0, -7], [7, -7], [7, 7], [-7, 7]])
    windows = [
        middle + polygon
        for middle, polygon in zip(
            quarter,
            [star_polygon(generator, 8, 6.0), convex_polygon(generator, 5.5), 0.9 * SQUARE],
            strict=False,
        )
    ]
    island = quarter[2] + star_polygon(generator, 6, 3.5)
    small = quarter[2] + star_polygon(generator, 5, 1.0)
    outline = 17 * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    plate, stands = prism([outline, *windows], -1, 1), prism([island, small], -1, 1)
    both = _mesh(
        np.concatenate([plate.vertices, stands.vertices]),
        np.concatenate([plate.faces, stands.faces + len(plate.vertices)]),
    )
    height = generator.uniform(8, 15)
    return Parts([_tilted(both, generator, height, 0.4)], _flat(0.6 * SQUARE), _above())


def _gulfs_within_gulfs(generator) -> Parts:
    shape = hooked_comb(generator, 2) if generator.random() < 0.5 else None
    if shape is None:
        shape = tangled_polygon(generator, int(generator.integers(8, 13)), 14.0)
    body = prism([shape], -0.5, 0.5)
    target = _flat(0.3 * convex_polygon(generator, 5.0))
    return Parts([_tilted(body, generator, generator.uniform(8, 14), 0.5)], target, _above())


def _touching(generator) -> Parts:
    """Boxes on a lattice: they share faces, edges and corners, and lie in the same planes."""
    bodies = [_box((-5, -5, -5), (5, 5, 0))]
    while len(bodies) < 7:
        low = generator.integers([-3, -3, 0], [3, 3, 5])
        high = low + generator.integers(1, 4, 3)
        over_target = (low[:2] < 1).all() and (high[:2] > -1).all()
        if not (low[2] == 0 and over_target):
            bodies.append(_box(5.0 * low, 5.0 * high))
    if generator.random() < 0.5:
        bodies = [bodies[0], _united(bodies[1:4]), *bodies[4:]]
    return Parts(bodies, _flat(SQUARE), _above(), turn=False)


def _leaning_walls(generator) -> Parts:
    """Walls that stand on edges of the target, in one body with it or not, leaning in or out."""
    target = SQUARE if generator.random() < 0.5 else convex_polygon(generator, 5.0)
    bodies = [prism([target], -5.0, 0.0)]
    for k in generator.permutation(len(target))[: generator.integers(1, 4)]:
        start, stop = target[k], target[(k + 1) % len(target)]
        height, thickness = generator.uniform(3, 15), generator.uniform(0.5, 2)
        lean = generator.choice([-1, 0, 1]) * generator.uniform(0, 0.7)
        profile = np.array([[0, -5], [1, -5], [1, 0], [1, 1], [0, 1], [0, 0]])
        along = (stop - start) / np.linalg.norm(stop - start)
        outward = np.array([along[1], -along[0]])
        wall = prism([profile], 0.0, 1.0)
        # From (profile x, profile y, 0 to 1 along the edge) to where it stands.
        x, y, share = wall.vertices.T
        z = np.where(y > 0, height, y)
        out = thickness * x + lean * np.maximum(z, 0.0)
        plan = start + share[:, None] * (stop - start) + out[:, None] * outward
        faces = np.fliplr(wall.faces)
        placed = _mesh(np.column_stack([plan, z]), faces)
        bodies.append(placed if placed.volume > 0 else _mesh(placed.vertices, wall.faces))
    if generator.random() < 0.5:
        bodies = [_united(bodies)]
    return Parts(bodies, _flat(target), _above())


def _pocket_floor(generator) -> Parts:
    """The target is the floor of a pocket whose walls lean in or out."""
    target = SQUARE if generator.random() < 0.5 else convex_polygon(generator, 5.0)
    height, growth = generator.uniform(4, 20), generator.uniform(0.7, 1.6)
    middle = target.mean(axis=0)
    top = middle + growth * (target - middle)
    ends = [_flat(target), np.column_stack([top, np.full(len(top), height)])]
    block = _box((-15, -15, -5), (15, 15, 0.9 * height))
    bodies = (block, _hull(np.concatenate(ends)))
    whole, pocket = (to_manifold("body", m.vertices, m.faces) for m in bodies)
    return Parts([_mesh(*from_manifold(whole - pocket))], _flat(target), _above())


def _fillet(generator) -> Parts:
    """The lowest facet of a fillet between target and wall is 1e-6 mm high."""
    radius = generator.uniform(0.5, 2)
    angles = np.linspace(0, np.pi / 2, 5)[1:]
    arc = np.stack([5 + radius * np.sin(angles), radius * (1 - np.cos(angles))], axis=-1)
    first = [[5.0, 0.0], [5 + 0.2 * radius, 1e-6]]
    wall = [[5 + radius, 12.0], [9, 12.0], [9, -5]]
    profile = np.array([[-5, -5], [-5, 0.0], *first, *arc, *wall])
    body = prism([profile[::-1]], 0.0, 1.0)
    x, z, share = body.vertices.T
    placed = _mesh(np.column_stack([x, 16 * (0.5 - share), z]), body.faces)
    extra = _hull(generator.uniform([-12, -12, 8], [4, 12, 20], (5, 3)))
    return Parts([placed, extra], _flat(SQUARE), _above(), turn=False)


def _u_shaped_target(generator) -> Parts:
    """A post stands in the notch of the U, touching one edge or two; bodies float above."""
    outline = np.array([[-6.0, -5], [6, -5], [6, 5], [2, 5], [2, -1], [-2, -1], [-2, 5], [-6, 5]])
    right, low = generator.uniform(-1.5, 0), generator.choice([-1.0, 0.0])
    corners = [(-2, low), (right, low), (right, 4), (-2, 4)]
    post = prism([corners], -5.0, generator.uniform(0.5, 8))
    block = prism([outline], -5.0, 0.0)
    cloud = _hull(generator.uniform([-12, -12, 10], [12, 12, 25], (6, 3)))
    star = _tilted(prism([star_polygon(generator, 6, 8.0)], -1, 1), generator, 18, 0.5)
    return Parts([block, post, cloud, star], _flat(outline), _above())


def _segment_target(generator) -> Parts:
    """A segment along an edge of a body, in its inner corner, or free; cameras are all around."""
    step = _united([_box((-8, 0, -8), (8, 8, 8)), _box((-8, 8, -8), (8, 16, 20))])
    ends = [
        np.array([[-8.0, 0, 8], [8, 0, 8]]),
        np.array([[-5.0, 8, 8], [6, 8, 8]]),
        generator.uniform([-8, -20, 10], [8, -10, 20], (2, 3)),
    ][generator.integers(3)]
    cloud = _hull(generator.uniform([-20, -30, 25], [20, 0, 40], (6, 3)))
    star = _tilted(prism([star_polygon(generator, 6, 9.0)], -1, 1), generator, -25, 0.7)
    return Parts([step, cloud, star], ends, box_workspace(*_ALL_AROUND))


def _slivers(generator) -> Parts:
    """Needles, and plates of 1e-5 mm."""
    bodies = []
    for _ in range(3):
        centre = generator.uniform([-15, -15, 8], [15, 15, 25])
        thin = [10.0 ** generator.uniform(-4, -3), 10.0 ** generator.uniform(-4, 1)]
        points = generator.uniform(-1, 1, (5, 3)) * [8, *thin]
        bodies.append(_hull(points @ Rotation.random(random_state=generator).as_matrix() + centre))
    plate = prism([star_polygon(generator, 6, 10.0)], 0.0, 1e-5)
    bodies.append(_tilted(plate, generator, 15, 0.4))
    return Parts(bodies, _flat(convex_polygon(generator, 5.0)), _above(), turn=False)


def _far_workspace(generator) -> Parts:
    """The workspace does not reach down to the target, or is askew, or lies partly behind it."""
    kinds = (_concave, _leaning_walls, _pocket_floor, _holes_with_islands)
    parts = kinds[generator.integers(len(kinds))](generator)
    low = generator.uniform([-40, -40, -10], [-5, -5, 50])
    box = box_workspace(low, low + generator.uniform(30, 60, 3))
    turn = Rotation.from_rotvec(generator.uniform(-0.5, 0.5, 3)).as_matrix()
    askew = Solid(box.vertices_mm @ turn.T, box.faces)
    return Parts(parts.meshes, parts.target, askew)


KINDS: Final[dict[str, Callable[[np.random.Generator], Parts]]] = {
    "concave": _concave,
    "convex": _convex,
    "far workspace": _far_workspace,
    "fillet": _fillet,
    "gulfs within gulfs": _gulfs_within_gulfs,
    "holes with islands": _holes_with_islands,
    "leaning walls": _leaning_walls,
    "pocket floor": _pocket_floor,
    "segment": _segment_target,
    "slivers": _slivers,
    "touching": _touching,
    "u-shaped target": _u_shaped_target,
}
