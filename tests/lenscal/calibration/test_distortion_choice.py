import numpy as np
import pandas as pd
import pytest

from lenscal.calibration.distortion_choice import DistortionModel, choose_distortion
from lenscal.calibration.refine import calibrate_views
from lenscal.camera import Camera
from lenscal.sensor import Sensor
from lenscal.target import Chessboard

SENSOR = Sensor(1280, 960, 0.00465, 0.00465)
TILTS = ((0, 0), (25, 0), (-25, 0), (0, 25), (0, -25), (17, 17), (-17, 17), (12, -20))


def _world(look, camera):
    return look(camera, 90.0, TILTS, Chessboard(12, 9, 5.0))


def test_terms_that_are_there_are_found(look):
    world = _world(look, Camera(SENSOR, 8.0, 4e-3, None, (6e-4,), (8e-4, -5e-4)))
    pixels, _ = world.noisy(np.random.default_rng(1), 0.1)
    assert choose_distortion(world.points, pixels, SENSOR) == DistortionModel(2, True)


def test_terms_that_are_not_there_are_not(look):
    world = _world(look, Camera(SENSOR, 8.0, 4e-3))
    pixels, _ = world.noisy(np.random.default_rng(2), 0.1)
    assert choose_distortion(world.points, pixels, SENSOR) == DistortionModel(1, False)


def test_few_views_get_the_simplest_model(tele):
    model = choose_distortion(tele.points[:3], tele.pixels[:3], tele.camera.sensor)
    assert model == DistortionModel(1, False)


@pytest.fixture
def photographed_corners(reference_data):
    table = pd.read_csv(reference_data / "opencv-chessboard" / "left_corners.csv")
    views = [view for _, view in table.groupby("image")]
    points = [
        np.column_stack([1000 * v.x_board_m, 1000 * v.y_board_m, np.zeros(len(v))]) for v in views
    ]
    return points, [v[["u_px", "v_px"]].to_numpy() for v in views]


def test_real_corners_with_a_bad_view(photographed_corners):
    """OpenCV's 13 photographs with its customary window: mrcal gets 533.88, OpenCV 535.92."""
    points, pixels = photographed_corners
    sensor = Sensor(640, 480, 0.01, 0.01)
    model = choose_distortion(points, pixels, sensor)
    assert model == DistortionModel(2, True)
    result = calibrate_views(
        points, pixels, sensor, focus_view=None, radial_terms=2, decentring=True
    )
    assert 100 * result.image_distance_mm == pytest.approx(533.9, abs=1.2)
    assert 0.3 < 100 * result.sigma("image_distance_mm") < 0.8
    # Most of what is wrong is wrong in left02, the second view, and it is the worst of all.
    rejected = [r for r in result.rejected if r.view == 1]
    assert len(rejected) == 6
    assert max(result.rejected, key=lambda r: r.residual_px).view == 1
    plain = calibrate_views(points, pixels, sensor, focus_view=None, reject_outliers=False)
    assert 100 * plain.image_distance_mm == pytest.approx(537.6, abs=0.1)
