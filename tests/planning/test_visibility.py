"""Visibility regions: closed forms, laws, and agreement with the exact test."""

from __future__ import annotations

import dataclasses

import manifold3d
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lenscal.errors import GeometryError, InputError
from planning import boolean
from planning.enclosure import example_part
from planning.scene import Scene
from planning.solid import Solid, box_workspace
from planning.target import Target
from planning.visibility.audit import random_viewpoints, sees_whole_target
from planning.visibility.methods import visibility_region


def tetrahedra(count: int, size: float, seed: int) -> list[trimesh.Trimesh]:
    """Random tetrahedra in a slab above the target."""
    generator = np.random.default_rng(seed)
    meshes = []
    for _ in range(count):
        corners = generator.uniform([-25, -25, 4], [25, 25, 30]) + size * generator.normal(
            size=(4, 3)
        )
        faces = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]
        volume = np.linalg.det(corners[1:] - corners[0])
        meshes.append(
            trimesh.Trimesh(corners, faces if volume < 0 else np.fliplr(faces), process=False)
        )
    return meshes


def plate(bench, low, high, *holes) -> trimesh.Trimesh:
    """A plate with rectangular holes through it."""
    cutters = [bench.box((a, b, low[2] - 1), (c, d, high[2] + 1)) for a, b, c, d in holes]
    if not cutters:
        return bench.box(low, high)
    return trimesh.boolean.difference([bench.box(low, high), *cutters])


@pytest.mark.parametrize("height", [10.0, 1.0, 1e-3, 1e-6])
def test_wall_on_the_edge_of_the_target(bench, height: float) -> None:
    """Whatever its height, it hides all that lies behind it: 0.55 of the box remains."""
    wall = bench.box((-5, 5, -5), (5, 6, height))
    region = visibility_region(bench.scene(bench.block, wall), bench.target, bench.workspace)
    assert region.volume_mm3 / bench.volume == pytest.approx(0.55, abs=1e-9)
    assert region.audit.disagreements == 0
    assert region.audit.viewpoints == 10_000


def test_wall_and_block_in_one_concave_body(bench) -> None:
    """The same from faces instead of convex bodies."""
    wall = bench.box((-5, 5, -5), (5, 6, 10))
    body = trimesh.boolean.union([bench.block, wall])
    region = visibility_region(bench.scene(body), bench.target, bench.workspace)
    assert region.volume_mm3 / bench.volume == pytest.approx(0.55, abs=1e-9)
    assert region.audit.disagreements == 0


@pytest.mark.parametrize("side", [14.0, 8.0])
def test_square_aperture_over_a_square_target(bench, side: float) -> None:
    """At height z the region is a square of side a + (b − a) z/h, for the rim at h that binds."""
    low, high, top = 10.0, 11.0, 30.0
    half = side / 2
    cover = plate(bench, (-60, -60, low), (60, 60, high), (-half, -half, half, half))
    workspace = box_workspace((-50, -50, high), (50, 50, top))
    region = visibility_region(bench.scene(cover), bench.target, workspace)
    rim = high if side > 10 else low
    slope = (side - 10.0) / rim

    def integral(z: float) -> float:
        return (10.0 + slope * z) ** 3 / (3 * slope)

    wanted = integral(top) - integral(high)
    # A hole that is smaller than the target shuts where the square has shrunk to nothing.
    assert 10.0 + slope * top > 0
    assert region.volume_mm3 == pytest.approx(wanted, abs=1e-9 * workspace.volume_mm3)
    assert region.audit.disagreements == 0


def test_half_plane(bench) -> None:
    """An edge at x = c, height h: x < a/2 + (c − a/2) z/h sees past it."""
    cover = plate(bench, (2, -300, 10), (300, 300, 10.5))
    workspace = box_workspace((-50, -50, 20), (50, 50, 60))
    region = visibility_region(bench.scene(cover), bench.target, workspace)
    # (c − a/2) < 0: the lower rim binds; the region's width is 50 + 5 − 3 z/10.
    wanted = 100 * (55 * 40 - 0.3 * (60**2 - 20**2) / 2)
    assert region.volume_mm3 == pytest.approx(wanted, abs=1e-9 * workspace.volume_mm3)


def test_nothing_in_the_way_leaves_the_half_space_in_front(bench) -> None:
    workspace = box_workspace((-50, -50, -30), (50, 50, 70))
    region = visibility_region(bench.scene(bench.block), bench.target, workspace)
    assert region.volume_mm3 == pytest.approx(0.7e6, rel=1e-12)
    np.testing.assert_allclose(region.distance_to_boundary([[0, 0, 10], [0, 0, -10]]), [10, -10])
    assert region.to_mesh().is_watertight


