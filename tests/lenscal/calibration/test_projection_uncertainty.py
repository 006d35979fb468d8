from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from lenscal.calibration.calibration import Calibration
from lenscal.calibration.projection_uncertainty import projection_sigma_map, projection_sigma_px
from lenscal.calibration.refine import calibrate_views
from lenscal.calibration.tsai import calibrate_tsai
from lenscal.camera import Camera
from lenscal.errors import CalibrationError, InputError
from lenscal.sensor import Sensor

SENSOR = Sensor(641, 481, 0.01, 0.01)
CENTRAL = Camera(SENSOR, 6.0)
BENT = Camera(SENSOR, 6.0, 4e-3, (330.0, 235.0), (1e-4,), (3e-4, -2e-4))
NAMES = (
    "image_distance_mm",
    "principal_point_x_px",
    "principal_point_y_px",
    "scale_factor",
    "p1_per_mm",
    "p2_per_mm",
    "k1_per_mm2",
    "k2_per_mm4",
)
#: σ of each that moves pixels by some tenths.
SIGMAS = np.array([3e-3, 0.5, 0.5, 1e-3, 2e-5, 2e-5, 1e-4, 1e-5])
CENTRE, MIDWAY, CORNER = [320.0, 240.0], [480.0, 120.0], [640.0, 0.0]
PLACES = np.array([CENTRE, MIDWAY, CORNER])


def _calibration(camera, covariance, names=NAMES):
    return Calibration(
        camera=camera,
        poses=(),
        pixels=(),
        residuals_px=(),
        inliers=(),
        rejected=(),
        noise_px=0.1,
        focus_view=None,
        quantities=tuple(names),
        quantity_covariance=np.asarray(covariance),
    )


def _only(camera, name, sigma):
    covariance = np.zeros((len(NAMES), len(NAMES)))
    covariance[NAMES.index(name), NAMES.index(name)] = sigma**2
    return _calibration(camera, covariance)


def _random_covariance(seed, rank=8):
    mixed = np.random.default_rng(seed).normal(size=(8, rank)) * SIGMAS[:, None]
    return mixed @ mixed.T


def _best_motion(camera, rays, pixels, depth_mm):
    """Rotation, and translation for points at a depth, with which a camera sees rays at pixels."""
    points = rays / rays[:, 2:] * (depth_mm or 1.0)

    def moved(motion, given):
        turned = Rotation.from_rotvec(motion[:3]).apply(given)
        return turned + motion[3:] * depth_mm if depth_mm else turned

    def misfit(motion):
        return (camera.project(moved(motion, points)) - pixels).ravel()

    found = least_squares(misfit, np.zeros(6 if depth_mm else 3), x_scale="jac").x
    return lambda given: camera.project(moved(found, given / given[:, 2:] * (depth_mm or 1.0)))


@pytest.mark.parametrize("depth_mm", [None, 500.0])
@pytest.mark.parametrize("name", ["tele", "wide"])
def test_the_spread_of_repeated_calibrations_is_foretold(name, depth_mm, request):
    """Noise is drawn again and again; the cameras found differ as the first one said they would."""
    world, rng = request.getfixturevalue(name), np.random.default_rng(1)
    sensor, noise_px, copies = world.camera.sensor, 0.1, 90
    corner = np.array([sensor.width_px - 1.0, sensor.height_px - 1.0])
    places = np.array([0.5, 0.75, 1.0])[:, None] * corner
    x, y = np.meshgrid(*((np.arange(12) + 0.5) / 12 * size for size in corner))
    grid = np.stack([x.ravel(), y.ravel()], axis=-1)
    rays, place_rays = world.camera.unproject(grid), world.camera.unproject(places)
    found, foretold = [], []
    for _ in range(copies):
        pixels, _ = world.noisy(rng, noise_px)
        result = calibrate_views(world.points, pixels, sensor, reject_outliers=False)
        found.append(_best_motion(result.camera, rays, grid, depth_mm)(place_rays) - places)
        foretold.append(projection_sigma_px(result, places, depth_mm))
    seen = np.moveaxis(np.array(found), 1, 0)
    spread = [np.sqrt(np.linalg.eigvalsh(np.cov(one.T))[-1]) for one in seen]
    np.testing.assert_allclose(np.median(foretold, axis=0), spread, rtol=0.2)


