import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lenscal.errors import InputError
from lenscal.imaging.aperture import Aperture, blur_kernel
from lenscal.imaging.blur import BlurFloor, blur, blur_margin_px

PITCH = np.array([0.01625, 0.01375])


def moments(weights):
    """Total, and variance along x and y, in px."""
    rows, columns = (np.arange(side) - side // 2 for side in weights.shape)
    weights = weights.astype(np.float64)
    return (
        weights.sum(),
        weights.sum(axis=0) @ columns**2 / weights.sum(),
        weights.sum(axis=1) @ rows**2 / weights.sum(),
    )


@settings(max_examples=40, deadline=None)
@given(st.floats(0.0, 0.5), st.floats(0.005, 0.03), st.floats(0.005, 0.03))
def test_a_kernel_has_the_moments_of_the_disk(diameter_mm, pitch_x_mm, pitch_y_mm):
    total, along_x, along_y = moments(blur_kernel(diameter_mm, pitch_x_mm, pitch_y_mm))
    assert total == pytest.approx(1.0, abs=1e-5)
    assert along_x == pytest.approx((diameter_mm / pitch_x_mm) ** 2 / 16, rel=1e-3, abs=1e-4)
    assert along_y == pytest.approx((diameter_mm / pitch_y_mm) ** 2 / 16, rel=1e-3, abs=1e-4)


def test_a_large_kernel_is_flat_and_round():
    kernel = blur_kernel(0.4, 0.01, 0.01)
    rows, columns = np.indices(kernel.shape) - kernel.shape[0] // 2
    radius = np.hypot(rows, columns)
    flat = 1 / (np.pi * 20**2)
    np.testing.assert_allclose(kernel[radius < 18], flat, rtol=0.02)
    np.testing.assert_allclose(kernel[radius > 22.1], 0.0, atol=0.02 * flat)


def point_image(diameter_mm, size=61):
    margin_x, margin_y = blur_margin_px(diameter_mm, PITCH)
    image = np.zeros((size + 2 * margin_y, size + 2 * margin_x), np.float32)
    image[margin_y + size // 2, margin_x + size // 2] = 1.0
    return blur(image, np.full((size, size), diameter_mm), PITCH)


@pytest.mark.parametrize("diameter_mm", [0.0, 0.004, 0.013, 0.0371, 0.08, 0.29])
def test_mixing_of_levels_keeps_the_second_moment(diameter_mm):
    total, along_x, along_y = moments(point_image(diameter_mm))
    assert total == pytest.approx(1.0, abs=1e-5)
    np.testing.assert_allclose(
        [along_x, along_y], (diameter_mm / PITCH) ** 2 / 16, rtol=1e-3, atol=1e-4
    )


def test_blur_of_a_flat_image_changes_nothing():
    diameters = np.linspace(0.0, 0.1, 150)[None, :] + np.zeros((40, 1))
    margin_x, margin_y = blur_margin_px(0.1, PITCH)
    flat = np.full((40 + 2 * margin_y, 150 + 2 * margin_x), 0.7, np.float32)
    np.testing.assert_allclose(blur(flat, diameters, PITCH), 0.7, atol=1e-5)


def test_the_floor_adds_in_quadrature():
    floor = BlurFloor(wavelength_mm=0.0005, aberration_mm=0.003)
    airy_mm = 2.44 * 0.0005 * 8.0
    expected = np.sqrt(0.02**2 + airy_mm**2 + 0.003**2)
    assert floor.add_to(0.02, 8.0) == pytest.approx(expected)


@pytest.mark.parametrize("blades", [3, 5, 6, 7])
@pytest.mark.parametrize("rotation", [0.0, 0.4])
def test_a_polygon_is_flat_and_has_the_area_of_the_disk(blades, rotation):
    kernel = blur_kernel(0.6, 0.01, 0.01, Aperture(blades, rotation))
    flat = 1 / (np.pi * 30**2)
    assert kernel.sum() == pytest.approx(1.0, abs=1e-5)
    # The mean of the weights over the light is the reciprocal of the area, but for the rim.
    assert (kernel**2).sum() == pytest.approx(flat, rel=0.05)
    middle = kernel.shape[0] // 2
    np.testing.assert_allclose(kernel[middle - 10 : middle + 11, middle], flat, rtol=0.02)


def test_corners_of_a_polygon_lie_where_they_are_stated():
    kernel = blur_kernel(0.6, 0.01, 0.01, Aperture(3, np.pi / 2))
    lit = kernel > 0.5 * kernel.max()
    rows = np.flatnonzero(lit.any(axis=1)) - kernel.shape[0] // 2
    reach = 30 * Aperture(3).reach
    assert rows.max() == pytest.approx(reach, abs=2.5)
    assert rows.min() == pytest.approx(-reach / 2, abs=1.5)


def test_many_blades_are_round():
    assert Aperture(60).reach == pytest.approx(1.0, abs=2e-3)
    np.testing.assert_allclose(
        blur_kernel(0.1, 0.01, 0.01, Aperture(60)),
        blur_kernel(0.1, 0.01, 0.01),
        atol=2e-4,
    )


def test_near_and_far_points_of_a_tilted_target_are_blurred_side_by_side():
    """A point nearer than the sharp plane shows the turned triangle, a farther one the upright."""
    triangle = Aperture(3)
    margin_x, margin_y = blur_margin_px(0.1, PITCH, triangle)
    image = np.zeros((41 + 2 * margin_y, 81 + 2 * margin_x), np.float32)
    image[margin_y + 20, [margin_x + 20, margin_x + 60]] = 1.0
    diameter = np.where(np.arange(81) < 40, 0.1, -0.1)[None, :] + np.zeros((41, 1))
    blurred = blur(image, diameter.astype(np.float32), PITCH, triangle)
    np.testing.assert_allclose(blurred[:, :40], blurred[:, 80:40:-1], atol=1e-6)
    assert not np.allclose(blurred[:, 5:20], blurred[:, 35:20:-1], atol=1e-3)


@pytest.mark.parametrize("blades", [-1, 1, 2])
def test_an_iris_of_too_few_blades_is_refused(blades):
    with pytest.raises(InputError, match=f"has 0 blades .* or 3 to 99, but {blades} are given"):
        Aperture(blades)
