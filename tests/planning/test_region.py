"""Regions: what they contain by their factors, their audit, and what they say when empty."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lenscal.errors import GeometryError
from planning.membership import winding_number
from planning.scene import Scene
from planning.solid import Solid, box_workspace
from planning.target import Target
from planning.visibility.audit import Audit, random_viewpoints, sees_whole_target
from planning.visibility.exact_test import ExactTest
from planning.visibility.methods import visibility_region
from planning.visibility.star import StarShaped

SQUARE = np.array([[-5.0, -5, 0], [5, -5, 0], [5, 5, 0], [-5, 5, 0]])
LETTER_U = np.array(
    [
        [-5.0, -5, 0],
        [5, -5, 0],
        [5, 5, 0],
        [2, 5, 0],
        [2, -2, 0],
        [-2, -2, 0],
        [-2, 5, 0],
        [-5, 5, 0],
    ]
)
SPACE = box_workspace((-50, -50, 0), (50, 50, 100))


def box(low, high) -> trimesh.Trimesh:
    """Box between two corners."""
    return trimesh.creation.box(bounds=[low, high])


def ball(seed: int, radius: float = 4.0) -> trimesh.Trimesh:
    """A ball of 80 faces somewhere above the target."""
    centre = np.random.default_rng(seed).uniform([-20, -20, 6], [20, 20, 30])
    ball = trimesh.creation.icosphere(subdivisions=1, radius=radius)
    ball.apply_translation(centre)
    return ball


def pocket() -> trimesh.Trimesh:
    """A block with a pocket whose floor is the target."""
    return trimesh.boolean.difference(
        [box((-12, -12, -4), (12, 12, 9)), box((-5, -5, 0), (5, 5, 20))]
    )


def reach() -> Solid:
    """A shell segment, such as what a robot reaches: neither convex nor a box."""
    outer = trimesh.creation.icosphere(subdivisions=2, radius=80)
    inner = trimesh.creation.icosphere(subdivisions=2, radius=45)
    shell = trimesh.boolean.difference([outer, inner, box((-90, -90, -90), (90, 90, -8))])
    return Solid(shell.vertices, shell.faces)


def torus() -> trimesh.Trimesh:
    """A ring that leans above the target."""
    ring = trimesh.creation.torus(14, 3, major_sections=12, minor_sections=8)
    ring.apply_transform(trimesh.transformations.rotation_matrix(0.5, [1, 2, 0], [0, 0, 0]))
    ring.apply_translation([3, 0, 22])
    return ring


#: Scene, target, workspace.
WORLDS = {
    "balls": lambda: (Scene([ball(k) for k in range(6)]), Target(SQUARE), SPACE),
    "ring and letter": lambda: (Scene([torus(), ball(3)]), Target(LETTER_U), SPACE),
    "pocket": lambda: (Scene([pocket(), ball(1)]), Target(SQUARE), SPACE),
    "low walls": lambda: (
        Scene(
            [
                box((-5, 5, -5), (5, 6, 1e-6)),
                box((-7, -5, -5), (-5, 5, 3)),
                box((-5, -5, -5), (5, 5, 0)),
            ]
        ),
        Target(SQUARE),
        SPACE,
    ),
    "segment": lambda: (
        Scene([box((-10, 0, -10), (10, 10, 10)), ball(2), ball(7)]),
        Target.segment((-10, 0, 10), (10, 0, 10)),
        box_workspace((-50, -50, -50), (50, 50, 50)),
    ),
    "reach of a robot": lambda: (Scene([torus(), pocket()]), Target(SQUARE), reach()),
    "workspace far above": lambda: (
        Scene([ball(k, 6.0) for k in range(4)]),
        Target(SQUARE),
        box_workspace((-200, -200, 300), (250, 200, 500)),
    ),
}  # fmt: skip


@pytest.fixture(scope="module", params=list(WORLDS))
def world(request):
    """Scene, target, workspace, and the region, audited sparsely."""
    scene, target, workspace = WORLDS[request.param]()
    region = visibility_region(scene, target, workspace, audit_points=100)
    return scene, target, workspace, region


def test_no_disagreement_with_the_exact_test(world) -> None:
    """A quarter of the viewpoints lies close to the boundary."""
    scene, target, workspace, region = world
    points = random_viewpoints(workspace, region.solid, 4000, np.random.default_rng(1))
    assert workspace.contains(points).all()
    sees = ExactTest(scene).sees(points, target)
    audit = region.audit.with_viewpoints(region, points, sees)
    assert audit.viewpoints == 4100
    assert audit.disagreements == 0
    assert 200 < audit.visible < 3900
    assert audit.tolerance_mm <= 1e-6 * np.linalg.norm(np.ptp(workspace.bounds_mm, axis=0))


@pytest.mark.long
def test_no_disagreement_in_a_hundred_thousand_viewpoints(world) -> None:
    scene, target, workspace, region = world
    points = random_viewpoints(workspace, region.solid, 100_000, np.random.default_rng(2))
    sees = ExactTest(scene).sees(points, target)
    assert region.audit.with_viewpoints(region, points, sees).disagreements == 0


def test_factors_agree_with_the_winding_number(world) -> None:
    """Anywhere, and on lines from the target's centre through corners and edges of the region."""
    _, target, workspace, region = world
    triangles = region.solid.triangles_mm
    generator = np.random.default_rng(4)
    anywhere = random_viewpoints(workspace, region.solid, 800, generator)
    special = np.concatenate([triangles[:, 0], (triangles[:, 0] + triangles[:, 1]) / 2])
    special = special[generator.integers(len(special), size=200)]
    share = generator.uniform(0.3, 1.3, (len(special), 1))
    through = target.centroid_mm + share * (special - target.centroid_mm)
    points = np.concatenate([anywhere, through])
    size = np.linalg.norm(np.ptp(workspace.bounds_mm, axis=0))
    points = points[region.solid.distance_to_surface_mm(points) > 1e-9 * size]
    np.testing.assert_array_equal(region.contains(points), winding_number(points, triangles) > 0.5)
    distance = region.distance_to_boundary(points)
    np.testing.assert_array_equal(distance > 0, region.contains(points))


