"""The preset against the paper and against what a zoom lens has to do."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from lenscal.errors import InputError, OutOfRangeError
from lenscal.imaging.blur import BlurFloor
from lenscal.imaging.formation import render
from lenscal.imaging.texture import TargetSurface
from lenscal.pose import Pose
from lenscal.rig.simulated.vicon_1990 import REFERENCE, TRAVEL, vicon_lens
from lenscal.setting import LensSetting, LensTravel
from lenscal.target import Disk

MM_PER_INCH = 25.4
LENS = vicon_lens()
GRID = [
    LensSetting(float(zoom), float(focus), 50.0)
    for zoom in np.linspace(*TRAVEL.zoom, 14)
    for focus in np.linspace(*TRAVEL.focus, 8)
]


@pytest.mark.parametrize(
    ("zoom", "focus", "magnification", "object_distance_in", "offset_in"),
    [(98, 131, 0.192, 25.98, 11.48), (102, 89, 0.192, 26.74, 11.84), (108, 95, 0.295, 21.0, 6.35)],
)
def test_viewpoints_of_the_paper(zoom, focus, magnification, object_distance_in, offset_in):
    """Table of the paper's nine numbers; d/D at equal value does not fit one Gaussian lens."""
    truth = LENS.truth(LensSetting(zoom, focus, 100.0))
    assert truth.magnification == pytest.approx(magnification, rel=0.055)
    assert truth.object_distance_mm / MM_PER_INCH == pytest.approx(object_distance_in, abs=0.12)
    assert truth.nodal_offset_mm / MM_PER_INCH == pytest.approx(offset_in, abs=0.12)
    assert truth.standoff_mm / MM_PER_INCH == pytest.approx(
        object_distance_in - offset_in, abs=0.15
    )


def test_the_focal_length_without_close_up_runs_from_about_12_5_to_75_mm():
    bare = replace(LENS, groups=LENS.groups[1:])
    zooms = np.linspace(*TRAVEL.zoom, 60)
    lengths = np.abs(
        [
            [bare.system(LensSetting(z, focus)).gaussian_focal_length_mm for z in zooms]
            for focus in np.linspace(*TRAVEL.focus, 5)
        ]
    )
    assert (np.diff(lengths, axis=1) > 0).all()
    assert lengths[:, 0] == pytest.approx(12.5, rel=0.18)
    assert lengths[:, -1] == pytest.approx(75.0, rel=0.13)


def test_groups_keep_apart_over_the_travel():
    zoom, focus = np.meshgrid(np.linspace(*TRAVEL.zoom, 400), np.linspace(*TRAVEL.focus, 60))
    places = [np.broadcast_to(g.cam(zoom, focus), zoom.shape) for g in LENS.groups]
    gaps = [(b - a).min() for a, b in pairwise(places)]
    assert min(gaps) > 3.0
    assert gaps[0] > 5.4


def test_the_stated_front_glass_is_where_the_lens_has_it():
    assert LENS.body.front_mm == pytest.approx(LENS.truth(REFERENCE).front_depth_mm, abs=1e-6)
    assert LENS.body.glass_radius_mm < LENS.body.barrel_radius_mm


@pytest.mark.parametrize("setting", GRID[::7], ids=str)
def test_the_front_glass_is_large_enough(setting):
    """Rays to the corner of the image pass it, and their bundle wide open on the axis."""
    truth = LENS.truth(setting.with_iris(100.0))
    share = truth.working_distance_mm / truth.object_distance_mm
    chief = np.hypot(LENS.sensor.width_mm, LENS.sensor.height_mm) / 2 / truth.image_distance_mm
    height_mm = chief * truth.front_depth_mm
    assert height_mm + share * truth.entrance_pupil_diameter_mm / 2 < LENS.body.glass_radius_mm


@pytest.mark.parametrize("setting", GRID[::9], ids=str)
def test_depth_of_field_is_where_the_blur_is_what_is_permitted(setting):
    truth = LENS.truth(setting)
    near, far = truth.depth_of_field_mm(0.02)
    for depth in (near, far):
        blur = truth.entrance_pupil_diameter_mm * truth.image_distance_mm
        blur *= abs(1 / depth - 1 / truth.object_distance_mm)
        assert blur == pytest.approx(0.02)
    assert near < truth.object_distance_mm < far


def test_the_working_f_number_is_that_of_the_exit_pupil():
    truth = LENS.truth(LensSetting(98, 131, 50))
    from_behind = truth.exit_pupil_distance_mm / truth.exit_pupil_diameter_mm
    assert truth.f_number == pytest.approx(from_behind)


def test_a_depth_of_field_needs_a_blur():
    with pytest.raises(InputError, match="blur_mm"):
        LENS.truth(LensSetting(98, 131, 50)).depth_of_field_mm(0.0)


def test_light_falls_off_most_at_the_wide_end_wide_open():
    corner_mm2 = (LENS.sensor.width_mm**2 + LENS.sensor.height_mm**2) / 4

    def loss(zoom, iris):
        c2, c4 = LENS.truth(LensSetting(zoom, 70, iris)).falloff
        return -(c2 * corner_mm2 + c4 * corner_mm2**2)

    losses = np.array([[loss(z, i) for i in (5, 50, 100)] for z in np.linspace(45, 110, 9)])
    assert (np.diff(losses, axis=0) < 0).all()
    assert (np.diff(losses, axis=1) > 0).all()
    assert 0.015 < losses.min() < losses.max() < 0.2