def test_segment_on_an_edge_of_a_cube_is_hidden_by_the_cube_only(bench) -> None:
    """It has no front: all but the wedge of the cube sees it, 1 − 0.5 · 0.6."""
    cube = bench.box((-10, 0, -10), (10, 10, 10))
    workspace = box_workspace((-50, -50, -50), (50, 50, 50))
    edge = Target.segment((-10, 0, 10), (10, 0, 10))
    region = visibility_region(bench.scene(cube), edge, workspace)
    assert region.volume_mm3 / bench.volume == pytest.approx(0.7, abs=1e-9)
    assert region.audit.disagreements == 0


def test_segment_in_the_inner_corner_of_a_concave_body(bench) -> None:
    body = trimesh.boolean.union(
        [bench.box((-10, 0, -10), (10, 10, 10)), bench.box((-10, 10, -10), (10, 20, 30))]
    )
    workspace = box_workspace((-50, -50, -50), (50, 50, 50))
    region = visibility_region(
        bench.scene(body), Target.segment((-10, 10, 10), (10, 10, 10)), workspace
    )
    assert region.volume_mm3 / bench.volume == pytest.approx(0.6 * 0.4, abs=1e-9)
    assert region.audit.disagreements == 0


@pytest.mark.parametrize("lean", [-25.0, 0.0, 25.0])
def test_leaning_wall_in_single_precision(bench, lean: float) -> None:
    """A wall that shares an edge with the target survives the rounding of a binary STL."""
    shift = 10 * np.tan(np.radians(lean))
    profile = np.array(
        [[-5, -5], [6, -5], [6, 0], [6 + shift, 10], [5 + shift, 10], [5, 0], [-5, 0]]
    )
    body = trimesh.Trimesh(*_extruded(profile, -5, 5), process=False)
    turn = Rotation.from_rotvec([0.3, -0.5, 0.9]).as_matrix()
    vertices = (body.vertices @ turn.T).astype(np.float32).astype(np.float64)
    scene = Scene([trimesh.Trimesh(vertices, body.faces, process=False)])
    target = Target.from_face(scene, near=turn @ [0, 0, 0.1])
    assert target.area_mm2 == pytest.approx(100, rel=1e-6)
    exact = visibility_region(Scene([body]), bench.target, bench.workspace, audit_points=2000)
    moved = Solid(bench.workspace.vertices_mm @ turn.T, bench.workspace.faces)
    rounded = visibility_region(scene, target, moved, audit_points=2000)
    assert rounded.volume_mm3 == pytest.approx(exact.volume_mm3, rel=1e-4)
    assert exact.audit.disagreements == 0


def _extruded(profile, low: float, high: float):
    """Prism along x over a (y, z) profile."""
    section = manifold3d.CrossSection([profile])
    vertices, faces = boolean.from_manifold(manifold3d.Manifold.extrude(section, high - low))
    # The profile lies in x, y of the extrusion; it becomes y, z.
    return np.column_stack([vertices[:, 2] + low, vertices[:, 0], vertices[:, 1]]), faces


