import cv2
import numpy as np
import pytest

from lenscal.camera import Camera
from lenscal.errors import InputError
from lenscal.imaging.blur import BlurFloor
from lenscal.imaging.decal import Decal
from lenscal.imaging.formation import render
from lenscal.imaging.raycast import Body
from lenscal.imaging.scene import render_scene
from lenscal.imaging.texture import TargetSurface
from lenscal.optics import blur_diameter_mm
from lenscal.pose import Pose
from lenscal.sensor import Sensor, Window
from lenscal.target import Chessboard

CAMERA = Camera(Sensor(200, 160, 0.01, 0.012), 30.0, 2e-3, [104.0, 77.0])
SHARP_MM, PUPIL_MM = 300.0, 1.0
NO_FLOOR = BlurFloor(0.0, 0.0)


def plate(z_mm, left_mm=-500.0, right_mm=500.0, reflectance=0.8):
    """A sheet across the view, from one x to another."""
    corners = [(left_mm, -500, z_mm), (right_mm, -500, z_mm), (right_mm, 500, z_mm)]
    corners.append((left_mm, 500, z_mm))
    return Body(corners, [(0, 1, 2), (0, 2, 3)], reflectance)


def box(half_mm, reflectance=0.8):
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1], indexing="ij")).reshape(3, -1).T
    quads = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return Body(signs * half_mm, faces, reflectance)


def scene(bodies, pose=None, **options):
    defaults = {
        "object_distance_mm": SHARP_MM,
        "entrance_pupil_diameter_mm": PUPIL_MM,
        "floor": NO_FLOOR,
        "background": 0.0,
    }
    return render_scene(CAMERA, pose or Pose.identity(), bodies, **(defaults | options))


def test_a_cube_covers_the_hull_of_its_projected_corners():
    """A black cube before white: its area to 0.1 %, its middle to a hundredth of a pixel."""
    cube = box(3.0, reflectance=0.0)
    pose = Pose.from_rotation_vector([0.5, 0.7, 0.2], [1.0, 2.0, SHARP_MM])
    dark = 1 - scene([cube], pose, background=1.0).astype(np.float64)
    hull = cv2.convexHull(CAMERA.project(pose.transform(cube.vertices_mm)).astype(np.float32))
    moments = cv2.moments(hull)
    rows, columns = np.indices(dark.shape)
    assert dark.sum() == pytest.approx(moments["m00"], rel=1e-3)
    middle = np.array([(dark * columns).sum(), (dark * rows).sum()]) / dark.sum()
    expected = np.array([moments["m10"], moments["m01"]]) / moments["m00"]
    np.testing.assert_allclose(middle, expected, atol=0.01)


def test_the_nearer_body_hides_the_farther():
    near, far = plate(SHARP_MM - 10, -500, 0, 0.9), plate(SHARP_MM + 10, reflectance=0.2)
    for bodies in ([near, far], [far, near]):
        picture = scene(bodies, lamp_direction=(0, 0, -1))
        np.testing.assert_allclose(picture[:, :95], 0.9, rtol=1e-3)
        np.testing.assert_allclose(picture[:, 115:], 0.2, rtol=1e-3)


def test_a_lamp_shines_as_lambert_says():
    square = scene([plate(SHARP_MM)], lamp_direction=(0, 0, -1))
    slanted = scene([plate(SHARP_MM)], lamp_direction=(np.sqrt(3), 0, -1))
    behind = scene([plate(SHARP_MM)], lamp_direction=(0, 0, 1))
    np.testing.assert_allclose(square, 0.8, rtol=1e-5)
    np.testing.assert_allclose(slanted, 0.8 * (0.25 + 0.75 * 0.5), rtol=1e-5)
    np.testing.assert_allclose(behind, 0.8 * 0.25, rtol=1e-5)


