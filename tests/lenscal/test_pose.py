import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from lenscal.errors import InputError
from lenscal.pose import Pose

MICROMETRE = 1e-3
vectors = arrays(float, 3, elements=st.floats(-3.0, 3.0))
poses = st.builds(lambda r, t: Pose.from_rotation_vector(r, 100 * t), vectors, vectors)


def assert_same(a: Pose, b: Pose) -> None:
    shift, turn = a.distance_to(b)
    assert shift < 1e-9
    assert turn < 1e-7


@given(poses, poses, poses)
def test_composition_is_associative(a, b, c):
    assert_same((a @ b) @ c, a @ (b @ c))


@given(poses)
def test_a_pose_and_its_inverse_cancel(pose):
    assert_same(pose @ pose.inverse(), Pose.identity())


@given(poses, poses, vectors)
def test_a_product_maps_as_its_factors_do_one_after_the_other(a, b, point):
    np.testing.assert_allclose((a @ b).transform(point), a.transform(b.transform(point)), atol=1e-9)


@given(poses)
def test_matrix_and_rotation_vector_round_trip(pose):
    assert_same(Pose.from_matrix(pose.matrix), pose)
    assert_same(Pose.from_rotation_vector(pose.rotation_vector, pose.translation_mm), pose)


@given(poses)
def test_rotation_stays_orthonormal_along_a_chain(pose):
    chain = pose
    for _ in range(50):
        chain = chain @ pose
    assert np.abs(chain.rotation.T @ chain.rotation - np.eye(3)).max() < 1e-14


def test_a_quarter_turn_about_z_takes_x_to_y():
    turn = Pose.from_rotation_vector([0, 0, np.pi / 2], [0, 0, 5])
    np.testing.assert_allclose(turn.transform([[1.0, 0, 0]]), [[0, 1, 5]], atol=1e-15)


def test_a_pose_prints_as_what_makes_it():
    assert repr(Pose.identity()) == (
        "Pose.from_rotation_vector([0., 0., 0.], translation_mm=[0., 0., 0.])"
    )


@pytest.mark.parametrize(
    ("rotation", "message"),
    [
        (np.diag([1.0, 1.0, -1.0]), "it is a reflection; use Pose.from_rotation_vector"),
        (2 * np.eye(3), "it is off orthonormal by 3.0e"),
        (np.eye(2), r"rotation must have shape \(3, 3\)"),
    ],
)
def test_what_is_no_rotation_is_refused(rotation, message):
    with pytest.raises(InputError, match=message):
        Pose(rotation, np.zeros(3))


def test_a_projective_matrix_is_refused():
    matrix = np.eye(4)
    matrix[3, 0] = 1.0
    with pytest.raises(InputError, match=r"last row of matrix must be \(0, 0, 0, 1\)"):
        Pose.from_matrix(matrix)


def test_a_pose_multiplies_poses_only():
    with pytest.raises(TypeError):
        Pose.identity() @ 2.0
