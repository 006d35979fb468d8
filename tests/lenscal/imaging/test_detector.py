import numpy as np
import pytest

from lenscal.errors import InputError
from lenscal.imaging.detector import Detector


def detector(**changes):
    values = {
        "full_well_e": 20_000.0,
        "read_noise_e": 12.0,
        "black_level_dn": 64.0,
        "bit_depth": 12,
        "electrons_per_second": 64e6,
    }
    return Detector(**(values | changes))


def test_photon_transfer_gives_gain_and_read_noise_back():
    """Variance over mean signal is a line: its slope is 1/gain, its start the read noise."""
    camera, rng = detector(), np.random.default_rng(5)
    means, variances = [], []
    for electrons in np.geomspace(5, 15_000, 16):
        flat = np.full((2, 250, 250), electrons, np.float32)
        first, second = camera.read(flat, rng).astype(np.float64)
        means.append((first + second).mean() / 2 - camera.black_level_dn)
        variances.append((first - second).var() / 2)
    weights = 1 / np.array(variances)
    slope, start = np.polyfit(means, variances, 1, w=weights)
    assert 1 / slope == pytest.approx(camera.electrons_per_dn, rel=0.03)
    read_noise_e = np.sqrt(start - 1 / 12) * camera.electrons_per_dn
    assert read_noise_e == pytest.approx(camera.read_noise_e, rel=0.05)


def test_light_goes_with_time_and_the_square_of_the_aperture():
    camera = detector()
    once = camera.electrons(0.5, 0.01, 8.0)
    assert camera.electrons(0.5, 0.03, 4.0) == pytest.approx(12 * once)
    assert once == pytest.approx(0.5 * 64e6 * 0.01 / 64)


def test_black_and_full_pixels():
    camera = detector(bit_depth=8, black_level_dn=4.0)
    grey = camera.read(np.array([0.0, 10_000.0, 20_000.0, 1e12], np.float32), None)
    assert grey.dtype == np.uint8
    assert grey.tolist() == [4, 130, 255, 255]
    bright = camera.read(np.full(1000, 1e12, np.float32), np.random.default_rng(0))
    assert bright.min() >= 254


def test_more_than_8_bits_come_in_16():
    assert detector().read(np.zeros(3, np.float32), None).dtype == np.uint16


def test_the_same_seed_gives_the_same_picture():
    flat = np.full((20, 20), 500.0, np.float32)
    first, second = (detector().read(flat, np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_there_is_no_negative_light():
    assert detector().electrons(-0.1, 0.01, 8.0) == 0


@pytest.mark.parametrize("bits", [7, 17])
def test_a_bit_depth_out_of_range_is_refused(bits):
    with pytest.raises(InputError, match="bit_depth must be 8 to 16 bits, but is"):
        detector(bit_depth=bits)


@pytest.mark.parametrize("change", [{"read_noise_e": -1.0}, {"black_level_dn": 5000.0}])
def test_noise_and_black_level_must_make_sense(change):
    with pytest.raises(InputError, match="must not be negative, and black must lie below"):
        detector(**change)