def test_an_error_of_the_image_distance_alone_shows_at_infinity_only():
    """Turning cannot undo a magnification; shifting along the axis undoes it on a plane."""
    calibration = _only(CENTRAL, "image_distance_mm", 0.006)
    radius_px = np.linalg.norm(PLACES - SENSOR.centre_px, axis=-1)
    np.testing.assert_allclose(
        projection_sigma_px(calibration, PLACES), 0.001 * radius_px, atol=1e-12
    )
    np.testing.assert_allclose(projection_sigma_px(calibration, PLACES, 700.0), 0.0, atol=1e-12)
    bent = _only(BENT, "image_distance_mm", 0.006)
    np.testing.assert_allclose(projection_sigma_px(bent, PLACES, 700.0), 0.0, atol=1e-12)


def test_an_error_of_the_principal_point_is_mostly_a_turn_and_wholly_a_shift():
    calibration = _only(CENTRAL, "principal_point_x_px", 1.0)
    at_infinity = projection_sigma_px(calibration, PLACES)
    assert (at_infinity < 0.3).all()
    assert at_infinity[2] > 0.2
    np.testing.assert_allclose(projection_sigma_px(calibration, PLACES, 90.0), 0.0, atol=1e-12)
    # The narrower the view, the more a turn is like a shift of the image: with the square of it.
    tele, longer = (
        projection_sigma_px(
            _only(replace(CENTRAL, image_distance_mm=d), "principal_point_x_px", 1.0), PLACES
        )
        for d in (200.0, 2000.0)
    )
    np.testing.assert_allclose(longer, tele / 100, rtol=1e-3)


def test_a_fixed_camera_predicts_exactly_and_two_uncertain_ways_the_worst_counts():
    fixed = _calibration(BENT, np.zeros((8, 8)))
    np.testing.assert_array_equal(projection_sigma_px(fixed, PLACES), 0.0)
    # k1 and the scale factor move a point on the x axis along x alone, and add up in square there.
    on_axis = [[600.0, 240.0]]
    parts = [
        projection_sigma_px(_only(CENTRAL, name, s), on_axis)[0]
        for name, s in (("k1_per_mm2", 1e-3), ("scale_factor", 1e-3))
    ]
    both = np.diag([0, 0, 0, 1e-6, 0, 0, 1e-6, 0])
    total = projection_sigma_px(_calibration(CENTRAL, both), on_axis)[0]
    assert total == pytest.approx(np.hypot(*parts), rel=1e-9)


@given(st.integers(0, 999), st.floats(0.01, 100), st.booleans())
def test_sigma_is_lawful(seed, factor, near):
    distance_mm = 300.0 if near else None
    covariance = _random_covariance(seed)
    sigma = projection_sigma_px(_calibration(BENT, covariance), PLACES, distance_mm)
    larger = projection_sigma_px(_calibration(BENT, factor**2 * covariance), PLACES, distance_mm)
    np.testing.assert_allclose(larger, factor * sigma, rtol=1e-9)
    more = _calibration(BENT, covariance + _random_covariance(seed + 1, rank=1))
    assert (projection_sigma_px(more, PLACES, distance_mm) >= sigma * (1 - 1e-9)).all()
    order = np.random.default_rng(seed).permutation(8)
    shuffled = _calibration(BENT, covariance[np.ix_(order, order)], np.array(NAMES)[order].tolist())
    np.testing.assert_allclose(projection_sigma_px(shuffled, PLACES, distance_mm), sigma, rtol=1e-9)


