"""The direct method: shadows that are exact, and pieces that are left out rightly."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from planning.scene import Scene
from planning.solid import box_workspace
from planning.target import Target
from planning.visibility import direct, occluding, shadows
from planning.visibility.convex import ConvexPiece, ConvexPieces
from planning.visibility.frame import TargetFrame
from planning.visibility.methods import visibility_region
from planning.visibility.occluding import occluding_pieces
from planning.visibility.perspective import Perspective
from planning.visibility.reach import Girth, Reach

SQUARE = np.array([[-0.05, -0.05, 0], [0.05, -0.05, 0], [0.05, 0.05, 0], [-0.05, 0.05, 0]])
SEGMENT = np.array([[-0.05, 0, 0], [0.05, 0, 0]])


def loose_triangles(count: int, size: float, seed: int) -> trimesh.Trimesh:
    """Random triangles in a slab above the target, in mm."""
    generator = np.random.default_rng(seed)
    corners = generator.uniform([-30, -30, 5], [30, 30, 30], (count, 3))[:, None]
    corners = corners + size * generator.normal(size=(count, 3, 3))
    faces = np.arange(3 * count).reshape(-1, 3)
    return trimesh.Trimesh(corners.reshape(-1, 3), faces, process=False)


def random_pieces(generator: np.random.Generator, is_segment: bool) -> ConvexPieces:
    """Three triangles, a pentagon and a solid, well above z = 0 or around."""
    low = [-0.4, -0.4, -0.4 if is_segment else 0.1]
    middles = generator.uniform(low, [0.4, 0.4, 0.6], (5, 1, 3))
    middles[:, :, 1] += 0.2 * is_segment
    corners = middles + 0.03 * generator.normal(size=(5, 8, 3))
    angle = np.arange(5) * 2 * np.pi / 5
    pentagon = corners[3, 0] + np.cos(angle)[:, None] * [0.05, 0.02, 0.01]
    pentagon += np.sin(angle)[:, None] * [0, 0.03, -0.02]
    hull = ConvexPiece.hull(corners[4])
    mesh = trimesh.Trimesh(hull.vertices).convex_hull
    return ConvexPieces.gathered(
        [corners[:3, :3], pentagon[None]], [(np.array(mesh.vertices), np.array(mesh.faces))]
    )


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.booleans())
def test_hull_and_limiting_planes_bound_the_same_shadow(seed: int, is_segment: bool) -> None:
    """Within the extent; two constructions that share nothing."""
    pieces = random_pieces(np.random.default_rng(seed), is_segment)
    target = SEGMENT if is_segment else SQUARE
    extent = manifold3d.Manifold.cube([2, 2, 2], center=True)
    if not is_segment:
        extent = extent.trim_by_plane([0, 0, 1], 0)
    made = shadows.Shadows(pieces, target, 1e-12, Perspective(None))
    for index in range(len(pieces)):
        by_hull, by_planes = made._hull(index), made._between_planes(index, 0.0)
        if by_hull is None:
            continue
        common = extent ^ by_hull
        assert common.volume() == pytest.approx((extent ^ by_planes).volume(), abs=1e-11)
        assert common.volume() > 1e-6


def test_hull_that_leaves_out_a_corner_is_noticed() -> None:
    """manifold3d does so where the corner sticks out by less than 1e-7."""
    flat = np.array(
        [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0.5, 0.5, -1], [0.3, 0.4, 2e-8]]
    )
    quick = manifold3d.Manifold.hull_points(flat)
    assert not shadows._holds(quick, flat)
    careful = shadows._careful_hull(flat)
    assert shadows._holds(careful, flat)
    assert careful.status() == manifold3d.Error.NoError
    assert careful.volume() - 1 / 3 == pytest.approx(2e-8 / 3, rel=1e-6)
    assert not shadows._holds(manifold3d.Manifold(), flat)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.booleans(), st.sampled_from([64, 128]))
def test_triangles_said_to_be_outside_are(seed: int, half: bool, cells: int) -> None:
    """Points all over each of them are outside of a solid that is star-shaped about the origin."""
    generator = np.random.default_rng(seed)
    solid = manifold3d.Manifold.cube([2, 2, 2], center=True)
    if half:
        solid = solid.trim_by_plane([0, 0, 1], 0)
    planes = []
    for _ in range(8):
        normal = generator.normal(size=3)
        normal /= np.linalg.norm(normal)
        planes.append((normal, generator.uniform(0.02, 0.9)))
        solid = solid.trim_by_plane(-normal, -planes[-1][1])
    triangles = generator.uniform(-1, 1, (400, 1, 3)) + generator.choice(
        [0.02, 0.3]
    ) * generator.normal(size=(400, 3, 3))
    surface = Perspective(None).triangles(solid)
    entered = Reach.of(surface, cells).entered_by(triangles)
    missed = Girth.of(surface).misses(triangles.min(axis=1), triangles.max(axis=1))
    share = generator.dirichlet(np.ones(3), (400, 50))
    points = np.einsum("nsk,nki->nsi", share, triangles)
    inside = (np.abs(points) < 1).all(axis=-1) & ((points[..., 2] > 0) | (not half))
    for normal, offset in planes:
        inside &= points @ normal < offset
    assert not (inside.any(axis=1) & (missed | ~entered)).any()
    # The bounds are of use: most of what is outside is told to be.
    assert (entered & ~inside.any(axis=1)).mean() < 0.25


def test_what_lies_beside_the_lower_part_of_a_solid_misses_it() -> None:
    """A cone that opens upwards: boxes at the same distance from its axis, at several heights."""
    cone = manifold3d.Manifold.cylinder(1.0, 0.01, 0.51, circular_segments=64)
    girth = Girth.of(Perspective(None).triangles(cone))
    low = np.array([[0.3, -0.05, 0.1], [0.3, -0.05, 0.5], [0.3, -0.05, 0.9], [-0.1, -0.1, -0.2]])
    high = low + np.array([0.1, 0.1, 0.1])
    np.testing.assert_array_equal(girth.misses(low, high), [True, False, False, False])
    farther = np.array([0.3, 0, 0])
    assert girth.misses(low + farther, high + farther)[:3].all()


def test_triangle_through_the_origin_sticks_in() -> None:
    solid = manifold3d.Manifold.cube([2, 2, 2], center=True)
    around = np.array([[[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]], [[3, 0, 0], [3, 1, 0], [3, 0, 1]]])
    np.testing.assert_array_equal(
        Reach.of(Perspective(None).triangles(solid), 128).entered_by(around), [True, False]
    )


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10**6))
def test_perspective_keeps_planes_and_comes_back(seed: int) -> None:
    generator = np.random.default_rng(seed)
    perspective = Perspective.of(SQUARE)
    weights = generator.dirichlet(np.ones(3), 6)
    in_plane = weights @ generator.uniform([-1, -1, 0], [1, 1, 1], (3, 3))
    image = perspective.forward(in_plane)
    np.testing.assert_allclose(perspective.back(image), in_plane, atol=1e-14)
    spread = np.linalg.svd(image - image.mean(axis=0), compute_uv=False)
    assert spread[2] <= 1e-14
    assert (np.abs(image) <= 1).all()


def test_perspective_measures_what_the_image_stands_for() -> None:
    cube = manifold3d.Manifold.cube([1, 1, 1])
    perspective = Perspective.of(SQUARE)
    image = perspective.image(cube)
    assert image.volume() == pytest.approx(1 / 3, rel=1e-4)
    assert perspective.volume(image) == pytest.approx(1, abs=1e-13)
    assert perspective.original(image).volume() == pytest.approx(1, abs=1e-13)
    assert Perspective.of(SEGMENT).behind is None


@pytest.mark.parametrize("seed", range(3))
def test_leaving_pieces_out_changes_nothing(bench, monkeypatch, seed: int) -> None:
    """Most pieces are left out, and the region is the same."""
    scene = Scene([loose_triangles(400, 3.0, seed)], as_faces=True)
    asked = []
    cutter = shadows.Shadows.cutter

    def counting(self, index):
        asked.append(index)
        return cutter(self, index)

    monkeypatch.setattr(shadows.Shadows, "cutter", counting)
    culled = visibility_region(scene, bench.target, bench.workspace, audit_points=1000)
    assert len(asked) < 300
    assert culled.audit.disagreements == 0
    asked.clear()
    monkeypatch.setattr(direct, "_WORTH_ASKING", 10**9)
    whole = visibility_region(scene, bench.target, bench.workspace, audit_points=0)
    assert len(asked) == 400
    assert whole.volume_mm3 == pytest.approx(culled.volume_mm3, abs=1e-9 * bench.volume)


@pytest.mark.parametrize("closed", [True, False])
def test_faces_dropped_at_once_are_those_that_would_be_dropped_anyway(
    bench, monkeypatch, closed: bool
) -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=20.0)
    dented = trimesh.boolean.difference([ball, bench.box((5, 5, 5), (30, 30, 30))])
    dented.apply_translation([3.0, 2.0, 15.0])
    corners = [[0, 0, 40], [9, 1, 40], [9.0, 1 + 1e-5, 40]]
    sliver = trimesh.Trimesh(corners, [[0, 1, 2]], process=False)
    scene = Scene([dented]) if closed else Scene([dented, sliver], as_faces=True)
    frame = TargetFrame.around(bench.target, bench.workspace)
    kept = occluding_pieces(scene, bench.target, frame)
    monkeypatch.setattr(occluding, "_may_hide", lambda faces, *_: np.arange(len(faces.corners)))
    every = occluding_pieces(scene, bench.target, frame)
    for name in ("corners", "starts", "flat", "triangles", "owners"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(every, name))


def test_open_faces_hide_from_both_sides(bench) -> None:
    """A square at half height: seen from the target, its front or its back."""
    corners = bench.square + np.array([0, 0, 50])
    volumes = []
    for faces in ([[0, 1, 2], [0, 2, 3]], [[2, 1, 0], [3, 2, 0]]):
        scene = Scene([trimesh.Trimesh(corners, faces, process=False)], as_faces=True)
        region = visibility_region(scene, bench.target, bench.workspace, audit_points=500)
        assert region.audit.disagreements == 0
        volumes.append(region.volume_mm3)
    # At height z the shadow is a square of side 10 z/50 + 10 (z − 50)/50 = 0.4 z − 10.
    hidden = (30.0**3 - 10.0**3) / (3 * 0.4)
    np.testing.assert_allclose(volumes, bench.volume - hidden, rtol=1e-12)


def test_slit(bench) -> None:
    """2 wide at height 10 over a target of 10: what is seen through it narrows by 0.8 z."""
    plates = [bench.box((-300, -300, 10), (-1, 300, 11)), bench.box((1, -300, 10), (300, 300, 11))]
    workspace = box_workspace((-50, -50, 11), (50, 50, 20))
    region = visibility_region(bench.scene(*plates), bench.target, workspace)
    # It is shut at 12.5, and 100 long.
    assert region.volume_mm3 == pytest.approx(90, abs=1e-9 * workspace.volume_mm3)
    assert region.audit.disagreements == 0


@pytest.mark.parametrize("height", [1e-3, 1e-6])
def test_low_fillet_on_the_edge_of_the_target(bench, height: float) -> None:
    """Facets of a quarter circle that rises from the target's edge hide as their steepest does."""
    turn = np.linspace(0, np.pi / 2, 5)
    profile = np.column_stack([5 + height * np.sin(turn), height * (1 - np.cos(turn))])
    outline = np.concatenate([[[-5, -5], [6, -5], [6, height]], profile[::-1], [[-5, 0]]])
    section = manifold3d.CrossSection([outline])
    solid = manifold3d.Manifold.extrude(section, 10)
    mesh = solid.to_mesh64()
    x, y, z = np.asarray(mesh.vert_properties)[:, :3].T
    body = trimesh.Trimesh(np.column_stack([z - 5, x, y]), np.asarray(mesh.tri_verts).astype(int))
    region = visibility_region(bench.scene(body), bench.target, bench.workspace, audit_points=2000)
    assert region.audit.disagreements == 0
    # The last facet ends at (5 + h, h); a line from the edge (5, 0) past it leaves at 45 degrees.
    steep = visibility_region(
        bench.scene(bench.block, bench.box((-5, 5 + height, -5), (5, 6, height))),
        bench.target,
        bench.workspace,
        audit_points=0,
    )
    assert region.volume_mm3 == pytest.approx(steep.volume_mm3, abs=3 * height * 1e4)


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 1000))
def test_order_and_splitting_of_faces_change_nothing(seed: int) -> None:
    generator = np.random.default_rng(seed)
    mesh = trimesh.creation.torus(14, 3, major_sections=8, minor_sections=6)
    mesh.apply_transform(trimesh.transformations.random_rotation_matrix(generator.random(3)))
    mesh.apply_translation([0, 5, 24])
    shuffled = generator.permutation(len(mesh.faces))
    turned = np.roll(mesh.faces[shuffled], 1, axis=1)
    split = trimesh.remesh.subdivide(mesh.vertices, mesh.faces)
    target, space = Target(100 * SQUARE), box_workspace((-50, -50, 0), (50, 50, 100))
    volumes = [
        visibility_region(
            Scene([trimesh.Trimesh(vertices, faces, process=False)]), target, space, audit_points=0
        ).volume_mm3
        for vertices, faces in ((mesh.vertices, mesh.faces), (mesh.vertices, turned), split[:2])
    ]
    np.testing.assert_allclose(volumes, volumes[0], atol=1e-9 * space.volume_mm3)


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 1000))
def test_the_order_of_bodies_changes_nothing(seed: int) -> None:
    """Touching and overlapping boxes, a ring and bare faces, in any order."""
    generator = np.random.default_rng(seed)
    corners = generator.uniform((-20, -20, 4), (15, 15, 25), (6, 3))
    boxes = [trimesh.creation.box(bounds=[c, c + generator.uniform(1, 6, 3)]) for c in corners]
    beside = boxes[0].copy().apply_translation([boxes[0].extents[0], 0, 0])
    ring = trimesh.creation.torus(14, 3, major_sections=8, minor_sections=6)
    ring.apply_translation([0, 5, 24])
    sheet = trimesh.Trimesh([[-9, 0, 9], [9, 1, 9], [0, 9, 11]], [[0, 1, 2]], process=False)
    meshes = [*boxes, beside, ring, sheet]
    target, space = Target(100 * SQUARE), box_workspace((-50, -50, 0), (50, 50, 100))
    volumes = [
        visibility_region(
            Scene([meshes[k] for k in order], as_faces=True), target, space, method, 0
        ).volume_mm3
        for method in ("direct", "decomposition")
        for order in (range(len(meshes)), generator.permutation(len(meshes)))
    ]
    np.testing.assert_allclose(volumes, volumes[0], atol=1e-9 * space.volume_mm3)


def test_pieces_are_nearest_first_and_only_what_can_hide(bench) -> None:
    """A wall is cut at the plane of the target; the block below and faces that face away drop."""
    wall = bench.box((-5, 5, -5), (5, 6, 10))
    body = trimesh.boolean.union([bench.block, wall])
    far = bench.box((-20, -20, 60), (20, 20, 61))
    frame = TargetFrame.around(bench.target, bench.workspace)
    pieces = occluding_pieces(bench.scene(far, body), bench.target, frame)
    assert len(pieces) == 2
    np.testing.assert_array_equal(pieces.flat, [True, False])
    corners = pieces.corners_of(0) * frame.scale_mm
    np.testing.assert_allclose(corners[:, 1] if abs(corners[0, 1]) > 4 else corners[:, 0], 5)
    assert pieces.piece(1).normals.shape[0] == 12
    none = occluding_pieces(bench.scene(bench.block), bench.target, frame)
    assert len(none) == 0
