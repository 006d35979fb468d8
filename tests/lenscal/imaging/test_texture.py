import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lenscal.artwork import Mosaic, TexelGrid, draw
from lenscal.errors import InputError
from lenscal.imaging.texture import Box, TargetSurface
from lenscal.plate import parse_target
from lenscal.target import Chessboard

EVERYTHING = Box(np.array([-100.0, -100.0]), np.array([100.0, 100.0]))


@settings(max_examples=30, deadline=None)
@given(st.floats(0.3, 9.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_ink_does_not_depend_on_the_grid(texels_per_mm, left_mm, top_mm):
    """Every texel is the mean over its area, so that they all hold as much ink as there is."""
    cells = np.array([[0, 255, 100], [30, 0, 255]], np.uint8)
    mosaic = Mosaic(cells, np.array([-1.7, 0.2, 1.0, 2.9]), np.array([-2.0, 0.5, 1.1]))
    margin = 6.0
    count = int(np.ceil((2 * margin + 1) * texels_per_mm))
    grid = TexelGrid(left_mm - margin, top_mm - margin, texels_per_mm, count, count)
    ink = (255 - draw([mosaic], grid).astype(float)).sum() / texels_per_mm**2
    size = np.outer(np.diff(mosaic.y_edges_mm), np.diff(mosaic.x_edges_mm))
    assert ink == pytest.approx(((255.0 - cells) * size).sum(), rel=0.01)


@pytest.mark.parametrize("spec", ["charuco:7x5:6mm:4.5mm", "circles:7x5:4mm:2mm"])
def test_a_part_is_drawn_as_it_is_in_the_whole(spec):
    patterns = parse_target(spec).patterns()
    whole = draw(patterns, TexelGrid(-20.0, -16.0, 7.3, 292, 233))
    part = draw(patterns, TexelGrid(-20.0 + 50 / 7.3, -16.0 + 80 / 7.3, 7.3, 100, 90))
    assert np.abs(part.astype(int) - whole[80:170, 50:150]).max() <= 1


def test_a_texture_has_paper_ink_and_an_end():
    texture = TargetSurface(Chessboard(4, 3, 2.0)).texture(EVERYTHING, 0.1)
    assert texture.texels_per_mm == pytest.approx(20.0)

    def at(x_mm, y_mm):
        column, row = (np.array([x_mm, y_mm]) - texture.origin_mm) * texture.texels_per_mm
        return texture.paper[round(row), round(column)], texture.sheet[round(row), round(column)]

    assert at(0.0, 1.0) == (0, 255)
    assert at(0.0, -1.0) == (255, 255)
    assert at(6.5, 0.0) == (255, 255)
    assert at(7.1, 0.0) == (0, 0)


def test_within_the_sheet_there_is_no_end():
    inside = Box(np.array([-3.0, -2.0]), np.array([1.0, 2.0]))
    assert TargetSurface(Chessboard(4, 3, 2.0)).texture(inside, 0.1).sheet is None


def test_a_drawing_does_not_grow_beyond_bounds():
    texture = TargetSurface(Chessboard(10, 10, 100.0)).texture(EVERYTHING, 1e-6)
    assert max(texture.paper.shape) <= 4096


def test_a_reflectance_beyond_white_is_refused():
    with pytest.raises(InputError, match="ink must be a reflectance between 0 and 1"):
        TargetSurface(Chessboard(4, 3, 2.0), ink=1.5)
