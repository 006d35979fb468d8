from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lenscal.calibration.pupil import SHAPE_SIGMA, effective_pitch_mm, entrance_pupil_diameter
from lenscal.errors import CalibrationError
from lenscal.imaging.aperture import Aperture, blur_kernel, convolved
from lenscal.recording import FocusResult, Recording
from lenscal.rig.simulated import SimulatedRig
from lenscal.rig.simulated.world import PoseNoise
from lenscal.sensor import Sensor
from lenscal.session.autofocus import autofocus
from lenscal.session.disk_search import find_disk
from lenscal.session.sharpness import ring_sharpness
from lenscal.setting import LensSetting

DATA = Path(__file__).parents[3] / "data" / "vicon-1990"
SQUARE = Sensor(1000, 1000, 0.005, 0.005)
#: ∫ℓ² across an edge that a disk of diameter 1 blurs, ℓ = (8/π) (1/4 − x²)^½, is 32/(3π²).
WIDTH_OF_DISK = 3 * np.pi**2 / 32


def focus_result(sharpness, standoffs, sharpest=500.0, **options):
    return FocusResult(sharpest, 0.05, 0.8, 4.0, standoffs, sharpness, **options)


def curve(standoffs, pupil_mm, image_mm, object_mm, sharpest=500.0, least_px=2.1, pitch=0.005):
    """Sharpness in 1/px of a plane that the pupil alone blurs, and the pixels a little."""
    z = standoffs - sharpest + object_mm
    blur_mm = pupil_mm * image_mm * (1 / z - 1 / object_mm)
    return (least_px**2 + (WIDTH_OF_DISK * blur_mm / pitch) ** 2) ** -0.5


def test_the_width_of_an_edge_blurred_by_a_disk():
    """The closed form, by quadrature."""
    x = np.linspace(-0.5, 0.5, 200_001)
    spread = 8 / np.pi * np.sqrt(0.25 - x**2)
    assert 1 / np.trapezoid(spread**2, x) == pytest.approx(WIDTH_OF_DISK, rel=1e-6)


@pytest.mark.parametrize("pitch_mm", [(0.005, 0.005), (0.016, 0.0137), (0.008, 0.005)])
@pytest.mark.parametrize("blades", [0, 5, 8])
def test_pictures_have_that_width_along_the_whole_rim(pitch_mm, blades):
    """Drawn disks, blurred by the iris, as the session measures them; a is that of equal area."""
    pitch = np.array(pitch_mm)
    fine, diameter_mm = 4, 12 * pitch.mean()
    half = np.ceil(70 * pitch.mean() / pitch).astype(int)
    y, x = (np.arange(-n * fine, n * fine) + 0.5 for n in half[::-1])
    inside = np.hypot(x * pitch[0] / fine, y[:, None] * pitch[1] / fine) < 38 * pitch.mean()
    drawn = np.where(inside, 100.0, 3000.0).astype(np.float32)
    pixels = cv2.resize(drawn, tuple(2 * half), interpolation=cv2.INTER_AREA)
    kernel = blur_kernel(diameter_mm, *pitch_mm, Aperture(blades))
    image = convolved(pixels, kernel, cv2.BORDER_REPLICATE).astype(np.uint16)
    width_px = 1 / ring_sharpness(image, find_disk(image))
    # The pixels add their own 2.1 px in quadrature.
    disk_px = np.sqrt(width_px**2 - 2.1**2)
    found_mm = disk_px * effective_pitch_mm(pitch) / WIDTH_OF_DISK
    assert found_mm == pytest.approx(diameter_mm, rel=2 * SHAPE_SIGMA)


def test_the_effective_pitch_is_the_pitch_of_square_pixels():
    assert effective_pitch_mm(np.array([0.005, 0.005])) == pytest.approx(0.005, rel=1e-12)
    stretched = effective_pitch_mm(np.array([0.016, 0.0137]))
    assert np.sqrt(0.016 * 0.0137) < stretched < 0.016


@settings(max_examples=50, deadline=None)
@given(
    pupil_mm=st.floats(3, 60),
    image_mm=st.floats(10, 150),
    object_mm=st.floats(150, 3000),
    decentred=st.floats(-0.5, 0.5),
    missed=st.floats(-0.2, 0.2),
)
def test_a_perfect_curve_gives_the_pupil(pupil_mm, image_mm, object_mm, decentred, missed):
    """Wherever the sweep lies; that the autofocus missed the peak a little costs little."""
    reach = min(2.1 * 0.005 * object_mm**2 / (pupil_mm * image_mm), object_mm / 20)
    standoffs = 500 + reach * (decentred + np.linspace(-2, 2, 15))
    sharpness = curve(standoffs, pupil_mm, image_mm, object_mm)
    focus = focus_result(sharpness, standoffs, 500 + missed * reach)
    found = entrance_pupil_diameter(
        focus, SQUARE, object_distance_mm=object_mm, image_distance_mm=image_mm
    )
    assert found.diameter_mm == pytest.approx(
        pupil_mm, rel=2.5 * abs(missed) * reach / object_mm + 1e-6
    )
    assert found.sigma_mm == pytest.approx(SHAPE_SIGMA * pupil_mm, rel=0.05)
    assert found.iris == 4.0