def test_faces_have_a_reflectance_each():
    both = Body(plate(SHARP_MM).vertices_mm, plate(SHARP_MM).faces, [0.2, 0.7])
    picture = scene([both], lamp_direction=(0, 0, -1))
    # The border between both triangles runs from the top left to the bottom right.
    assert picture[10, 190] == pytest.approx(0.2, rel=1e-4)
    assert picture[150, 10] == pytest.approx(0.7, rel=1e-4)


@pytest.mark.parametrize("pupil_mm", [1e-3, 4.0, 15.0])
@pytest.mark.parametrize("tilt", [0.0, 0.4])
def test_a_decal_looks_like_the_flat_target(pupil_mm, tilt):
    """The same board through both renderers: every edge in the same place, with the same blur."""
    surface = TargetSurface(Chessboard(5, 4, 2.0))
    pose = Pose.from_rotation_vector([0.8 * tilt, 0.6 * tilt, 0.1], [0.2, -0.3, SHARP_MM + 4])
    through = {
        "object_distance_mm": SHARP_MM,
        "entrance_pupil_diameter_mm": pupil_mm,
        "floor": NO_FLOOR,
    }
    flat = render(CAMERA, pose, surface, **through)
    decal = Decal.of_target(Pose.identity(), surface, texels_per_mm=100)
    lamp = {"lamp_direction": (0, 0, -1), "background": 0.3}
    solid = render_scene(CAMERA, pose, [], decals=[decal], **through, **lamp)
    assert np.sqrt(np.mean((solid - flat) ** 2)) < 0.01
    assert abs((solid - flat).mean()) < 1e-3


def test_the_edges_of_a_decal_on_a_part_are_where_the_camera_projects_them():
    """Columns of the image sum up to the place of a vertical edge, to a hundredth of a pixel."""
    picture = np.zeros((1, 2))
    picture[0, 1] = 1.0
    pose = Pose(np.eye(3), np.array([0.37, 0.0, SHARP_MM]))
    decal = Decal(Pose.identity(), np.repeat(picture, 400, axis=1), (12.0, 30.0))
    seen = scene(
        [plate(0.0)], pose, decals=[decal], lamp_direction=(0, 0, -1), window=Window(90, 74, 40, 6)
    )
    edge = CAMERA.project(pose.transform([0.0, 0.0, 0.0]))[0]
    found = 90 - 0.5 + (1 - seen.mean(axis=0)).sum()
    assert found == pytest.approx(edge, abs=0.02)


def test_a_decal_shows_one_side_and_hides_behind_bodies():
    white = np.ones((2, 2))
    decal = Decal(Pose(np.eye(3), np.array([0.0, 0.0, SHARP_MM])), white, (50.0, 50.0))
    turned = Pose.from_rotation_vector([np.pi, 0, 0], [0.0, 0.0, SHARP_MM])
    assert scene([], decals=[decal]).min() > 0.9
    assert scene([], decals=[Decal(turned, white, (50.0, 50.0))]).max() == 0
    hidden = scene([plate(SHARP_MM - 5, reflectance=0.1)], decals=[decal])
    assert hidden.max() < 0.11


@pytest.mark.parametrize("depth_mm", [280.0, 330.0])
def test_an_edge_is_blurred_by_the_circle_of_confusion(depth_mm):
    """The line spread of a disk has the variance diameter²/16; pixels and samples add theirs."""
    half = plate(depth_mm, 0.0, 500.0)
    spread = np.diff(
        scene([half], entrance_pupil_diameter_mm=20.0, lamp_direction=(0, 0, -1))[70:84]
        .mean(axis=0)
        .astype(np.float64)
    )
    place = np.arange(len(spread)) * CAMERA.sensor.sample_pitch_x_mm
    variance = spread @ place**2 / spread.sum() - (spread @ place / spread.sum()) ** 2
    measured = 4 * np.sqrt(variance - CAMERA.sensor.sample_pitch_x_mm**2 / 6)
    expected = float(blur_diameter_mm(depth_mm, SHARP_MM, CAMERA.image_distance_mm, 20.0))
    assert measured == pytest.approx(expected, rel=0.03)


