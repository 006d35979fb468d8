"""Matrices against the laws of optics, for random lenses."""

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from lenscal.camera import Camera
from lenscal.errors import InputError
from lenscal.imaging.blur import BlurFloor
from lenscal.imaging.formation import render
from lenscal.imaging.texture import TargetSurface
from lenscal.optics import blur_diameter_mm
from lenscal.pose import Pose
from lenscal.rig.simulated.optics import OpticalSystem, ThinGroup
from lenscal.sensor import Sensor
from lenscal.target import Disk

focal_lengths = st.floats(15, 200).flatmap(lambda f: st.sampled_from([f, -f]))
gaps = st.floats(1, 60)


@st.composite
def systems(draw):
    count = draw(st.integers(1, 5))
    positions = np.cumsum([draw(gaps) for _ in range(count + 1)])
    groups = tuple(ThinGroup(draw(focal_lengths), float(p)) for p in positions[:-1])
    stop_mm = draw(st.floats(float(positions[0]) - 5, float(positions[-1]) - 0.1))
    system = OpticalSystem(groups, stop_mm, float(positions[-1]))
    assume(abs(system.matrix[1, 0]) > 1e-4)
    assume(1e-2 < abs(system.lateral_magnification) < 1e2)
    assume(1e-2 < system.entrance_pupil_magnification < 1e2)
    assume(1 < abs(system.object_distance_mm) < 1e4)
    return system


def trace(system, depth_mm, height_mm, aim_height_mm, to_mm):
    """Send a ray from before the entrance pupil through a height in it; its height farther on."""
    pupil_mm = system.entrance_pupil_mm
    slope = (aim_height_mm - height_mm) / depth_mm
    here_mm = system.front_mm
    height = aim_height_mm + slope * (here_mm - pupil_mm)
    for group in system.groups:
        if group.position_mm > to_mm:
            break
        height += slope * (group.position_mm - here_mm)
        here_mm = group.position_mm
        slope -= height / group.focal_length_mm
    return height + slope * (to_mm - here_mm), slope


quick = settings(max_examples=60, deadline=None)


@quick
@given(systems())
def test_the_lens_law_holds_between_principal_planes(system):
    object_mm, image_mm = system.principal_object_distance_mm, system.principal_image_distance_mm
    assume(abs(object_mm) > 1e-3)
    assume(abs(image_mm) > 1e-3)
    vergences = 1 / object_mm + 1 / image_mm
    scale = abs(1 / object_mm) + abs(1 / image_mm)
    assert abs(vergences - 1 / system.gaussian_focal_length_mm) < 1e-7 * scale
    assert system.lateral_magnification == pytest.approx(-image_mm / object_mm, rel=1e-6)


@quick
@given(systems())
def test_principal_points_are_nodal_points(system):
    """In air a ray towards the front one leaves from the rear one with the slope it came with."""
    slope = 0.01
    height_at_front = slope * (system.front_mm - system.front_principal_mm)
    height, slope_out = system.matrix @ [height_at_front, slope]
    back = system.rear_principal_mm - system.groups[-1].position_mm
    size = abs(height) + abs(slope_out * back) + 1.0
    assert slope_out == pytest.approx(slope, abs=1e-8 * size)
    assert abs(height + slope_out * back) < 1e-7 * size


@quick
@given(systems(), st.floats(-5, 5), st.floats(-1, 1))
def test_all_rays_from_a_sharp_point_meet_at_its_magnified_place(system, height_mm, aim_mm):
    distance = system.object_distance_mm
    landed, _ = trace(system, distance, height_mm, aim_mm, system.sensor_position_mm)
    expected = system.lateral_magnification * height_mm
    assert landed == pytest.approx(expected, rel=1e-6, abs=1e-6 * (1 + abs(expected)))


@quick
@given(systems(), st.floats(0.5, 2.0), st.floats(0.1, 20))
def test_the_circle_of_confusion_is_that_of_the_perspective_quantities(system, share, pupil_mm):
    """a·d·|1/z − 1/D| is exact for a thick lens with D and d measured from the entrance pupil."""
    distance = system.object_distance_mm
    depth = share * distance
    rims = [trace(system, depth, 0.0, h, system.sensor_position_mm)[0] for h in (-0.5, 0.5)]
    diameter = pupil_mm * abs(rims[1] - rims[0])
    image_mm = distance * abs(system.lateral_magnification)
    expected = float(blur_diameter_mm(depth, distance, abs(image_mm), pupil_mm))
    assert diameter == pytest.approx(expected, rel=1e-5, abs=1e-7 * pupil_mm)


@quick
@given(systems(), st.floats(-3, 3))
def test_the_entrance_pupil_is_the_image_of_the_stop(system, start_mm):
    """Whatever ray is aimed at a point of the pupil crosses the stop at one height."""
    crossed, _ = trace(system, 137.0, start_mm, 1.0, system.stop_position_mm)
    assert abs(crossed) == pytest.approx(1 / system.entrance_pupil_magnification, rel=1e-6)


