"""The devices behind the interfaces, and the world that they share."""

import numpy as np
import pytest

from lenscal.errors import DeviceError, InputError, OutOfRangeError
from lenscal.pose import Pose
from lenscal.rig.interfaces import Rig, Window
from lenscal.rig.simulated import SimulatedRig
from lenscal.rig.simulated.world import PoseNoise
from lenscal.setting import ApproachSide, LensSetting

EXACT = PoseNoise(0.0, 0.0)
SMALL = Window(200, 180, 64, 48)


@pytest.fixture
def rig():
    return SimulatedRig.preset("vicon-1990", seed=3)


def hand_for(rig, reference_from_target):
    """Where the hand has to go, by what is stated of the rig."""
    camera = rig.base_from_target @ reference_from_target.inverse()
    return camera @ rig.hand_from_camera.inverse()


def facing(distance_mm, tilt_deg=0.0):
    tilted = Pose.from_rotation_vector([np.radians(tilt_deg), 0.0, 0.0])
    return Pose(np.eye(3), np.array([0.0, 0.0, distance_mm])) @ tilted


def test_a_preset_is_a_rig_at_its_reference_in_front_of_the_sharp_target(rig):
    assert isinstance(rig, Rig)
    assert rig.lens.setting == rig.reference_setting
    seen = rig.true_camera_from_target()
    truth = rig.truth(rig.reference_setting)
    expected = Pose(np.eye(3), np.array([0.0, 0.0, truth.object_distance_mm]))
    distance_mm, angle_rad = seen.distance_to(expected)
    assert distance_mm < 1.0
    assert angle_rad < 2e-3
    assert rig.identities().keys() >= {"lens", "camera", "positioner", "rig"}


def test_an_unknown_preset_is_refused():
    with pytest.raises(InputError, match="no simulated rig 'nikon'; the presets are vicon-1990"):
        SimulatedRig.preset("nikon")


@pytest.mark.parametrize("setting", [LensSetting(98, 131, 40), LensSetting(108, 95, 40)], ids=str)
@pytest.mark.parametrize("tilt_deg", [0.0, 25.0])
def test_the_projection_centre_moves_along_the_axis_by_the_offset(setting, tilt_deg):
    """Standoff to the plate from the reference centre is object distance from the true one."""
    rig = SimulatedRig.preset("vicon-1990", repeatability=EXACT, mounting_error=EXACT)
    rig.lens.move_to(setting)
    truth = rig.truth(setting)
    rig.positioner.move_to(hand_for(rig, facing(truth.standoff_mm, tilt_deg)))
    expected = facing(truth.object_distance_mm, tilt_deg)
    distance_mm, angle_rad = rig.true_camera_from_target().distance_to(expected)
    assert distance_mm < 1e-9
    assert angle_rad < 1e-7


def test_mounting_and_moves_have_a_small_hidden_error(rig):
    commanded = hand_for(rig, facing(370.0))
    reported = rig.positioner.move_to(commanded)
    assert reported is commanded
    assert rig.positioner.base_from_hand is commanded
    errors = []
    for _ in range(60):
        rig.positioner.move_to(commanded)
        errors.append((commanded.inverse() @ rig.world.base_from_hand).translation_mm)
    assert np.std(errors) == pytest.approx(0.02, rel=0.2)
    mounting_mm, _ = rig.hand_from_camera.distance_to(rig.world.hand_from_camera)
    assert 0.005 < mounting_mm < 0.3


def test_the_same_seed_gives_the_same_frames():
    frames = [SimulatedRig.preset("vicon-1990", seed=9).camera.grab(SMALL).image for _ in range(2)]
    np.testing.assert_array_equal(*frames)
    other = SimulatedRig.preset("vicon-1990", seed=10).camera.grab(SMALL).image
    assert (other != frames[0]).any()


def test_the_clock_runs_without_waiting(rig):
    start_s = rig.world.clock_s
    rig.lens.move_to(LensSetting(98, 131))
    after_lens_s = rig.world.clock_s
    rig.positioner.move_to(hand_for(rig, facing(420.0)))
    after_move_s = rig.world.clock_s
    frame = rig.camera.grab(SMALL)
    assert start_s < after_lens_s < after_move_s == frame.time_s
    assert rig.world.clock_s > frame.time_s + rig.camera.exposure_s


def test_an_iris_of_none_stays(rig):
    rig.lens.move_to(LensSetting(98, 131, 20))
    arrived = rig.lens.move_to(LensSetting(90, 60), ApproachSide.FROM_ABOVE)
    assert arrived == rig.lens.setting == LensSetting(90, 60, 20)
    assert rig.truth(LensSetting(90, 60)).setting.iris == 20


@pytest.mark.parametrize(
    "setting", [LensSetting(44, 100), LensSetting(98, 141), LensSetting(98, 100, 4)], ids=str
)
def test_a_setting_beyond_the_travel_moves_nothing(rig, setting):
    before, clock_s = rig.lens.setting, rig.world.clock_s
    with pytest.raises(OutOfRangeError, match="lies outside the travel"):
        rig.lens.move_to(setting)
    assert rig.lens.setting == before
    assert rig.world.clock_s == clock_s


