"""Resolution and field of view: the paper's numbers, and views that are not the ideal one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lenscal.camera import Camera
from lenscal.errors import InputError, PlanningError
from lenscal.pose import Pose
from lenscal.sensor import Sensor
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.incidence import Incidence
from planning.requirements.magnification import (
    contradiction,
    image_axis,
    required_magnification,
)
from planning.requirements.resolution import Resolution
from planning.target import Target
from planning.views import Subject, Views

INCH = Target.segment((-12.7, 0, 0), (12.7, 0, 0))


def seen(requirement, camera: Camera, camera_from_part: Pose) -> float:
    """Share of the margin of one view of the inch."""
    pose = camera_from_part.inverse()
    return float(requirement.margin(Views.through(camera, pose, Subject(INCH))).share[0, 0])


def test_numbers_of_the_paper(paper_sensor: Sensor) -> None:
    """(10) and (12): 3 px on 0.01 in, and 512 px for 1 in."""
    low = Resolution(3, 0.254, "x").magnification_bounds(paper_sensor)[0]
    high = FieldOfView(25.4, "x").magnification_bounds(paper_sensor)[1]
    assert low == pytest.approx(0.1919, abs=5e-5)
    assert high == pytest.approx(0.3275, abs=5e-5)
    both = [Resolution(3, 0.254, "x"), FieldOfView(25.4, "x")]
    assert required_magnification(both, paper_sensor) == (low, high)
    tightened = required_magnification(both, paper_sensor, safety=0.01)
    assert tightened == pytest.approx((low * 1.01, high * 0.99))


def test_unknown_roll_takes_the_smaller_side_and_the_coarser_pitch(paper_sensor: Sensor) -> None:
    assert FieldOfView(25.4).magnification_bounds(paper_sensor)[1] == pytest.approx(6.6 / 25.4)
    coarse = Resolution(3, 0.254).magnification_bounds(paper_sensor)[0]
    assert coarse == Resolution(3, 0.254, "x").magnification_bounds(paper_sensor)[0]


def test_margins_are_signed_shares_of_the_limit(paper_sensor: Sensor) -> None:
    resolution, view = Resolution(3, 0.254, "x"), FieldOfView(25.4, "x")
    limit = resolution.magnification_bounds(paper_sensor)[0]
    margin = resolution.orthogonal_margin(np.array([0.9, 1.0, 1.2]) * limit, paper_sensor)
    np.testing.assert_allclose(margin.share, [-0.1, 0, 0.2], atol=1e-12)
    np.testing.assert_allclose(margin.value, margin.share * limit)
    assert margin.unit == "d/D"
    assert margin.binds == "resolution of 3 px on 0.254 mm along x (d/D ≥ 0.1919)"
    limit = view.magnification_bounds(paper_sensor)[1]
    margin = view.orthogonal_margin(np.array([0.9, 1.0, 1.2]) * limit, paper_sensor)
    np.testing.assert_allclose(margin.share, [0.1, 0, -0.2], atol=1e-12)
    assert margin.binds == "field of view of 25.4 mm along x (d/D ≤ 0.3275)"


@settings(max_examples=25, deadline=None)
@given(st.floats(0.1, 0.4), st.floats(300, 900))
def test_orthogonal_view_gives_the_same_margins_in_the_image(ratio: float, distance: float) -> None:
    """With the whole camera model, as long as it has nothing to add."""
    sensor = Sensor(512, 480, 0.023, 0.01375, scale_factor=0.70642)
    camera = Camera(sensor, ratio * distance)
    pose = Pose(np.eye(3), np.array([0, 0, distance]))
    for requirement in (Resolution(3, 0.254, "x"), Resolution(2, 0.5), FieldOfView(25.4, "x")):
        ideal = requirement.orthogonal_margin(ratio, sensor).share
        assert seen(requirement, camera, pose) == pytest.approx(float(ideal), abs=1e-9)


def test_distortion_and_principal_point_cost_margin(paper_sensor: Sensor) -> None:
    pose = Pose(np.eye(3), np.array([0, 0, 600.0]))
    ideal = Camera(paper_sensor, 150.0)
    shifted = Camera(
        paper_sensor, 150.0, principal_point_px=paper_sensor.centre_px + np.array([10, 0])
    )
    view = FieldOfView(25.4, "x")
    lost = seen(view, ideal, pose) - seen(view, shifted, pose)
    assert lost == pytest.approx(10 / 256)
    barrel = Camera(paper_sensor, 150.0, k1_per_mm2=0.01)
    resolution = Resolution(3, 0.254, "x")
    assert seen(resolution, barrel, pose) < seen(resolution, ideal, pose) - 0.05


def test_a_camera_cannot_be_focused_on_what_is_behind_it(paper_sensor: Sensor) -> None:
    behind = Pose(np.eye(3), np.array([0, 0, -600.0]))
    with pytest.raises(InputError, match="object_distance_mm must be positive, but is -600 mm"):
        seen(FieldOfView(25.4), Camera(paper_sensor, 150.0), behind)


def test_other_requirements_leave_d_over_d_alone(paper_sensor: Sensor) -> None:
    assert required_magnification([Incidence(30)], paper_sensor) == (0.0, np.inf)
    assert contradiction([Incidence(30)], paper_sensor) == ""
    assert image_axis([Incidence(30), Resolution(3, 1, "y")]) == "y"


def test_contradiction_names_both_requirements(paper_sensor: Sensor) -> None:
    requirements = [Resolution(6, 0.254, "x"), FieldOfView(25.4, "x")]
    why = contradiction(requirements, paper_sensor)
    assert "resolution of 6 px on 0.254 mm along x (d/D ≥ 0.3838)" in why
    assert "field of view of 25.4 mm along x (d/D ≤ 0.3275)" in why
    assert "ask for at least 14.7% less resolution" in why
    assert contradiction(requirements[1:], paper_sensor) == ""
    tight = [Resolution(5.1, 0.254, "x"), FieldOfView(25.4, "x")]
    assert contradiction(tight, paper_sensor) == ""
    assert "each kept by 0.01 of itself" in contradiction(tight, paper_sensor, safety=0.01)


def test_axis_of_the_image() -> None:
    assert image_axis([Resolution(3, 1)]) == "any"
    assert image_axis([Resolution(3, 1), FieldOfView(3, "y")]) == "y"
    with pytest.raises(PlanningError, match="one requirement is along x and another along y"):
        image_axis([Resolution(3, 1, "x"), FieldOfView(3, "y")])


@pytest.mark.parametrize("make", [lambda: Resolution(0, 1), lambda: Resolution(1, -1)])
def test_numbers_must_be_positive(make) -> None:
    with pytest.raises(InputError, match="must be a positive number"):
        make()
    with pytest.raises(InputError, match="length_mm must be a positive number"):
        FieldOfView(float("nan"))