@given(st.integers(0, 999), st.floats(0.1, 10))
def test_sigma_follows_a_mirrored_and_a_scaled_camera(seed, scale):
    covariance = _random_covariance(seed)
    sigma = projection_sigma_px(_calibration(BENT, covariance), PLACES)
    x, y = BENT.centre_px
    mirrored = replace(
        BENT, principal_point_px=(640.0 - x, y), decentring=(3e-4, 2e-4)
    )  # u(−x, y) = (−u_x, u_y) when p2 changes its sign
    signs = np.array([1, -1, 1, 1, 1, -1, 1, 1])
    flipped = _calibration(mirrored, covariance * np.outer(signs, signs))
    np.testing.assert_allclose(
        projection_sigma_px(flipped, [640.0, 0.0] + [-1.0, 1.0] * PLACES), sigma, rtol=1e-9
    )
    # The same camera built larger: pixels, and what they are worth, stay.
    large = Camera(
        replace(SENSOR, pitch_x_mm=0.01 * scale, pitch_y_mm=0.01 * scale),
        6.0 * scale,
        4e-3 / scale**2,
        BENT.principal_point_px,
        (1e-4 / scale**4,),
        (3e-4 / scale, -2e-4 / scale),
    )
    powers = scale ** np.array([1.0, 0, 0, 0, -1, -1, -2, -4])
    built_large = _calibration(large, covariance * np.outer(powers, powers))
    np.testing.assert_allclose(projection_sigma_px(built_large, PLACES), sigma, rtol=1e-9)


def test_the_unit_of_the_target_does_not_matter(wide):
    pixels, _ = wide.noisy(np.random.default_rng(0), 0.1)
    sensor = wide.camera.sensor
    small = calibrate_views(wide.points, pixels, sensor)
    large = calibrate_views([1000 * p for p in wide.points], pixels, sensor)
    places = [[0.0, 0.0], [1200.0, 1000.0], [1800.0, 40.0]]
    np.testing.assert_allclose(
        projection_sigma_px(large, places), projection_sigma_px(small, places), rtol=1e-4
    )


def test_the_map_covers_the_image_and_grows_towards_the_corners(wide):
    pixels, _ = wide.noisy(np.random.default_rng(0), 0.1)
    calibration = calibrate_views(wide.points, pixels, wide.camera.sensor)
    result = projection_sigma_map(calibration, columns=25)
    assert result.sigma_px.shape == result.x_px.shape == (21, 25)
    assert (result.x_px.min(), result.x_px.max()) == (-0.5, 2447.5)
    assert (result.y_px.min(), result.y_px.max()) == (-0.5, 2047.5)
    corners = result.sigma_px[[0, 0, -1, -1], [0, -1, 0, -1]]
    assert corners.min() > 1.5 * np.median(result.sigma_px)
    there = projection_sigma_px(calibration, [result.x_px[3, 7], result.y_px[3, 7]])
    assert there == pytest.approx(result.sigma_px[3, 7])


def test_beyond_the_fold_of_the_distortion_nothing_is_foretold():
    folding = Camera(SENSOR, 6.0, -0.04)
    assert folding.radius_limit_mm < 3.0
    sigma = projection_sigma_px(_only(folding, "k1_per_mm2", 1e-5), PLACES)
    assert np.isfinite(sigma[:2]).all()
    assert np.isnan(sigma[2])


def test_what_cannot_be_told_is_refused():
    sure = _only(CENTRAL, "k1_per_mm2", 1e-5)
    for distance_mm in (0.0, -5.0, np.inf, np.nan):
        with pytest.raises(InputError, match="distance_mm must be a positive number, but is"):
            projection_sigma_px(sure, PLACES, distance_mm)
    with pytest.raises(InputError, match=r"pixels must have shape \(..., 2\), but has shape \(3,"):
        projection_sigma_px(sure, np.zeros((3, 3)))
    with pytest.raises(InputError, match="a map needs 2 columns or more, but columns is 1"):
        projection_sigma_map(sure, columns=1)


def test_a_two_stage_calibration_has_none(tele):
    two_stage = calibrate_tsai(
        tele.points[1],
        tele.pixels[1],
        tele.camera.sensor,
        principal_point_px=tele.camera.centre_px,
        method="two_stage",
    )
    with pytest.raises(CalibrationError, match="two-stage solution comes without uncertainty"):
        projection_sigma_px(two_stage, PLACES)
