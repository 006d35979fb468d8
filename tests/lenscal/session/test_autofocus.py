import re
from dataclasses import replace

import numpy as np
import pytest

from lenscal.errors import FocusError, OutOfRangeError
from lenscal.rig.interfaces import CameraDevice, Frame, Positioner, Window
from lenscal.rig.simulated import SimulatedRig
from lenscal.rig.simulated.world import PoseNoise
from lenscal.sensor import Sensor
from lenscal.session.aim import hand_pose
from lenscal.session.autofocus import autofocus, autofocus_lens
from lenscal.session.exposure import expose
from lenscal.session.plan import AutofocusPlan
from lenscal.setting import LensSetting

DISK = (0.0, 27.0)
SWEEP = list(np.linspace(364.0, 384.0, 15))


def depth_mm(rig):
    """Depth at which the axis truly meets the plane."""
    camera_from_target = rig.true_camera_from_target()
    normal = camera_from_target.rotation[:, 2]
    return normal @ camera_from_target.translation_mm / normal[2]


def make_rig(setting, seed=3, **options):
    rig = SimulatedRig.preset("vicon-1990", seed=seed, mounting_error=PoseNoise(0, 0), **options)
    rig.lens.move_to(LensSetting(*setting))
    return rig


@pytest.mark.parametrize("setting", [(60, 100), (80, 60), (92, 60), (98, 131), (108, 95)])
def test_the_sharpest_distance_is_found_on_the_simulated_rig(setting):
    """Within the smaller of 0.2 % of D and a fifth of the one-pixel depth of field; σ is true."""
    rig = make_rig((*setting, 100.0))
    result = autofocus(rig, SWEEP, point_mm=DISK)
    truth = rig.truth(rig.lens.setting)
    aperture = truth.entrance_pupil_diameter_mm * truth.image_distance_mm
    pitch_mm = rig.camera.sensor.sample_pitch_mm.min()
    near_mm = 1 / (1 / truth.object_distance_mm + pitch_mm / aperture)
    bar_mm = min(0.002, (1 - near_mm / truth.object_distance_mm) / 5) * truth.object_distance_mm
    # The camera stands where the search says, give or take the arm's repeatability.
    error_mm = depth_mm(rig) - truth.object_distance_mm
    assert abs(error_mm) < bar_mm
    assert abs(error_mm) < 3 * result.sigma_mm
    assert 0.02 <= result.sigma_mm < 0.15
    assert 0 < result.confidence < 1
    assert (result.iris, result.notes, result.measure) == (100.0, (), "edge_width")
    assert result.curve.shape == (15 + result.fine, 2)


@pytest.mark.parametrize("measure", ["laplacian_variance", "brenner", "tenengrad"])
def test_any_measure_can_be_used(measure):
    rig = make_rig((104, 100, 100))
    result = autofocus(rig, SWEEP, point_mm=DISK, measure=measure)
    assert result.measure == measure
    assert result.distance_mm == pytest.approx(rig.truth(rig.lens.setting).standoff_mm, abs=0.2)


def test_a_modern_camera_searches_evenly_in_vergence():
    """12 bits, a plate with three disks, and a lens whose peak is a hundredth of the search."""
    rig = SimulatedRig.preset("machine-vision", seed=2, mounting_error=PoseNoise(0, 0))
    rig.lens.move_to(LensSetting(2388, 6921.8, 75))
    truth = rig.truth(rig.lens.setting)
    plan = AutofocusPlan(nearest="0.35 m", farthest="0.55 m", step="12 mm", iris=75)
    result = autofocus(rig, plan.standoffs_mm(), point_mm=(270.0, 30.0))
    assert abs(depth_mm(rig) - truth.object_distance_mm) < min(0.15, 4 * result.sigma_mm)


class Moves(Positioner):
    """A positioner that remembers where it was sent, and reaches standoffs within limits only."""

    def __init__(self, rig, reach_mm=(0.0, np.inf)):
        self._rig, self._inner, self._reach_mm = rig, rig.positioner, reach_mm
        self.standoffs_mm = []

    @property
    def identity(self):
        return "moves"

    @property
    def base_from_hand(self):
        return self._inner.base_from_hand

    def move_to(self, base_from_hand):
        target = self._rig.base_from_target.inverse() @ base_from_hand @ self._rig.hand_from_camera
        standoff_mm = -float(target.translation_mm[2])
        low, high = self._reach_mm
        if not low <= standoff_mm <= high:
            raise OutOfRangeError("beyond reach", standoff_mm, self._reach_mm)
        self.standoffs_mm.append(standoff_mm)
        return self._inner.move_to(base_from_hand)


