from dataclasses import replace

import numpy as np
import pytest

from lenscal.calibration.projection import PERSPECTIVE
from lenscal.calibration.refine import calibrate_views, conclude, fit_poses
from lenscal.calibration.rejection import Selection
from lenscal.calibration.views import State, Views
from lenscal.camera import Camera
from lenscal.errors import (
    CalibrationError,
    ConvergenceError,
    DegenerateGeometryError,
    InputError,
)
from lenscal.optics import focal_length_mm
from lenscal.pose import Pose
from lenscal.sensor import Sensor
from lenscal.target import Chessboard

SENSOR = Sensor(2448, 2048, 0.00345, 0.00345)
QUANTITIES = (
    "image_distance_mm",
    "object_distance_mm",
    "magnification",
    "focal_length_mm",
    "principal_point_x_px",
    "principal_point_y_px",
    "k1_per_mm2",
    "translation_x_mm",
)


def _values(calibration):
    return [
        calibration.image_distance_mm,
        calibration.object_distance_mm,
        calibration.magnification,
        calibration.focal_length_mm,
        *calibration.camera.centre_px,
        calibration.camera.k1_per_mm2,
        calibration.poses[0].translation_mm[0],
    ]


@pytest.mark.parametrize("name", ["tele", "wide"])
def test_exact_pixels_give_the_exact_camera(name, request):
    world = request.getfixturevalue(name)
    result = calibrate_views(world.points, world.pixels, world.camera.sensor)
    assert result.rejected == ()
    assert result.rms_px < 1e-8
    assert result.image_distance_mm == pytest.approx(world.camera.image_distance_mm, rel=1e-9)
    assert result.camera.k1_per_mm2 == pytest.approx(world.camera.k1_per_mm2, rel=1e-7)
    np.testing.assert_allclose(result.camera.centre_px, world.camera.centre_px, atol=1e-5)
    for found, exact in zip(result.poses, world.poses, strict=True):
        np.testing.assert_allclose(found.matrix, exact.matrix, rtol=1e-7, atol=1e-6)


def test_every_model_gets_its_own_data_back(look):
    sensor = Sensor(1280, 960, 0.00465, 0.00465)
    camera = Camera(sensor, 8.0, 4e-3, (650.0, 470.0), (1e-4, -2e-6), (3e-4, -2e-4))
    world = look(camera, 90.0, board=Chessboard(12, 9, 5.0))
    result = calibrate_views(world.points, world.pixels, sensor, radial_terms=3, decentring=True)
    assert result.image_distance_mm == pytest.approx(8.0, rel=1e-8)
    np.testing.assert_allclose(result.camera.radial, camera.radial, rtol=1e-4)
    np.testing.assert_allclose(result.camera.decentring, camera.decentring, rtol=1e-5)
    names = ["k1_per_mm2", "k2_per_mm4", "k3_per_mm6", "p1_per_mm", "p2_per_mm"]
    assert all(result.sigma(name) >= 0 for name in names)


def test_scale_factor_of_a_frame_grabber(look):
    """The paper's 0.70642, from views that start out believing in square samples."""
    sensor = Sensor(768, 576, 0.011, 0.011, scale_factor=0.70642)
    world = look(Camera(sensor, 25.0, 1e-3), 500.0, board=Chessboard(9, 7, 10.0))
    pixels, _ = world.noisy(np.random.default_rng(4), 0.1)
    ignorant = replace(sensor, scale_factor=1.0)
    result = calibrate_views(world.points, pixels, ignorant, free_scale_factor=True)
    assert result.camera.sensor.scale_factor == pytest.approx(0.70642, rel=1e-3)
    assert result.image_distance_mm == pytest.approx(
        25.0, abs=4 * result.sigma("image_distance_mm")
    )


def test_a_fixed_principal_point_stays_and_has_no_error(tele):
    pixels, _ = tele.noisy(np.random.default_rng(0), 0.1)
    result = calibrate_views(
        tele.points, pixels, tele.camera.sensor, principal_point_px=tele.camera.centre_px
    )
    np.testing.assert_array_equal(result.camera.centre_px, tele.camera.centre_px)
    assert result.sigma("principal_point_x_px") == 0.0
    assert result.sigma("image_distance_mm") > 0.0


def test_no_distortion_terms(tele):
    plain = replace(tele.camera, k1_per_mm2=0.0)
    pixels = [plain.project(p.transform(w)) for p, w in zip(tele.poses, tele.points, strict=True)]
    result = calibrate_views(tele.points, pixels, plain.sensor, radial_terms=0)
    assert result.camera.k1_per_mm2 == 0.0
    assert result.image_distance_mm == pytest.approx(130.0, rel=1e-9)


