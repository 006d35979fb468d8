import cv2
import numpy as np
import pytest

from lenscal.errors import FocusError
from lenscal.session.disk_search import DiskImage, find_disk
from lenscal.session.sharpness import MEASURES, Measure, ring_gradient_magnitude, ring_sharpness


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


@pytest.mark.parametrize("measure", list(Measure))
def test_every_measure_prefers_the_sharper_picture(measure):
    scores = []
    for blur in (1.0, 2.0, 4.0, 8.0):
        image = picture(blur=blur)
        scores.append(MEASURES[measure].score(image, find_disk(image)))
    assert np.all(np.diff(scores) < 0)


def test_the_criterion_of_the_paper_takes_800_px_and_leaves_out_what_is_below_its_threshold():
    image = picture(noise=2.0)
    disk = find_disk(image)
    half = 400 / disk.perimeter_px
    ring = np.abs(disk.rim_distance_px(image.shape)) <= half
    assert ring.sum() == pytest.approx(800, rel=0.05)
    whole = ring_gradient_magnitude(image, disk)
    rim_alone = ring_gradient_magnitude(image, disk, threshold=20.0)
    assert 0 < rim_alone < whole
    assert ring_gradient_magnitude(image, disk, threshold=1e6) == 0


def test_twelve_bits_measure_like_eight():
    eight = picture()
    twelve = eight.astype(np.uint16) * 16
    assert find_disk(twelve) == find_disk(eight)
    disk = find_disk(eight)
    assert ring_sharpness(twelve, disk) == pytest.approx(ring_sharpness(eight, disk), rel=1e-5)


def test_among_several_disks_the_one_expected_is_found():
    """Nearest to the place, of the size, and no farther off than said."""
    small = picture((15.0, 15.0), centre=(40.0, 75.0), shape=(150, 200))
    large = picture((35.0, 35.0), centre=(140.0, 75.0), shape=(150, 200))
    image = np.minimum(small, large)
    assert find_disk(image, (60.0, 75.0)).centre_px[0] == pytest.approx(40, abs=0.5)
    assert find_disk(image, (60.0, 75.0), 33.0).centre_px[0] == pytest.approx(140, abs=0.5)
    with pytest.raises(FocusError, match="no round dark spot of about 33 px radius lies wholly"):
        find_disk(image, (60.0, 75.0), 33.0, within_px=10.0)


def test_a_disk_without_room_about_it_is_refused():
    image = picture()
    with pytest.raises(FocusError, match="has no room about its rim in the picture; take a larger"):
        ring_sharpness(image, DiskImage((80.0, 75.0), (400.0, 400.0)))
