"""What docs/conventions.md says, tried out."""

from pathlib import Path

import numpy as np
import pytest

from lenscal.camera import Camera
from lenscal.optics import blur_diameter_mm, focal_length_mm
from lenscal.plate import parse_target
from lenscal.pose import Pose
from lenscal.sensor import Sensor

SENSOR = Sensor(512, 480, 0.023, 0.01375, scale_factor=0.70642)
CAMERA = Camera(SENSOR, 50.0)
AHEAD = np.array([0.0, 0.0, 500.0])


@pytest.mark.parametrize(
    ("axis", "moves"), [((0.0, 1.0, 0.0), (-1, 0)), ((1.0, 0.0, 0.0), (0, 1))], ids=["+y", "+x"]
)
def test_a_tilt_moves_the_image_the_way_it_says(axis, moves):
    """A tilt about +y turns the axis to +x, so the image moves left; about +x it moves down."""
    turned = Pose.from_rotation_vector(0.02 * np.array(axis))
    shift = CAMERA.project(turned.inverse().transform(AHEAD)) - CAMERA.project(AHEAD)
    expected = 50.0 * np.tan(0.02) / SENSOR.sample_pitch_mm
    np.testing.assert_allclose(shift, np.array(moves) * expected, atol=1e-9)


def test_the_axis_turns_towards_plus_x_about_plus_y():
    axis = Pose.from_rotation_vector([0.0, 0.02, 0.0]).transform([0.0, 0.0, 1.0])
    assert axis[0] > 0


def test_a_camera_that_faces_the_target_squarely_has_the_identity_rotation():
    """Right in the print is right in the image, down is down."""
    target = parse_target("chessboard:4x3:5mm")
    camera_from_target = Pose(np.eye(3), np.array([0.0, 0.0, 400.0]))
    pixels = CAMERA.project(camera_from_target.transform(target.points_mm)).reshape(3, 4, 2)
    assert (np.diff(pixels[..., 0], axis=1) > 0).all()
    assert (np.diff(pixels[..., 1], axis=0) > 0).all()


def test_chains_read_like_fractions():
    base_from_hand = Pose.from_rotation_vector([0.1, 0, 0], [1, 2, 3])
    hand_from_camera = Pose.from_rotation_vector([0, 0.2, 0], [0, 5, 0])
    point = np.array([1.0, 1.0, 10.0])
    np.testing.assert_allclose(
        (base_from_hand @ hand_from_camera).transform(point),
        base_from_hand.transform(hand_from_camera.transform(point)),
    )


def test_the_scale_factor_multiplies():
    """x_mm = pitch_x_mm · scale_factor · (u − c_x)."""
    u = 300.0
    x_mm = 0.023 * 0.70642 * (u - SENSOR.centre_px[0])
    assert CAMERA.unproject([u, SENSOR.centre_px[1]])[0] == pytest.approx(
        x_mm / np.hypot(x_mm, 50.0)
    )


def test_f_is_the_papers_and_blur_uses_the_perspective_quantities():
    assert focal_length_mm(660.0, 126.0) == pytest.approx(1 / (1 / 660 + 1 / 126))
    assert blur_diameter_mm(600.0, 660.0, 126.0, 20.0) == pytest.approx(
        20 * 126 * (1 / 600 - 1 / 660)
    )


def test_the_page_names_every_quantity_of_a_map():
    from lenscal.maps.quantities import QUANTITIES

    page = (Path(__file__).parents[1] / "docs" / "conventions.md").read_text()
    core = [q for q in QUANTITIES if not q.startswith(("principal_point", "k1"))]
    assert [q for q in core if q not in page] == []
