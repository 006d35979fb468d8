"""Surfaces in space, exact contour lines and their labels."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from lenscal.maps.lens_map import LensMap
from lenscal.plots.maps import draw_curves, draw_lines, draw_surface


@pytest.fixture(scope="module")
def lens_map():
    return LensMap.load(Path(__file__).parents[3] / "data" / "vicon-1990" / "map.json")


@pytest.mark.parametrize("quantity", ["magnification", "object_distance_mm"])
def test_a_surface_stands_above_the_settings(lens_map, quantity):
    axes = Figure().add_subplot(projection="3d")
    assert draw_surface(axes, lens_map, quantity) is axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("zoom setting", "focus setting")
    assert "d/D" in axes.get_zlabel() or "(mm)" in axes.get_zlabel()
    low, high = lens_map.range_of(quantity)
    bottom, top = axes.get_zlim()
    assert bottom <= low
    assert high <= top
    assert top - bottom < 1.3 * (high - low)


def test_lines_are_exact_and_levels_beyond_are_left_out(lens_map):
    axes = Figure().add_subplot()
    lines = draw_lines(axes, lens_map, "magnification", [0.3, 0.2, 7.0])
    assert list(lines.levels) == [0.2, 0.3]
    for level, path in zip(lines.levels, lines.get_paths(), strict=True):
        on_line = path.vertices
        # Where a label interrupts it, a line gains ends between its vertices.
        values = lens_map.value("magnification", *on_line.T, outside="nan")
        assert np.nanmax(np.abs(values - level)) < 1e-4
        assert np.nanmedian(np.abs(values - level)) < 1e-12


def test_labels_keep_clear_of_the_border(lens_map):
    axes = Figure().add_subplot()
    lines = draw_lines(axes, lens_map, "focal_length_mm", 12)
    assert lines.labelTexts
    span = np.ptp(lens_map.domain.zoom)
    for text in lines.labelTexts:
        assert lens_map.domain.zoom[0] + 0.01 * span < text.get_position()[0]
        assert text.get_position()[0] < lens_map.domain.zoom[1] - 0.01 * span
    levels = [text.get_text() for text in lines.labelTexts]
    assert len(set(levels)) == len(levels)


def test_more_curves_than_styles_are_all_drawn(lens_map):
    axes = Figure().add_subplot()
    curves = {
        f"{level:g}": lens_map.contour("magnification", level)
        for level in (0.18, 0.2, 0.22, 0.24, 0.26)
    }
    draw_curves(axes, curves | {"none": []})
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["0.18", "0.2", "0.22", "0.24", "0.26", "none (beyond this map)"]