def test_most_points_are_proved_by_one_ray(world) -> None:
    """The rest is asked of the whole surface; past a segment some directions are empty."""
    _, target, workspace, region = world
    points = random_viewpoints(workspace, region.solid, 2000, np.random.default_rng(5))
    for factor in region.factors:
        local = factor.frame.to_local(points)
        local = local if target.is_segment else local[local[:, 2] > 0]
        assert factor._star.is_star_shaped
        _, sure = factor._star._by_ray(local - factor._star._centre)
        assert sure.mean() > (0.5 if target.is_segment else 0.99)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 1000), st.floats(-3, 6))
def test_membership_and_distance_survive_rigid_motion_and_scale(seed: int, decade: float) -> None:
    """From 1e-3 to 1e6 mm."""
    generator = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed).as_matrix()
    shift, scale = generator.normal(size=3) * 100, 10**decade / 100
    meshes = [ball(seed), ball(seed + 1, 7.0), box((-5, 5, -5), (5, 6, 4))]

    def moved(points):
        return (points @ turn.T + shift) * scale

    here = visibility_region(Scene(meshes), Target(SQUARE), SPACE, audit_points=0)
    there = visibility_region(
        Scene([trimesh.Trimesh(moved(m.vertices), m.faces, process=False) for m in meshes]),
        Target(moved(SQUARE)),
        Solid(moved(SPACE.vertices_mm), SPACE.faces),
        audit_points=2000,
        seed=seed,
    )
    assert there.audit.disagreements == 0
    points = random_viewpoints(SPACE, here.solid, 300, generator)
    distance = here.distance_to_boundary(points)
    np.testing.assert_allclose(
        there.distance_to_boundary(moved(points)) / scale, distance, atol=1e-6, rtol=1e-6
    )
    far = np.abs(distance) > 1e-6
    np.testing.assert_array_equal(there.contains(moved(points))[far], here.contains(points)[far])