def test_distances_are_those_of_the_focus_view(tele):
    """D is where the axis meets the plane z = 0 of the target, also when the target is tilted."""
    result = calibrate_views(tele.points, tele.pixels, tele.camera.sensor, focus_view=1)
    pose = tele.poses[1]
    axis_in_target = pose.inverse().transform([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    start, direction = axis_in_target[0], axis_in_target[1] - axis_in_target[0]
    expected = -start[2] / direction[2]
    assert result.object_distance_mm == pytest.approx(expected, rel=1e-9)
    assert result.magnification == pytest.approx(130.0 / expected, rel=1e-9)
    assert result.focal_length_mm == pytest.approx(float(focal_length_mm(expected, 130.0)))


@pytest.mark.parametrize("name", ["tele", "wide"])
def test_predicted_errors_are_those_seen_and_nonsense_is_found(name, request):
    """60 re-noised copies with 5 % nonsense: σ against the spread, noise against its truth."""
    world = request.getfixturevalue(name)
    rng = np.random.default_rng(11)
    values, sigmas, noise, believed, lost = [], [], [], 0, 0
    for _ in range(60):
        pixels, nonsense = world.noisy(rng, 0.1, outliers=0.05)
        result = calibrate_views(world.points, pixels, world.camera.sensor)
        values.append(_values(result))
        sigmas.append([result.sigma(quantity) for quantity in QUANTITIES])
        noise.append(result.noise_px)
        for used, bad in zip(result.inliers, nonsense, strict=True):
            believed += int((used & bad).sum())
            lost += int((~used & ~bad).sum())
    ratio = np.std(values, axis=0, ddof=1) / np.sqrt(np.mean(np.square(sigmas), axis=0))
    np.testing.assert_allclose(ratio, 1.0, atol=0.25)
    assert np.mean(noise) == pytest.approx(0.1, rel=0.01)
    # Of 50 000 corners, a handful of nonsense lands within 0.4 px, and one good one in 17 000 goes.
    assert believed <= 3
    assert lost <= 12


def test_the_ratio_is_better_known_than_its_parts(tele):
    """The paper's claim: d/D is far better determined than d or D, whose errors go together."""
    pixels, _ = tele.noisy(np.random.default_rng(0), 0.1)
    result = calibrate_views(tele.points, pixels, tele.camera.sensor)
    relative = result.sigma("image_distance_mm") / result.image_distance_mm
    assert result.sigma("magnification") / result.magnification < 0.03 * relative
    covariance = result.covariance(["image_distance_mm", "object_distance_mm"])
    correlation = covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])
    assert correlation > 0.99


def test_a_few_corners_are_enough(look, tele):
    world = look(tele.camera, 650.0, board=Chessboard(4, 3, 9.0))
    rng = np.random.default_rng(2)
    for _ in range(10):
        pixels, nonsense = world.noisy(rng, 0.1, outliers=0.05)
        result = calibrate_views(world.points, pixels, world.camera.sensor)
        error = result.image_distance_mm - 130.0
        assert abs(error) < 4.5 * result.sigma("image_distance_mm")
        assert not any((u & b).any() for u, b in zip(result.inliers, nonsense, strict=True))


