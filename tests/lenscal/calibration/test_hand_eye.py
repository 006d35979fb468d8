import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lenscal.calibration.calibration import Repeatability
from lenscal.calibration.hand_eye import solve_hand_eye
from lenscal.calibration.hand_eye_equation import METHODS
from lenscal.errors import DegenerateGeometryError, InputError

#: The reference setting: the projection centre has not travelled.
REFERENCE = {"object_distance_mm": 400.0, "image_distance_mm": 110.0, "nodal_mm": (0.0, 0.0, 0.0)}


def _solve(world, **options):
    return solve_hand_eye(world.points, world.pixels, world.hands, world.camera.sensor, **options)


def _error(result, world):
    """Rotation vector in the frame of the hand, and translation."""
    truth = world.camera_from_hand.inverse()
    turn = Rotation.from_matrix(result.hand_from_camera.rotation @ truth.rotation.T).as_rotvec()
    return np.concatenate([turn, result.hand_from_camera.translation_mm - truth.translation_mm])


def test_exact_data_give_the_exact_answer(ride):
    world = ride(np.random.default_rng(0), noise_px=0.0, slip_mm=0.0, slip_rad=0.0, **REFERENCE)
    result = _solve(world, repeatability=Repeatability(rotation_rad=1e-4, translation_mm=0.02))
    np.testing.assert_allclose(_error(result, world), 0.0, atol=1e-5)
    np.testing.assert_allclose(
        result.base_from_target.matrix, world.base_from_target.matrix, atol=1e-4
    )


@pytest.mark.parametrize("method", METHODS)
def test_the_refined_result_does_not_depend_on_the_closed_form(ride, method):
    world = ride(np.random.default_rng(1), **REFERENCE)
    result, usual = _solve(world, method=method), _solve(world)
    assert result.method == method
    np.testing.assert_allclose(
        result.hand_from_camera.matrix, usual.hand_from_camera.matrix, atol=1e-9
    )
    apart = result.closed_form.translation_mm - result.hand_from_camera.translation_mm
    assert np.linalg.norm(apart) < 10.0


def test_errors_are_as_large_as_stated(ride):
    """Forty hand-eye calibrations, all six numbers and how their errors go together."""
    rng = np.random.default_rng(2)
    squared = []
    for _ in range(40):
        world = ride(rng, **REFERENCE)
        result = _solve(world, repeatability=Repeatability(rotation_rad=1e-4, translation_mm=0.02))
        error = _error(result, world)
        squared.append(error @ np.linalg.solve(result.covariance, error))
    assert np.mean(squared) == pytest.approx(6.0, rel=0.3)


def test_the_axis_is_known_worst(ride):
    """Along the optical axis the error is that of D; the camera looks along z of the hand."""
    result = _solve(ride(np.random.default_rng(3), **REFERENCE))
    across, _, along = result.sigma_translation_mm
    assert along > 2 * across
    assert (result.sigma_rotation_rad < 5e-4).all()


def test_what_cannot_be_solved_is_named(ride):
    world = ride(np.random.default_rng(4), tilted=0, displacements_mm=(-9, -6, 6, 9), **REFERENCE)
    with pytest.raises(DegenerateGeometryError, match="turn"):
        _solve(world)
    world = ride(np.random.default_rng(5), **REFERENCE)
    with pytest.raises(InputError, match="park"):
        _solve(world, method="guess")
