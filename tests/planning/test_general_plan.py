"""General views: found where there are some; where there are none, the right one is blamed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lenscal.calibration.calibration import Repeatability
from lenscal.camera_mount import CameraMount
from lenscal.document import read_document
from lenscal.errors import PlanningError
from lenscal.maps.lens_map import LensMap
from lenscal.pose import Pose
from planning import general
from planning.camera_body import CameraBody
from planning.enclosure import example_part
from planning.fixed_lens import FixedLens
from planning.judgement import judge
from planning.lens_states import LensStates
from planning.planner import plan
from planning.positions import positions_for
from planning.requirements.clearance import Clearance
from planning.requirements.depth_of_field import DepthOfField
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.incidence import Incidence
from planning.requirements.resolution import Resolution
from planning.requirements.unvignetted import Unvignetted
from planning.requirements.visibility import Visibility
from planning.robot_cell import RobotCell
from planning.scene import Scene
from planning.solid import box_workspace
from planning.target import Target
from planning.task import Task
from planning.verify import verify_viewpoint
from planning.views import Subject, Views
from planning.visibility.methods import visibility_region

BODY = CameraBody.barrel(front_mm=235.0, radius_mm=20.0, length_mm=200.0)
ALL = (
    Resolution(3, 0.254),
    FieldOfView(25.4),
    DepthOfField(1.0, 2.5),
    Incidence(80),
    Clearance(BODY, 5.0),
    Unvignetted(),
)


@pytest.fixture(scope="module")
def lens_map(request) -> LensMap:
    return LensMap.load(request.config.rootpath / "data" / "vicon-1990" / "map.json")


@pytest.fixture(scope="module")
def part():
    return example_part()


@pytest.fixture(scope="module")
def region(part):
    return visibility_region(part.scene, part.target, part.workspace, audit_points=0)


@pytest.fixture(scope="module")
def task(part) -> Task:
    return Task(part.target, part.feature, ALL, part.workspace, "T", views="general")


@pytest.fixture(scope="module")
def found(task, lens_map, part):
    return plan(task, lens_map, part.scene, audit_points=200)


def test_every_view_satisfies_everything(found, part) -> None:
    table = found.viewpoints
    assert len(table) >= 3
    assert (np.diff(table["smallest_margin"]) <= 1e-6).all(), "but for rounding"
    margins = table[[f"{r.name}_margin" for r in ALL]]
    assert (margins >= 0).all().all()
    np.testing.assert_allclose(
        np.minimum(
            margins.min(axis=1), table["visibility_margin_mm"] / table["object_distance_mm"]
        ),
        table["smallest_margin"],
    )
    states = found.views.states
    for k, pose in enumerate(found.poses):
        seen = verify_viewpoint(
            found.camera(k), pose, part.target, part.feature, ALL, part.scene,
            object_distance_mm=float(states.object_distance_mm[k]),
            entrance_pupil_diameter_mm=float(states.entrance_pupil_diameter_mm[k]),
            projection_centre_mm=states.projection_centre_mm[k], workspace=part.workspace,
        )  # fmt: skip
        assert seen.failed == ()


def test_the_sharp_plane_lies_in_the_feature_where_nothing_else_is_asked(
    task, lens_map, part
) -> None:
    flat = plan(replace(task, requirements=ALL[:2]), lens_map, part.scene, audit_points=0)
    views = flat.views
    depths = views.feature_in_camera_mm[2][..., 0]
    sharp = (1 / depths.min(axis=1) + 1 / depths.max(axis=1)) / 2
    np.testing.assert_allclose(1 / sharp, views.states.object_distance_mm, rtol=1e-9)


def test_it_is_better_than_the_best_orthogonal_view(found, task, lens_map, part) -> None:
    """The search may do all that the ring does, and more: T's middle need not be in the middle."""
    ring = plan(replace(task, views="orthogonal"), lens_map, part.scene, audit_points=0)
    best = ring.viewpoints["smallest_margin"].max()
    assert found.viewpoints["smallest_margin"].iloc[0] > best


def test_the_same_seed_gives_the_same_plan(found, task, lens_map, part) -> None:
    again = plan(task, lens_map, part.scene, audit_points=200)
    assert again.viewpoints.equals(found.viewpoints)


