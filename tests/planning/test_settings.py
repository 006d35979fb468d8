"""Admissible settings: between the contours, exactly, or the reason why not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lenscal.errors import InputError, PlanningError
from lenscal.sensor import Sensor
from planning.choices import choose_settings
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.resolution import Resolution
from planning.fixed_lens import FixedLens
from planning.settings import admissible_settings, object_distance_bounds_mm

PAPER = (Resolution(3, 0.254, "x"), FieldOfView(25.4, "x"))


class Levels:
    """A requirement that is stated as d/D itself, for the paper's rounded ratios."""

    name, axis = "levels", "any"

    def __init__(self, low: float, high: float) -> None:
        self.bounds = (low, high)

    def magnification_bounds(self, sensor):
        return self.bounds


def test_fixed_lens_of_the_paper(paper_sensor: Sensor) -> None:
    """f = 5 in: 20.27 to 31.06 in, and 20.29 to 31.04 in from the ratios that it rounds."""
    nearest, farthest = object_distance_bounds_mm(5 * 25.4, paper_sensor, PAPER)
    assert nearest / 25.4 == pytest.approx(20.27, abs=5e-3)
    assert farthest / 25.4 == pytest.approx(31.06, abs=5e-3)
    nearest, farthest = object_distance_bounds_mm(127, paper_sensor, [Levels(0.192, 0.327)])
    assert nearest / 25.4 == pytest.approx(20.29, abs=5e-3)
    assert farthest / 25.4 == pytest.approx(31.04, abs=5e-3)


def test_fixed_lens_is_bounded_only_by_what_is_asked(paper_sensor: Sensor) -> None:
    assert object_distance_bounds_mm(127, paper_sensor, PAPER[1:])[1] == np.inf
    assert object_distance_bounds_mm(127, paper_sensor, PAPER[:1])[0] == 127
    found = admissible_settings(FixedLens(127, paper_sensor), PAPER)
    assert found.object_distance_bounds_mm == object_distance_bounds_mm(127, paper_sensor, PAPER)
    assert admissible_settings(FixedLens(127, paper_sensor), PAPER[1:]).is_empty is False
    with pytest.raises(InputError, match="a fixed lens has no zoom and focus"):
        found.contains(100, 100)
    with pytest.raises(InputError, match="focal_length_mm must be a positive number"):
        FixedLens(0, paper_sensor)
    with pytest.raises(PlanningError, match="the requirements contradict each other"):
        object_distance_bounds_mm(127, paper_sensor, [Resolution(6, 0.254, "x"), PAPER[1]])


def test_border_lies_exactly_on_the_contours(lens) -> None:
    found = admissible_settings(lens, PAPER)
    low, high = found.magnification_bounds
    (polygon,) = found.polygons
    ratio = lens.magnification(*polygon.outline.T)
    zoom, focus = polygon.outline.T
    (z0, z1), (f0, f1) = lens.domain.zoom, lens.domain.focus
    on_border = (zoom == z0) | (zoom == z1) | (focus == f0) | (focus == f1)
    on_contour = (np.abs(ratio - low) < 1e-12) | (np.abs(ratio - high) < 1e-12)
    assert (on_border | on_contour).all()
    assert on_contour.sum() > 200
    assert (ratio >= low - 1e-12).all()
    assert (ratio <= high + 1e-12).all()


def test_bounds_and_membership_follow_the_map(lens) -> None:
    found = admissible_settings(lens, PAPER)
    generator = np.random.default_rng(0)
    zoom, focus = generator.uniform(85, 112, 4000), generator.uniform(30, 150, 4000)
    ratio = lens.magnification(zoom, focus, outside="nan")
    low, high = found.magnification_bounds
    inside = (ratio >= low) & (ratio <= high)
    np.testing.assert_array_equal(found.contains(zoom, focus), inside)
    distance = lens.object_distance_mm(zoom[inside], focus[inside])
    assert found.object_distance_bounds_mm[0] <= distance.min()
    assert found.object_distance_bounds_mm[1] >= distance.max()
    np.testing.assert_allclose(
        found.object_distance_bounds_mm, [distance.min(), distance.max()], atol=5
    )
    assert found.standoff_bounds_mm == (370, 385)


