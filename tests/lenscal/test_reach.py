import numpy as np
import pytest

from lenscal.errors import InputError, OutOfRangeError
from lenscal.pose import Pose
from lenscal.reach import Reach

DOWN = Pose.from_rotation_vector([np.pi, 0, 0]).rotation


def hand(place, tilt_deg=0.0):
    turn = Pose.from_rotation_vector([np.radians(tilt_deg), 0, 0]).rotation
    return Pose(turn @ DOWN, np.array(place, float))


def test_what_lies_inside_and_looks_down_can_be_reached():
    reach = Reach([0, 0, 0], [10, 10, 10], 30)
    reach.check(hand([0, 10, 5], 29.9))
    Reach([0, 0, 0], [10, 10, 10]).check(hand([1, 1, 1], 170))


def test_beyond_reach_says_by_how_much():
    reach = Reach([0, 0, 0], [10, 10, 10], 30)
    with pytest.raises(OutOfRangeError, match=r"y = 12.5 mm of the hand .* 0 to 10 mm, by 2.5 mm"):
        reach.check(hand([1, 12.5, 1]))
    with pytest.raises(OutOfRangeError, match="cannot tilt 40.0 degrees from .* 30 are allowed"):
        reach.check(hand([1, 1, 1], 40))


def test_a_reach_that_is_none():
    with pytest.raises(InputError, match=r"must run from a low corner to a high one.*\[0.0, 0.0"):
        Reach([0, 0, 0], [10, -1, 10])
    with pytest.raises(InputError, match="tilt limit must lie between 0 and 180 degrees.*200"):
        Reach([0, 0, 0], [1, 1, 1], 200)
