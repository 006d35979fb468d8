"""The main job from end to end: what it leaves, and that it holds against the truth.

Taking the pictures of 40 settings needs minutes. The project carries that very session; it stands
in for taking it again, and a part of it is taken again and compared to the last digits. With
`-m long` the demo takes all of it, and the same tests judge what comes of that.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from lenscal.calibration.table import CalibrationTable
from lenscal.errors import PlanningError, SessionError
from lenscal.maps.lens_map import LensMap
from lenscal.recording import Recording
from lenscal.rig.simulated import SimulatedRig
from lenscal.sequence import Sequence
from lenscal.session.plan import SessionPlan
from lenscal.session.runner import run_session
from lenscal.workflow import CalibratedLens
from planning import demo
from planning.requirements.resolution import Resolution

pytestmark = pytest.mark.timeout(600)


RECORDED = Path(__file__).parents[2] / "data" / "vicon-1990" / "session"


@pytest.fixture(
    scope="module", params=["session on record", pytest.param("all", marks=pytest.mark.long)]
)
def folder(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("demo") / "out"

    def on_record(plan, rig, folder, *, progress):
        assert plan.settings() == SessionPlan.model_validate(demo.SESSION).settings()
        assert rig.lens.identity == SimulatedRig.preset("vicon-1990", seed=0).lens.identity
        recording = Recording.load(RECORDED)
        recording.save(folder)
        return recording

    with pytest.MonkeyPatch.context() as patch:
        if request.param != "all":
            patch.setattr("lenscal.workflow.run_session", on_record)
        demo.run_demo(path, seed=0)
    return path


@pytest.fixture(scope="module")
def summary(folder):
    return json.loads((folder / "summary.json").read_text())


def test_the_map_is_the_lens(summary):
    """The bar is 1 % for d/D, everywhere in the domain; D is held more loosely by its nature."""
    assert summary["settings"] == 40
    assert summary["worst_magnification_error"] <= 0.01
    assert summary["worst_object_distance_error"] <= 0.04
    assert summary["worst_standoff_error_mm"] <= 0.4


def test_every_planned_viewpoint_holds_in_truth(summary):
    assert summary["viewpoints"] >= 4
    assert summary["viewpoints_verified"] == summary["viewpoints"]


def test_pictures_show_what_was_planned(folder, summary):
    """Measured on a ruler in the picture of the true lens; the paper's own bar is 3 px."""
    assert summary["worst_pictured_error_px"] < 1
    assert len(list(folder.glob("picture-*.png"))) == 2
    assert len(Sequence.load(folder / "sequence.json")) == summary["viewpoints"]


def test_viewpoints_look_through_both_holes(folder):
    plan = json.loads((folder / "plan.json").read_text())
    sides = {v["y_mm"] > 0 for v in plan["viewpoints"]}
    assert sides == {True, False}
    assert plan["region"]["audit"]["disagreements"] == 0


def test_everything_it_leaves_can_be_read_again(folder):
    recording = Recording.load(folder / "session")
    assert len(recording.settings) == 40
    assert all(len(s.views) >= 4 for s in recording.settings)
    table = CalibrationTable.load(folder / "table.csv")
    assert len(table) == 40
    lens_map = LensMap.load(folder / "map.json")
    assert lens_map.has_standoff
    for name in ("magnification", "object_distance", "focal_length", "region"):
        assert (folder / f"{name}.png").stat().st_size > 20_000


def test_the_session_that_the_project_carries_is_that_of_the_demo(request):
    plan = SessionPlan.load(request.config.rootpath / "data" / "vicon-1990" / "session.toml")
    ours = SessionPlan.model_validate(demo.SESSION)
    assert plan.model_copy(update={"keep_frames": True}) == ours


def test_that_session_is_what_the_rig_records_to_this_day(tmp_path):
    """Its first two settings: focused, looked at and detected again, with the noise of its seed."""
    ours = SessionPlan.model_validate(demo.SESSION)
    start = ours.model_copy(update={"zoom": ours.zoom[:1], "focus": ours.focus[:2]})
    rig = SimulatedRig.preset("vicon-1990", seed=0)
    again = run_session(start, rig, tmp_path / "session")
    for new, old in zip(again.settings, Recording.load(RECORDED).settings[:2], strict=True):
        assert new.setting == old.setting
        assert new.focus.distance_mm == pytest.approx(old.focus.distance_mm, abs=0.01)
        assert len(list((again.folder / "frames").rglob("*.png"))) == 10
        for view, recorded in zip(new.views, old.views, strict=True):
            # Other processors round otherwise, which may move a grey value by one.
            np.testing.assert_array_equal(view.observation.ids, recorded.observation.ids)
            np.testing.assert_allclose(
                view.observation.pixels, recorded.observation.pixels, rtol=0, atol=0.01
            )
            np.testing.assert_allclose(
                view.base_from_hand.matrix, recorded.base_from_hand.matrix, atol=1e-3
            )


def test_a_folder_that_holds_something_is_left_alone(folder):
    before = (folder / "summary.json").read_bytes()
    with pytest.raises(SessionError, match="is not empty: it may hold another session; choose ano"):
        demo.run_demo(folder, seed=0)
    assert (folder / "summary.json").read_bytes() == before


def test_without_viewpoints_the_demo_says_why(monkeypatch, tmp_path, folder):
    """Asked for more pixels than the lens can give, on the map that was just made."""
    done = CalibratedLens(
        Recording.load(folder / "session"),
        CalibrationTable.load(folder / "table.csv"),
        LensMap.load(folder / "map.json"),
    )
    monkeypatch.setattr(demo, "calibrate_lens", lambda *_, **__: done)
    monkeypatch.setattr(demo, "REQUIREMENTS", [Resolution(9, 0.254, axis="x")])
    with pytest.raises(PlanningError, match="found no viewpoint: no setting of this lens satisf"):
        demo.run_demo(tmp_path / "out", seed=0)
    assert (tmp_path / "out" / "plan.json").exists()
