"""A made-up lens that is not parfocal: at each zoom a band of its own sees finite distances."""

import numpy as np
import pytest

from lenscal.maps.strip import Strip
from lenscal.maps.tame_surfaces import fit_tame_surfaces, tame_coordinates


def _band(zoom):
    return 5.0 + 3.0 * (zoom - 0.4) ** 2, 6.0 + 3.5 * (zoom - 0.4) ** 2


@pytest.fixture
def settings():
    zoom = np.repeat(np.linspace(0, 1, 8), 6)
    low, high = _band(zoom)
    return zoom, low + np.tile(np.linspace(0, 1, 6), 8) * (high - low)


def _inverse(zoom, focus):
    """A quantity whose reciprocal is nearly a straight line over focus: it nears infinity."""
    return 1.0 / (0.02 + 0.1 * (focus - _band(zoom)[0]) * (1 + 0.3 * zoom))


def test_across_the_strip_every_zoom_is_sampled_from_zero_to_one(settings):
    zoom, focus = settings
    strip = Strip.through(zoom, focus)
    across = strip.across(zoom, focus).reshape(8, 6)
    np.testing.assert_allclose(across, np.tile(np.linspace(0, 1, 6), (8, 1)), atol=1e-9)
    between = np.linspace(0, 1, 50)
    low, high = _band(between)
    np.testing.assert_allclose(strip.across(between, low), 0.0, atol=1e-6)
    np.testing.assert_allclose(strip.across(between, high), 1.0, atol=1e-6)


def test_slopes_across_the_strip_match_differences(settings):
    strip = Strip.through(*settings)
    zoom, focus = np.array([0.13, 0.5, 0.77]), np.array([5.4, 5.6, 5.9])
    by_zoom, by_focus = strip.slopes(zoom, focus)
    step = 1e-6
    ahead, behind = strip.across(zoom + step, focus), strip.across(zoom - step, focus)
    np.testing.assert_allclose(by_zoom, (ahead - behind) / (2 * step), rtol=1e-6)
    ahead, behind = strip.across(zoom, focus + step), strip.across(zoom, focus - step)
    np.testing.assert_allclose(by_focus, (ahead - behind) / (2 * step), rtol=1e-6)


def test_a_grid_keeps_its_focus_settings():
    zoom, focus = (a.ravel() for a in np.meshgrid(np.arange(5.0), np.arange(4.0)))
    strip = Strip.through(zoom, focus)
    assert strip.ends is None
    np.testing.assert_array_equal(strip.across(zoom, focus), focus)


def test_the_data_choose_the_reciprocal_of_what_runs_to_infinity(settings):
    zoom, focus = settings
    rng = np.random.default_rng(0)
    noisy = np.log(_inverse(zoom, focus)) + 1e-3 * rng.standard_normal(len(zoom))
    powers, _, _ = tame_coordinates(zoom, focus, noisy[:, None], np.full((len(zoom), 1, 1), 1e-6))
    assert powers[0] == -1.0


def test_values_slopes_and_sigma_of_the_logarithm_come_back(settings):
    zoom, focus = settings
    rng = np.random.default_rng(1)
    noisy = np.log(_inverse(zoom, focus)) + 1e-3 * rng.standard_normal(len(zoom))
    found = fit_tame_surfaces(
        zoom, focus, noisy[:, None], np.full((len(zoom), 1, 1), 1e-6), powers=[-1.0]
    )
    inner = np.linspace(0.05, 0.95, 40)
    low, high = _band(inner)
    across = low + 0.37 * (high - low)
    error = found.value(inner, across)[:, 0] - np.log(_inverse(inner, across))
    sigma = np.sqrt(found.covariance_at(inner, across)[:, 0, 0])
    assert (sigma < 2e-3).all()
    assert np.sqrt(np.mean((error / sigma) ** 2)) < 2.0
    step = 1e-6
    for axis, by in enumerate(((1, 0), (0, 1))):
        move = np.eye(2)[axis] * step
        ahead = found.value(inner + move[0], across + move[1])
        behind = found.value(inner - move[0], across - move[1])
        np.testing.assert_allclose(
            found.value(inner, across, by), (ahead - behind) / (2 * step), rtol=1e-5, atol=1e-6
        )


def test_mixed_surfaces_are_sums_of_their_splines():
    """ln D as ln D/standoff and ln standoff: the sum has the value, and the variance of both."""
    zoom, focus = (a.ravel() for a in np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 4)))
    values = np.stack([1.0 + zoom + 0.2 * focus, 0.5 * zoom - focus], axis=-1)
    covariances = np.tile(np.diag([1e-4, 4e-4]), (len(zoom), 1, 1))
    plain = fit_tame_surfaces(zoom, focus, values, covariances)
    mixed = fit_tame_surfaces(
        zoom, focus, values, covariances, mixing=np.array([[1.0, 1.0], [0.0, 1.0]])
    )
    for found in (plain, mixed):
        np.testing.assert_allclose(found.value(zoom, focus), values, atol=1e-6)
    np.testing.assert_allclose(
        mixed.value(zoom, focus, only=[0])[:, 0], mixed.value(zoom, focus)[:, 0]
    )
