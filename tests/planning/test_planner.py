"""Plans: every viewpoint satisfies everything, and an empty plan says why."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest

from lenscal.camera import Camera
from lenscal.document import read_document
from lenscal.errors import PlanningError
from lenscal.maps.lens_map import LensMap
from lenscal.pose import Pose
from planning.camera_body import CameraBody
from planning.enclosure import example_part
from planning.fixed_lens import FixedLens
from planning.planner import plan
from planning.requirements.clearance import Clearance
from planning.requirements.depth_of_field import DepthOfField
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.incidence import Incidence
from planning.requirements.resolution import Resolution
from planning.requirements.unvignetted import Unvignetted
from planning.requirements.visibility import Visibility
from planning.solid import box_workspace
from planning.target import Target
from planning.task import Task
from planning.verify import verify_viewpoint
from planning.viewpoints import Ring, visible_arcs
from planning.visibility.methods import visibility_region

matplotlib.use("Agg")

PAPER = (Resolution(3, 0.254, "x"), FieldOfView(25.4, "x"))


@pytest.fixture(scope="module")
def part():
    return example_part()


@pytest.fixture(scope="module")
def paper_task(part) -> Task:
    return Task(part.target, part.feature, PAPER, part.workspace, "T of figure 15")


@pytest.fixture(scope="module")
def found(paper_task: Task, lens, part):
    return plan(paper_task, lens, part.scene, audit_points=2000)


def test_viewpoints_pass_through_both_holes(found) -> None:
    assert not found.why_empty
    table = found.viewpoints
    assert (table["y_mm"] < 0).any(), "through the small hole"
    assert (table["y_mm"] > 0).any(), "through the large hole"
    assert (np.diff(table["smallest_margin"]) <= 1e-6).all(), "but for rounding"
    assert (table["smallest_margin"] > 0).all()
    assert (table["resolution_margin"] >= 0.005 - 1e-9).all()
    assert (table["field_of_view_margin"] >= 0.005 - 1e-9).all()
    assert table["resolution_margin"].min() < 0.01, "one lies near the resolution limit"
    assert table["field_of_view_margin"].min() < 0.01, "one lies near the field-of-view limit"


def test_independent_check_agrees(found, part) -> None:
    for index, pose in enumerate(found.poses):
        seen = verify_viewpoint(
            found.camera(index), pose, part.target, part.feature, PAPER, part.scene
        )
        row = found.viewpoints.iloc[index]
        assert seen.satisfied
        pitch = found.lens.sensor.sample_pitch_x_mm
        assert seen.feature_px == pytest.approx(25.4 * row["magnification"] / pitch)
        assert seen.pixels_per_mm == pytest.approx((1 + row["resolution_margin"]) * 3 / 0.254)


def test_cameras_look_at_the_midpoint_with_the_feature_along_x(found, part) -> None:
    for pose, (_, row) in zip(found.poses, found.viewpoints.iterrows(), strict=True):
        middle = pose.inverse().transform(part.feature.centroid_mm)
        np.testing.assert_allclose(middle, [0, 0, row["object_distance_mm"]], atol=1e-9)
        np.testing.assert_allclose(pose.rotation[:, 0], [1, 0, 0], atol=1e-12)
        np.testing.assert_allclose(pose.translation_mm, row[["x_mm", "y_mm", "z_mm"]].tolist())


def test_plan_is_saved_with_its_evidence(found, tmp_path) -> None:
    path = found.save(tmp_path / "plan.json")
    body = read_document(path, "plan", 1)
    assert body["lens"] == {"map_digest": "analytic"}
    assert body["region"]["audit"]["disagreements"] == 0
    assert body["region"]["volume_mm3"] == pytest.approx(found.region.volume_mm3)
    assert body["task_digest"] == found.task.digest
    assert len(body["viewpoints"]) == len(found.viewpoints)
    assert body["task"]["requirements"][0] == {
        "kind": "resolution", "pixels": 3, "length_mm": 0.254, "axis": "x",
    }  # fmt: skip
    assert body["made_with"]["manifold3d"]


def test_fixed_lens_is_planned_with_too(paper_task: Task, part, paper_sensor, tmp_path) -> None:
    found = plan(paper_task, FixedLens(127, paper_sensor), part.scene, audit_points=200)
    distances = found.viewpoints["object_distance_mm"] / 25.4
    assert distances.between(20.2, 31.1).all()
    assert (
        read_document(found.save(tmp_path / "p.json"), "plan", 1)["viewpoints"][0]["zoom"] is None
    )
    seen = verify_viewpoint(
        found.camera(0), found.poses[0], part.target, part.feature, PAPER, part.scene
    )
    assert seen.satisfied


def test_all_requirements_are_planned_with_together(part, paper_sensor, lens) -> None:
    """The map of the demo knows its pupil; the lens stays clear, sharp and unvignetted."""
    body = CameraBody.barrel(front_mm=235.0, radius_mm=20.0, length_mm=200.0)
    requirements = [
        *PAPER,
        DepthOfField(1.0, 2.5),
        Incidence(80),
        Clearance(body, 5.0),
        Unvignetted(),
        Visibility(1.0),
    ]
    task = Task(part.target, part.feature, requirements, part.workspace)
    lens_map = LensMap.load(Path(__file__).parents[2] / "data" / "vicon-1990" / "map.json")
    found = plan(task, lens_map, part.scene, audit_points=200, settings_tried=5)
    assert not found.why_empty
    table = found.viewpoints
    names = ("depth_of_field", "incidence", "clearance", "unvignetted", "visibility")
    for name in names:
        assert (table[f"{name}_margin"] >= 0).all()
    assert (table["iris"] == 100).all()
    assert (table["smallest_margin"] <= table[[f"{n}_margin" for n in names]].min(axis=1)).all()
    blurred = replace(task, requirements=[*PAPER, DepthOfField(60.0, 0.5)])
    why = plan(blurred, lens_map, part.scene, audit_points=200, settings_tried=3).why_empty
    assert why.startswith("depth_of_field: no view satisfies everything; the depth of field")
    with pytest.raises(PlanningError, match="judge depth_of_field planning needs the entrance-p"):
        plan(blurred, lens, part.scene, audit_points=200, settings_tried=3)
    fixed = FixedLens(127, paper_sensor, 4.0)
    focused = replace(task, requirements=[*PAPER, DepthOfField(1.0, 2.5)])
    seen = plan(focused, fixed, part.scene, audit_points=200, settings_tried=3)
    assert (seen.viewpoints["depth_of_field_margin"] > 0).all()
    assert seen.viewpoints["iris"].isna().all()


def test_face_as_feature_is_seen_along_its_normal(lens, bench) -> None:
    workspace = box_workspace((-50, -50, 400), (50, 50, 800))
    task = Task(bench.target, None, [Resolution(2, 0.254), FieldOfView(15)], workspace)
    found = plan(task, lens, bench.scene(bench.block), audit_points=200)
    assert len(found.viewpoints) > 3
    np.testing.assert_allclose(found.viewpoints[["x_mm", "y_mm"]], 0, atol=1e-9)
    seen = verify_viewpoint(
        found.camera(0), found.poses[0], bench.target, bench.target, task.requirements, found.scene
    )
    assert seen.satisfied
    assert seen.target_in_view


def test_axis_y_turns_the_camera(lens, part) -> None:
    requirements = [Resolution(4, 0.254, "y"), FieldOfView(25.4, "y")]
    task = Task(part.target, part.feature, requirements, part.workspace)
    found = plan(task, lens, part.scene, audit_points=200, settings_tried=3)
    np.testing.assert_allclose(found.poses[0].rotation[:, 1], [1, 0, 0], atol=1e-12)
    assert np.linalg.det(found.poses[0].rotation) == pytest.approx(1)
    seen = verify_viewpoint(
        found.camera(0), found.poses[0], part.target, part.feature, requirements, part.scene
    )
    assert seen.satisfied


def test_contradiction_is_found_before_any_geometry(lens, part) -> None:
    requirements = [Resolution(6, 0.254, "x"), FieldOfView(25.4, "x")]
    found = plan(Task(part.target, part.feature, requirements, part.workspace), lens, part.scene)
    assert found.region is None
    assert found.viewpoints.empty
    assert found.poses == ()
    assert "the requirements contradict each other" in found.why_empty


def test_empty_plans_name_what_blocks(paper_task: Task, lens, part, bench, tmp_path) -> None:
    lid = bench.box((-40, -40, 31), (40, 50, 40))
    closed = type(part.scene)([*part.scene.meshes, lid])
    found = plan(paper_task, lens, closed, audit_points=200)
    assert found.why_empty.startswith("visibility: every viewpoint in the workspace has material")
    near = replace(paper_task, workspace=box_workspace((-300, -300, 35), (300, 300, 300)))
    found = plan(near, lens, part.scene, audit_points=200)
    assert found.why_empty.startswith(
        "workspace: no view satisfies everything; the workspace would have to reach"
    )
    between = replace(paper_task, workspace=box_workspace((-300, -150, 100), (300, 100, 900)))
    found = plan(between, lens, part.scene, audit_points=200)
    assert found.why_empty.startswith(
        "workspace: no view satisfies everything; the workspace would have to reach"
    )
    distorted = replace(lens, k1_per_mm2=-0.002)
    tight = replace(paper_task, requirements=[FieldOfView(25.4, "x"), Resolution(5, 0.254, "x")])
    found = plan(tight, distorted, part.scene, audit_points=200)
    assert found.why_empty.startswith("resolution: no view satisfies everything")
    assert [r.name for r in found.relaxations[:2]] == ["resolution", "field_of_view"]
    assert "or the field of view of 25.4 mm along x (d/D ≤ 0.3275) would have" in found.why_empty
    assert read_document(found.save(tmp_path / "p.json"), "plan", 1)["why_empty"]


def test_verification_notices_each_fault(found, part) -> None:
    pose, camera = found.poses[0], found.camera(0)
    arguments = (part.target, part.feature, PAPER, part.scene)
    roof = Pose(pose.rotation, pose.translation_mm * [1, -1, 1])
    assert not verify_viewpoint(camera, roof, *arguments).satisfied
    far = verify_viewpoint(Camera(camera.sensor, camera.image_distance_mm / 2), pose, *arguments)
    assert (far.resolved, far.in_view, far.visible) == (False, True, True)
    close = verify_viewpoint(Camera(camera.sensor, camera.image_distance_mm * 2), pose, *arguments)
    assert (close.resolved, close.in_view, close.visible) == (True, False, True)
    blocked = Pose(pose.rotation, pose.translation_mm + np.array([0, 400, 0]))
    assert not verify_viewpoint(camera, blocked, *arguments).visible


def test_arcs_end_on_the_border_of_the_region(part) -> None:
    region = visibility_region(part.scene, part.target, part.workspace, audit_points=0)
    ring = Ring.about(part.feature, part.target)
    arcs = visible_arcs(region, ring, 600.0)
    assert len(arcs) == 2
    for arc in arcs:
        assert arc.start < arc.deepest < arc.stop
        ends = ring.positions(600.0, np.array([arc.start, arc.stop]))
        np.testing.assert_allclose(region.distance_to_boundary(ends), 0, atol=1e-6)
        assert arc.depth_mm > 5


def test_arc_may_cross_the_seam_and_go_all_around(bench) -> None:
    """A segment in the open is seen from all around; behind a wall, across angle π."""
    segment = Target.segment((-1, 0, 0), (1, 0, 0))
    workspace = box_workspace((-50, -50, -50), (50, 50, 50))
    ring = Ring.about(segment, segment)
    far = bench.scene(bench.box((40, 40, 40), (41, 41, 41)))
    (arc,) = visible_arcs(visibility_region(far, segment, workspace, audit_points=0), ring, 20.0)
    assert arc.stop - arc.start == pytest.approx(2 * np.pi)
    centre = 5 * ring.axes[0]
    wall = bench.scene(bench.box(centre - 3, centre + 3))
    (arc,) = visible_arcs(visibility_region(wall, segment, workspace, audit_points=0), ring, 20.0)
    assert arc.stop > np.pi


def test_tasks_that_make_no_sense_are_refused(part) -> None:
    with pytest.raises(PlanningError, match="a task needs at least one requirement"):
        Task(part.target, part.feature, [], part.workspace)
    lifted = Target.segment((-1, 0, 1), (1, 0, 1))
    with pytest.raises(PlanningError, match="the feature leaves the plane of the target by 1 mm"):
        Task(part.target, lifted, PAPER, part.workspace)


def test_figures_have_labels_and_legends(found) -> None:
    from matplotlib.figure import Figure

    from planning.plots import plot_plan, plot_section

    figure = Figure()
    section = plot_section(figure.add_subplot(1, 3, 1), found)
    assert section.get_xlabel() == "y from the feature (mm)"
    words = [text.get_text() for text in section.get_legend().get_texts()]
    assert {"part", "target", "sees the whole target"} < set(words)
    detail = plot_section(figure.add_subplot(1, 3, 2), found, reach_mm=80)
    assert detail.get_xlim() == (-80, 80)
    space = plot_plan(figure.add_subplot(1, 3, 3, projection="3d"), found)
    assert space.get_zlabel() == "z (mm)"
    figure.canvas.draw()


def test_figures_of_a_plan_without_a_region(lens, part) -> None:
    from matplotlib.figure import Figure

    from planning.plots import plot_plan, plot_section

    requirements = [Resolution(6, 0.254, "x"), FieldOfView(25.4, "x")]
    empty = plan(Task(part.target, part.feature, requirements, part.workspace), lens, part.scene)
    figure = Figure()
    plot_section(figure.add_subplot(1, 2, 1), empty)
    plot_plan(figure.add_subplot(1, 2, 2, projection="3d"), empty)
    figure.canvas.draw()
