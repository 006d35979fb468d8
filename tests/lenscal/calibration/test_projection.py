from dataclasses import replace

import numpy as np
import pytest

from lenscal.calibration.bundle import residuals
from lenscal.calibration.projection import (
    RADIAL,
    camera_of,
    intrinsics_of,
    project,
    project_with_derivatives,
)
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
    return project(views.points_mm, state.intrinsics, state.rotations, state.placements, PITCH)


def _with_derivatives(views, state, free):
    return project_with_derivatives(
        views.points_mm, state.intrinsics, state.rotations, state.placements, PITCH, free
    )


def test_pixels_are_the_same_with_and_without_derivatives(state):
    views, parameters, _ = state
    free = np.ones(len(parameters.intrinsics), dtype=bool)
    np.testing.assert_array_equal(
        _with_derivatives(views, parameters, free).pixels, _pixels(views, parameters)
    )


def test_derivatives_match_differences(state):
    """All at once: the intrinsics, then rotation vector and placement of each view."""
    views, parameters, _ = state
    count = len(parameters.intrinsics)
    exact = _with_derivatives(views, parameters, np.ones(count, dtype=bool)).jacobian
    for index in range(count + 6):
        shared, poses = np.zeros(count), np.zeros((len(parameters.placements), 6))
        size = 1e-6
        if index < count:
            size *= max(abs(parameters.intrinsics[index]), 1e-3)
            shared[index] = size
        else:
            poses[:, index - count] = size
        ahead = _pixels(views, parameters.moved(shared, poses))
        change = (ahead - _pixels(views, parameters.moved(-shared, -poses))) / (2 * size)
        scale = np.abs(exact[:, index]).max()
        np.testing.assert_allclose(exact[:, index], change, atol=2e-6 * scale, err_msg=str(index))


def test_derivatives_of_what_is_held_fixed_are_left_out(state):
    views, parameters, _ = state
    count = len(parameters.intrinsics)
    every = _with_derivatives(views, parameters, np.ones(count, dtype=bool)).jacobian
    free = np.arange(count) % 2 == 1
    some = _with_derivatives(views, parameters, free).jacobian
    np.testing.assert_array_equal(some, every[:, np.r_[free, np.ones(6, dtype=bool)]])


def test_no_perspective_is_no_singularity(state):
    """At 1/d = 0 the projection is affine, and its derivative by 1/d finite."""
    views, parameters, _ = state
    flat = parameters.intrinsics.copy()
    flat[0], flat[RADIAL:] = 0.0, 0.0
    free = np.ones(len(flat), dtype=bool)
    result = _with_derivatives(views, replace(parameters, intrinsics=flat), free)
    assert np.isfinite(result.pixels).all()
    assert np.isfinite(result.jacobian).all()


def test_points_beyond_the_fold_or_behind_the_camera_are_nan():
    fold = Camera(SENSOR, 5.0, -0.05)
    state = State(intrinsics_of(fold), np.eye(3)[None], np.array([[0.0, 0.0, 0.1]]))
    points = np.array([[[0.0, 0.0, 0.0], [80.0, 0.0, 0.0], [0.0, 0.0, -60.0]]]).mT
    pixels = project(points, state.intrinsics, state.rotations, state.placements, PITCH)
    assert np.isfinite(pixels[0, :, 0]).all()
    assert np.isnan(pixels[0, :, 1:]).all()


def test_translation_of_a_placement():
    shift = translations_mm(
        np.array(1 / 100.0), np.eye(3)[None], np.array([[2.0, 1.0, 0.2]]), np.zeros((1, 3))
    )
    np.testing.assert_allclose(shift, [[10.0, 5.0, 500.0]])
