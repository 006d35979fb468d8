import numpy as np
import pytest

from lenscal.arrays import frozen_array, positive
from lenscal.errors import InputError


def test_the_copy_is_read_only_and_independent():
    source = np.arange(6.0).reshape(2, 3)
    array = frozen_array("points", source, ("N", 3))
    source[0, 0] = 99.0
    assert array[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        array[0, 0] = 1.0


@pytest.mark.parametrize(
    ("value", "shape", "message"),
    [
        ([[1, 2]], ("N", 3), r"points must have shape \(N, 3\), but has shape \(1, 2\)"),
        ([1.0], ("...", 2), r"points must have shape \(\.\.\., 2\), but has shape \(1,\)"),
        (3.0, ("N",), r"points must have shape \(N,\), but has shape \(\)"),
        ("two", (2,), r"points must be an array of numbers of shape \(2,\); given is 'two'"),
        ([[1], [1, 2]], ("N", 2), "points must be an array of numbers"),
        ([1.0, np.nan], (2,), r"1 of 2 values are NaN or infinite, the first at index \(1,\)"),
    ],
)
def test_what_does_not_fit_is_named(value, shape, message):
    with pytest.raises(InputError, match=message):
        frozen_array("points", value, shape)


def test_nan_may_be_allowed():
    assert np.isnan(frozen_array("pixels", [np.nan, 0.0], ("...", 2), finite=False)[0])


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_positive_refuses(value):
    with pytest.raises(InputError, match="diameter must be a positive number, but is .* mm"):
        positive("diameter", value, "mm")