def test_fixed_lens_is_searched_too(task, paper_sensor, part) -> None:
    fixed = FixedLens(127.0, paper_sensor, 5.0)
    asked = replace(task, requirements=[ALL[0], ALL[1], ALL[3]])
    found = plan(asked, fixed, part.scene, audit_points=0)
    assert (found.viewpoints["smallest_margin"] > 0).all()
    assert found.viewpoints["zoom"].isna().all()
    assert found.viewpoints["nodal_offset_mm"].isna().all()


def open_bench(bench):
    """A face with nothing about it."""
    return Scene([bench.block])


@pytest.mark.parametrize("pixels", [5.3, 6.0, 8.0])
def test_resolution_is_blamed_by_what_the_sensor_cannot_hold(bench, lens, pixels) -> None:
    """A segment that fills 512 samples has 5.12 on each hundredth, whatever the lens."""
    segment = Target(np.array([[-5.0, 0, 0], [5, 0, 0]]))
    asked = [Resolution(pixels, 0.1, "x"), FieldOfView(10.0, "x")]
    task = Task(
        bench.target, segment, asked, box_workspace((-400, -400, 1), (400, 400, 900)),
        views="general",
    )  # fmt: skip
    # With bounds that leave nothing between them nobody has to look at the part.
    early = plan(task, lens, open_bench(bench), safety=0.0)
    assert early.region is None
    assert "the requirements contradict each other" in early.why_empty
    # Without a field of view the lens itself is what cannot.
    task = replace(task, requirements=[Resolution(pixels, 0.05, "x")])
    found = plan(task, lens, open_bench(bench), safety=0.0, audit_points=0)
    most = 0.35 * 0.05 / lens.sensor.sample_pitch_mm[0]
    assert found.relaxations[0].name == "resolution"
    assert found.relaxations[0].lacking == pytest.approx(pixels - most, rel=0.01)
    assert f"would have to give by {pixels - most:.3g} px" in found.why_empty


def test_incidence_is_blamed_in_degrees(bench, lens) -> None:
    """The workspace is 300 mm high, and the lens is sharp no nearer than 510 mm: 54 degrees."""
    segment = Target(np.array([[-0.5, 0, 0], [0.5, 0, 0]]))
    low = box_workspace((-900, -900, 0), (900, -300, 300))
    task = Task(bench.target, segment, [Incidence(30.0), Resolution(1, 0.254)], low, "low",
                views="general")  # fmt: skip
    found = plan(task, lens, open_bench(bench), safety=0.0, audit_points=0)
    named = {relaxation.name: relaxation for relaxation in found.relaxations}
    least = np.degrees(np.arccos(300 / 510))
    assert np.degrees(named["incidence"].lacking) == pytest.approx(least - 30, abs=0.1)
    assert "incidence of at most 30° would have to give by 24" in found.why_empty
    # Or the workspace would have to reach to where 30 degrees are.
    assert "or the workspace would have to reach" in found.why_empty


def test_visibility_is_blamed_in_mm(bench, lens) -> None:
    """A slit of 60 mm leaves 30 mm to its sides at the very most, wherever the camera is."""
    left, right = (
        bench.box((-900, -900, 490), (-30, 900, 500)),
        bench.box((30, -900, 490), (900, 900, 500)),
    )
    workspace = box_workspace((-300, -300, 540), (300, 300, 720))
    segment = Target(np.array([[-0.5, 0, 0], [0.5, 0, 0]]))
    point_like = Target(np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]]))
    scene = Scene([bench.block, left, right])
    asked = [Resolution(1.5, 0.254), Visibility(60.0)]
    task = Task(point_like, segment, asked, workspace, views="general")
    found = plan(task, lens, scene, safety=0.0, audit_points=0)
    # At the upper edge of the slit, z = 500, the region is 60 wide less the target's cone.
    height = found.relaxations[0].place_mm[2]
    half = (30 + 0.5) * height / 500 - 0.5
    assert found.relaxations[0].name == "visibility"
    room = half / np.hypot(1, 30.5 / 500)
    assert 60 - found.relaxations[0].lacking == pytest.approx(room, rel=0.02)


def test_two_requirements_too_many(bench, lens, tmp_path) -> None:
    """No single one could give way: the workspace is far too low, and the resolution too high."""
    low = box_workspace((-900, -900, 0), (900, -300, 60))
    task = Task(bench.target, None, [Incidence(30.0), Resolution(99, 0.254)], low, views="general")
    found = plan(task, lens, open_bench(bench), safety=0.0, audit_points=0)
    assert found.relaxations == ()
    assert found.why_empty.startswith("several requirements together")
    assert "resolution lacks 9" in found.why_empty
    assert "visibility lacks 9" in found.why_empty
    body = read_document(found.save(tmp_path / "p.json"), "plan", 1)
    assert body["relaxations"] == []
    assert body["task"]["views"] == "general"


