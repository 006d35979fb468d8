"""Evaluation of surfaces: per cell, fast, and the same as scipy's splines and dense algebra."""

import numpy as np
import pytest
from scipy.interpolate import NdBSpline

from lenscal.maps.spline_axis import tensor_design
from lenscal.maps.surface import fit_surfaces

GRIDS = [(8, 8, 3), (1, 6, 2), (5, 1, 3), (3, 2, 1), (2, 30, 2)]


@pytest.fixture(scope="module", params=GRIDS, ids=str)
def surfaces(request):
    """Surfaces through a grid that is not regular, with errors that are correlated."""
    columns, rows, count = request.param
    rng = np.random.default_rng(3)
    zooms, focuses = np.sort(rng.uniform(90, 110, columns)), np.sort(rng.uniform(60, 140, rows))
    zoom, focus = (v.ravel() for v in np.meshgrid(zooms, focuses))
    values = 3 + np.sin(zoom[:, None] / 5 + np.arange(count)) + focus[:, None] / 100
    covariance = 1e-4 * (np.eye(count) + 0.3)
    return fit_surfaces(
        zoom,
        focus,
        values + 0.01 * rng.normal(size=values.shape),
        np.tile(covariance, (len(zoom), 1, 1)),
        log_smoothing=np.full((count, 2), -5.0),
    )


def places(surfaces, shape=(40, 50)):
    """Random settings, all knots, and the corners."""
    rng = np.random.default_rng(4)
    ends = surfaces.zoom.ends, surfaces.focus.ends
    zoom, focus = (rng.uniform(*pair, shape) for pair in ends)
    for values, axis in ((zoom, surfaces.zoom), (focus, surfaces.focus)):
        inner = np.clip(axis.breaks, *axis.ends)
        values[0, : len(inner)] = inner
        values[1, :2] = axis.ends
    return zoom, focus


def by_scipy(surfaces, zoom, focus, derivative):
    axes = surfaces.zoom, surfaces.focus
    spline = NdBSpline(
        tuple(axis.knots for axis in axes),
        surfaces.coefficients,
        tuple(axis.degree for axis in axes),
    )
    return spline(np.stack([zoom, focus], axis=-1), nu=derivative)


def test_values_are_those_of_scipy(surfaces):
    zoom, focus = places(surfaces)
    expected = by_scipy(surfaces, zoom, focus, (0, 0))
    np.testing.assert_allclose(surfaces.value(zoom, focus), expected, rtol=1e-12)


@pytest.mark.parametrize("derivative", [(1, 0), (0, 1), (1, 1)])
def test_derivatives_are_those_of_scipy(surfaces, derivative):
    zoom, focus = places(surfaces)
    found = surfaces.value(zoom, focus, derivative)
    if (surfaces.zoom.degree == 0 and derivative[0]) or (
        surfaces.focus.degree == 0 and derivative[1]
    ):
        assert (found == 0).all()
        return
    expected = by_scipy(surfaces, zoom, focus, derivative)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_the_outermost_polynomials_go_on_beyond_the_knots(surfaces):
    zoom, focus = (
        np.array([axis.ends[0] - 0.02 * (axis.degree > 0), axis.ends[1] + 0.03 * (axis.degree > 0)])
        for axis in (surfaces.zoom, surfaces.focus)
    )
    expected = by_scipy(surfaces, zoom, focus, (0, 0))
    np.testing.assert_allclose(surfaces.value(zoom, focus), expected, rtol=1e-12)


def by_dense_algebra(surfaces, zoom, focus):
    """Posterior covariance, and the sum of the magnitudes of what adds up to it."""
    design = tensor_design(surfaces.zoom, surfaces.focus, zoom.ravel(), focus.ravel())
    size, count = design.shape[1], surfaces.coefficients.shape[2]
    blocks = surfaces.covariance.reshape(size, count, size, count)
    return (
        np.einsum("nk,kqlr,nl->nqr", design, matrix, design, optimize=True).reshape(
            *zoom.shape, count, count
        )
        for matrix in (blocks, np.abs(blocks))
    )


def test_covariances_are_those_of_the_whole_covariance_matrix(surfaces):
    """To rounding of the terms: between samples that nearly agree they cancel each other."""
    zoom, focus = places(surfaces)
    expected, terms = by_dense_algebra(surfaces, zoom, focus)
    found = surfaces.covariance_at(zoom, focus)
    assert found.shape == expected.shape
    assert (np.abs(found - expected) / terms).max() < 1e-13
    np.testing.assert_array_equal(found, np.swapaxes(found, -1, -2))


def test_single_surfaces_may_be_asked_for(surfaces):
    zoom, focus = places(surfaces)
    last = surfaces.coefficients.shape[2] - 1
    everything = surfaces.value(zoom, focus)
    # Several at once are rounded in another order.
    np.testing.assert_allclose(
        surfaces.value(zoom, focus, only=[last])[..., 0],
        everything[..., last],
        rtol=0,
        atol=1e-14 * np.abs(surfaces.coefficients).max(),
    )
    spread = surfaces.covariance_at(zoom, focus)[..., last, last]
    np.testing.assert_allclose(
        surfaces.covariance_at(zoom, focus, only=[last])[..., 0, 0],
        spread,
        rtol=0,
        atol=1e-14 * np.abs(surfaces.covariance).max(),
    )


def test_unknown_settings_give_unknown_values(surfaces):
    (z, _), (f, _) = surfaces.zoom.ends, surfaces.focus.ends
    zoom, focus = np.array([np.nan, z, z]), np.array([f, np.nan, f])
    for found in (
        surfaces.value(zoom, focus),
        surfaces.value(zoom, focus, (1, 0)),
        surfaces.covariance_at(zoom, focus),
    ):
        assert np.isnan(found[:2]).all()
        assert np.isfinite(found[2]).all()


def test_scalars_and_nothing_keep_their_shapes(surfaces):
    count = surfaces.coefficients.shape[2]
    here = np.array(surfaces.zoom.ends[0]), np.array(surfaces.focus.ends[0])
    assert surfaces.value(*here).shape == (count,)
    assert surfaces.covariance_at(*here).shape == (count, count)
    assert surfaces.value(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0, 3, count)
    assert surfaces.covariance_at(np.zeros(0), np.zeros(0)).shape == (0, count, count)


def test_many_points_are_evaluated_as_few_are(surfaces):
    """More points than are evaluated at a time."""
    zoom, focus = places(surfaces, (101, 100))
    whole = surfaces.value(zoom, focus)
    few = surfaces.value(zoom[-7:], focus[-7:])
    np.testing.assert_allclose(whole[-7:], few, rtol=0, atol=1e-13 * np.abs(few).max())