@pytest.mark.parametrize(
    ("base_from_hand", "message"),
    [
        (Pose.from_rotation_vector([np.pi, 0, 0], [600, 100, 100]), "z = 100.0 mm of the hand"),
        (Pose.from_rotation_vector([0.6 * np.pi, 0, 0], [600, 100, 500]), "cannot tilt 72.0 deg"),
    ],
)
def test_a_pose_beyond_reach_moves_nothing(rig, base_from_hand, message):
    before, truly = rig.positioner.base_from_hand, rig.world.base_from_hand
    with pytest.raises(OutOfRangeError, match=message) as caught:
        rig.positioner.move_to(base_from_hand)
    assert caught.value.allowed[0] < caught.value.allowed[1]
    assert rig.positioner.base_from_hand is before
    assert rig.world.base_from_hand is truly


@pytest.mark.parametrize("distance_mm", [200.0, 900.0])
@pytest.mark.parametrize("about", [0.0, 1.6, 3.1, 4.7])
def test_the_workspace_holds_the_views_of_a_session(rig, distance_mm, about):
    tilt = np.radians(35.0) * np.array([np.cos(about), np.sin(about), 0.0])
    reference_from_target = facing(distance_mm) @ Pose.from_rotation_vector(tilt)
    rig.positioner.move_to(hand_for(rig, reference_from_target))


def test_light_follows_exposure_and_aperture():
    rig = SimulatedRig.preset("vicon-1990", seed=1)

    def white_dn(iris, exposure_s):
        rig.lens.move_to(rig.reference_setting.with_iris(iris))
        rig.camera.set_exposure_s(exposure_s)
        return np.percentile(rig.camera.grab(SMALL).image, 95) - 4.0

    assert white_dn(60, 0.004) == pytest.approx(2 * white_dn(60, 0.002), rel=0.05)
    assert white_dn(60, 0.002) == pytest.approx(4 * white_dn(30, 0.002), rel=0.08)
    assert white_dn(100, 1.0) == 251


def test_corners_are_darker_as_the_truth_has_it():
    """The bench far beside the plate is even, so only the fall-off of the light is left."""
    rig = SimulatedRig.preset("vicon-1990", seed=1)
    setting = LensSetting(45, 20, 100)
    rig.lens.move_to(setting)
    rig.positioner.move_to(hand_for(rig, Pose(np.eye(3), np.array([300.0, 0.0, 500.0]))))
    rig.camera.set_exposure_s(0.003)
    image = np.mean([rig.camera.grab().image for _ in range(3)], axis=0) - 4.0
    truth = rig.truth(setting)
    rows, columns = np.indices(image.shape)
    x_mm = (columns - truth.principal_point_px[0]) * truth.camera.sensor.sample_pitch_x_mm
    y_mm = (rows - truth.principal_point_px[1]) * truth.camera.sensor.sample_pitch_y_mm
    squared = x_mm**2 + y_mm**2
    terms = np.stack([np.ones(image.size), squared.ravel(), squared.ravel() ** 2], axis=-1)
    axis, *bends = np.linalg.lstsq(terms, image.ravel(), rcond=None)[0]
    corner = np.array([squared.max(), squared.max() ** 2])
    assert bends @ corner / axis == pytest.approx(truth.falloff @ corner, abs=0.005)
    assert truth.falloff @ corner < -0.1


def test_an_exposure_out_of_range_is_refused(rig):
    before = rig.camera.exposure_s
    with pytest.raises(OutOfRangeError, match="an exposure of 5 s lies outside 1e-05 to 2 s"):
        rig.camera.set_exposure_s(5.0)
    assert rig.camera.exposure_s == before


def test_frames_say_what_they_show(rig):
    whole, part = rig.camera.grab(), rig.camera.grab(SMALL)
    assert whole.image.shape == (480, 512)
    assert part.image.shape == (48, 64)
    assert part.window == SMALL
    assert whole.window == Window(0, 0, 512, 480)
    assert whole.bit_depth == 8
    assert whole.image.dtype == np.uint8


def test_a_window_outside_the_frame_is_refused(rig):
    with pytest.raises(InputError, match="does not lie in the frame"):
        rig.camera.grab(Window(500, 0, 50, 50))


def test_looking_past_the_plate_shows_the_bench(rig):
    aside = Pose(np.eye(3), np.array([300.0, 0.0, 500.0]))
    rig.positioner.move_to(hand_for(rig, aside))
    rig.camera.set_exposure_s(0.002)
    picture = rig.camera.grab(SMALL).image
    assert picture.std() < 3


def test_a_plate_inside_the_lens_is_a_collision(rig):
    rig.positioner.move_to(hand_for(rig, facing(205.0)))
    with pytest.raises(DeviceError, match="lens and plate have collided; move the camera away"):
        rig.camera.grab(SMALL)


def test_closing_twice_is_harmless(rig):
    rig.close()
    rig.close()


def test_the_chip_warms_up_with_the_clock_of_the_world(rig):
    assert rig.camera.temperature_c == 22.0
    rig.world.advance(1500.0)
    assert rig.camera.temperature_c == pytest.approx(22 + 18 * (1 - np.exp(-1)))
    rig.world.advance(1e5)
    assert rig.camera.temperature_c == pytest.approx(40.0)


def test_a_rig_is_as_warm_as_its_lens_or_else_its_camera(rig, monkeypatch):
    assert rig.lens.temperature_c is None
    assert rig.temperature_c == rig.camera.temperature_c
    monkeypatch.setattr(type(rig.lens), "temperature_c", 0.0)
    assert rig.temperature_c == 0.0
    monkeypatch.undo()
    monkeypatch.delattr(type(rig.camera), "temperature_c")
    assert rig.temperature_c is None
