import numpy as np
import pytest

from lenscal.calibration.bundle import residuals
from lenscal.calibration.projection import RADIAL, camera_of, intrinsics_of, project
from lenscal.calibration.views import State, Views, translations_mm
from lenscal.camera import Camera
from lenscal.sensor import Sensor

SENSOR = Sensor(640, 480, 0.01, 0.012, scale_factor=0.7)
PITCH = np.array([0.01, 0.012])
CAMERA = Camera(SENSOR, 5.0, 8e-3, (310.0, 250.0), (3e-4, -1e-5), (2e-4, -3e-4))


@pytest.fixture
def state(look):
    world = look(CAMERA, 60.0, ((5, -3), (20, 10)))
    views = Views.pad(world.points, world.pixels, PITCH)
    single = [State.of(CAMERA, p, m) for p, m in zip(world.poses, views.middles_mm, strict=True)]
    together = State(
        single[0].intrinsics,
        np.concatenate([s.rotations for s in single]),
        np.concatenate([s.placements for s in single]),
    )
    return views, together, world


def test_agrees_with_the_camera(state):
    """The solver's projection and `Camera.project` are the same function."""
    views, parameters, _ = state
    np.testing.assert_allclose(residuals(views, parameters), 0.0, atol=1e-9)


def test_parameters_and_records_say_the_same(state):
    views, parameters, world = state
    for pose, exact in zip(parameters.poses(views.middles_mm), world.poses, strict=True):
        np.testing.assert_allclose(pose.matrix, exact.matrix, atol=1e-9)
    np.testing.assert_allclose(
        intrinsics_of(camera_of(parameters.intrinsics, SENSOR)), parameters.intrinsics, rtol=1e-14
    )


def _pixels(views, state):
    return project(
        views.points_mm, state.intrinsics, state.rotations, state.placements, PITCH
    ).pixels


def test_derivatives_by_intrinsics_match_differences(state):
    views, parameters, _ = state
    count = len(parameters.intrinsics)
    exact = project(
        views.points_mm,
        parameters.intrinsics,
        parameters.rotations,
        parameters.placements,
        PITCH,
    ).by_intrinsics
    still = np.zeros((len(parameters.placements), 6))
    for index in range(count):
        step = np.zeros(count)
        step[index] = 1e-6 * max(abs(parameters.intrinsics[index]), 1e-3)
        change = _pixels(views, parameters.moved(step, still)) - _pixels(
            views, parameters.moved(-step, still)
        )
        expected = change / (2 * step[index])
        scale = np.abs(exact[..., index]).max()
        np.testing.assert_allclose(exact[..., index], expected, atol=2e-6 * scale)


def test_derivatives_by_pose_match_differences(state):
    views, parameters, _ = state
    exact = project(
        views.points_mm,
        parameters.intrinsics,
        parameters.rotations,
        parameters.placements,
        PITCH,
    ).by_pose
    for index in range(6):
        step = np.zeros((len(parameters.placements), 6))
        step[:, index] = 1e-6
        none = np.zeros(len(parameters.intrinsics))
        change = _pixels(views, parameters.moved(none, step)) - _pixels(
            views, parameters.moved(none, -step)
        )
        scale = np.abs(exact[..., index]).max()
        np.testing.assert_allclose(exact[..., index], change / 2e-6, atol=1e-6 * scale)


def test_no_perspective_is_no_singularity(state):
    """At 1/d = 0 the projection is affine, and its derivative by 1/d finite."""
    views, parameters, _ = state
    flat = parameters.intrinsics.copy()
    flat[0], flat[RADIAL:] = 0.0, 0.0
    result = project(views.points_mm, flat, parameters.rotations, parameters.placements, PITCH)
    assert np.isfinite(result.pixels).all()
    assert np.isfinite(result.by_intrinsics).all()


def test_points_beyond_the_fold_or_behind_the_camera_are_nan():
    fold = Camera(SENSOR, 5.0, -0.05)
    state = State(intrinsics_of(fold), np.eye(3)[None], np.array([[0.0, 0.0, 0.1]]))
    points = np.array([[[0.0, 0.0, 0.0], [80.0, 0.0, 0.0], [0.0, 0.0, -60.0]]])
    pixels = project(points, state.intrinsics, state.rotations, state.placements, PITCH).pixels
    assert np.isfinite(pixels[0, 0]).all()
    assert np.isnan(pixels[0, 1:]).all()


def test_translation_of_a_placement():
    shift = translations_mm(
        np.array(1 / 100.0), np.eye(3)[None], np.array([[2.0, 1.0, 0.2]]), np.zeros((1, 3))
    )
    np.testing.assert_allclose(shift, [[10.0, 5.0, 500.0]])
