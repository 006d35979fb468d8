import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lenscal.imaging.blur import BlurFloor, blur, blur_margin_px, disk_kernel

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
    total, along_x, along_y = moments(disk_kernel(diameter_mm, pitch_x_mm, pitch_y_mm))
    assert total == pytest.approx(1.0, abs=1e-5)
    assert along_x == pytest.approx((diameter_mm / pitch_x_mm) ** 2 / 16, rel=1e-3, abs=1e-4)
    assert along_y == pytest.approx((diameter_mm / pitch_y_mm) ** 2 / 16, rel=1e-3, abs=1e-4)


def test_a_large_kernel_is_flat_and_round():
    kernel = disk_kernel(0.4, 0.01, 0.01)
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