def test_intersection_keeps_the_factors_of_both() -> None:
    """Two targets, two workspaces, and a segment on material; then a region without factors."""
    scene = Scene([box((-1, -20, 5), (1, 20, 15)), box((12, -5, -5), (20, 5, 0))])
    left = visibility_region(scene, Target(SQUARE - np.array([15, 0, 0])), SPACE, audit_points=200)
    right = visibility_region(
        scene,
        Target.segment((12, -5, 0), (12, 5, 0)),
        box_workspace((-40, -60, -30), (60, 40, 70)),
        audit_points=300,
    )
    both = left.intersect(right)
    assert len(both.factors) == 2
    assert len(both.limits) == 1
    assert len(both.excluded) == 2
    assert both.audit.viewpoints == 500
    points = np.random.default_rng(0).uniform([-50, -50, -20], [60, 50, 100], (1500, 3))
    wanted = left.contains(points) & right.contains(points)
    assert 0.02 < wanted.mean() < 0.98
    np.testing.assert_array_equal(both.contains(points), wanted)
    np.testing.assert_array_equal(both.solid.contains(points), wanted)
    bare = replace(right, factors=(), excluded=())
    np.testing.assert_array_equal(left.intersect(bare).contains(points), wanted)
    np.testing.assert_array_equal(bare.intersect(bare).contains(points), right.contains(points))
    assert json.loads(json.dumps(both.to_dict()))["intersection_of"][1]["method"] == "direct"


def test_audit_finds_a_forgotten_body() -> None:
    """A region computed without one ball of 4 mm disagrees with the exact test."""
    meshes = [ball(k) for k in range(6)]
    wrong = visibility_region(Scene(meshes[:5]), Target(SQUARE), SPACE, audit_points=0)
    points = random_viewpoints(SPACE, wrong.solid, 10_000, np.random.default_rng(0))
    sees = sees_whole_target(points, Target(SQUARE), Scene(meshes))
    assert wrong.audit.with_viewpoints(wrong, points, sees).disagreements > 100


def test_audit_finds_a_solid_that_lost_volume_although_its_factors_are_right() -> None:
    """Both ways in which a region is kept are audited: here 1e-4 of the solid is gone."""
    scene, target = Scene([ball(1)]), Target(SQUARE)
    region = visibility_region(scene, target, SPACE, audit_points=0)
    bitten = region.to_mesh().difference(box((20, 20, 95), (24, 24, 101)))
    wrong = replace(region, solid=Solid(bitten.vertices, bitten.faces))
    assert wrong.volume_mm3 < region.volume_mm3 * (1 - 5e-5)
    points = random_viewpoints(SPACE, wrong.solid, 50_000, np.random.default_rng(0))
    sees = sees_whole_target(points, target, scene)
    assert region.audit.with_viewpoints(region, points, sees).disagreements == 0
    assert wrong.audit.with_viewpoints(wrong, points, sees).disagreements > 0


def test_what_is_not_star_shaped_is_asked_of_its_surface() -> None:
    ring = trimesh.creation.torus(10, 3, major_sections=24, minor_sections=12)
    star = StarShaped(ring.triangles, np.array([10.0, 0, 0]))
    assert not star.is_star_shaped
    points = np.random.default_rng(0).uniform([-14, -14, -4], [14, 14, 4], (500, 3))
    np.testing.assert_array_equal(
        star.contains(points), winding_number(points, ring.triangles) > 0.5
    )
    assert not StarShaped(np.zeros((0, 3, 3)), np.zeros(3)).contains(points).any()