@pytest.mark.parametrize("seed", range(4))
def test_contains_agrees_with_the_exact_test(bench, seed: int) -> None:
    """Closed convex bodies, a torus, and a concave target."""
    torus = trimesh.creation.torus(14, 3, major_sections=12, minor_sections=8)
    torus.apply_transform(trimesh.transformations.rotation_matrix(seed, [1, 2, 0], [0, 0, 0]))
    torus.apply_translation([3 * seed, 0, 22])
    outline = [
        [-5, -5, 0],
        [5, -5, 0],
        [5, 5, 0],
        [2, 5, 0],
        [2, -2, 0],
        [-2, -2, 0],
        [-2, 5, 0],
        [-5, 5, 0],
    ]
    target = Target(np.array(outline, float)) if seed % 2 else bench.target
    scene = Scene([*tetrahedra(6, 3.0, seed), torus])
    region = visibility_region(scene, target, bench.workspace, audit_points=3000, seed=seed)
    assert region.audit.disagreements == 0
    assert 0 < region.audit.visible < 3000
    assert region.audit.imbalance < 1e-12
    points = np.random.default_rng(seed).uniform([-50, -50, 0], [50, 50, 100], (500, 3))
    np.testing.assert_array_equal(region.contains(points), sees_whole_target(points, target, scene))


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 1000), st.floats(-3, 6))
def test_volume_survives_rigid_motion_and_scale(seed: int, decade: float) -> None:
    """From 1e-3 to 1e6 mm, anywhere, in any direction."""
    generator = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed).as_matrix()
    shift, scale = generator.normal(size=3) * 100, 10**decade / 100
    square = np.array([[-5.0, -5, 0], [5, -5, 0], [5, 5, 0], [-5, 5, 0]])
    space = box_workspace((-50, -50, 0), (50, 50, 100))
    meshes = tetrahedra(5, 4.0, seed)

    def moved(points):
        return (points @ turn.T + shift) * scale

    first = visibility_region(Scene(meshes), Target(square), space, audit_points=0)
    second = visibility_region(
        Scene([trimesh.Trimesh(moved(m.vertices), m.faces, process=False) for m in meshes]),
        Target(moved(square)),
        Solid(moved(space.vertices_mm), space.faces),
        audit_points=0,
    )
    difference = abs(second.volume_mm3 / scale**3 - first.volume_mm3)
    assert difference <= 1e-9 * space.volume_mm3


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 1000))
def test_more_occluders_never_more_region(seed: int) -> None:
    square = np.array([[-5.0, -5, 0], [5, -5, 0], [5, 5, 0], [-5, 5, 0]])
    space = box_workspace((-50, -50, 0), (50, 50, 100))
    meshes = tetrahedra(6, 4.0, seed)
    few = visibility_region(Scene(meshes[:3]), Target(square), space, audit_points=0)
    many = visibility_region(Scene(meshes), Target(square), space, audit_points=0)
    assert many.volume_mm3 <= few.volume_mm3 + 1e-9 * space.volume_mm3
    shared = few.intersect(many)
    assert shared.volume_mm3 == pytest.approx(many.volume_mm3, abs=1e-9 * space.volume_mm3)


def test_splitting_a_body_changes_nothing(bench) -> None:
    whole = bench.box((-8, 4, 12), (8, 9, 15))
    halves = [bench.box((-8, 4, 12), (1, 9, 15)), bench.box((1, 4, 12), (8, 9, 15))]
    one = visibility_region(bench.scene(whole), bench.target, bench.workspace, audit_points=0)
    two = visibility_region(
        bench.scene(*halves[::-1]), bench.target, bench.workspace, audit_points=0
    )
    assert one.volume_mm3 == pytest.approx(two.volume_mm3, abs=1e-9 * bench.volume)


def test_intersection_sees_both_targets(bench) -> None:
    wall = bench.box((-1, -20, 5), (1, 20, 15))
    scene = bench.scene(wall)
    left, right = (Target(bench.square + np.array([x, 0, 0])) for x in (-15, 15))
    regions = [
        visibility_region(scene, t, bench.workspace, audit_points=500) for t in (left, right)
    ]
    both = regions[0].intersect(regions[1])
    points = np.random.default_rng(0).uniform([-50, -50, 0], [50, 50, 100], (500, 3))
    np.testing.assert_array_equal(
        both.contains(points), regions[0].contains(points) & regions[1].contains(points)
    )
    assert both.audit.viewpoints == 1000


def test_example_part_has_two_envelopes() -> None:
    example = example_part()
    region = visibility_region(example.scene, example.target, example.workspace)
    envelopes = region.to_mesh().split()
    assert len(envelopes) == 2
    assert region.audit.disagreements == 0
    small, large = sorted(envelopes, key=lambda m: m.volume)
    assert small.bounds[1, 1] < 0 < large.bounds[0, 1]
    assert np.linalg.norm(np.concatenate(example.scene.triangles_mm), axis=-1).max() < 62


def test_hidden_target_is_an_empty_region_with_the_reason(bench) -> None:
    lid = bench.box((-60, -60, 5), (60, 60, 6))
    above = box_workspace((-50, -50, 7), (50, 50, 100))
    region = visibility_region(bench.scene(lid), bench.target, above, audit_points=200)
    assert region.is_empty
    assert region.why_empty.startswith("every viewpoint in the workspace has material between")
    assert region.audit.visible == 0
    assert np.isneginf(region.distance_to_boundary([0, 0, 10]))
    assert not region.contains([0, 0, 10])
    behind = box_workspace((-50, -50, -20), (50, 50, -10))
    region = visibility_region(bench.scene(lid), bench.target, behind, audit_points=200)
    assert region.why_empty == "the whole workspace lies behind the plane of the target"
    other = visibility_region(
        bench.scene(bench.block), bench.target, bench.workspace, audit_points=0
    )
    assert other.intersect(region).is_empty


