import numpy as np
import pytest

from lenscal.errors import FocusError, OutOfRangeError
from lenscal.rig.interfaces import CameraDevice, Frame, Window
from lenscal.rig.simulated import SimulatedRig
from lenscal.sensor import Sensor
from lenscal.session.autofocus import autofocus, fit_peak
from lenscal.session.exposure import expose
from lenscal.setting import LensSetting

DISK = (0.0, 27.0)
SWEEP = list(np.linspace(364.0, 384.0, 15))


def hyperbola(distances, sharpest=371.3, reach=3.0):
    return 1 / np.sqrt(1 + ((distances - sharpest) / reach) ** 2)


def test_the_vertex_of_a_perfect_curve_is_exact():
    distances = np.linspace(365, 378, 13)
    found, sigma = fit_peak(distances, hyperbola(distances))
    assert found == pytest.approx(371.3, abs=1e-9)
    assert sigma < 1e-9


def test_the_stated_sigma_is_the_spread_of_the_vertex():
    rng = np.random.default_rng(0)
    distances = np.linspace(368, 375, 13)
    noisy = hyperbola(distances) * (1 + 0.01 * rng.normal(size=(400, 13)))
    found, sigma = np.array([fit_peak(distances, curve) for curve in noisy]).T
    assert found.std() == pytest.approx(np.sqrt((sigma**2).mean()), rel=0.15)
    assert abs(found.mean() - 371.3) < 0.03


def test_a_curve_without_a_peak_is_refused():
    distances = np.linspace(365, 370, 9)
    with pytest.raises(FocusError, match=r"no peak between 365\.0 and 370\.0 mm"):
        fit_peak(distances, hyperbola(distances, sharpest=390.0))


@pytest.mark.parametrize("setting", [(92, 60), (98, 131), (108, 95)])
def test_the_sharpest_standoff_is_found_on_the_simulated_rig(setting):
    rig = SimulatedRig.preset("vicon-1990", seed=3)
    rig.lens.move_to(LensSetting(*setting, 100.0))
    result = autofocus(rig, SWEEP, point_mm=DISK)
    truth = rig.truth(LensSetting(*setting, 100.0))
    # Hand-eye and target are stated to 0.05 mm; the rest is the autofocus.
    assert abs(result.distance_mm - truth.standoff_mm) < 0.25
    assert 0 < result.sigma_mm < 0.1
    assert result.curve.shape[1] == 2
    assert result.iris == 100.0


def test_a_peak_beyond_the_sweep_is_said():
    rig = SimulatedRig.preset("vicon-1990", seed=3)
    rig.lens.move_to(LensSetting(105, 100, 100.0))
    with pytest.raises(
        FocusError, match=r"is the farthest one of the search, at 370\.0 mm; extend"
    ):
        autofocus(rig, np.linspace(362.0, 370.0, 6).tolist(), point_mm=DISK)


def test_stopped_down_at_the_wide_end_there_is_no_clear_peak():
    rig = SimulatedRig.preset("vicon-1990", seed=3)
    rig.lens.move_to(LensSetting(60, 100, 10.0))
    with pytest.raises(FocusError, match="open the iris|extend the search|no peak"):
        autofocus(rig, np.linspace(368.0, 378.0, 6).tolist(), point_mm=DISK)


def test_a_sweep_must_ascend():
    rig = SimulatedRig.preset("vicon-1990", seed=3)
    with pytest.raises(FocusError, match="at least five ascending standoffs, but has 3"):
        autofocus(rig, [370.0, 371.0, 372.0], point_mm=DISK)
    with pytest.raises(FocusError, match="ascending"):
        autofocus(rig, [375.0, 374.0, 373.0, 372.0, 371.0], point_mm=DISK)


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
