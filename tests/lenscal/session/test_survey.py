"""Looking a plate over before focusing."""

from dataclasses import replace

import numpy as np
import pytest

from lenscal.errors import FocusError
from lenscal.plate import parse_target
from lenscal.rig.simulated import SimulatedRig
from lenscal.session.plan import SessionPlan
from lenscal.session.survey import survey_disks
from lenscal.setting import LensSetting

#: The plate of the paper's rig as it is, and a part that is stated and not there.
REAL = "charuco:17x13:3mm:2.25mm@0,0+disk:6mm@0,27"
SETTING = LensSetting(98.0, 100.0)


def plan_of(nearest, farthest, step, focus_iris, view_iris):
    return SessionPlan.model_validate(
        {
            "zoom": (0.0,),
            "focus": (0.0,),
            "autofocus": {
                "nearest": f"{nearest} mm",
                "farthest": f"{farthest} mm",
                "step": f"{step} mm",
                "iris": focus_iris,
            },
            "views": {"iris": view_iris},
        }
    )


def vicon_believing(target):
    return replace(SimulatedRig.preset("vicon-1990", seed=1), target=parse_target(target))


def check(survey, truth, sensor):
    """The sharp standoff lies inside the sweep, and the disk is of a good size."""
    assert survey.standoffs_mm[0] < truth.standoff_mm < survey.standoffs_mm[-1]
    np.testing.assert_allclose(np.diff(1 / np.array(survey.standoffs_mm), n=2), 0, atol=1e-12)
    assert len(survey.standoffs_mm) == 9
    assert 60 < survey.disk.diameter_px(truth.magnification, sensor) < 480
    assert survey.magnification(truth.standoff_mm) == pytest.approx(truth.magnification, rel=0.1)


def test_a_disk_that_does_not_fit_in_is_passed_over():
    rig = vicon_believing(REAL + "+disk:80mm@300,0")
    survey = survey_disks(rig, plan_of(340, 420, 8, 100, 20), SETTING)
    assert survey.disk.number == 1
    check(survey, rig.truth(SETTING), rig.camera.sensor)
    assert rig.lens.setting == SETTING.with_iris(100.0)


def test_a_depth_of_field_that_is_too_long_to_tell_makes_it_open_the_iris():
    rig = SimulatedRig.preset("machine-vision", seed=1)
    setting = LensSetting(400.0, 6560.0)
    plan = plan_of(340, 440, 20, 75, 5)
    irises = []
    grab = rig.camera.grab
    watched = type("Watched", (type(rig.camera),), {})
    rig.camera.__class__ = watched
    watched.grab = lambda _, window=None: irises.append(rig.lens.setting.iris) or grab(window)
    survey = survey_disks(rig, plan, setting)
    check(survey, rig.truth(setting), rig.camera.sensor)
    assert set(irises) == {5.0, 75.0}
    assert irises == sorted(irises)


def test_a_plate_that_is_not_there_is_said_so():
    rig = vicon_believing("charuco:17x13:3mm:2.25mm@0,0+disk:6mm@250,0+disk:7mm@300,0")
    with pytest.raises(
        FocusError,
        match="no disk of the plate can be seen from 340 to 420 mm at zoom 98.*; the last one: ",
    ):
        survey_disks(rig, plan_of(340, 420, 8, 100, 20), SETTING)


def test_a_disk_that_suits_and_is_not_there_is_said_so():
    """The larger disk would suit, and only the smaller one is there."""
    rig = vicon_believing(REAL + "+disk:15mm@250,0")
    with pytest.raises(
        FocusError,
        match="none of the disks is sharp enough to be seen from 340 to 420 mm at zoom 98, focus "
        "100; search a longer range, or in smaller steps",
    ):
        survey_disks(rig, plan_of(340, 420, 8, 100, 20), SETTING)