def test_an_error_of_the_distance_goes_into_the_pupil_and_its_sigma():
    """With d/D held, a goes as D: one for one."""
    standoffs = np.linspace(485, 515, 15)
    sharpness = curve(standoffs, 20.0, 50.0, 600.0)
    relative = 0.05
    both = np.array([600.0, 50.0])
    exact, shifted = (
        entrance_pupil_diameter(
            focus_result(sharpness, standoffs),
            SQUARE,
            object_distance_mm=600.0 * scale,
            image_distance_mm=50.0 * scale,
            covariance_mm2=relative**2 * np.outer(both, both),
        )
        for scale in (1.0, 1 + relative)
    )
    assert shifted.diameter_mm / exact.diameter_mm == pytest.approx(1 + relative, rel=1e-3)
    assert exact.sigma_mm / exact.diameter_mm == pytest.approx(
        np.hypot(relative, SHAPE_SIGMA), rel=1e-3
    )


def test_the_stated_sigma_is_the_spread():
    rng = np.random.default_rng(0)
    standoffs = np.linspace(485, 515, 15)
    exact = curve(standoffs, 20.0, 50.0, 600.0)
    found = [
        entrance_pupil_diameter(
            focus_result(exact * (1 + 0.03 * rng.normal(size=15)), standoffs),
            SQUARE,
            object_distance_mm=600.0,
            image_distance_mm=50.0,
        )
        for _ in range(300)
    ]
    diameter = np.array([one.diameter_mm for one in found])
    scatter = np.array([one.sigma_mm for one in found]) ** 2 - (SHAPE_SIGMA * diameter) ** 2
    assert diameter.std() == pytest.approx(np.sqrt(scatter.mean()), rel=0.15)


def test_pictures_far_from_the_peak_do_not_count():
    standoffs = np.linspace(440, 560, 61)
    sharpness = curve(standoffs, 20.0, 50.0, 600.0)
    far = sharpness < 0.3 * sharpness.max()
    assert far.any()
    spoilt = np.where(far, 0.5 * sharpness, sharpness)
    found = [
        entrance_pupil_diameter(
            focus_result(s, standoffs), SQUARE, object_distance_mm=600.0, image_distance_mm=50.0
        ).diameter_mm
        for s in (sharpness, spoilt)
    ]
    assert found[0] == found[1]


@pytest.mark.parametrize("setting", [(80, 60), (98, 131), (108, 95)])
@pytest.mark.parametrize("iris", [30, 60, 100])
def test_the_simulated_lens_is_measured_at_every_iris(setting, iris):
    rig = SimulatedRig.preset("vicon-1990", seed=3, mounting_error=PoseNoise(0, 0))
    rig.lens.move_to(LensSetting(*setting, iris))
    focus = autofocus(rig, list(np.linspace(362, 386, 17)), point_mm=(0.0, 27.0))
    # Where the iris was too small to focus, it was opened; the record says so.
    truth = rig.truth(LensSetting(*setting, focus.iris))
    found = entrance_pupil_diameter(
        focus,
        rig.camera.sensor,
        object_distance_mm=truth.object_distance_mm,
        image_distance_mm=truth.image_distance_mm,
    )
    assert found.iris == focus.iris
    assert found.diameter_mm == pytest.approx(truth.entrance_pupil_diameter_mm, rel=0.02)
    assert abs(found.diameter_mm - truth.entrance_pupil_diameter_mm) < 2.5 * found.sigma_mm


def test_the_recorded_session_tells_the_pupil_though_it_does_not_say_which_sweep_was_fine():
    recording = Recording.load(DATA / "session")
    rows = pd.read_csv(DATA / "table.csv").set_index(["zoom", "focus"])
    rig = SimulatedRig.preset("vicon-1990", seed=0)
    errors, sigmas = [], []
    for record in recording.settings:
        row = rows.loc[(record.setting.zoom, record.setting.focus)]
        found = entrance_pupil_diameter(
            record.focus,
            recording.head.sensor,
            object_distance_mm=row.object_distance_mm,
            image_distance_mm=row.image_distance_mm,
        )
        truth = rig.truth(record.setting.with_iris(found.iris)).entrance_pupil_diameter_mm
        errors.append(found.diameter_mm / truth - 1)
        sigmas.append(found.sigma_mm / truth)
    assert len(errors) == 40
    assert np.abs(errors).max() < 0.02
    assert abs(np.mean(errors)) < SHAPE_SIGMA
    assert np.sqrt(np.mean(np.square(errors))) < 0.008
    assert max(sigmas) < 0.02


def measure(sharpness, standoffs, **options):
    return entrance_pupil_diameter(
        focus_result(sharpness, standoffs, **options),
        SQUARE,
        object_distance_mm=600.0,
        image_distance_mm=50.0,
    )


def test_another_measure_does_not_tell():
    standoffs = np.linspace(485, 515, 15)
    sharpness = curve(standoffs, 20.0, 50.0, 600.0)
    with pytest.raises(CalibrationError, match="measured by tenengrad, which tells no width"):
        measure(sharpness, standoffs, measure="tenengrad")


@pytest.mark.parametrize("count", [0, 4])
def test_too_few_pictures_are_said(count):
    standoffs = np.linspace(498, 502, count)
    with pytest.raises(
        CalibrationError, match=f"has {count} pictures about its peak, but 7 are needed"
    ):
        measure(curve(standoffs, 20.0, 50.0, 600.0), standoffs)


def test_a_curve_that_does_not_bend_is_said():
    standoffs = np.linspace(499, 501, 15)
    noise = 1 + 0.02 * np.random.default_rng(1).normal(size=15)
    with pytest.raises(CalibrationError, match=r"falls by \d+ % and scatters too much .* open the"):
        measure(curve(standoffs, 20.0, 50.0, 600.0) * noise, standoffs)
    with pytest.raises(CalibrationError, match="does not tell the entrance pupil"):
        measure(1 / curve(np.linspace(485, 515, 15), 20.0, 50.0, 600.0), np.linspace(485, 515, 15))