def test_partial_boards_are_used(tele):
    pixels, _ = tele.noisy(np.random.default_rng(0), 0.1)
    halves = [(p[: len(p) // (1 + i % 3)], q[: len(p) // (1 + i % 3)]) for i, (p, q) in
              enumerate(zip(tele.points, pixels, strict=True))]  # fmt: skip
    result = calibrate_views([p for p, _ in halves], [q for _, q in halves], tele.camera.sensor)
    assert [len(i) for i in result.inliers] == [len(p) for p, _ in halves]
    assert abs(result.image_distance_mm - 130) < 4 * result.sigma("image_distance_mm")


def test_a_bad_view_is_dropped_whole(tele):
    """The target was moved a little under the camera's eyes: blurred corners, all of them."""
    rng = np.random.default_rng(0)
    pixels, _ = tele.noisy(rng, 0.1)
    pixels[3] = pixels[3] + 1.5 * rng.standard_normal(pixels[3].shape)
    result = calibrate_views(tele.points, pixels, tele.camera.sensor)
    (rejection,) = result.rejected
    assert (rejection.view, rejection.point) == (3, None)
    assert 1.5 < rejection.residual_px < 2.7
    assert "corners agree with the other views" in rejection.reason
    assert not result.inliers[3].any()
    assert np.isfinite(result.residuals_px[3]).all()


def test_a_noisier_view_is_dropped_when_it_is_much_noisier(tele):
    rng = np.random.default_rng(0)
    pixels, _ = tele.noisy(rng, 0.1)
    pixels[2] = pixels[2] + 0.35 * rng.standard_normal(pixels[2].shape)
    result = calibrate_views(tele.points, pixels, tele.camera.sensor)
    assert any(r.view == 2 and r.point is None for r in result.rejected)


def test_swapped_corners_are_reported_one_by_one(tele):
    pixels, _ = tele.noisy(np.random.default_rng(0), 0.1)
    pixels[1][[5, 6]] = pixels[1][[6, 5]]
    result = calibrate_views(tele.points, pixels, tele.camera.sensor)
    assert [(r.view, r.point) for r in result.rejected] == [(1, 5), (1, 6)]
    assert "px from where the other corners put it (limit" in result.rejected[0].reason


def test_a_view_without_enough_points_is_left_out(tele):
    points = [*tele.points, tele.points[0][:3], tele.points[0][:10]]
    pixels = [*tele.pixels, tele.pixels[0][:3], tele.pixels[0][:10]]
    result = calibrate_views(points, pixels, tele.camera.sensor)
    assert [(r.view, r.point) for r in result.rejected] == [(6, None), (7, None)]
    assert result.rejected[0].reason == "view 6 shows 3 points, and at least 4 are needed"
    assert "the 10 points of view 7 lie on a line" in result.rejected[1].reason
    assert result.image_distance_mm == pytest.approx(130.0, rel=1e-7)
    with pytest.raises(DegenerateGeometryError, match="view 6 shows 3 points, and at least 4"):
        calibrate_views(points, pixels, tele.camera.sensor, reject_outliers=False)
    with pytest.raises(DegenerateGeometryError, match="no view can be used: view 0 shows 3"):
        calibrate_views(points[6:7], pixels[6:7], tele.camera.sensor)


def test_without_rejection_every_corner_counts(tele):
    pixels, _ = tele.noisy(np.random.default_rng(0), 0.1)
    pixels[0][0] += 5.0
    result = calibrate_views(tele.points, pixels, tele.camera.sensor, reject_outliers=False)
    assert all(used.all() for used in result.inliers)
    assert result.noise_px > 0.15


def test_losing_the_focus_view_is_told(tele):
    pixels, _ = tele.noisy(np.random.default_rng(0), 0.1)
    pixels[0] = np.random.default_rng(1).uniform(0, 2000, pixels[0].shape)
    result = calibrate_views(tele.points, pixels, tele.camera.sensor)
    assert result.focus_view is None
    assert "the focus view (view 0) was rejected, so that D is not known" in result.warnings
    with pytest.raises(CalibrationError, match="the object distance is not known: no focus view"):
        _ = result.object_distance_mm
    with pytest.raises(InputError, match="no covariance of magnification; known are image_dist"):
        result.sigma("magnification")


def test_small_tilts_are_warned_of_in_words(look, tele):
    world = look(tele.camera, 650.0, ((0, 0), (4, 0), (-4, 0), (0, 4)))
    pixels, _ = world.noisy(np.random.default_rng(0), 0.2)
    result = calibrate_views(
        world.points, pixels, world.camera.sensor, principal_point_px=world.camera.centre_px
    )
    (warning,) = result.warnings
    assert "f and D cannot be told apart at this tilt (at most 4°): σ(f)" in warning
    assert "but d/D is good to 0.0" in warning


def test_a_wandering_principal_point_is_warned_of(look, tele):
    world = look(tele.camera, 1300.0, ((0, 0), (12, 0), (-12, 0), (0, 12)))
    pixels, _ = world.noisy(np.random.default_rng(0), 1.0)
    result = calibrate_views(world.points, pixels, world.camera.sensor)
    assert any("the principal point is only known to ±" in w for w in result.warnings)


def test_parallel_views_are_refused(look, tele):
    world = look(tele.camera, 650.0, ((0, 0), (0, 0), (0, 0)))
    pixels, _ = world.noisy(np.random.default_rng(0), 0.1)
    with pytest.raises(DegenerateGeometryError, match="f and T_z are inseparable: the target pla"):
        calibrate_views(
            world.points, pixels, world.camera.sensor, principal_point_px=world.camera.centre_px
        )


def test_exactly_parallel_views_leave_parameters_undetermined(look, tele):
    plain = Camera(tele.camera.sensor, 130.0)
    world = look(plain, 650.0, ((0, 0), (0, 0)))
    with pytest.raises(DegenerateGeometryError, match="the views do not determine the camera: two"):
        calibrate_views(world.points, world.pixels, plain.sensor)


def test_too_few_observations_are_refused(look, tele):
    world = look(tele.camera, 650.0, ((10, 5),), Chessboard(3, 3, 10.0))
    few = [world.points[0][[0, 2, 6, 8]]], [world.pixels[0][[0, 2, 6, 8]]]
    with pytest.raises(DegenerateGeometryError, match="4 points in 1 views are too few for the 10"):
        calibrate_views(*few, world.camera.sensor, reject_outliers=False)


def test_nonsense_is_refused(tele):
    rng = np.random.default_rng(0)
    nonsense = [rng.uniform(0, 2000, p.shape) for p in tele.pixels]
    with pytest.raises(CalibrationError, match="agree with no camera: at best, points miss by"):
        calibrate_views(tele.points, nonsense, tele.camera.sensor)


@pytest.fixture
def solved(tele):
    """Observations of the tele world, its true parameters, and which of them are estimated."""
    free = np.array([True, True, True, False, False, False, True])
    views = Views.pad(tele.points, tele.pixels, tele.camera.sensor.sample_pitch_mm)
    states = [
        State.of(tele.camera, p, m) for p, m in zip(tele.poses, views.middles_mm, strict=True)
    ]
    state = State(
        states[0].intrinsics,
        np.concatenate([s.rotations for s in states]),
        np.concatenate([s.placements for s in states]),
    )
    return views, state, free


def test_a_fit_that_ran_out_of_steps_is_refused(tele, solved):
    views, state, free = solved
    unfinished = Selection(state, views.present, (), False)
    with pytest.raises(ConvergenceError, match="the fit did not settle; hold the") as caught:
        conclude(views, unfinished, tele.camera.sensor, free, 0)
    assert caught.value.best.image_distance_mm == pytest.approx(130.0)


def test_a_camera_turned_inside_out_is_refused(tele, solved):
    """Without perspective in the pictures a fit may end at an image distance below zero."""
    views, state, free = solved
    intrinsics = state.intrinsics.copy()
    intrinsics[PERSPECTIVE] = -1e-9
    backwards = Selection(replace(state, intrinsics=intrinsics), views.present, (), True)
    with pytest.raises(DegenerateGeometryError, match="the image distance is not known at all"):
        conclude(views, backwards, tele.camera.sensor, free, 0)


def test_a_picture_given_twice_is_refused(tele):
    with pytest.raises(InputError, match="views 1 and 2 are the same to the last digit; give each"):
        calibrate_views(
            [*tele.points[:2], tele.points[1]], [*tele.pixels[:2], tele.pixels[1]], SENSOR
        )


def test_wrong_input_is_refused(tele):
    sensor = tele.camera.sensor
    with pytest.raises(InputError, match="one array a view, at least one; given are 0 and 0"):
        calibrate_views([], [], sensor)
    with pytest.raises(InputError, match="view 0 has 139 points, but 140 pixels; give one each"):
        calibrate_views([tele.points[0][1:]], tele.pixels[:1], sensor)
    with pytest.raises(InputError, match="focus_view 6 is not among the 6 views"):
        calibrate_views(tele.points, tele.pixels, sensor, focus_view=6)
    with pytest.raises(InputError, match="radial_terms must be 0 or more, but is -1"):
        calibrate_views(tele.points, tele.pixels, sensor, radial_terms=-1)
    with pytest.raises(InputError, match=r"pixels\[0\] must be finite"):
        calibrate_views(tele.points, [np.full_like(p, np.nan) for p in tele.pixels], sensor)
    bent = [p + np.array([0.0, 0.0, 1.0]) for p in tele.points]
    with pytest.raises(
        InputError, match="not in the plane z = 0, off by up to 1 mm; use calibrate"
    ):
        calibrate_views(bent, tele.pixels, sensor)


def test_poses_before_a_known_camera(wide):
    pixels, _ = wide.noisy(np.random.default_rng(0), 0.1)
    missed = fit_poses(wide.camera, wide.points, pixels)
    spread = np.sqrt(np.mean(np.concatenate(missed) ** 2))
    assert spread == pytest.approx(0.1, rel=0.05)
    with pytest.raises(DegenerateGeometryError, match="view 0 shows 3 points"):
        fit_poses(wide.camera, [wide.points[0][:3]], [pixels[0][:3]])


def test_a_target_seen_from_behind_its_neighbours_branch(look, tele):
    """Narrow fields make a tilt look like its mirror image; the right one is found."""
    world = look(tele.camera, 2000.0, ((0, 0), (25, 0), (-25, 0), (0, 25)))
    pixels, _ = world.noisy(np.random.default_rng(0), 0.05)
    result = calibrate_views(world.points, pixels, world.camera.sensor)
    for found, exact in zip(result.poses, world.poses, strict=True):
        assert found.distance_to(Pose(exact.rotation, found.translation_mm))[1] < np.radians(0.5)
