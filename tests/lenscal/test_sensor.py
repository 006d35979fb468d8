import numpy as np
import pytest

from lenscal.errors import InputError
from lenscal.sensor import Sensor

PAPER = Sensor(512, 480, 0.023, 0.01375, scale_factor=0.70642)


def test_sample_pitch_is_the_scale_factor_times_the_element_pitch():
    assert PAPER.sample_pitch_x_mm == pytest.approx(0.70642 * 0.023)
    assert PAPER.sample_pitch_y_mm == 0.01375
    assert PAPER.width_mm == pytest.approx(512 * 0.70642 * 0.023)


def test_any_axis_takes_the_smaller_side_and_the_coarser_pitch():
    assert PAPER.extent_mm("any") == PAPER.height_mm == pytest.approx(6.6)
    assert PAPER.sample_spacing_mm("any") == PAPER.sample_pitch_x_mm


def test_the_first_pixel_has_its_centre_at_the_origin():
    assert PAPER.centre_px.tolist() == [255.5, 239.5]
    inside = PAPER.contains([[-0.5, -0.5], [511.5, 479.5], [-0.51, 0], [0, 480.0], [np.nan, 0]])
    assert inside.tolist() == [True, True, False, False, False]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0, 480, 0.01, 0.01), "width_px must be a positive whole number, but is 0"),
        ((512, 4.5, 0.01, 0.01), "height_px must be a positive whole number, but is 4.5"),
        ((512, 480, -0.01, 0.01), "pitch_x_mm must be a positive number"),
        ((512, 480, 0.01, 0.01, 0.0), "scale_factor must be a positive number"),
    ],
)
def test_bad_sensors_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        Sensor(*arguments)


def test_an_unknown_axis_is_refused():
    with pytest.raises(InputError, match="axis must be 'any', 'x' or 'y', but is 'z'"):
        PAPER.extent_mm("z")
