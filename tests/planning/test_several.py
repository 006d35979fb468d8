"""Several targets: shared viewpoints, an order, and what cannot be covered."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lenscal.document import read_document
from lenscal.errors import PlanningError
from lenscal.maps.lens_map import LensMap
from lenscal.progress import silent
from planning.camera_body import CameraBody
from planning.fixed_lens import FixedLens
from planning.placement import place_plan
from planning.placement_export import as_sequence
from planning.requirements.clearance import Clearance
from planning.requirements.depth_of_field import DepthOfField
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.resolution import Resolution
from planning.scene import Scene
from planning.several import plan_all
from planning.solid import box_workspace
from planning.target import Target
from planning.task import Task
from planning.task_file import load_cell
from planning.verify import verify_viewpoint

ASKED = (Resolution(2, 0.254, "x"), FieldOfView(8, "x"))
WORKSPACE = box_workspace((-300, -300, 60), (300, 300, 900))
REPOSITORY = Path(__file__).parents[2]


def patch(x: float, y: float, z: float = 0.0) -> Target:
    return Target(
        np.array([[x - 4, y - 3, z], [x + 4, y - 3, z], [x + 4, y + 3, z], [x - 4, y + 3, z]])
    )


def task(name: str, x: float, y: float, requirements=ASKED, workspace=WORKSPACE) -> Task:
    feature = Target.segment((x - 4, y, 0), (x + 4, y, 0))
    return Task(patch(x, y), feature, requirements, workspace, name)


@pytest.fixture(scope="module")
def plate(bench) -> Scene:
    """A plate 300 mm wide, with a wall across."""
    return bench.scene(
        bench.box((-150, -50, -5), (150, 50, 0)), bench.box((60, -50, 0), (62, 50, 8))
    )


@pytest.fixture(scope="module")
def lens_map() -> LensMap:
    return LensMap.load(REPOSITORY / "data" / "vicon-1990" / "map.json")


@pytest.fixture(scope="module")
def found(plate, lens_map):
    tasks = [task("a", -80, 0), task("b", -66, 5), task("c", 80, 0), task("d", 92, -4)]
    return plan_all(tasks, lens_map, plate, audit_points=100, settings_tried=3)


def test_neighbours_share_a_viewpoint(found) -> None:
    assert sorted(found.viewpoints["targets"]) == ["a, b", "c, d"]
    assert found.cover.is_proven
    assert found.route.is_shortest
    assert not found.uncovered
    assert not found.why_empty
    assert found.route.travel_mm > 150


def test_every_viewpoint_satisfies_what_it_covers(found, plate) -> None:
    """Looked through by the independent check, with the camera that the map knows."""
    for row in found.coverage.to_dict("records"):
        asked = found.tasks[row["target"]]
        viewpoint = found.viewpoints.iloc[row["viewpoint"]]
        camera = found.lens.camera_at(viewpoint["zoom"], viewpoint["focus"])
        pose = found.poses[row["viewpoint"]]
        seen = verify_viewpoint(
            camera, pose, asked.target, asked.seen_feature, asked.requirements, plate
        )
        assert seen.satisfied
        assert row["resolution_margin"] >= found.safety
        assert row["visibility_margin_mm"] > 0
    least = found.coverage.groupby("viewpoint")["smallest_margin"].min()
    np.testing.assert_array_equal(found.viewpoints["smallest_margin"], least)


def test_it_is_saved_and_placed_like_any_plan(found, tmp_path) -> None:
    body = read_document(found.save(tmp_path / "plan.json"), "covering-plan", 1)
    assert {row["target"] for row in body["coverage"]} == set("abcd")
    assert body["at_least"] == 2
    assert body["regions"]["a"]["audit"]["disagreements"] == 0
    assert set(body["made_from"]) == {"task a", "task b", "task c", "task d", "scene", "lens_map"}
    cell = replace(load_cell(REPOSITORY / "data" / "task.toml"), reach=None)
    sequence = as_sequence(place_plan(found, cell))
    assert len(sequence) == 2
    assert sequence.made_from == found.made_from


def test_one_that_nothing_covers_is_told_and_the_others_planned(plate, lens, bench) -> None:
    lid = bench.box((-125, -45, 6), (-35, 45, 9))
    tasks = [task("a", -80, 0), task("far", 0, 0, (Resolution(9, 0.254), FieldOfView(25)))]
    covered = Scene([*plate.meshes, lid])
    found = plan_all([*tasks, task("c", 80, 0)], lens, covered, audit_points=0, settings_tried=3)
    assert set(found.uncovered) == {"a", "far"}
    assert found.uncovered["a"].startswith("visibility: ")
    assert "contradict each other" in found.uncovered["far"]
    assert found.viewpoints["targets"].tolist() == ["c"]
    none = plan_all(tasks, lens, covered, audit_points=0, settings_tried=3)
    assert none.viewpoints.empty
    assert none.poses == ()
    assert none.reasons.keys() == set(none.uncovered.values())
    assert none.why_empty.startswith("none of the 2 targets can be seen as asked; a: visibility: ")
    with pytest.raises(PlanningError, match="nothing to place: the plan is empty .none of the 2"):
        place_plan(none, load_cell(REPOSITORY / "data" / "task.toml"))


def test_targets_that_ask_for_different_things(plate, lens_map) -> None:
    """One wants depth of field, so its iris is chosen; one wants the lens to stay clear."""
    body = CameraBody.barrel(front_mm=235.0, radius_mm=20.0, length_mm=200.0)
    deep = task("deep", -80, 0, (*ASKED, DepthOfField(1.0, 2.5)))
    clear = task("clear", -66, 5, (*ASKED, Clearance(body, 5.0)))
    found = plan_all([deep, clear], lens_map, plate, audit_points=0, settings_tried=3)
    assert found.viewpoints["targets"].tolist() == ["deep, clear"]
    assert np.isfinite(found.viewpoints["iris"]).all()
    table = found.coverage.set_index("target")
    assert table.loc[0, "depth_of_field_margin"] >= 0
    assert table.loc[1, "clearance_margin"] >= 0
    assert np.isnan(table.loc[1, "depth_of_field_margin"])
    assert np.isnan(table.loc[0, "clearance_margin"])
    touching = task("clear", -66, 5, (*ASKED, Clearance(body, 400.0)))
    left = plan_all([deep, touching], lens_map, plate, audit_points=0, settings_tried=3)
    assert left.uncovered["clear"].startswith("clearance")


def test_what_is_not_in_the_image_is_not_covered(plate, lens) -> None:
    """Without a field of view, the formula of resolution holds anywhere in the sharp plane."""
    tasks = [task("a", -80, 0, ASKED[:1]), task("c", -26, 0, ASKED[:1])]
    found = plan_all(tasks, lens, plate, audit_points=0, settings_tried=3)
    assert sorted(found.viewpoints["targets"]) == ["a", "c"]


def test_a_fixed_lens_and_a_lens_along_y(plate, paper_sensor) -> None:
    asked = (Resolution(2, 0.254, "y"), FieldOfView(8, "y"))
    tasks = [task("a", -80, 0, asked), task("b", -80, 8, asked)]
    found = plan_all(tasks, FixedLens(100, paper_sensor), plate, audit_points=0, settings_tried=5)
    assert found.viewpoints["targets"].tolist() == ["a, b"]
    np.testing.assert_allclose(found.poses[0].rotation[:, 1], [1, 0, 0], atol=1e-12)
    assert set(found.made_from) == {"task a", "task b", "scene"}


def test_progress_is_told(plate, lens) -> None:
    told = []

    def make(title):
        context = silent(title)
        context.enter_result = lambda done, total, last: told.append((title, done, total, last))
        return context

    plan_all([task("a", -80, 0)], lens, plate, audit_points=0, settings_tried=3, progress=make)
    assert told == [("planning", 1, 1, "a"), ("judging", 1, 1, "a")]


def test_tasks_need_names(plate, lens) -> None:
    with pytest.raises(PlanningError, match="there is no target to plan for"):
        plan_all([], lens, plate)
    with pytest.raises(PlanningError, match="several targets are called 'a'; give each a name"):
        plan_all([task("a", 0, 0), task("a", 9, 0)], lens, plate)


def test_confidence_counts_for_shared_viewpoints_too(plate, lens_map) -> None:
    cell = load_cell(REPOSITORY / "data" / "task.toml")
    tasks = [replace(t, confidence=0.99) for t in (task("a", -80, 0), task("b", -66, 5))]
    sure = plan_all(tasks, lens_map, plate, cell=cell, audit_points=0, settings_tried=3)
    assert sure.viewpoints["targets"].tolist() == ["a, b"]
    assert (sure.coverage["probability"] >= 0.99).all()
    shaky = replace(cell, part_covariance=np.diag([0.01] * 3 + [25.0] * 3))
    none = plan_all(tasks, lens_map, plate, cell=shaky, audit_points=0, settings_tried=3)
    assert all("confidence: 0.99 is asked" in why for why in none.uncovered.values())
