"""What cannot be planned with a lens is refused before any region is computed."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lenscal.errors import PlanningError
from planning import planner
from planning.camera_body import CameraBody
from planning.fixed_lens import FixedLens
from planning.placement import placeable
from planning.planner import plan
from planning.preconditions import refuse_unknown
from planning.requirements.clearance import Clearance
from planning.requirements.depth_of_field import DepthOfField
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.unvignetted import Unvignetted
from planning.several import plan_all
from planning.solid import box_workspace
from planning.target import Target
from planning.task import Task
from planning.task_file import load_cell

BARREL = CameraBody.barrel(front_mm=10.0, radius_mm=4.0, length_mm=30.0)


def test_what_the_lens_does_not_tell_is_refused(lens, paper_sensor) -> None:
    with pytest.raises(PlanningError, match="judge depth_of_field .* lens map does not know; cali"):
        refuse_unknown([FieldOfView(1), DepthOfField(1, 1)], lens)
    with pytest.raises(PlanningError, match="judge unvignetted .* this fixed lens does not know"):
        refuse_unknown([Unvignetted()], FixedLens(50, paper_sensor))
    with pytest.raises(PlanningError, match="to judge clearance .* this lens map has no nodal off"):
        refuse_unknown([Clearance(BARREL, 1)], replace(lens, has_standoff=False))
    refuse_unknown([Clearance(BARREL, 1)], lens)
    refuse_unknown([Clearance(BARREL, 1), Unvignetted()], FixedLens(50, paper_sensor, 4.0))


def test_before_any_region_is_computed(lens, bench, monkeypatch) -> None:
    def refuse(*_arguments, **_keywords):
        raise AssertionError

    monkeypatch.setattr(planner, "visibility_region", refuse)
    workspace = box_workspace((-50, -50, 400), (50, 50, 800))
    target = Target(bench.square)
    blind = Task(target, None, [FieldOfView(15), Unvignetted()], workspace, "a")
    scene = bench.scene(bench.block)
    for make in (plan, lambda task, *rest: plan_all([task], *rest)):
        with pytest.raises(PlanningError, match="needs the entrance-pupil diameter"):
            make(blind, lens, scene)


def test_a_cell_is_held_against_the_lens(request, lens, paper_sensor) -> None:
    cell = load_cell(request.config.rootpath / "data" / "task.toml")
    with pytest.raises(PlanningError, match="a fixed lens has no nodal offsets to place it by"):
        placeable(FixedLens(50, paper_sensor), cell)
    with pytest.raises(PlanningError, match="the lens map has no standoffs and nodal offsets"):
        placeable(replace(lens, has_standoff=False), cell)