def test_confidence_is_asked_and_told(task, lens_map, part) -> None:
    mount = CameraMount(Pose.identity(), np.zeros((6, 6)), lens_map.reference_setting)
    cell = RobotCell(
        mount, Pose.identity(), None, Repeatability(rotation_rad=1e-3, translation_mm=0.3)
    )
    task = replace(task, requirements=ALL[:4], confidence=0.95)
    sure = plan(task, lens_map, part.scene, cell=cell, audit_points=0)
    table = sure.viewpoints
    assert len(table)
    assert (table["probability"] >= 0.95).all()
    assert (np.diff(table["probability"]) <= 1e-4).all()
    assert (table["smallest_margin_sigmas"] > 1).all()
    assert {f"{r.name}_margin_sigmas" for r in ALL[:4]} <= set(table)
    shaky = replace(cell, repeatability=Repeatability(rotation_rad=0.1, translation_mm=30.0))
    none = plan(task, lens_map, part.scene, cell=shaky, audit_points=0)
    assert none.why_empty.startswith("confidence: 0.95 is asked, but the surest of")
    assert "the weakest there, at" in none.why_empty
    assert not len(none.viewpoints)
    with pytest.raises(PlanningError, match=r"probability between 0 and 1, but is 95; 99 % is"):
        replace(task, confidence=95.0)
    with pytest.raises(PlanningError, match="views must be 'orthogonal' or 'general', but is 'x'"):
        replace(task, views="x")


def test_the_search_goes_on_while_no_view_is_sure_enough(task, lens_map, part, monkeypatch) -> None:
    mount = CameraMount(Pose.identity(), np.zeros((6, 6)), lens_map.reference_setting)
    cell = RobotCell(
        mount, Pose.identity(), None, Repeatability(rotation_rad=4e-3, translation_mm=1.0)
    )
    task = replace(task, requirements=ALL[:4])
    monkeypatch.setattr(general, "_FIRST_STEPS", 1)
    monkeypatch.setattr(general, "_STEPS", 1)
    short = plan(task, lens_map, part.scene, cell=cell, audit_points=0).viewpoints["probability"]
    asked = 0.97
    assert short.max() < 0.95
    longer = plan(
        replace(task, confidence=asked), lens_map, part.scene, cell=cell, audit_points=0
    ).viewpoints["probability"]
    assert len(longer)
    assert (longer >= asked).all()


def test_positions_for_a_direction_are_exact(lens_map, part, region) -> None:
    """Inside of the solid every polyhedral requirement holds, outside one of them does not."""
    subject = Subject(part.target, part.feature, part.scene, region)
    pinhole = FixedLens(127.0, lens_map.sensor, 5.0)
    states = LensStates.of_fixed(pinhole, 620.0)
    pose = Pose.from_rotation_vector([np.pi - 0.6, 0, 0])
    asked = [FieldOfView(25.4), DepthOfField(1.0, 2.0), Visibility()]
    solid = positions_for(asked, subject, states, pose.rotation)
    assert not solid.is_empty
    low, high = solid.bounds_mm
    places = np.random.default_rng(0).uniform(low - 10, high + 10, (4000, 3))
    rotations = np.broadcast_to(pose.rotation, (len(places), 1, 3, 3))
    holds = judge(asked, Views(places[:, None], rotations, states, subject)).holds[:, 0]
    near = solid.distance_to_surface_mm(places) < 1e-6
    inside = solid.contains(places)
    assert 200 < inside.sum() < 3800
    np.testing.assert_array_equal(holds[~near], inside[~near])


def test_positions_need_a_region_and_one_state(lens_map, part, region) -> None:
    states = LensStates.of_fixed(FixedLens(127.0, lens_map.sensor), [500.0, 600.0])
    bare = Subject(part.target)
    with pytest.raises(PlanningError, match="cut out of the region of visibility, but there is no"):
        positions_for(ALL, bare, states, np.eye(3))
    with pytest.raises(PlanningError, match="those of one lens state, but there are 2"):
        positions_for(ALL, replace(bare, region=region), states, np.eye(3))
