"""Admissible settings: between the contours, exactly, or the reason why not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from matplotlib import path as mpath

from lenscal.errors import InputError, PlanningError
from lenscal.maps.fit import fit_lens_map
from lenscal.sensor import Sensor
from planning.choices import choose_settings
from planning.fixed_lens import FixedLens
from planning.requirements.depth_of_field import DepthOfField
from planning.requirements.field_of_view import FieldOfView
from planning.requirements.resolution import Resolution
from planning.setting_area import MagnificationGrid, onto_contours
from planning.settings import admissible_settings, object_distance_bounds_mm

PAPER = (Resolution(3, 0.254, "x"), FieldOfView(25.4, "x"))


class Levels:
    """A requirement that is stated as d/D itself, for the paper's rounded ratios."""

    name, axis = "levels", "any"

    def __init__(self, low: float, high: float) -> None:
        self.bounds = (low, high)

    def magnification_bounds(self, sensor):
        return self.bounds

    def orthogonal_margin(self, magnification, sensor):
        raise NotImplementedError

    def describe(self, sensor):
        return f"d/D between {self.bounds[0]} and {self.bounds[1]}"


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
    grid = MagnificationGrid.over(lens)
    last = len(grid.zoom) - 1
    index = np.array([[last + 1e-13, 100.0], [np.nextafter(last, 999), last], [-1e-16, 0.0]])
    found = onto_contours(grid, index, (0.2, 0.3))
    np.testing.assert_allclose(found, [[109.0, 90.0], [109.0, 140.0], [90.0, 40.0]])


def test_bounds_on_d_are_its_true_extremes(lens) -> None:
    """D has its maximum between nodes inside, its minimum on a contour between vertices."""
    sensor = lens.sensor

    class Hill(type(lens)):
        def object_distance_mm(self, zoom, focus, outside="raise"):
            u, w = self._unit(zoom, focus, outside)
            return 700.0 - 3000.0 * ((u - 0.523) ** 2 + (w - 0.517) ** 2)

    # The band is bounded by 0.75 u + 0.25 w = const: the farthest point of a circle about the top.
    low = 0.14 * 2.5 ** (0.75 * 0.523 + 0.25 * 0.517 - 0.3)
    found = admissible_settings(Hill(sensor), [Levels(low, 0.34)])
    assert found.object_distance_bounds_mm[1] == pytest.approx(700.0, abs=1e-6)
    (polygon,) = found.polygons
    at = Hill(sensor).object_distance_mm(*polygon.outline.T)
    assert found.object_distance_bounds_mm[0] <= at.min()

    class Valley(Hill):
        def object_distance_mm(self, zoom, focus, outside="raise"):
            u, w = self._unit(zoom, focus, outside)
            return 700.0 + 3000.0 * ((u - 0.523) ** 2 + (w - 0.517) ** 2)

    # Nearest to the centre the contour is 0.1/√(0.75² + 0.25²) away.
    level = 0.14 * 2.5 ** (0.75 * 0.523 + 0.25 * 0.517 + 0.1)
    found = admissible_settings(Valley(sensor), [Levels(level, 0.34)])
    closest = 700.0 + 3000.0 * 0.1**2 / (0.75**2 + 0.25**2)
    assert found.object_distance_bounds_mm[0] == pytest.approx(closest, abs=1e-5)


@pytest.fixture(scope="module")
def strip_lens():
    """A map whose domain is a curved strip."""
    zoom = np.repeat(np.linspace(90.0, 109.0, 7), 5)
    middle = 60.0 + 70.0 * ((zoom - 90.0) / 19.0) ** 2
    focus = middle + np.tile(np.linspace(-15.0, 15.0, 5), 7)
    u, w = (zoom - 90.0) / 19.0, (focus - 40.0) / 100.0
    table = pd.DataFrame(
        {
            "zoom": zoom,
            "focus": focus,
            "magnification": 0.14 * 2.5 ** (0.75 * u + 0.25 * w),
            "object_distance_mm": 720.0 - 150.0 * u**2 - 60.0 * w,
            "standoff_mm": 385.0 - 15.0 * w,
        }
    )
    for name in ("magnification", "object_distance_mm", "standoff_mm"):
        table[f"sigma_{name}"] = 1e-4 * table[name]
    sensor = Sensor(512, 480, 0.023, 0.01375, scale_factor=0.70642)
    return fit_lens_map(table, sensor=sensor, log_smoothing={"core": np.full((3, 2), -9.0)})


def test_border_of_a_curved_domain_is_exact(strip_lens) -> None:
    assert not strip_lens.domain.is_rectangle
    found = admissible_settings(strip_lens, [Levels(0.17, 0.27)])
    (polygon,) = found.polygons
    zoom, focus = polygon.outline.T
    assert strip_lens.domain.contains(zoom, focus).all()
    ratio = strip_lens.magnification(zoom, focus)
    on_contour = np.minimum(np.abs(ratio - 0.17), np.abs(ratio - 0.27)) < 1e-9
    start = strip_lens.domain.outline
    stop = np.roll(start, -1, axis=0)
    along, away = stop - start, polygon.outline[:, None] - start
    cross = along[:, 0] * away[..., 1] - along[:, 1] * away[..., 0]
    inside = ((away * along).sum(-1) >= -1e-9) & (
        (away * along).sum(-1) <= (along**2).sum(-1) + 1e-9
    )
    on_outline = (inside & (np.abs(cross) < 1e-8)).any(axis=1)
    assert (on_contour | on_outline).all()
    assert (on_contour & on_outline).sum() == 4, "the strip is cut across at both levels"
    corners = strip_lens.domain.outline
    at = strip_lens.magnification(*corners.T)
    kept = corners[(at > 0.17) & (at < 0.27)]
    assert len(kept) > 3
    for corner in kept:
        assert np.abs(polygon.outline - corner).max(axis=1).min() < 1e-9
    outline = mpath.Path(polygon.outline)
    generator = np.random.default_rng(1)
    points = np.stack([generator.uniform(90, 109, 5000), generator.uniform(40, 150, 5000)], axis=-1)
    differ = outline.contains_points(points) != found.contains(*points.T)
    # Contours are chords between vertices: only a sliver is judged differently.
    assert differ.mean() < 1e-3


