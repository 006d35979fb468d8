"""Many cameras as arrays are the same cameras."""

from __future__ import annotations

import numpy as np
import pytest

from lenscal.camera import Camera
from lenscal.cameras import Cameras
from lenscal.errors import InputError
from lenscal.sensor import Sensor

SENSOR = Sensor(640, 480, 0.01, 0.01)
ONES = (
    Camera(SENSOR, 50.0),
    Camera(SENSOR, 60.0, 1e-4, np.array([300.0, 250.0]), (2e-7, 0.0, 3e-12)),
    Camera(SENSOR, 70.0, -1e-4, None, (1e-7,), (1e-5, -2e-5)),
)


def test_each_comes_out_as_it_went_in() -> None:
    cameras = Cameras.of(ONES)
    assert len(cameras) == 3
    for one, other in zip(ONES, cameras, strict=True):
        assert other.image_distance_mm == one.image_distance_mm
        assert other.k1_per_mm2 == one.k1_per_mm2
        assert other.radial == one.radial
        assert other.decentring == one.decentring
        np.testing.assert_array_equal(other.centre_px, one.centre_px)
    assert Cameras.of(cameras) is cameras
    np.testing.assert_array_equal(cameras.take(np.array([2, 0, 2])).image_distance_mm, [70, 50, 70])
    assert cameras[1:][0].image_distance_mm == 60.0
    assert cameras[-1].image_distance_mm == 70.0
    with pytest.raises(IndexError):
        _ = cameras[3]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Cameras.of(()), "there is no camera; give one or more"),
        (
            lambda: Cameras.of((ONES[0], Camera(Sensor(9, 9, 1, 1), 5.0))),
            "the cameras have different sensors, .*; take one sensor at a time",
        ),
        (
            lambda: Cameras(SENSOR, np.array([-5.0]), np.zeros((1, 2)), np.zeros((1, 1)),
                            np.zeros((1, 2))),
            "image_distance_mm must be positive, but is -5 mm; check the sign and the unit",
        ),
        (
            lambda: Cameras(SENSOR, np.zeros(0), np.zeros((0, 2)), np.zeros((0, 1)),
                            np.zeros((0, 2))),
            "there is no camera; give one or more",
        ),
        (
            lambda: Cameras(SENSOR, np.array([5.0]), np.zeros((2, 2)), np.zeros((1, 1)),
                            np.zeros((1, 2))),
            r"principal_point_px must have shape \(1, 2\), but has shape \(2, 2\)",
        ),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(make, message) -> None:
    with pytest.raises(InputError, match=message):
        make()
