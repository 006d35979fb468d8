"""The restricted likelihood, its slope, and roughness that grows towards one end of an axis."""

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from lenscal.maps.penalised import PenalisedProblem
from lenscal.maps.spline_axis import SplineAxis
from lenscal.maps.surface import fit_surfaces


def _grid(zooms, focuses):
    zoom, focus = np.meshgrid(np.linspace(0, 1, zooms), np.linspace(0, 1, focuses))
    return zoom.ravel(), focus.ravel()


def _wild_at_the_end(zoom, focus):
    return 0.05 * (1 + focus) * np.exp(7 * (zoom - 1))


@pytest.mark.parametrize("estimate_noise", [False, True])
def test_the_slope_of_the_likelihood_is_that_of_differences(estimate_noise):
    rng = np.random.default_rng(0)
    zoom, focus = _grid(8, 6)
    values = np.stack([np.sin(3 * zoom) + focus, np.cos(zoom * focus)], axis=-1)
    covariances = np.tile(1e-4 * (np.eye(2) + 0.4), (len(zoom), 1, 1))
    problem = PenalisedProblem.of(
        zoom,
        focus,
        values + 0.01 * rng.normal(size=values.shape),
        covariances,
        np.array([[0.0, 1.0], [-2.0, 0.0]]),
    )
    where = np.array([[-3.0, -5.0], [-1.0, 2.0]])
    _, slope = problem.criterion(where, estimate_noise)
    expected = approx_fprime(
        where.ravel(), lambda x: problem.criterion(x.reshape(2, 2), estimate_noise)[0], 1e-6
    )
    np.testing.assert_allclose(slope.ravel(), expected, rtol=1e-3, atol=1e-3)


def test_bases_stay_orthonormal_and_spare_the_same_polynomials():
    axis = SplineAxis.through(np.tile(np.linspace(2.0, 7.0, 9), 5))
    plain, bends = axis.roughness()
    for roughening in (-4.0, 4.0):
        basis, eigenvalues = axis.roughness(roughening)
        where = np.linspace(2.0, 7.0, 4001)[:-1] + 5.0 / 8000
        values = axis.design(where) @ basis
        np.testing.assert_allclose(values.T @ values / 4000, np.eye(axis.size), atol=1e-4)
        np.testing.assert_array_equal(eigenvalues == 0, bends == 0)
        assert (np.diff(eigenvalues[3:]) > 0).all()
        spared = np.linalg.lstsq(plain[:, :3], basis[:, :3], rcond=None)[1]
        assert (spared < 1e-12).all()


def test_roughness_that_grows_is_found_and_the_intervals_hold_at_the_wild_end():
    zoom, focus = _grid(8, 8)
    sigma = 2e-4
    held = {False: [], True: []}
    fine = np.linspace(0.8, 1.0, 21), np.full(21, 0.4)
    for seed in range(4):
        noisy = _wild_at_the_end(zoom, focus) + sigma * np.random.default_rng(seed).normal(
            size=len(zoom)
        )
        for free in held:
            found = fit_surfaces(
                zoom,
                focus,
                noisy[:, None],
                np.full((len(zoom), 1, 1), sigma**2),
                roughening_free=free,
            )
            error = found.value(*fine)[:, 0] - _wild_at_the_end(*fine)
            spread = np.sqrt(found.covariance_at(*fine)[:, 0, 0])
            held[free].append(np.mean(np.abs(error) < 1.96 * spread))
            assert (found.roughening[0, 0] > 2) == free
    assert np.mean(held[True]) > 0.9
    # The same roughness everywhere takes the wild end for as quiet as the rest.
    assert np.mean(held[False]) < 0.7
