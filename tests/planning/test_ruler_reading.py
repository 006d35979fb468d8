"""Reading rulers in pictures that are drawn here, with noise and blur."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter
from scipy.special import erf

from lenscal.errors import DetectionError
from planning.ruler_reading import edge_to_edge_px, read_ruler

TICKS = 51


def drawn(first=104.3, step=6.0, blur=0.8, around=60.0, face=150.0, ticks=TICKS, stretch=0.0):
    """A ruler on a face before something else; all edges at exact fractions of pixels."""
    columns = np.arange(512.0)

    def bar(left, right):
        root = blur * np.sqrt(2)
        return (erf((columns - left) / root) - erf((columns - right) / root)) / 2

    places = first + step * np.arange(ticks) + stretch * np.arange(ticks) ** 2
    last = places[-1]
    image = np.full((300, 512), around) + (face - around) * bar(places[0], last)
    strip = around + (220 - around) * bar(places[0] - step, last + step)
    ink = sum(bar(p - 0.2 * step, p + 0.2 * step) for p in places)
    image[125:175] = strip
    image[140:160] = strip - 200 * np.clip(ink, 0, 1)
    return gaussian_filter(image, (blur, 0)), places


@settings(max_examples=25, deadline=None)
@given(
    first=st.floats(20, 60),
    step=st.floats(5.0, 8.5),
    blur=st.floats(0.6, 1.2),
    around=st.sampled_from([20.0, 60.0, 140.0]),
    stretch=st.floats(-2e-3, 2e-3),
)
def test_ticks_are_found_to_a_tenth_of_a_pixel(first, step, blur, around, stretch) -> None:
    image, places = drawn(first, step, blur, around, stretch=stretch)
    noise = np.random.default_rng(0).normal(0, 1.5, image.shape)
    reading = read_ruler(np.clip(np.rint(image + noise), 0, 255).astype(np.uint8), TICKS)
    np.testing.assert_allclose(reading.ticks_px, places, atol=0.1)
    assert reading.row_px == pytest.approx(149.5, abs=1.0)
    assert reading.length_px == pytest.approx(places[-1] - places[0], abs=0.1)
    local = [np.diff(places[s]).mean() for s in (slice(0, 5), slice(23, 28), slice(-5, None))]
    np.testing.assert_allclose(reading.step_px, local, atol=0.03)


def test_edges_of_the_target_are_followed_across_the_ruler() -> None:
    image, places = drawn()
    assert edge_to_edge_px(image, read_ruler(image, TICKS)) == pytest.approx(
        places[-1] - places[0], abs=0.1
    )


def test_without_contrast_there_is_no_edge() -> None:
    image, _ = drawn(around=150.0)
    reading = read_ruler(image, TICKS)
    with pytest.raises(DetectionError, match="an edge of the target is not to be seen beside the"):
        edge_to_edge_px(image, reading)


@pytest.mark.parametrize("harm", ["cut", "blur", "blank"])
def test_a_ruler_that_is_not_whole_or_not_sharp(harm: str) -> None:
    image, _ = drawn()
    image = {
        "cut": image[:, 150:],
        "blur": gaussian_filter(image, 8.0),
        "blank": np.full((300, 512), 100.0),
    }[harm]
    with pytest.raises(DetectionError, match="shows .* ticks of a ruler that has 51; it must lie"):
        read_ruler(image, TICKS)
