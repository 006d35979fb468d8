"""The lens of today: not parfocal, and what follows from it."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from lenscal.errors import InputError, OutOfRangeError
from lenscal.plate import Plate
from lenscal.pose import Pose
from lenscal.rig.simulated import PRESETS, SimulatedRig
from lenscal.rig.simulated.machine_vision import REFERENCE, TRAVEL, machine_vision_lens
from lenscal.rig.simulated.zoom_lens import FARTHEST_MM
from lenscal.sensor import Window
from lenscal.session.aim import hand_pose
from lenscal.setting import LensSetting
from lenscal.target import Charuco, Disk

LENS = machine_vision_lens()
ZOOMS = np.linspace(*TRAVEL.zoom, 13)
NEAREST_MM, FAR_MM = 300.0, 5000.0
SMALL = Window(1192, 992, 64, 64)


def strip(shares, far_mm=FAR_MM):
    """Truths over the strip: (zooms, shares of the strip), open."""
    rows = []
    for zoom in ZOOMS:
        low, high = LENS.focus_range(zoom, NEAREST_MM, far_mm)
        rows.append([LENS.truth(LensSetting(zoom, low + s * (high - low), 75.0)) for s in shares])
    return rows


STRIP = strip(np.linspace(0, 1, 5))


def table(quantity):
    return np.array([[getattr(truth, quantity) for truth in row] for row in STRIP])


def test_the_focal_length_runs_from_12_to_50_mm():
    at_infinity = [
        LENS.system(LensSetting(z, LENS.focus_range(z)[0])).gaussian_focal_length_mm for z in ZOOMS
    ]
    assert np.abs(at_infinity)[[0, -1]] == pytest.approx([12.0, 50.0], rel=0.02)
    assert (np.diff(np.abs(at_infinity)) > 0).all()
    assert (np.diff(np.abs(table("gaussian_focal_length_mm")), axis=0) > 0).all()


def test_the_open_lens_is_about_f_1_8():
    at_infinity = table("gaussian_f_number")[:, 0]
    assert 1.7 < at_infinity.min() < at_infinity.max() < 2.05


def test_groups_keep_clear_of_each_other_and_of_the_stop():
    zoom, focus = np.meshgrid(np.linspace(*TRAVEL.zoom, 200), np.linspace(*TRAVEL.focus, 200))
    places = [np.broadcast_to(g.cam(zoom, focus), zoom.shape) for g in LENS.groups]
    assert min((b - a).min() for a, b in pairwise(places)) >= 2.0
    # The last group clears the flange of a CS-mount.
    assert LENS.sensor_position_mm - places[-1].max() > 12.5
    stop_mm = LENS.system(REFERENCE).stop_position_mm
    assert places[1].max() < stop_mm - 2.0


def test_finite_distances_form_a_curved_strip():
    middles = np.array([np.mean(LENS.focus_range(z, NEAREST_MM, FAR_MM)) for z in ZOOMS])
    widths = np.array([np.ptp(LENS.focus_range(z, NEAREST_MM, FAR_MM)) for z in ZOOMS])
    assert TRAVEL.focus[0] < (middles - widths / 2).min()
    assert (middles + widths / 2).max() < TRAVEL.focus[1]
    slope = np.diff(middles)
    assert slope[0] > 0 > slope[-1]  # it bends
    # Not parfocal: no single focus serves both ends of the zoom at any distance in the strip.
    assert LENS.focus_range(ZOOMS[0], NEAREST_MM, FAR_MM)[0] > middles[-1] + 1000
    assert (np.diff(widths) > 0).all()


def test_the_ends_of_the_strip_are_the_distances_asked_for():
    distances = table("object_distance_mm")
    np.testing.assert_allclose(distances[:, 0], FAR_MM, rtol=1e-8)
    np.testing.assert_allclose(distances[:, -1], NEAREST_MM, rtol=1e-8)


def test_larger_numbers_zoom_in_and_focus_closer():
    assert (np.diff(table("object_distance_mm"), axis=1) < 0).all()
    assert (np.diff(table("working_distance_mm"), axis=1) < 0).all()
    for distance_mm in (400.0, 1000.0, 3000.0):
        truths = [
            LENS.truth(LensSetting(z, LENS.focus_range(z, distance_mm, 2e4)[1], 75.0))
            for z in ZOOMS
        ]
        assert (np.diff([t.magnification for t in truths]) > 0).all()


@pytest.mark.parametrize("quantity", ["magnification", "standoff_mm", "nodal_offset_mm"])
def test_quantities_are_smooth_over_the_strip(quantity):
    """Along the strip at constant 1/D, a parabola through neighbours misses by under a percent."""
    zooms = np.linspace(*TRAVEL.zoom, 41)
    truths = [LENS.truth(LensSetting(z, LENS.focus_range(z, 800.0, 2e4)[1], 75.0)) for z in zooms]
    values = np.array([getattr(t, quantity) for t in truths])
    third = np.diff(values, n=3)
    assert np.abs(third).max() < 0.01 * np.ptp(values)


def test_magnifications_are_those_that_the_target_is_made_for():
    m = [t.magnification for row in strip((0.0, 1.0), 2500.0) for t in row]
    assert min(m) < 0.005
    assert max(m) > 0.15


@pytest.mark.parametrize("zoom", [0.0, 1600.0, 3227.0])
def test_outside_the_strip_there_is_no_truth(zoom):
    low, high = LENS.focus_range(zoom)
    with pytest.raises(OutOfRangeError, match="puts the sharp plane .* the focus can go") as caught:
        LENS.truth(LensSetting(zoom, low - 1.0, 75.0))
    assert caught.value.given == low - 1.0
    assert caught.value.allowed == pytest.approx((low, high))
    assert LENS.truth(LensSetting(zoom, low, 75.0)).object_distance_mm == pytest.approx(FARTHEST_MM)


def test_beyond_infinity_is_called_that():
    with pytest.raises(OutOfRangeError, match="focus 0 at zoom 0 puts the sharp plane beyond inf"):
        LENS.truth(LensSetting(0.0, 0.0, 75.0))


def test_inside_the_lens_nothing_is_sharp():
    """A sensor on a long tube brings the sharp plane behind the front glass."""
    macro = replace(LENS, sensor_position_mm=LENS.sensor_position_mm + 15.0)
    _, high = macro.focus_range(1600.0)
    assert high < TRAVEL.focus[1]
    assert macro.truth(LensSetting(1600.0, high - 0.1, 75.0)).working_distance_mm < 0.1
    with pytest.raises(OutOfRangeError, match=r"sharp plane at \d+ mm, not between the front"):
        macro.truth(LensSetting(1600.0, high + 10.0, 75.0))


def test_a_zoom_at_which_nothing_can_be_sharp_is_named():
    macro = replace(LENS, sensor_position_mm=LENS.sensor_position_mm + 25.0)
    with pytest.raises(InputError, match="at zoom 0 no focus between 0 and 8390 gives an object"):
        macro.truth(LensSetting(0.0, 4000.0, 75.0))


def test_impossible_strips_are_refused():
    with pytest.raises(InputError, match="from a positive nearest_mm to a larger farthest_mm"):
        LENS.focus_range(0.0, 500.0, 300.0)
    with pytest.raises(InputError, match=r"at zoom 3227 no focus between 0 and 8390 gives"):
        LENS.focus_range(3227.0, 1.0, 50.0)
    with pytest.raises(OutOfRangeError, match="zoom 4000 lies outside the travel"):
        LENS.focus_range(4000.0)


def test_the_stated_front_glass_is_where_the_lens_has_it():
    system = LENS.system(REFERENCE)
    assert LENS.body.front_mm == pytest.approx(system.entrance_pupil_mm - system.front_mm, abs=1e-3)


def test_the_front_glass_is_large_enough():
    """Rays to the corner of the image pass it, and their bundle wide open on the axis."""
    diagonal_mm = np.hypot(LENS.sensor.width_mm, LENS.sensor.height_mm)
    for truth in (truth for row in STRIP for truth in row):
        on_axis_mm = truth.entrance_pupil_diameter_mm / 2
        on_axis_mm *= truth.working_distance_mm / truth.object_distance_mm
        chief_mm = diagonal_mm / 2 / truth.image_distance_mm * truth.front_depth_mm
        assert on_axis_mm + chief_mm < LENS.body.glass_radius_mm


def test_distortion_wander_and_vignetting_are_as_stated():
    corner_mm2 = (LENS.sensor.width_mm**2 + LENS.sensor.height_mm**2) / 4
    for truth in (truth for row in STRIP for truth in row):
        assert -0.012 < truth.camera.k1_per_mm2 * corner_mm2 < 0.027
        assert np.abs(truth.principal_point_px - LENS.sensor.centre_px).max() < 15.5
        c2, c4 = truth.falloff
        assert -0.2 < c2 * corner_mm2 + c4 * corner_mm2**2 < -0.05


def test_one_board_of_the_plate_serves_each_magnification():
    """Some board shows squares of 45 to 240 px, and some disk is 90 to 480 px large."""
    plate = SimulatedRig.preset("machine-vision").target
    assert isinstance(plate, Plate)
    boards = [part for part, _ in plate.parts if isinstance(part, Charuco)]
    disks = [part for part, _ in plate.parts if isinstance(part, Disk)]
    for magnification in np.geomspace(0.005, 0.206, 30):
        squares_px = [b.square_mm * magnification / LENS.sensor.sample_pitch_x_mm for b in boards]
        assert any(45 < px < 240 for px in squares_px)
        disks_px = [d.diameter_mm * magnification / LENS.sensor.sample_pitch_x_mm for d in disks]
        assert any(90 < px < 480 for px in disks_px)


def test_the_boards_share_no_marker():
    boards = [
        p for p, _ in SimulatedRig.preset("machine-vision").target.parts if hasattr(p, "board")
    ]
    ids = np.concatenate([b.board().getIds().ravel() for b in boards])
    assert len(np.unique(ids)) == len(ids)
    assert len({b.dictionary for b in boards}) == 1


def test_frames_have_twelve_bits():
    frame = SimulatedRig.preset("machine-vision").camera.grab(SMALL)
    assert frame.image.dtype == np.uint16
    assert frame.bit_depth == 12
    assert frame.saturation == 4095


@pytest.mark.parametrize(
    ("zoom", "distance_mm", "point_mm"),
    [(0, 2500, (285, 130)), (1600, 800, (270, -80)), (3227, 300, (270, 30))],
)
def test_the_disk_is_sharp_in_the_middle_of_the_image(zoom, distance_mm, point_mm):
    """Black in the middle and white around it, and edges as sharp as the optics allow."""
    rig = SimulatedRig.preset("machine-vision", seed=2)
    setting = LensSetting(float(zoom), LENS.focus_range(zoom, distance_mm, 2e4)[1], 75.0)
    rig.lens.move_to(setting)
    truth = rig.truth(setting)
    rig.positioner.move_to(hand_pose(rig, truth.standoff_mm, point_mm))
    rig.camera.set_exposure_s(0.0006)
    disk_px = {0: 80, 1600: 20, 3227: 6}[zoom] * truth.magnification / 0.00345
    column, row = (int(v) for v in truth.principal_point_px)
    half = int(0.7 * disk_px)
    image = rig.camera.grab(Window(column - half, row - 2, 2 * half, 5)).image.mean(axis=0)
    dark, light = np.percentile(image, [2, 98])
    edges = np.flatnonzero(np.diff((image > (dark + light) / 2).astype(int)))
    assert len(edges) == 2
    assert np.diff(edges)[0] == pytest.approx(disk_px, abs=3)
    assert np.abs(np.diff(image)).max() > 0.25 * (light - dark)


@pytest.mark.parametrize("standoff_mm", [NEAREST_MM - 45, 2532.0])
@pytest.mark.parametrize("about", [0.0, 1.6, 3.1, 4.7])
def test_the_workspace_holds_the_views_of_a_session(standoff_mm, about):
    rig = SimulatedRig.preset("machine-vision")
    tilt = np.radians(30.0) * np.array([np.cos(about), np.sin(about), 0.0])
    for point_mm in [(-100.0, 0.0), (270.0, -165.0), (285.0, 130.0)]:
        pose = hand_pose(rig, standoff_mm, point_mm, Pose.from_rotation_vector(tilt))
        rig.positioner.move_to(pose)


def test_grabbing_outside_the_strip_says_where_to_focus():
    rig = SimulatedRig.preset("machine-vision")
    rig.lens.move_to(LensSetting(0, 1000))
    with pytest.raises(OutOfRangeError, match="at this zoom the focus can go from 5998"):
        rig.camera.grab(SMALL)
    # Where the camera is does not depend on what is sharp.
    assert rig.true_camera_from_target().translation_mm[2] > 0


def test_both_presets_are_there():
    assert set(PRESETS) == {"vicon-1990", "machine-vision"}
    rig = SimulatedRig.preset("machine-vision")
    assert rig.body == LENS.body
