"""Against Willson's reference data of 1995; his numbers are in issue 4 and in the anchors."""

from dataclasses import replace

import numpy as np
import pytest

from lenscal.calibration.tsai import calibrate_tsai
from lenscal.camera import Camera
from lenscal.errors import CalibrationError, DegenerateGeometryError, InputError
from lenscal.pose import Pose
from lenscal.sensor import Sensor

SENSOR = Sensor(576, 384, 0.023, 0.023)


@pytest.fixture
def coplanar(reference_data):
    return _read(reference_data / "tsai-willson-v3.0b3" / "cc_cd.dat")


@pytest.fixture
def in_space(reference_data):
    return _read(reference_data / "tsai-willson-v3.0b3" / "ncc_cd.dat")


def _read(path):
    rows = np.loadtxt(path)
    return rows[:, :3], rows[:, 3:]


def _squares(calibration):
    return sum(float((r**2).sum()) for r in calibration.residuals_px)


def test_two_stage_reaches_the_converged_solution(coplanar):
    """Willson's own log stopped early, at f 220.222 and Tz 5375.73."""
    result = calibrate_tsai(*coplanar, SENSOR, principal_point_px=(258, 204), method="two_stage")
    t_x, t_y, t_z = result.poses[0].translation_mm
    assert result.image_distance_mm == pytest.approx(220.566, rel=2e-5)
    assert result.camera.k1_per_mm2 == pytest.approx(-5.3967e-4, rel=2e-5)
    assert t_z == pytest.approx(5384.19, rel=2e-5)
    assert (t_x, t_y) == pytest.approx((152.194, -70.610), abs=1e-3)
    assert t_z / result.image_distance_mm == pytest.approx(24.4108, abs=5e-4)
    assert result.warnings == ()
    willson = _at(coplanar, 220.222296, -5.393556e-4, 5375.732834, result)
    assert willson > 2.1099
    assert _undistorted(coplanar, result.camera, result.poses[0]) < willson


def _at(data, distance, k1, t_z, result):
    """Squares of the undistorted residual, with d, κ1 and T_z from elsewhere."""
    camera = replace(result.camera, image_distance_mm=distance, k1_per_mm2=k1)
    shift = result.poses[0].translation_mm
    return _undistorted(data, camera, Pose(result.poses[0].rotation, [*shift[:2], t_z]))


def _undistorted(data, camera, pose):
    """Squares of what Tsai's second stage minimises, in px²."""
    (points, seen), pitch = data, camera.sensor.sample_pitch_mm
    x, y, z = pose.transform(points).T
    ideal = camera.image_distance_mm * np.column_stack([x / z, y / z])
    straight = camera.undistort((seen - camera.centre_px) * pitch)
    return float((((ideal - straight) / pitch) ** 2).sum())


def test_two_stage_in_space_agrees_with_willsons(in_space):
    """From nccal.log, "Tz, f, kappa1 optimization"; his T_x is not freed from his s_x."""
    result = calibrate_tsai(*in_space, SENSOR, principal_point_px=(258, 204), method="two_stage")
    t_x, t_y, t_z = result.poses[0].translation_mm
    assert t_y == pytest.approx(-79.794913, abs=1e-6)
    assert t_x / result.camera.sensor.scale_factor == pytest.approx(-97.408705, abs=1e-6)
    assert result.image_distance_mm == pytest.approx(68.168628, rel=3e-3)
    assert t_z / result.image_distance_mm == pytest.approx(28.556096, rel=1e-4)
    assert 1 / result.camera.sensor.scale_factor == pytest.approx(1.000158, abs=6e-7)
    # One degree of freedom less: the same orientation, in samples as they are stated.
    held = calibrate_tsai(
        *in_space, SENSOR, principal_point_px=(258, 204), scale_factor=1.0, method="two_stage"
    )
    assert held.camera.sensor.scale_factor == 1.0
    assert held.image_distance_mm == pytest.approx(68.168628, rel=3e-3)