def test_contour_of_focal_length_within_the_band(strip_lens, paper_sensor: Sensor) -> None:
    """1.5.3.3: the f = 5 in contour between both limits, with D along it."""
    found = admissible_settings(strip_lens, [Levels(0.18, 0.26)])
    focal = float(strip_lens.focal_length_mm(100.0, 82.0))
    curves = found.along("focal_length_mm", focal)
    assert curves
    for curve in curves:
        assert found.contains(curve.zoom, curve.focus).all()
        np.testing.assert_allclose(curve.value("focal_length_mm"), focal, rtol=1e-9)
        distance = curve.value("object_distance_mm")
        assert (distance >= found.object_distance_bounds_mm[0] - 1e-6).all()
        assert (distance <= found.object_distance_bounds_mm[1] + 1e-6).all()
    assert admissible_settings(strip_lens, [Levels(0.5, 0.6)]).along("focal_length_mm", focal) == []
    fixed = admissible_settings(FixedLens(127, paper_sensor), PAPER)
    with pytest.raises(InputError, match="a fixed lens has no zoom and focus"):
        fixed.along("focal_length_mm", 127)


def test_direct_solution_agrees_with_the_iterative_one(paper_sensor: Sensor) -> None:
    """Cowan and Kovesi (1988) iterate: D from the magnification at a guessed d, d from (3a)."""
    generator = np.random.default_rng(2)
    for _ in range(200):
        focal, pixels = generator.uniform(8, 200), generator.uniform(1, 5)
        resolution, view = Resolution(pixels, 0.254, "x"), FieldOfView(10.0, "x")
        limits = (
            view.magnification_bounds(paper_sensor)[1],
            resolution.magnification_bounds(paper_sensor)[0],
        )
        found = object_distance_bounds_mm(focal, paper_sensor, [resolution, view])
        for ratio, distance in zip(limits, found, strict=True):
            image_distance = focal
            for _ in range(2000):
                guess = image_distance / ratio
                image_distance += (
                    0.3 * (1.0 / (1.0 / focal - 1.0 / guess) - image_distance)
                    if (guess > focal)
                    else 0.3 * image_distance
                )
            assert guess == pytest.approx(distance, rel=1e-6)


def test_depth_of_field_bounds_a_fixed_lens_too(paper_sensor: Sensor) -> None:
    depth = DepthOfField(4.0, 1.5)
    lens = FixedLens.with_f_number(127, paper_sensor, 8.0)
    assert lens.entrance_pupil_diameter_mm == pytest.approx(127 / 8)
    nearest = object_distance_bounds_mm(127, paper_sensor, [depth], 127 / 8)[0]
    image_distance = 127 * nearest / (nearest - 127)
    blur = 127 / 8 * image_distance * (1 / (nearest - 2) - 1 / nearest)
    assert blur == pytest.approx(1.5 * 0.01375)
    both = admissible_settings(lens, [*PAPER, DepthOfField(1.0, 1.5)])
    assert both.object_distance_bounds_mm[1] / 25.4 == pytest.approx(31.06, abs=5e-3)
    without = admissible_settings(lens, PAPER).object_distance_bounds_mm[0]
    assert both.object_distance_bounds_mm[0] >= without
    deep = admissible_settings(lens, [*PAPER, DepthOfField(40.0, 1.5)])
    assert deep.why_empty.startswith("the requirements contradict each other with this lens")
    assert "needs D of at most 788.8 mm" in deep.why_empty
    assert "depth of field of 40 mm within 1.5 px of blur at least" in deep.why_empty
    with pytest.raises(PlanningError, match="at least .* mm; close the iris"):
        object_distance_bounds_mm(127, paper_sensor, [*PAPER, DepthOfField(40.0, 1.5)], 127 / 8)
    with pytest.raises(PlanningError, match="need the entrance-pupil diameter"):
        object_distance_bounds_mm(127, paper_sensor, [depth])
    with pytest.raises(InputError, match="f_number must be a positive number"):
        FixedLens.with_f_number(127, paper_sensor, 0)
    with pytest.raises(InputError, match="entrance_pupil_diameter_mm must be a positive number"):
        FixedLens(127, paper_sensor, -1.0)


def test_depth_of_field_with_diffraction_bounds_d_by_its_root(paper_sensor: Sensor) -> None:
    lens = FixedLens(127, paper_sensor, 6.0)
    plain = DepthOfField(10.0, 2.5).object_distance_bounds_mm(lens)[0]
    nearest = DepthOfField(10.0, 2.5, 550).object_distance_bounds_mm(lens)[0]
    assert nearest > plain
    image_distance = 127 * nearest / (nearest - 127)
    geometric = 6.0 * image_distance * (1 / (nearest - 5) - 1 / nearest)
    airy = 2.44 * 550e-6 * image_distance / 6.0
    assert np.hypot(geometric, airy) == pytest.approx(2.5 * 0.01375)
    with pytest.raises(PlanningError, match="diffraction alone blurs by .* open the iris"):
        DepthOfField(10.0, 0.5, 550).object_distance_bounds_mm(lens)