def with_moves(rig, **options):
    moves = Moves(rig, **options)
    return replace(rig, positioner=moves), moves


def test_every_picture_and_the_last_place_are_reached_from_the_near_side():
    rig, moves = with_moves(make_rig((104, 100, 100)))
    result = autofocus(rig, SWEEP, point_mm=DISK)
    assert moves.standoffs_mm[-1] == pytest.approx(result.distance_mm)
    taken = set(np.round(result.curve_standoff_mm, 6))
    arrivals = zip(moves.standoffs_mm, moves.standoffs_mm[1:], strict=False)
    for before, after in arrivals:
        if round(after, 6) in taken or after == moves.standoffs_mm[-1]:
            assert before < after


def test_without_a_clear_peak_the_iris_is_opened_and_restored():
    rig = make_rig((64, 100, 8))
    exposure_s = rig.camera.exposure_s
    result = autofocus(rig, SWEEP, point_mm=DISK)
    assert result.iris == 100
    assert "no clear peak at iris 8; the iris was opened to 100" in result.notes[0]
    assert rig.lens.setting == LensSetting(64, 100, 8)
    assert rig.camera.exposure_s == exposure_s
    assert result.distance_mm == pytest.approx(rig.truth(rig.lens.setting).standoff_mm, abs=0.3)


@pytest.mark.parametrize("sweep", [(358.0, 367.0), (381.0, 391.0)])
def test_a_peak_beyond_the_sweep_is_followed(sweep):
    rig = make_rig((104, 100, 100))
    result = autofocus(rig, np.linspace(*sweep, 9).tolist(), point_mm=DISK)
    assert result.distance_mm == pytest.approx(rig.truth(rig.lens.setting).standoff_mm, abs=0.1)
    assert any("end or beyond between" in note and "extended to" in note for note in result.notes)


def test_a_peak_that_cannot_be_followed_is_said_and_everything_is_put_back():
    rig = make_rig((104, 100, 50))
    before = rig.positioner.base_from_hand, rig.lens.setting, rig.camera.exposure_s
    with pytest.raises(
        FocusError,
        match=r"lies at the highest standoff of the search, 366\.0 mm, or beyond; extend",
    ):
        autofocus(rig, np.linspace(358, 366, 6).tolist(), point_mm=DISK, extensions=0)
    after = rig.positioner.base_from_hand, rig.lens.setting, rig.camera.exposure_s
    assert before == after


def test_the_end_of_travel_is_said():
    rig = make_rig((104, 100, 100))
    rig.positioner.move_to(hand_pose(rig, 360.0, DISK))
    rig, _ = with_moves(rig, reach_mm=(355.0, 366.5))
    with pytest.raises(FocusError, match="could not be extended: the travel ends"):
        autofocus(rig, np.linspace(358, 366, 6).tolist(), point_mm=DISK)
    with pytest.raises(FocusError, match=r"no standoff from 370\.0 mm to 380\.0 mm can be reached"):
        autofocus(rig, np.linspace(370, 380, 6).tolist(), point_mm=DISK)


def test_places_that_cannot_be_reached_are_noted():
    rig, _ = with_moves(make_rig((104, 100, 100)), reach_mm=(366.0, 400.0))
    result = autofocus(rig, SWEEP, point_mm=DISK)
    assert "2 of 15 places of the sweep, from 364.0 mm to 365.4 mm, cannot be" in result.notes[0]


class Rails(Moves):
    """A positioner with a few stops only, between which it cannot stand."""

    def __init__(self, rig, stops_mm):
        super().__init__(rig)
        self._stops_mm = np.append(stops_mm, -self._where(rig.positioner.base_from_hand))

    def _where(self, base_from_hand):
        target = self._rig.base_from_target.inverse() @ base_from_hand @ self._rig.hand_from_camera
        return float(target.translation_mm[2])

    def move_to(self, base_from_hand):
        standoff_mm = -self._where(base_from_hand)
        if np.abs(self._stops_mm - standoff_mm).min() > 1e-6:
            raise OutOfRangeError("no stop there", standoff_mm, (0.0, 0.0))
        return super().move_to(base_from_hand)


def test_a_peak_that_cannot_be_looked_at_closely_is_said():
    rig = make_rig((104, 100, 100))
    rails = replace(rig, positioner=Rails(rig, SWEEP))
    with pytest.raises(FocusError, match="pictures about the peak were reached and show a disk"):
        autofocus(rails, SWEEP, point_mm=DISK)