def test_wall_on_the_middle_of_the_target_hides_it(bench) -> None:
    """Its foot covers part of the target."""
    wall = bench.box((-5, 1, 0), (5, 2, 10))
    region = visibility_region(bench.scene(bench.block, wall), bench.target, bench.workspace)
    assert region.is_empty
    assert region.audit.disagreements == 0


def test_covered_target_and_unknown_method_are_refused(bench) -> None:
    with pytest.raises(GeometryError, match="material lies on the target at .* counter-clockwise"):
        visibility_region(bench.scene(bench.block), Target(bench.square[::-1]), bench.workspace)
    with pytest.raises(InputError, match="unknown method 'magic' .* available are 'direct'"):
        visibility_region(bench.scene(bench.block), bench.target, bench.workspace, method="magic")


def test_books_that_do_not_balance_are_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A boolean operation that loses volume is repeated, and refused when that does not help."""
    cube = manifold3d.Manifold.cube([1, 1, 1])
    tried = []

    def cutter(inflation: float) -> manifold3d.Manifold:
        tried.append(inflation)
        return cube.translate([0.5, 0, 0])

    monkeypatch.setattr(boolean, "BALANCE_TOLERANCE", -1.0)
    with pytest.raises(GeometryError, match="fail to add up by .* simplify the part"):
        boolean.subtract(cube, [cutter])
    assert tried == [0, 1e-9, 1e-8, 1e-7]


def test_larger_cutters_repair_a_step(bench) -> None:
    """The first try loses volume, the second is right: one repair is counted."""
    box = boolean.to_manifold("box", bench.workspace.vertices_mm / 100, bench.workspace.faces)

    class Leaky:
        """Stands for a solid whose first subtraction goes wrong."""

        def __init__(self) -> None:
            self.tries = 0

        def volume(self) -> float:
            return float(box.volume())

        def is_empty(self) -> bool:
            return False

        def num_tri(self) -> int:
            return int(box.num_tri())

        def split(self, cutter):
            self.tries += 1
            removed, rest = box.split(cutter)
            return (removed, rest) if self.tries > 1 else (type(box)(), rest)

    cutter = box.scale([0.5, 0.5, 0.5])
    rest, imbalance, repairs = boolean.subtract(
        Leaky(), [lambda _: cutter], volume=lambda s: float(s.volume())
    )
    assert repairs == 1
    assert imbalance < 1e-12
    assert rest.volume() == pytest.approx(0.875)


def test_known_defect_of_the_library_is_caught_and_repaired(reference_data) -> None:
    """Two solids of which manifold3d loses 50 of 620,000 units of volume without saying so."""
    solids = []
    for name in "VU":
        data = np.load(reference_data / "manifold3d-defect" / f"manifold_defect_{name}.npz")
        mesh = manifold3d.Mesh64(data["v"], data["f"].astype(np.uint64))
        solids.append(manifold3d.Manifold(mesh))
    whole, cutter = solids
    wrong, imbalance, repairs = boolean.subtract(whole, [lambda _: cutter], guarded=False)
    assert imbalance == pytest.approx(50.226, abs=1e-3)
    assert repairs == 0
    right, imbalance, repairs = boolean.subtract(whole, [lambda _: cutter])
    assert repairs == 1
    assert imbalance <= 1e-9 * whole.volume()
    assert right.volume() == pytest.approx(wrong.volume() + 50.226, abs=1e-3)
    assert right.volume() == pytest.approx(whole.volume(), rel=1e-9)
    # An audit finds it too: random points where volume was lost, all of them in V and not in U.
    low, high = np.reshape((right - wrong).bounding_box(), (2, 3))
    points = np.random.default_rng(0).uniform(low, high, (1000, 3))
    members = {
        name: Solid(*boolean.from_manifold(solid)).contains(points)
        for name, solid in (("V", whole), ("U", cutter), ("wrong", wrong), ("right", right))
    }
    wanted = members["V"] & ~members["U"]
    assert (members["right"] == wanted).all()
    assert (members["wrong"] != wanted).any()


def test_the_audit_finds_the_defect_in_a_scene_and_the_guards_repair_it() -> None:
    """A ring of seven icospheres as bare faces, seen from all around a segment."""
    heights = 12 + 4 * np.random.default_rng(1).uniform(-1, 1, 7)
    ball = trimesh.creation.icosphere(subdivisions=2, radius=3.0)
    angles = 2 * np.pi * np.arange(7) / 7
    centres = np.stack([15 * np.cos(angles), 15 * np.sin(angles), heights], axis=-1)
    # One face is missing: a ball without it is no solid, and each face casts its own shadow.
    open_balls = [trimesh.Trimesh(ball.vertices + c, ball.faces[1:]) for c in centres]
    scene = Scene(open_balls, as_faces=True)
    target = Target.segment((-5, 0, 0), (5, 0, 0))
    workspace = box_workspace((-50, -50, 0), (50, 50, 100))
    wrong = visibility_region(scene, target, workspace, guarded=False)
    assert wrong.audit.disagreements > 0
    assert wrong.audit.imbalance == pytest.approx(1.15e-4, rel=0.01)
    assert wrong.audit.repairs == 0
    right = visibility_region(scene, target, workspace)
    assert right.audit.disagreements == 0
    assert right.audit.imbalance < 1e-12
    assert right.audit.repairs > 0
    assert right.volume_mm3 > wrong.volume_mm3 + 10


def test_slivers_are_dropped() -> None:
    cube = manifold3d.Manifold.cube([1, 1, 1])
    cut = manifold3d.Manifold.cube([1, 1, 1]).translate([0, 0, 1e-10])
    rest, _, _ = boolean.subtract(cube, [lambda _: cut])
    assert rest.is_empty()


def test_a_margin_gives_a_region_on_the_safe_side(bench) -> None:
    """Where a plate over a square is larger by half a millimetre, its shadow is in closed form."""
    lid = bench.box((20, -60, 10), (60, 60, 11))
    scene = bench.scene(bench.block, lid)
    exact = visibility_region(scene, bench.target, bench.workspace)
    safe = visibility_region(scene, bench.target, bench.workspace, margin_mm=0.5)
    larger = bench.scene(bench.block, bench.box((19.5, -60.5, 9.5), (60.5, 60.5, 11.5)))
    expected = visibility_region(larger, bench.target, bench.workspace).volume_mm3
    # The hull of cubes about the corners is that box: the target stands along its sides.
    assert safe.volume_mm3 == pytest.approx(expected, rel=1e-9)
    assert safe.volume_mm3 < exact.volume_mm3
    assert safe.audit.margin_mm == 0.5
    assert safe.audit.disagreements == 0
    points = random_viewpoints(bench.workspace, exact.solid, 2000, np.random.default_rng(1))
    assert not (safe.contains(points) & ~exact.contains(points)).any()


def test_a_region_that_is_too_large_fails_the_audit_of_a_margin(bench) -> None:
    """What the margin takes away is no disagreement; what is hidden and called visible is."""
    free = visibility_region(bench.scene(bench.block), bench.target, bench.workspace)
    points = random_viewpoints(bench.workspace, free.solid, 2000, np.random.default_rng(1))
    lid = bench.scene(bench.block, bench.box((0, -60, 10), (60, 60, 11)))
    claimed = dataclasses.replace(free.audit, viewpoints=0, margin_mm=0.5)
    sees = sees_whole_target(points, bench.target, lid)
    assert claimed.with_viewpoints(free, points, sees).disagreements == (~sees).sum() > 0
    blind = visibility_region(lid, bench.target, bench.workspace)
    assert claimed.with_viewpoints(blind, points, np.ones(len(points), bool)).disagreements == 0


def test_a_margin_that_closes_everything_says_so(bench) -> None:
    wall = bench.box((-5, 5, -5), (5, 6, 10))
    scene = bench.scene(bench.block, wall)
    region = visibility_region(scene, bench.target, bench.workspace, margin_mm=0.5)
    assert region.is_empty
    assert "larger by the margin of 0.5 mm hide the target" in region.why_empty
    with pytest.raises(InputError, match=r"margin_mm must be zero or positive, but is -1 mm"):
        visibility_region(scene, bench.target, bench.workspace, margin_mm=-1)
    with pytest.raises(InputError, match="only known to the method 'direct'"):
        visibility_region(
            scene, bench.target, bench.workspace, method="decomposition", margin_mm=0.5
        )


def test_progress_is_told_to_the_end(bench) -> None:
    told: list[tuple[int, int, str]] = []
    scene = bench.scene(bench.block, *tetrahedra(60, 2.0, 3))
    visibility_region(
        scene,
        bench.target,
        bench.workspace,
        audit_points=0,
        progress=lambda *what: told.append(what),
    )
    done, totals, _ = zip(*told, strict=True)
    assert list(done) == sorted(done)
    assert done[-1] == totals[-1] > 0