def test_one_sided_and_narrow_bands(lens) -> None:
    assert len(admissible_settings(lens, PAPER[:1]).polygons) == 1
    assert len(admissible_settings(lens, PAPER[1:]).polygons) == 1
    narrow = admissible_settings(lens, [Levels(0.25, 0.25 * (1 + 1e-6))])
    ratio = np.concatenate([lens.magnification(*p.outline.T) for p in narrow.polygons])
    assert np.abs(ratio - 0.25).max() < 1e-6


def test_contradiction_comes_before_the_lens(lens) -> None:
    found = admissible_settings(lens, [Resolution(6, 0.254, "x"), PAPER[1]])
    assert found.is_empty
    assert found.why_empty.startswith("the requirements contradict each other whatever the lens")
    assert found.polygons == ()


def test_lens_that_cannot_reach_says_by_how_much(lens) -> None:
    found = admissible_settings(lens, [Resolution(6, 0.254, "x")])
    assert "no setting of this lens satisfies the resolution of 6 px" in found.why_empty
    assert "reaches d/D from 0.1400 to 0.3500, and 9.7% higher is needed" in found.why_empty
    found = admissible_settings(lens, [FieldOfView(80, "x")])
    assert "no setting of this lens satisfies the field of view of 80 mm" in found.why_empty
    assert "25.7% lower is needed" in found.why_empty


def test_sensor_must_be_that_of_the_lens(lens, paper_sensor: Sensor) -> None:
    other = Sensor(640, 480, 0.01, 0.01)
    with pytest.raises(InputError, match="is not the one that the lens was calibrated with"):
        admissible_settings(lens, PAPER, sensor=other)
    without = replace(lens, sensor=None)
    with pytest.raises(InputError, match="the lens map was made without a sensor"):
        admissible_settings(without, PAPER)
    stated = admissible_settings(without, PAPER, sensor=paper_sensor)
    assert stated.magnification_bounds == admissible_settings(lens, PAPER).magnification_bounds


def test_map_without_robot_has_no_standoff(lens) -> None:
    found = admissible_settings(replace(lens, has_standoff=False), PAPER)
    assert found.standoff_bounds_mm is None
    assert choose_settings(found, 5)["standoff_mm"].isna().all()


def test_choice_holds_both_limits_and_the_middle(lens) -> None:
    found = admissible_settings(lens, PAPER, safety=0.005)
    chosen = choose_settings(found, 9)
    low, high = found.magnification_bounds
    assert len(chosen) == 9
    assert chosen["magnification"].min() == pytest.approx(low, rel=1e-3)
    assert chosen["magnification"].max() == pytest.approx(high, rel=1e-3)
    assert (chosen["magnification"] - (low + high) / 2).abs().min() < 0.05 * (high - low)
    assert chosen["magnification"].between(low * (1 - 1e-9), high * (1 + 1e-9)).all()
    assert not chosen[["zoom", "focus"]].duplicated().any()
    np.testing.assert_allclose(
        chosen["standoff_mm"], chosen["object_distance_mm"] - chosen["nodal_offset_mm"]
    )


def test_choice_for_a_fixed_lens_spans_its_range(paper_sensor: Sensor) -> None:
    lens = FixedLens(127, paper_sensor)
    chosen = choose_settings(admissible_settings(lens, PAPER), 5)
    nearest, farthest = object_distance_bounds_mm(127, paper_sensor, PAPER)
    np.testing.assert_allclose(chosen["object_distance_mm"].iloc[[0, -1]], [nearest, farthest])
    law = 1 / chosen["object_distance_mm"] + 1 / chosen["image_distance_mm"]
    np.testing.assert_allclose(law, 1 / 127)
    unbounded = choose_settings(admissible_settings(lens, PAPER[1:]), 5)
    assert np.isfinite(unbounded["object_distance_mm"]).all()


def test_rounding_beyond_the_last_line_of_the_grid_does_no_harm(lens) -> None:
    """The tracer may place a vertex a few ulp outside of the grid."""
    from planning.setting_area import _onto_contours

    zoom, focus = np.linspace(*lens.domain.zoom, 5), np.linspace(*lens.domain.focus, 5)
    index = np.array([[4.0 + 1e-15, 2.0], [np.nextafter(4.0, 5.0), 4.0], [-1e-16, 0.0]])
    found = _onto_contours(lens, zoom, focus, index, (0.2, 0.3))
    np.testing.assert_allclose(found, [[109.0, 90.0], [109.0, 140.0], [90.0, 40.0]])
