"""Equations (3) to (8), on numbers that one can do by hand and on those that the paper prints."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lenscal import optics
from lenscal.sensor import Sensor
from lenscal.units import MM_PER_INCH

PAPER = Sensor(512, 480, 0.023, 0.01375, scale_factor=0.70642)
lengths = st.floats(1.0, 1e5)


def test_two_focal_lengths_away_the_image_is_as_large_as_the_object():
    assert optics.focal_length_mm(100.0, 100.0) == 50.0
    assert optics.magnification(100.0, 100.0) == 1.0


@given(lengths, st.floats(1e-3, 10.0))
def test_direct_solutions_obey_the_lens_law(focal_length, ratio):
    distance = optics.object_distance_mm(ratio, focal_length)
    image = optics.image_distance_mm(ratio, focal_length)
    assert optics.focal_length_mm(distance, image) == pytest.approx(focal_length, rel=1e-12)
    assert optics.magnification(distance, image) == pytest.approx(ratio, rel=1e-12)


def test_the_papers_resolution_limit():
    """(10): 3 px per 0.01 in."""
    limit = optics.resolution_limit(PAPER, 3, 0.01 * MM_PER_INCH, "x")
    assert limit == pytest.approx(0.1919, abs=5e-5)


def test_the_papers_field_of_view_limit():
    """(12): 512 px for 1 in."""
    assert optics.field_of_view_limit(PAPER, MM_PER_INCH, "x") == pytest.approx(0.3275, abs=5e-5)


@pytest.mark.parametrize(
    ("ratio", "inches"), [(0.192, 31.04), (0.327, 20.29)], ids=["resolution", "field of view"]
)
def test_the_papers_fixed_lens(ratio, inches):
    """1.5.3.3: a focal length of 5 in, from the rounded ratios that the paper prints."""
    assert optics.object_distance_mm(ratio, 5.0) == pytest.approx(inches, abs=5e-3)


def test_blur_vanishes_in_the_sharp_plane_and_depth_of_field_is_where_it_is_allowed():
    near, far = optics.depth_of_field_mm(660.0, 130.0, 10.0, 0.016)
    blur = optics.blur_diameter_mm(np.array([near, 660.0, far]), 660.0, 130.0, 10.0)
    np.testing.assert_allclose(blur, [0.016, 0.0, 0.016], rtol=1e-9, atol=1e-15)


def test_beyond_the_hyperfocal_distance_all_is_sharp():
    near, far = optics.depth_of_field_mm(10_000.0, 10.0, 1.0, 0.01)
    assert near == pytest.approx(909.09, abs=0.01)
    assert far == np.inf