def test_two_stage_gives_no_uncertainty(coplanar):
    result = calibrate_tsai(*coplanar, SENSOR, principal_point_px=(258, 204), method="two_stage")
    with pytest.raises(CalibrationError, match="comes without uncertainty; calibrate with method"):
        result.sigma("image_distance_mm")


def test_full_beats_the_published_optimum(coplanar):
    result = calibrate_tsai(*coplanar, SENSOR)
    assert _squares(result) <= 1.21366
    names = ["translation_z_mm", "image_distance_mm"]
    depth, distance = result.poses[0].translation_mm[2], result.image_distance_mm
    gradient = np.array([1 / distance, -depth / distance**2])
    sigma = np.sqrt(gradient @ result.covariance(names) @ gradient)
    assert depth / distance == pytest.approx(24.437, abs=1e-3)
    assert sigma == pytest.approx(0.0090, rel=0.05)
    assert 100 * result.sigma("image_distance_mm") / distance == pytest.approx(5.4, abs=0.3)


def test_the_warning_fires_on_the_coplanar_set_alone(coplanar, in_space):
    (warning,) = calibrate_tsai(*coplanar, SENSOR).warnings
    assert "f and D cannot be told apart at this tilt (at most 21°): σ(f) 5.4 %" in warning
    assert "but d/D is good to 0.012 %; tilt the target by 30° or more" in warning
    assert calibrate_tsai(*in_space, SENSOR).warnings == ()


def test_full_in_space_frees_the_scale_factor(in_space):
    result = calibrate_tsai(*in_space, SENSOR)
    assert _squares(result) <= 2.39976
    assert result.image_distance_mm == pytest.approx(70.0, abs=3 * 0.231)
    # Willson's s_x divides: 1.000175.
    assert 1 / result.camera.sensor.scale_factor == pytest.approx(1.000175, abs=1e-5)


def test_a_stated_scale_factor_and_principal_point_are_kept(in_space):
    result = calibrate_tsai(*in_space, SENSOR, principal_point_px=(262, 212), scale_factor=1.0)
    assert result.camera.sensor.scale_factor == 1.0
    np.testing.assert_array_equal(result.camera.centre_px, (262, 212))
    assert result.sigma("scale_factor") == result.sigma("principal_point_x_px") == 0.0


def _scene(pose, world, k1=-5e-4, distance=100.0):
    camera = Camera(SENSOR, distance, k1, (290.0, 190.0))
    return world, camera.project(pose.transform(world)), camera


def _plane(columns=8, rows=6, spacing=10.0):
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    grid = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3).astype(float)
    return spacing * (grid - grid.mean(axis=0))


@pytest.mark.parametrize(
    ("shift", "named"),
    [((0.0, 0.0, 1200.0), True), ((40.0, 0.0, 1200.0), True), ((20.0, -30.0, 900.0), False)],
)
@pytest.mark.parametrize("in_plane", [True, False])
def test_an_origin_that_tsai_warns_of_is_named(shift, named, in_plane):
    """T_y divides his linear system, and vanishes where the world's origin is level with C."""
    world = _plane() if in_plane else np.random.default_rng(3).uniform(-40, 40, (40, 3))
    pose = Pose.from_rotation_vector((0.5, 0.2, 0.1), shift)
    points, pixels, camera = _scene(pose, world)
    arguments = {"principal_point_px": camera.centre_px}
    result = calibrate_tsai(points, pixels, SENSOR, **arguments, method="two_stage")
    assert result.image_distance_mm == pytest.approx(100.0, rel=1e-6)
    np.testing.assert_allclose(result.poses[0].translation_mm, shift, rtol=1e-6, atol=1e-4)
    assert len(result.warnings) == named
    if named:
        place = ", ".join(f"{c:.6g}" for c in points[_farthest(pixels, camera)])
        assert "T_y is near zero: the origin of the world is seen near" in result.warnings[0]
        assert f"it was solved about ({place}) mm instead" in result.warnings[0]
    # The full optimisation does not depend on where it began.
    assert calibrate_tsai(points, pixels, SENSOR, **arguments).warnings == ()


def _farthest(pixels, camera):
    return np.argmax(np.abs(pixels[:, 1] - camera.centre_px[1]))