def test_a_sharp_far_plate_stays_sharp_beside_a_blurred_near_one():
    near, far = plate(200.0, -500, 0, 0.9), plate(SHARP_MM, 6.0, 500, 0.5)
    row = scene([near, far], entrance_pupil_diameter_mm=10.0, lamp_direction=(0, 0, -1))[77]
    slopes = np.abs(np.diff(row))
    far_edge = round(float(CAMERA.project([6.0, 0.0, SHARP_MM])[0]))
    assert slopes[far_edge - 2 : far_edge + 2].max() > 0.2
    assert slopes[100:108].max() < 0.1


def test_a_box_that_touches_the_ground_has_neither_bright_nor_dark_rims():
    """Where surfaces meet they are blurred as one, and steps along them must not show as halos."""
    pose = Pose.from_rotation_vector([0.6, 0.5, 0.1], [0.0, 0.0, SHARP_MM])
    bodies = [box(3.0, 0.7), plate(3.1, reflectance=0.3)]
    picture = scene(bodies, pose, entrance_pupil_diameter_mm=15.0)
    sharp = scene(bodies, pose, entrance_pupil_diameter_mm=1e-3)
    assert picture.min() > sharp.min() - 0.01
    assert picture.max() < sharp.max() + 0.01


def test_a_plate_between_rungs_of_blur_stays_evenly_bright():
    """A slanted plate falls into many layers; their seams must not show."""
    steep = Pose.from_rotation_vector([0.0, 0.9, 0.0], [0.0, 0.0, SHARP_MM])
    picture = scene([plate(0.0)], steep, entrance_pupil_diameter_mm=20.0, lamp_direction=(0, 0, -1))
    np.testing.assert_allclose(picture, 0.8, rtol=1e-3)


def test_a_window_shows_the_same_pixels_as_the_whole_image():
    cube, pose = box(6.0), Pose.from_rotation_vector([0.5, 0.7, 0.2], [1.0, 2.0, SHARP_MM + 20])
    window = Window(80, 60, 50, 40)
    options = {"entrance_pupil_diameter_mm": 5.0, "falloff": (-0.05, 0.0)}
    whole, part = scene([cube], pose, **options), scene([cube], pose, window=window, **options)
    np.testing.assert_allclose(part, whole[60:100, 80:130], atol=2e-3)


def test_an_empty_scene_is_background():
    np.testing.assert_array_equal(scene([], background=0.4), np.float32(0.4))


@pytest.mark.parametrize("faces", [np.zeros((0, 3), int), [(0, 1, 9)]])
def test_faces_must_name_vertices(faces):
    with pytest.raises(InputError, match="a body needs faces that name some of its 3 vertices"):
        Body(np.eye(3), faces)


def test_a_body_reflects_no_more_than_all():
    with pytest.raises(InputError, match="reflectance of a body must lie between 0 and 1"):
        plate(SHARP_MM, reflectance=1.2)


def test_a_decal_holds_reflectances():
    with pytest.raises(InputError, match="the picture of a decal must hold reflectances"):
        Decal(Pose.identity(), np.full((2, 2), 255.0), (1.0, 1.0))


def test_a_decal_has_a_size():
    with pytest.raises(InputError, match="size_mm must be a positive number"):
        Decal(Pose.identity(), np.ones((2, 2)), (1.0, 0.0))


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"lamp_direction": (0, 0, 0)}, "lamp_direction must point somewhere"),
        ({"samples_per_pixel": 0}, "samples_per_pixel must be at least 1, but is 0"),
        ({"window": Window(190, 0, 20, 20)}, "does not lie in the frame of 200 × 160 px"),
    ],
)
def test_views_that_cannot_be(option, message):
    with pytest.raises(InputError, match=message):
        scene([plate(SHARP_MM)], **option)