def test_the_focus_shift_moves_the_sharp_plane_and_nothing_else():
    shifted = replace(LENS, focus_shift_dioptres=0.05)
    setting = LensSetting(98, 131)
    open_, half = (shifted.truth(setting.with_iris(i)) for i in (100.0, 50.0))
    plain = LENS.truth(setting.with_iris(50.0))
    assert open_.object_distance_mm == pytest.approx(plain.object_distance_mm, rel=1e-12)
    dioptres = 1000 / half.object_distance_mm - 1000 / open_.object_distance_mm
    assert dioptres == pytest.approx(0.05 * 0.5)
    assert half.camera.image_distance_mm == plain.camera.image_distance_mm
    assert half.nodal_offset_mm == plain.nodal_offset_mm
    assert half.magnification * half.object_distance_mm == pytest.approx(half.image_distance_mm)


def test_the_reference_has_no_offset_and_its_pupil_where_the_search_put_it():
    assert LENS.truth(REFERENCE).nodal_offset_mm == 0
    assert LENS.system(REFERENCE).entrance_pupil_mm == pytest.approx(216.1047, abs=1e-8)


def test_larger_numbers_zoom_in_and_focus_closer():
    truths = np.array(
        [[t.magnification, t.working_distance_mm] for t in map(LENS.truth, GRID)]
    ).reshape(14, 8, 2)
    assert (np.diff(truths[..., 0], axis=0) > 0).all()
    assert (np.diff(truths[..., 1], axis=1) < 0).all()


@pytest.mark.parametrize("setting", GRID[::9], ids=str)
def test_the_quantities_of_a_setting_agree(setting):
    truth = LENS.truth(setting)
    assert truth.image_distance_mm == pytest.approx(truth.magnification * truth.object_distance_mm)
    assert 1 / truth.focal_length_mm == pytest.approx(
        1 / truth.object_distance_mm + 1 / truth.image_distance_mm
    )
    assert truth.standoff_mm == pytest.approx(truth.object_distance_mm - truth.nodal_offset_mm)
    assert truth.camera.image_distance_mm == truth.image_distance_mm
    np.testing.assert_array_equal(truth.camera.centre_px, truth.principal_point_px)
    # The Gaussian lens law, with distances from the principal planes.
    image_mm = truth.magnification * truth.principal_object_distance_mm
    assert 1 / truth.gaussian_focal_length_mm == pytest.approx(
        1 / truth.principal_object_distance_mm + 1 / image_mm
    )


@pytest.mark.parametrize(("zoom", "focus"), [(60, 40), (98, 131), (110, 100)])
def test_the_rendered_magnification_is_that_of_the_matrices(zoom, focus):
    truth = LENS.truth(LensSetting(zoom, focus, 30.0))
    surface = TargetSurface(Disk(2.0), surroundings=1.0)
    reach_mm = 2.0

    def centroid_mm(x_mm):
        picture = render(
            replace(truth.camera, k1_per_mm2=0.0),
            Pose(np.eye(3), np.array([x_mm, 0.0, truth.object_distance_mm])),
            surface,
            object_distance_mm=truth.object_distance_mm,
            entrance_pupil_diameter_mm=truth.entrance_pupil_diameter_mm,
            floor=BlurFloor(0.0, 0.0),
        )
        dark = 1.0 - picture.mean(axis=0, dtype=np.float64)
        dark[np.abs(dark) < 1e-5] = 0.0  # rounding of white, far away, would weigh heavily
        place_mm = np.arange(len(dark)) * LENS.sensor.sample_pitch_x_mm
        return dark @ place_mm / dark.sum()

    measured = (centroid_mm(reach_mm) - centroid_mm(-reach_mm)) / (2 * reach_mm)
    assert measured == pytest.approx(abs(LENS.system(truth.setting).lateral_magnification), 3e-4)


def test_the_pupil_opens_with_the_iris():
    wide, narrow = (LENS.truth(LensSetting(98, 131, iris)) for iris in (100.0, 10.0))
    assert wide.entrance_pupil_diameter_mm == pytest.approx(10 * narrow.entrance_pupil_diameter_mm)
    assert narrow.f_number == pytest.approx(10 * wide.f_number)
    assert wide.object_distance_mm == narrow.object_distance_mm


def test_distortion_and_principal_point_vary_but_little():
    corner_mm = np.hypot(LENS.sensor.width_mm, LENS.sensor.height_mm) / 2
    for truth in map(LENS.truth, GRID[::5]):
        assert abs(truth.camera.k1_per_mm2) * corner_mm**2 < 0.02
        assert np.abs(truth.principal_point_px - LENS.sensor.centre_px).max() < 6


def test_the_nearest_thing_is_the_front_glass():
    truth = LENS.truth(LensSetting(98, 131, 50))
    assert truth.front_depth_mm == pytest.approx(LENS.system(truth.setting).entrance_pupil_mm)


def test_colliding_groups_are_refused():
    with pytest.raises(InputError, match=r"collide at zoom 113, focus .* must be 2 mm"):
        replace(LENS, travel=LensTravel((45.0, 113.0), (0.0, 140.0), (5.0, 100.0)))


def test_a_cam_without_solution_is_a_collision():
    lost = replace(LENS.groups[3], cam=lambda zoom, focus: np.full(np.shape(zoom), np.nan))
    with pytest.raises(InputError, match="variator and compensator collide"):
        replace(LENS, groups=(*LENS.groups[:3], lost, LENS.groups[4]))


def test_a_stop_on_no_group_is_refused():
    with pytest.raises(InputError, match="the stop rides on 'shutter', which is none of"):
        replace(LENS, stop_group="shutter")


def test_the_truth_needs_an_iris():
    with pytest.raises(InputError, match="needs the iris too"):
        LENS.truth(LensSetting(98, 131))


def test_beyond_the_travel_there_is_no_truth():
    with pytest.raises(OutOfRangeError, match="zoom 120 lies outside the travel 45 to 110.5"):
        LENS.truth(LensSetting(120, 131, 50))