@quick
@given(systems())
def test_both_pupils_give_the_same_working_f_number(system):
    """d/a with the perspective d is the cone that the exit pupil sends to the sensor."""
    assume(1e-2 < system.exit_pupil_magnification < 1e2)
    image_mm = abs(system.object_distance_mm * system.lateral_magnification)
    from_before = image_mm / system.entrance_pupil_magnification
    from_behind = abs(system.exit_pupil_distance_mm) / system.exit_pupil_magnification
    assert from_behind == pytest.approx(from_before, rel=1e-5)


@quick
@given(systems(), st.floats(-3, 3))
def test_the_exit_pupil_is_the_image_of_the_stop(system, slope):
    """A ray through the middle of the stop leaves as if from the middle of the exit pupil."""
    height, here_mm = 0.0, system.stop_position_mm
    for group in system.groups:
        if group.position_mm <= system.stop_position_mm:
            continue
        height += slope * (group.position_mm - here_mm)
        here_mm = group.position_mm
        slope -= height / group.focal_length_mm
    assume(abs(system.exit_pupil_distance_mm) < 1e5)
    assert abs(height + slope * (system.exit_pupil_mm - here_mm)) < 1e-6 * (1 + abs(height))


# A camera can only look at what lies before it, which rules most random lenses out.
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.filter_too_much])
@given(systems())
def test_rendered_images_have_the_magnification_of_the_matrices(system):
    """The disk of a random lens grows in the image as the ray-transfer matrix says."""
    ratio, distance_mm = abs(system.lateral_magnification), system.object_distance_mm
    assume(distance_mm > 1)
    sensor = Sensor(160, 140, 0.01, 0.01)
    disk_mm = 0.8 / ratio
    assume(disk_mm < distance_mm)
    image = render(
        Camera(sensor, ratio * distance_mm),
        Pose(np.eye(3), np.array([0.0, 0.0, distance_mm])),
        TargetSurface(Disk(disk_mm), ink=0.0, surroundings=1.0),
        object_distance_mm=distance_mm,
        entrance_pupil_diameter_mm=1.0,
        floor=BlurFloor(0.0, 0.0),
    )
    area_mm2 = float((1.0 - image).sum(dtype=np.float64)) * 0.01**2
    assert 2 * np.sqrt(area_mm2 / np.pi) / disk_mm == pytest.approx(ratio, rel=2e-3)


def test_a_telecentric_lens_has_its_pupil_at_infinity():
    """The stop stands in the focus of the group behind it, then of the one before it."""
    lens = OpticalSystem((ThinGroup(40.0, 0.0), ThinGroup(16.0, 32.0)), 16.0, 80.0)
    assert abs(lens.exit_pupil_mm) == np.inf
    assert lens.exit_pupil_magnification == np.inf
    turned = OpticalSystem((ThinGroup(16.0, 0.0), ThinGroup(40.0, 32.0)), 16.0, 80.0)
    assert abs(turned.entrance_pupil_mm) == np.inf
    assert turned.entrance_pupil_magnification == np.inf


def test_one_thin_lens_with_the_stop_on_it():
    system = OpticalSystem((ThinGroup(50.0, 0.0),), 0.0, 60.0)
    assert system.gaussian_focal_length_mm == pytest.approx(50)
    assert system.working_distance_mm == pytest.approx(300)
    assert system.lateral_magnification == pytest.approx(-0.2)
    assert system.entrance_pupil_mm == system.exit_pupil_mm == 0
    assert system.entrance_pupil_magnification == system.exit_pupil_magnification == 1


def test_exit_pupil_of_a_stop_in_front():
    """A stop half the focal length before a lens is seen through it twice as large, at f behind."""
    system = OpticalSystem((ThinGroup(50.0, 25.0),), 0.0, 80.0)
    assert system.exit_pupil_mm == pytest.approx(25 - 50)
    assert system.exit_pupil_magnification == pytest.approx(2)
    assert system.entrance_pupil_mm == 0


@pytest.mark.parametrize(
    ("positions", "sensor_mm"), [((), 5.0), ((3.0, 2.0), 5.0), ((1.0, 2.0), 1.5)]
)
def test_groups_out_of_order_are_refused(positions, sensor_mm):
    groups = tuple(ThinGroup(50.0, p) for p in positions)
    with pytest.raises(InputError, match="must stand one behind the other"):
        OpticalSystem(groups, 0.0, sensor_mm)


def test_a_stop_behind_the_sensor_is_refused():
    with pytest.raises(InputError, match="must stand in front of the sensor"):
        OpticalSystem((ThinGroup(50.0, 0.0),), 80.0, 60.0)