@pytest.mark.parametrize("method", ["two_stage", "full"])
@pytest.mark.parametrize("shift", [(0.0, 0.0, 1200.0), (40.0, 0.0, 1200.0), (20.0, -30.0, 900.0)])
def test_exact_points_give_the_exact_camera_wherever_the_origin_is(method, shift):
    """An origin at the image centre, or on the axis where T_y vanishes, is moved, not refused."""
    pose = Pose.from_rotation_vector((0.5, 0.2, 0.1), shift)
    points, pixels, camera = _scene(pose, _plane())
    result = calibrate_tsai(
        points, pixels, SENSOR, principal_point_px=camera.centre_px, method=method
    )
    assert result.image_distance_mm == pytest.approx(100.0, rel=1e-6)
    np.testing.assert_allclose(result.poses[0].matrix, pose.matrix, rtol=1e-5, atol=1e-3)


def test_a_plane_may_stand_anywhere_in_the_world():
    """Coplanar points are recognised whatever their plane."""
    pose = Pose.from_rotation_vector((0.5, 0.2, 0.1), (20.0, -30.0, 900.0))
    points, pixels, camera = _scene(pose, _plane())
    plane_from_world = Pose.from_rotation_vector((1.0, -0.4, 0.3), (300.0, -200.0, 100.0))
    elsewhere = plane_from_world.inverse().transform(points)
    result = calibrate_tsai(elsewhere, pixels, SENSOR, principal_point_px=camera.centre_px)
    assert result.image_distance_mm == pytest.approx(100.0, rel=1e-6)
    expected = (pose @ plane_from_world).matrix
    np.testing.assert_allclose(result.poses[0].matrix, expected, rtol=1e-5, atol=1e-3)


def test_exact_points_in_space_show_the_scale_factor():
    rng = np.random.default_rng(3)
    points = rng.uniform(-40, 40, (40, 3))
    pose = Pose.from_rotation_vector((0.3, -0.2, 0.4), (10.0, 15.0, 900.0))
    camera = Camera(Sensor(576, 384, 0.023, 0.023, 0.70642), 100.0, -5e-4, (290.0, 190.0))
    pixels = camera.project(pose.transform(points))
    for method in ("two_stage", "full"):
        result = calibrate_tsai(
            points, pixels, SENSOR, principal_point_px=(290.0, 190.0), method=method
        )
        assert result.camera.sensor.scale_factor == pytest.approx(0.70642, rel=1e-7)
        assert result.image_distance_mm == pytest.approx(100.0, rel=1e-6)


def test_points_all_but_in_a_plane_keep_the_scale_factor_of_the_sensor():
    """Where it would be known to no better than 1 %, it is not estimated, and a warning says so."""
    rng = np.random.default_rng(3)
    points = rng.uniform(-40, 40, (60, 3)) * (1.0, 1.0, 2e-3)
    pose = Pose.from_rotation_vector((0.5, 0.0, 0.0), (10.0, 15.0, 900.0))
    points, pixels, camera = _scene(pose, points)
    noisy = pixels + 0.1 * rng.standard_normal(pixels.shape)
    result = calibrate_tsai(points, noisy, SENSOR, principal_point_px=camera.centre_px)
    assert result.camera.sensor.scale_factor == 1.0
    assert result.sigma("scale_factor") == 0.0
    assert result.image_distance_mm == pytest.approx(
        100.0, abs=4 * result.sigma("image_distance_mm")
    )
    assert (
        "the points are too nearly in one plane to show the scale factor (σ" in result.warnings[0]
    )
    assert "that of the sensor, 1, was kept" in result.warnings[0]


@pytest.mark.parametrize("method", ["two_stage", "full"])
def test_a_stated_scale_factor_is_right_in_both_methods(method):
    rng = np.random.default_rng(3)
    pose = Pose.from_rotation_vector((0.3, -0.2, 0.4), (10.0, 15.0, 900.0))
    sensor = replace(SENSOR, scale_factor=0.70642)
    camera = Camera(sensor, 100.0, -5e-4, (290.0, 190.0))
    points = rng.uniform(-40, 40, (40, 3))
    pixels = camera.project(pose.transform(points))
    result = calibrate_tsai(
        points,
        pixels,
        SENSOR,
        principal_point_px=(290.0, 190.0),
        scale_factor=0.70642,
        method=method,
    )
    assert result.camera.sensor == sensor
    assert result.rms_px < 1e-4
    assert result.image_distance_mm == pytest.approx(100.0, rel=1e-6)


