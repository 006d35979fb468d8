"""Intervals are found however short, and poles do no harm."""

import numpy as np
import pytest

from lenscal.rig.simulated.focus_strip import interval_between


def between(value, low, high, travel=(0.0, 1000.0)):
    return interval_between(value, lambda _: low, lambda _: high, travel)


@pytest.mark.parametrize("width", [300.0, 1.0, 1e-3])
def test_an_interval_of_any_length(width):
    found = between(lambda x: (x - 400.0) / width, 0.0, 1.0)
    assert found == pytest.approx((400.0, 400.0 + width), abs=1e-8)


def test_the_ends_of_the_travel_bound_it():
    assert between(lambda x: x, -5.0, 2000.0) == (0.0, 1000.0)
    assert between(lambda x: x, 400.0, 2000.0) == pytest.approx((400.0, 1000.0))


def test_a_pole_is_no_end():
    """1/(x − 700) changes its sign there, and lies between 0.002 and 0.01 far above only."""
    found = between(lambda x: 1.0 / (x - 700.001), 0.004, 0.01)
    assert found == pytest.approx((800.001, 950.001))


def test_none_when_there_is_none():
    assert between(np.sin, 2.0, 3.0) is None
