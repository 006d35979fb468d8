import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from lenscal.camera import Camera
from lenscal.imaging.plane_mapping import BEYOND_MM, points_on_plane
from lenscal.pose import Pose
from lenscal.sensor import Sensor, Window

CAMERA = Camera(Sensor(64, 48, 0.02, 0.03), 25.0, 2e-3, [30.0, 25.0])


@settings(max_examples=30, deadline=None)
@given(st.tuples(*[st.floats(-0.6, 0.6)] * 3), st.tuples(*[st.floats(-50, 50)] * 2))
def test_points_on_the_plane_project_to_their_pixels(rotation_vector, shift):
    camera_from_target = Pose.from_rotation_vector(rotation_vector, [*shift, 300.0])
    seen = points_on_plane(CAMERA, camera_from_target, Window(10, 5, 30, 20))
    points = np.concatenate([seen.position_mm, np.zeros((20, 30, 1))], axis=-1)
    in_camera = camera_from_target.transform(points)
    columns, rows = np.meshgrid(10 + np.arange(30), 5 + np.arange(20))
    np.testing.assert_allclose(
        CAMERA.project(in_camera), np.stack([columns, rows], axis=-1), atol=1e-8
    )
    np.testing.assert_allclose(seen.depth_mm, in_camera[..., 2], rtol=1e-9)


def test_rays_that_miss_the_plane_look_beyond():
    """A plane tilted far about x is seen by the lower half of the image only."""
    steep = Pose.from_rotation_vector([np.radians(-89.9), 0, 0], [0.0, 20.0, 100.0])
    seen = points_on_plane(CAMERA, steep, Window(0, 0, 64, 48))
    above = np.isinf(seen.depth_mm)
    assert above.any()
    assert not above.all()
    assert np.all(seen.position_mm[above] == BEYOND_MM)


def test_a_plane_seen_edge_on_is_nowhere():
    edge_on = Pose.from_rotation_vector([np.pi / 2, 0, 0], [0.0, 0.0, 100.0])
    assert np.isinf(points_on_plane(CAMERA, edge_on, Window(0, 0, 64, 48)).depth_mm).all()