def test_a_sliver_that_is_turned_away_by_rounding_is_no_fold() -> None:
    """Booleans leave such faces; a real one means that the solid is not star-shaped."""
    cube = box((-1, -1, -1), (1, 1, 1)).triangles
    a, b = np.array([0.2, 0.1, 0.9]), np.array([0.2, 0.3, 0.9])
    for width, star_shaped in ((1e-13, True), (1e-3, False)):
        # The plane of the face passes the centre by about the width, on the wrong side.
        face = np.array([[a, b, 0.45 * (a + b) - width * np.cross(a, b)]])
        assert np.linalg.det(face[0]) < 0
        solid = StarShaped(np.concatenate([cube, face]), np.zeros(3))
        assert solid.is_star_shaped == star_shaped


def test_the_body_that_hides_the_target_is_named(bench) -> None:
    lid, post = bench.box((-60, -60, 5), (60, 60, 6)), bench.box((20, 20, 0), (22, 22, 4))
    above = box_workspace((-50, -50, 7), (50, 50, 100))
    scene = Scene([post, lid, bench.block], ["post", "lid", "block"])
    region = visibility_region(scene, bench.target, above, audit_points=100)
    assert region.is_empty
    assert region.why_empty.endswith(
        "point of the target; lid alone hides it from all 500 that were tried"
    )
    halves = [bench.box((-90, -90, 5), (4, 90, 6)), bench.box((-4, -90, 6.1), (90, 90, 6.2))]
    region = visibility_region(
        Scene([*halves, post], ["left", "right", "post"]), bench.target, above, audit_points=0
    )
    assert "of 500 that were tried, it is hidden by " in region.why_empty
    assert "left from " in region.why_empty
    assert "right from " in region.why_empty
    assert region.why_empty.endswith("each taken alone")
    assert "post" not in region.why_empty


def test_record_says_what_it_was_made_of(bench) -> None:
    scene = bench.scene(bench.block)
    region = visibility_region(scene, bench.target, bench.workspace, audit_points=50, seed=3)
    record = json.loads(json.dumps(region.to_dict()))
    assert record["audit"]["viewpoints"] == 50
    assert record["audit"]["disagreements"] == 0
    assert record["scene_digest"] == scene.digest
    assert record["audit_seed"] == 3
    assert record["method"] == "direct"
    assert set(record["made_with"]) == {"lenscal", "manifold3d", "numpy"}
    other = visibility_region(scene, Target(SQUARE + 1e-9), bench.workspace, audit_points=0)
    assert other.to_dict()["target_digest"] != record["target_digest"]


def test_the_same_prepared_test_serves_many_targets() -> None:
    scene = Scene([ball(k) for k in range(3)])
    prepared = ExactTest(scene)
    for x in (-15.0, 0.0, 15.0):
        region = visibility_region(
            scene,
            Target(SQUARE + np.array([x, 0, 0])),
            SPACE,
            audit_points=500,
            exact_test=prepared,
        )
        assert region.audit.disagreements == 0
        assert region.audit.viewpoints == 500


def test_workspace_and_segment_are_checked(bench) -> None:
    scene = bench.scene(bench.block)
    turned = Solid(bench.workspace.vertices_mm, np.fliplr(bench.workspace.faces))
    with pytest.raises(GeometryError, match="the workspace is inside out"):
        visibility_region(scene, bench.target, turned)
    cut = Solid(bench.workspace.vertices_mm, bench.workspace.faces[:-1])
    with pytest.raises(GeometryError, match="the workspace is no closed solid: 3 of its"):
        visibility_region(scene, bench.target, cut)
    inside = Target.segment((-3, 0, -2), (3, 0, -2))
    with pytest.raises(GeometryError, match="material lies on the target .* not inside of it"):
        visibility_region(scene, inside, bench.workspace)
    on_face = Target.segment((-3, 0, 0), (3, 0, 0))
    region = visibility_region(scene, on_face, bench.workspace, audit_points=500)
    assert region.audit.disagreements == 0
    assert region.volume_mm3 == pytest.approx(bench.volume)


def test_audits_add_up() -> None:
    first, second = Audit(10, 1, 2, 1e-4, 5, 1e-15, 0), Audit(20, 0, 1, 1e-3, 7, 1e-16, 2)
    assert first.combined(second, 1e-13) == Audit(30, 1, 3, 1e-3, 12, 1e-13, 2)
