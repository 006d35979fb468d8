"""The paper's algorithm: it agrees with the direct method, with closed forms and the exact test."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from manifold3d import Manifold
from scipy.spatial.transform import Rotation
from visibility_scenes import (
    KINDS,
    SQUARE,
    hooked_comb,
    prism,
    random_scene,
    star_polygon,
    tangled_polygon,
)

from lenscal.errors import GeometryError
from planning import boolean, box_workspace, occluded_region, viewing_region, visibility_region
from planning.occlusion_plots import example_figure
from planning.polygons import area_vectors
from planning.scene import Scene
from planning.solid import Solid
from planning.target import Target
from planning.visibility.gulfs import face_part, hole_part
from planning.visibility.loops import cut_in_front, flat_faces
from planning.visibility.polygon_regions import face_steps, occlusion_steps

SPACE = box_workspace((-50, -50, 0), (50, 50, 100))
TARGET = Target(np.column_stack([SQUARE, np.zeros(4)]))


def lifted(polygon, height: float, turn=None) -> np.ndarray:
    """A polygon of the plane, turned and lifted."""
    flat = np.column_stack([polygon, np.zeros(len(polygon))])
    return (flat if turn is None else flat @ turn.T) + [0, 0, height]


def assert_methods_agree(kind: str, seeds) -> None:
    for seed in seeds:
        case = random_scene(kind, seed)
        direct, paper = (
            visibility_region(
                case.scene, case.target, case.workspace, method=method, audit_points=0
            ).volume_mm3
            for method in ("direct", "decomposition")
        )
        assert abs(direct - paper) <= 1e-9 * case.workspace.volume_mm3, case.name


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_methods_agree_on_random_scenes(kind: str) -> None:
    """Two hundred and four scenes, seventeen of each kind."""
    assert_methods_agree(kind, range(17))


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_methods_agree_on_many_random_scenes(kind: str) -> None:
    """Run by `pytest -m long tests/planning/test_decomposition.py`."""
    assert_methods_agree(kind, range(17, 217))


@pytest.mark.parametrize("kind", ["holes with islands", "gulfs within gulfs", "u-shaped target"])
def test_audit_finds_no_disagreement(kind: str) -> None:
    case = random_scene(kind, 100)
    region = visibility_region(case.scene, case.target, case.workspace, method="decomposition")
    assert region.audit.viewpoints == 10_000
    assert region.audit.disagreements == 0


@pytest.mark.parametrize("method", ["direct", "decomposition"])
@pytest.mark.parametrize("place", [(300, 0, 20), (0, 0, 300), (300, 200, -500)])
def test_bodies_beyond_the_workspace_hide_nothing(method: str, place) -> None:
    far = trimesh.creation.icosphere(subdivisions=1, radius=10)
    far.apply_translation(place)
    region = visibility_region(Scene([far]), TARGET, SPACE, method=method, audit_points=0)
    assert region.volume_mm3 == pytest.approx(SPACE.volume_mm3, rel=1e-12)


def test_intersection_that_loses_volume_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    cube = Manifold.cube([1, 1, 1])
    monkeypatch.setattr(boolean, "BALANCE_TOLERANCE", -1.0)
    with pytest.raises(GeometryError, match="fail to add up by .* slightly larger or elsewhere"):
        boolean.intersect(cube, cube.translate([0.5, 0, 0]))


# ── closed forms ──────────────────────────────────────────────────────────────────────────────────
def test_square_hides_a_frustum() -> None:
    """A square of side 4 at height 10 over one of 10: its shadow grows by 1.4 per mm."""
    region = occluded_region(
        lifted(0.4 * SQUARE, 10), TARGET, box_workspace((-50, -50, 0), (50, 50, 30))
    )
    low, high = 4.0, 32.0
    wanted = (high**3 - low**3) / (3 * 1.4)
    assert region.volume_mm3 == pytest.approx(wanted, abs=1e-9 * 3e5)
    assert region.audit.disagreements == 0


def test_square_hole_shows_a_frustum() -> None:
    """A hole of side 14 at height 10 over a square of 10: the region grows by 0.4 per mm."""
    region = viewing_region(
        lifted(1.4 * SQUARE, 10), TARGET, box_workspace((-50, -50, 0), (50, 50, 30))
    )
    wanted = (22.0**3 - 14.0**3) / (3 * 0.4)
    assert region.volume_mm3 == pytest.approx(wanted, abs=1e-9 * 3e5)
    assert region.audit.disagreements == 0
    assert region.contains([0, 0, 20])
    assert not region.contains([0, 0, 5])


def test_hole_smaller_than_the_target_shows_a_pyramid() -> None:
    region = viewing_region(lifted(0.5 * SQUARE, 10), TARGET, SPACE)
    assert region.volume_mm3 == pytest.approx(5.0**2 * 10 / 3, abs=1e-9 * 1e6)


def test_slit_over_a_segment() -> None:
    """Across the slit of width 2 at height 10 all v with |x| ≤ 1 + (z − 10)/10 see the segment."""
    slit = np.array([[-1.0, -200, 10], [1, -200, 10], [1, 200, 10], [-1, 200, 10]])
    space = box_workspace((-50, -50, 10), (50, 50, 20))
    region = viewing_region(slit, Target.segment((0, -5, 0), (0, 5, 0)), space)
    assert region.volume_mm3 == pytest.approx(100 * 10 * (2 + 4) / 2, abs=1e-9 * 1e5)


def test_material_less_hole_is_equation_1() -> None:
    """Occluded region of the material less the viewing region of the hole, (1)."""
    outline, hole = lifted(3 * SQUARE, 10), lifted(1.2 * SQUARE, 10)
    whole, through, both = (
        occluded_region(outline, TARGET, SPACE, audit_points=0),
        viewing_region(hole, TARGET, SPACE, audit_points=0),
        occluded_region(outline, TARGET, SPACE, holes=[hole], audit_points=2000),
    )
    assert both.volume_mm3 == pytest.approx(whole.volume_mm3 - through.volume_mm3, abs=1e-3)
    assert both.audit.disagreements == 0


def test_views_through_a_gulf_and_past_its_lid() -> None:
    """Views partly through the gulf and partly past its lid are visible."""
    outline = np.array([[-20.0, -20], [20, -20], [20, 0], [0, 0], [0, 20], [-20, 20]])
    region = occluded_region(lifted(outline, 10), TARGET, SPACE)
    assert region.audit.disagreements == 0
    # Sees 5 of the target's 10 mm over each arm, none of it through the gulf alone.
    assert not region.contains([10, 10, 20])
    assert region.contains([4, 10, 20])


# ── against the exact test ────────────────────────────────────────────────────────────────────────
U_SHAPE = np.array(
    [[-4.0, -3], [4, -3], [4, 3], [1.5, 3], [1.5, -1], [-1.5, -1], [-1.5, 3], [-4, 3]]
)
TARGETS = {
    "square": TARGET,
    "u": Target(lifted(U_SHAPE, 0)),
    "segment": Target.segment((-3, 0, 1), (3, 1, 2)),
}


@pytest.mark.parametrize("name", sorted(TARGETS))
@pytest.mark.parametrize("seed", range(3))
def test_plate_that_cuts_the_targets_plane(name: str, seed: int) -> None:
    """Holes, one of them with an island that touches its rim; planes that part the target."""
    generator = np.random.default_rng(seed)
    turn = Rotation.from_rotvec(generator.uniform(-1.5, 1.5, 3)).as_matrix()
    window = star_polygon(generator, 7, 6.0) - [8, 0]
    island = window[0] + 0.4 * (window - window[0])
    other = np.array([9, 3]) + tangled_polygon(generator, 8, 7.0)
    holes = [lifted(loop, 5, turn) for loop in (window, island, other)]
    region = occluded_region(
        lifted(4 * SQUARE, 5, turn), TARGETS[name], SPACE, holes=holes, audit_points=3000
    )
    assert region.audit.disagreements == 0
    assert region.audit.imbalance < 1e-9
    assert viewing_region(holes[2], TARGETS[name], SPACE, 3000).audit.disagreements == 0


def test_cavity_in_the_hidden_region_is_no_sliver() -> None:
    """What is seen through a small hole may lie within all that is hidden."""
    big = Target(lifted(4 * SQUARE, 0))
    plate = [[-90, -90], [90, -90], [90, 90], [-90, 90]]
    space = box_workspace((-20, -20, 9), (20, 20, 60))
    hole = lifted(0.4 * SQUARE, 10)
    region = occluded_region(lifted(plate, 10), big, space, holes=[hole])
    assert region.audit.disagreements == 0
    assert not region.contains([0, 0, 10.5])


# ── the parts ─────────────────────────────────────────────────────────────────────────────────────
def flat_area(part) -> float:
    return float(np.linalg.norm(area_vectors(part.outline)))


@pytest.mark.parametrize("seed", range(8))
def test_parts_of_a_hole_add_up(seed: int) -> None:
    """Hull less rests is the hole; all hulls are convex, and material and holes take turns."""
    generator = np.random.default_rng(seed)
    outline = lifted(tangled_polygon(generator, 11, 1.0), 0)
    hole = hole_part(outline, np.array([0.0, 0, 1]))
    hull = float(np.linalg.norm(area_vectors(hole.hull)))
    assert hull - sum(flat_area(rest) for rest in hole.inside) == pytest.approx(flat_area(hole))

    def check(part) -> None:
        turn = np.cross(np.roll(part.hull, -1, axis=0) - part.hull, [0, 0, 1.0])
        ahead = np.einsum("ei,eci->ec", turn, part.outline[None] - part.hull[:, None])
        assert ahead.max() <= 1e-9
        assert area_vectors(part.outline)[2] > 0
        for inner in part.inside:
            assert inner.is_material != part.is_material
            assert not part.is_material or inner.name.startswith("gulf")
            check(inner)

    check(hole)


def test_gulfs_within_gulfs_go_deep() -> None:
    face = flat_faces(*_sheet(hooked_comb(np.random.default_rng(1), 2) / 40))[0]

    def depth(part) -> int:
        return 1 + max((depth(inner) for inner in part.inside), default=0)

    assert depth(face_part(face)) >= 4


def _sheet(polygon):
    body = prism([polygon], -1.0, 0.0)
    top = (body.vertices[body.faces][:, :, 2] == 0).all(axis=1)
    return np.asarray(body.vertices), np.asarray(body.faces)[top]


def test_faces_of_a_plate_have_their_loops() -> None:
    square = [[-1, -1], [1, -1], [1, 1], [-1, 1]]
    loops = [4 * np.array(square), np.add(square, [2, 0]), np.subtract(square, [2, 0])]
    plate = prism(loops, 1.0, 2.0)
    faces = flat_faces(np.asarray(plate.vertices), np.asarray(plate.faces))
    assert len(faces) == 2 + 3 * 4
    assert sorted(len(face.holes) for face in faces)[-2:] == [2, 2]
    for face in faces:
        assert area_vectors(face.outline) @ face.normal > 0
        assert all(area_vectors(hole) @ face.normal > 0 for hole in face.holes)


def test_holes_that_touch_in_a_corner_are_parted() -> None:
    """As is a hole that touches the outline: sight does not pass through a point."""
    cells = [(i, j) for i in range(4) for j in range(4) if (i, j) not in {(1, 1), (2, 2), (3, 3)}]
    grid = np.array([[i, j, 0.0] for i in range(5) for j in range(5)])
    triangles = []
    for i, j in cells:
        a, b, c, d = 5 * i + j, 5 * (i + 1) + j, 5 * (i + 1) + j + 1, 5 * i + j + 1
        triangles += [(a, b, c), (a, c, d)]
    (face,) = flat_faces(grid, np.array(triangles))
    assert sorted(len(hole) for hole in face.holes) == [4, 4]
    assert len(face.outline) == 6
    assert np.linalg.norm(area_vectors(face.outline)) == pytest.approx(15)


def test_surface_is_cut_at_the_plane_of_the_target() -> None:
    box = trimesh.creation.box(bounds=[[0, 0, -1], [1, 1, 3]])
    vertices, faces = cut_in_front(np.asarray(box.vertices), np.asarray(box.faces))
    assert vertices[faces][..., 2].min() == 0.0
    cut = trimesh.Trimesh(vertices, faces, process=False)
    assert cut.area == pytest.approx(4 * 3 + 1)
    assert sorted(len(f.outline) for f in flat_faces(vertices, faces)) == [4] * 5


def test_steps_are_the_figures_of_the_paper() -> None:
    """Figures 2 to 4 and 5 to 8: material, hole and gulf, and what each of them hides or shows."""
    outline = np.array(
        [[-15.0, -15], [15, -15], [15, 15], [3, 15], [3, 4], [-3, 4], [-3, 15], [-15, 15]]
    )
    hole = lifted(np.array([[-6.0, -12], [6, -12], [6, -2], [-6, -2]]), 10)
    small = Target(lifted(0.3 * SQUARE, 0))
    steps = {s.name: s for s in occlusion_steps(lifted(outline, 10), small, SPACE, [hole])}
    assert list(steps) == [
        "material",
        "material/gulf 0",
        "material/gulf 0/rest 0",
        "material/gulf 0/rest 1",
        "material/hole 0",
    ]
    material, gulf = steps["material"], steps["material/gulf 0"]
    assert len(material.hull_mm) == 4
    assert len(gulf.outline_mm) == 8
    through = viewing_region(hole, small, SPACE, audit_points=0)
    assert steps["material/hole 0"].region.volume_mm3 == pytest.approx(through.volume_mm3)
    whole = occluded_region(lifted(outline, 10), small, SPACE, [hole], audit_points=0)
    assert material.region.volume_mm3 == pytest.approx(whole.volume_mm3)
    assert material.hull_region.volume_mm3 > material.region.volume_mm3
    assert gulf.region.volume_mm3 < gulf.hull_region.volume_mm3


def test_each_face_of_a_scene_can_be_asked_for() -> None:
    box = trimesh.creation.box(bounds=[[-2, -2, 10], [2, 2, 12]])
    steps = list(face_steps(Scene([box]), TARGET, SPACE))
    assert len(steps) == 6
    hidden = (
        SPACE.volume_mm3 - visibility_region(Scene([box]), TARGET, SPACE, audit_points=0).volume_mm3
    )
    assert max(step.region.volume_mm3 for step in steps) <= hidden * (1 + 1e-12)
    assert steps[0].region.volume_mm3 == pytest.approx(
        occluded_region(lifted(0.4 * SQUARE, 10), TARGET, SPACE, audit_points=0).volume_mm3
    )


@pytest.mark.parametrize("decade", [-3, 0, 6])
def test_regions_of_a_polygon_survive_rigid_motion_and_scale(decade: int) -> None:
    turn = Rotation.from_rotvec([0.4, -1.2, 0.7]).as_matrix()
    scale = 10.0**decade

    def moved(points):
        return (np.asarray(points) @ turn.T + [30, -70, 20]) * scale

    outline = lifted(star_polygon(np.random.default_rng(3), 9, 20.0), 12)
    first = occluded_region(outline, TARGET, SPACE, audit_points=0)
    second = occluded_region(
        moved(outline),
        Target(moved(TARGET.vertices_mm)),
        Solid(moved(SPACE.vertices_mm), SPACE.faces),
        audit_points=500,
    )
    assert second.volume_mm3 / scale**3 == pytest.approx(first.volume_mm3, abs=1e-9 * 1e6)
    assert second.audit.disagreements == 0


# ── emptiness and bad input ───────────────────────────────────────────────────────────────────────
def test_empty_regions_say_why() -> None:
    aside = occluded_region(lifted(SQUARE, -10), TARGET, SPACE, audit_points=100)
    assert aside.why_empty == "the polygon hides the target from no viewpoint in the workspace"
    below = viewing_region(
        lifted(0.1 * SQUARE, 10), TARGET, box_workspace((-9, -9, 20), (9, 9, 30))
    )
    assert below.why_empty.startswith("no viewpoint in the workspace sees the whole target through")
    # The segment pierces the plane of the hole beside it.
    pierced = viewing_region(lifted(SQUARE, 10), Target.segment((20, 0, 5), (20, 0, 15)), SPACE)
    assert pierced.is_empty
    assert pierced.audit.imbalance < 1e-12


def test_polygon_in_the_plane_of_a_segment_hides_nothing() -> None:
    flat = occluded_region(lifted(SQUARE, 10), Target.segment((20, 0, 10), (20, 5, 10)), SPACE)
    assert flat.is_empty
    assert flat.audit.disagreements == 0


@pytest.mark.parametrize(
    ("outline", "holes", "message"),
    [
        ([[0, 0, 5], [1, 0, 5]], [], "the polygon has 2 corners and an area of 0 mm²; give three"),
        ([[0, 0, 5], [1, 0, 5], [2, 0, 5]], [], "the polygon has 3 corners and an area of 0 mm²"),
        (lifted(SQUARE, 5), [lifted(SQUARE[:2], 5)], "hole 0 has 2 corners"),
        (lifted(SQUARE, 5), [lifted(0.1 * SQUARE, 6)], "lie in no plane: corners leave it by 1 mm"),
        (lifted(SQUARE, 5), [lifted(np.add(SQUARE, [5, 0]), 5)], "a hole reaches out of it"),
        (lifted(SQUARE, 5), [lifted(np.add(0.1 * SQUARE, [9, 0]), 5)], "a hole reaches out of it"),
        (
            lifted([[0, 0], [4, 4], [4, 0], [0, 3]], 5),
            [],
            "the outline of the polygon crosses itself",
        ),
    ],
)
def test_polygons_that_are_none_are_refused(outline, holes, message: str) -> None:
    with pytest.raises(GeometryError, match=message):
        occluded_region(outline, TARGET, SPACE, holes=holes)


def test_the_example_is_drawn() -> None:
    figure = example_figure()
    assert [axes.get_title()[:2] for axes in figure.axes] == ["1.", "2.", "3.", "4.", "5.", "6."]
    assert all(len(axes.collections) >= 2 for axes in figure.axes)