def test_no_clear_peak_even_wide_open():
    rig = make_rig((48, 100, 100))
    with pytest.raises(
        FocusError, match="no clear peak over the standoff between .* open the iris or"
    ):
        autofocus(rig, np.linspace(370, 373, 6).tolist(), point_mm=DISK, extensions=0)


def test_no_disk_is_said():
    rig = make_rig((104, 100, 100))
    with pytest.raises(
        FocusError, match=r"only [012] of 15 pictures from 364.* show a disk at the"
    ):
        autofocus(rig, SWEEP, point_mm=(0.0, 0.0))


@pytest.mark.parametrize("standoffs", [[], [370.0, 371.0, 372.0], [375.0, 374, 373, 372, 371]])
def test_a_sweep_must_ascend(standoffs):
    with pytest.raises(FocusError, match=f"five ascending positions, but has {len(standoffs)}"):
        autofocus(make_rig((104, 100, 100)), standoffs, point_mm=DISK)


def test_a_break_puts_everything_back():
    rig = make_rig((104, 100, 100))
    before = rig.positioner.base_from_hand

    class BrokenError(Exception):
        pass

    def grab(window=None):
        raise BrokenError

    rig.camera.grab = grab
    with pytest.raises(BrokenError):
        autofocus(rig, SWEEP, point_mm=DISK)
    assert rig.positioner.base_from_hand == before


def test_a_focus_shift_with_the_iris_is_noted():
    shifted = make_rig((106, 100, 100), focus_shift_dioptres=4e-3)
    result = autofocus(shifted, SWEEP, point_mm=DISK, check_iris=30)
    true = [shifted.truth(LensSetting(106, 100, iris)).standoff_mm for iris in (30, 100)]
    found, sigma = re.search(r"is ([+-][\d.]+) ± ([\d.]+) mm", result.notes[0]).groups()
    assert abs(true[0] - true[1]) > 0.2
    assert float(found) == pytest.approx(true[0] - true[1], abs=3 * float(sigma))
    assert shifted.lens.setting.iris == 100


def test_the_focus_motor_finds_the_same_plane():
    """The focus setting found for a standoff is the one whose truth is that standoff."""
    rig = make_rig((104, 60, 50))
    aim = rig.truth(LensSetting(104, 100, 100)).standoff_mm
    rig.positioner.move_to(hand_pose(rig, aim, DISK))
    peak = autofocus_lens(rig, np.linspace(60, 140, 15).tolist(), repeatability=0.1)
    assert peak.position == pytest.approx(100, abs=3 * peak.sigma)
    assert 0.1 <= peak.sigma < 3
    assert rig.lens.setting == LensSetting(104, peak.position, 50)


def test_the_focus_motor_goes_back_when_it_finds_nothing():
    rig = make_rig((104, 60, 100))
    rig.positioner.move_to(hand_pose(rig, 340.0, DISK))
    with pytest.raises(
        FocusError,
        match="peak over the focus setting .* the travel ends|lowest focus setting|highest focus",
    ):
        autofocus_lens(rig, np.linspace(60, 140, 6).tolist())
    assert rig.lens.setting == LensSetting(104, 60, 100)


class Lamp(CameraDevice):
    """A camera before a grey wall of a given brightness."""

    def __init__(self, brightness: float) -> None:
        self.brightness = brightness
        self._exposure_s = 0.01

    @property
    def identity(self):
        return "lamp"

    @property
    def sensor(self):
        return Sensor(8, 8, 0.01, 0.01)

    @property
    def exposure_s(self):
        return self._exposure_s

    @property
    def exposure_range_s(self):
        return 1e-4, 1.0

    def set_exposure_s(self, exposure_s):
        low, high = self.exposure_range_s
        if not low <= exposure_s <= high:
            raise OutOfRangeError("beyond", exposure_s, (low, high))
        self._exposure_s = exposure_s

    def grab(self, window=None):
        grey = min(255.0, 255 * self.brightness * self._exposure_s)
        return Frame(np.full((8, 8), grey, np.uint8), 8, 0.0, Window(0, 0, 8, 8))


@pytest.mark.parametrize("brightness", [1.0, 30.0, 5000.0])
def test_white_comes_to_three_quarters(brightness):
    lamp = Lamp(brightness)
    assert 0.65 < lamp.brightness * expose(lamp) < 0.85


@pytest.mark.parametrize(
    ("brightness", "message"),
    [
        (0.1, r"too dark: white lies at .* %.*open the iris or add light"),
        (1e6, r"too bright: white lies at 100 %.*close the iris or dim the light"),
    ],
)
def test_too_dark_or_too_bright_is_said(brightness, message):
    with pytest.raises(FocusError, match=message):
        expose(Lamp(brightness))
