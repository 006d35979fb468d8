from pathlib import Path

import pytest
from matplotlib.figure import Figure

from lenscal.maps.lens_map import LensMap
from lenscal.plots.maps import draw_contours, draw_limits


@pytest.fixture(scope="module")
def lens_map():
    return LensMap.load(Path(__file__).parents[3] / "data" / "vicon-1990" / "map.json")


@pytest.fixture
def axes():
    return Figure().add_subplot()


@pytest.mark.parametrize("quantity", ["magnification", "object_distance_mm", "k1_per_mm2"])
def test_a_map_is_drawn_with_names_and_units(axes, lens_map, quantity):
    assert draw_contours(axes, lens_map, quantity) is axes
    assert axes.get_xlabel() == "zoom setting"
    assert axes.get_ylabel() == "focus setting"
    assert axes.get_title()
    colour_bar = axes.figure.axes[1]
    assert colour_bar.get_ylabel() == axes.get_title()
    (samples,) = axes.get_lines()
    assert len(samples.get_xdata()) == len(lens_map.samples)


def test_asked_levels_are_drawn(axes, lens_map):
    draw_contours(axes, lens_map, "magnification", levels=[0.2, 0.25])
    assert {"0.20", "0.25"} <= {text.get_text() for text in axes.texts}


def test_limits_lie_on_their_contours_and_those_beyond_are_named(axes, lens_map):
    draw_contours(axes, lens_map, "focal_length_mm")
    draw_limits(axes, lens_map, "magnification", {"resolution": 0.2, "field of view": 0.9})
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert "resolution" in labels
    assert "field of view (beyond this map)" in labels
    line = next(line for line in axes.get_lines() if line.get_label() == "resolution")
    values = lens_map.magnification(line.get_xdata(), line.get_ydata())
    assert abs(values - 0.2).max() < 1e-9
