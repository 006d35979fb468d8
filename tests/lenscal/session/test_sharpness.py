import cv2
import numpy as np
import pytest

from lenscal.errors import FocusError
from lenscal.session.sharpness import find_disk, ring_sharpness


def picture(radius=(30.0, 36.0), centre=(80.3, 75.8), blur=1.5, noise=0.0, shape=(150, 160)):
    """A dark disk, drawn eight times as fine as the pixels, blurred by a Gaussian of that σ."""
    fine = 8
    y, x = np.mgrid[: shape[0] * fine, : shape[1] * fine]
    x, y = (x + 0.5) / fine - 0.5, (y + 0.5) / fine - 0.5
    inside = ((x - centre[0]) / radius[0]) ** 2 + ((y - centre[1]) / radius[1]) ** 2 < 1
    image = cv2.resize(np.where(inside, 30.0, 190.0), shape[::-1], interpolation=cv2.INTER_AREA)
    image = cv2.GaussianBlur(image, (0, 0), blur)
    rng = np.random.default_rng(7)
    return np.clip(np.round(image + noise * rng.normal(size=shape)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("blur", [0.8, 3.0, 6.0])
def test_the_disk_is_found_sharp_or_blurred(blur):
    disk = find_disk(picture(blur=blur, noise=2.0))
    np.testing.assert_allclose(disk.centre_px, (80.3, 75.8), atol=0.15)
    np.testing.assert_allclose(disk.semi_axes_px, (30.0, 36.0), rtol=0.03)


def test_sharpness_is_one_over_the_width_of_the_edge():
    """For a Gaussian edge of σ the squared gradient integrates to 1 / (2 √π σ)."""
    for blur in (2.0, 3.0, 4.0):
        image = picture(blur=blur)
        found = ring_sharpness(image, find_disk(image))
        assert found == pytest.approx(1 / (2 * np.sqrt(np.pi) * blur), rel=0.08)


def test_sharpness_does_not_change_with_scale_or_light():
    small, large = picture((20.0, 24.0)), picture((40.0, 48.0))
    dim = (0.5 * picture().astype(float)).astype(np.uint8)
    values = [ring_sharpness(image, find_disk(image)) for image in (small, large, dim, picture())]
    np.testing.assert_allclose(values, values[0], rtol=0.03)


def test_noise_does_not_look_like_sharpness():
    clean, noisy = picture(blur=4.0), picture(blur=4.0, noise=6.0)
    assert ring_sharpness(noisy, find_disk(noisy)) == pytest.approx(
        ring_sharpness(clean, find_disk(clean)), rel=0.08
    )


def test_without_contrast_there_is_no_disk():
    with pytest.raises(FocusError, match="the image has no contrast .grey values 100 to 100"):
        find_disk(np.full((50, 50), 100, np.uint8))


def test_squares_and_cut_disks_are_no_disks():
    square = np.full((100, 100), 200, np.uint8)
    square[20:80, 20:80] = 20
    with pytest.raises(FocusError, match="no round dark spot lies wholly in the image"):
        find_disk(square)
    with pytest.raises(FocusError, match="no round dark spot lies wholly in the image"):
        find_disk(picture(centre=(10.0, 75.0)))


def test_a_ring_without_contrast_is_refused():
    image = picture()
    with pytest.raises(FocusError, match="the disk has no contrast to its surroundings"):
        ring_sharpness(255 - image, find_disk(image))