def test_a_plane_parallel_to_the_sensor_is_refused():
    pose = Pose.from_rotation_vector((0.0, 0.0, 0.3), (20.0, -30.0, 900.0))
    points, pixels, camera = _scene(pose, _plane(), k1=0.0)
    pixels = pixels + np.random.default_rng(0).normal(0.0, 0.1, pixels.shape)
    for method in ("two_stage", "full"):
        with pytest.raises(DegenerateGeometryError, match="f and T_z are inseparable: the target"):
            calibrate_tsai(
                points, pixels, SENSOR, principal_point_px=camera.centre_px, method=method
            )


def test_when_not_even_the_sign_of_d_shows_the_error_says_so():
    """Among noisy near-parallel views, some have their best d below zero."""
    pose = Pose.from_rotation_vector((0.014, 0.01, 0.0), (3.0, 5.0, 900.0))
    points, pixels, camera = _scene(pose, _plane(), k1=0.0)
    messages = []
    for seed in range(40):
        noisy = pixels + np.random.default_rng(seed).normal(0.0, 1.0, pixels.shape)
        with pytest.raises(DegenerateGeometryError) as caught:
            calibrate_tsai(
                points,
                noisy,
                SENSOR,
                principal_point_px=camera.centre_px,
                method="two_stage",
            )
        messages.append(str(caught.value))
    assert all("f and T_z are inseparable" in message for message in messages)
    assert any("not known at all" in message for message in messages)


def test_points_on_a_line_are_refused():
    line = np.linspace(0, 1, 12)[:, None] * (50.0, 20.0, 0.0)
    with pytest.raises(DegenerateGeometryError, match="the 12 points lie on a line; spread them"):
        calibrate_tsai(line, line[:, :2], SENSOR)


def test_image_points_in_one_direction_are_refused():
    points = _plane()
    pixels = SENSOR.centre_px + np.arange(len(points))[:, None] * (1.0, 1.0)
    with pytest.raises(DegenerateGeometryError, match="do not determine the orientation"):
        calibrate_tsai(points, pixels, SENSOR)


@pytest.mark.parametrize(
    ("world", "words"),
    [
        (_plane(2, 2), "4 points are too few: Tsai's method needs at least 5 coplanar points"),
        (
            np.random.default_rng(1).uniform(-40, 40, (6, 3)),
            "6 points are too few: Tsai's method needs at least 7 points in space",
        ),
    ],
)
def test_too_few_points_are_refused(world, words):
    with pytest.raises(DegenerateGeometryError, match=words):
        calibrate_tsai(world, world[:, :2], SENSOR)


def test_too_few_points_for_the_full_method_are_refused():
    pose = Pose.from_rotation_vector((0.5, 0.2, 0.1), (20.0, -30.0, 900.0))
    points, pixels, _ = _scene(pose, _plane(3, 3))
    with pytest.raises(DegenerateGeometryError, match="9 points are too few for the full method"):
        calibrate_tsai(points, pixels, SENSOR)


def test_wrong_input_is_refused():
    points = _plane()
    with pytest.raises(InputError, match="there are 48 points, but 47 pixels; give one each"):
        calibrate_tsai(points, points[1:, :2], SENSOR)
    with pytest.raises(InputError, match="method must be 'full' or 'two_stage', but is 'best'"):
        calibrate_tsai(points, points[:, :2], SENSOR, method="best")
    with pytest.raises(InputError, match="pixels must be finite, but 96 of 96 values are NaN"):
        calibrate_tsai(points, np.full((48, 2), np.nan), SENSOR)
    with pytest.raises(InputError, match="scale_factor must be a positive number, but is 0"):
        calibrate_tsai(points, points[:, :2], SENSOR, scale_factor=0.0)
