import numpy as np
import pytest

from lenscal.calibration.refine import calibrate_views
from lenscal.errors import DegenerateGeometryError


@pytest.fixture
def views(tele):
    pixels, _ = tele.noisy(np.random.default_rng(0), 0.1)
    return [p.copy() for p in tele.points], pixels, tele.camera.sensor


def test_the_reasons_name_the_partner(views):
    points, pixels, sensor = views
    pixels[1][[5, 6]] = pixels[1][[6, 5]]
    pixels[2][[10, 50, 90]] = pixels[2][[50, 90, 10]]
    result = calibrate_views(points, pixels, sensor)
    partners = {(1, 5): 6, (1, 6): 5, (2, 10): 50, (2, 50): 90, (2, 90): 10}
    assert {(r.view, r.point) for r in result.rejected} == set(partners)
    for r in result.rejected:
        assert r.reason.endswith(f"looks swapped with corner {partners[r.view, r.point]}")


@pytest.mark.parametrize("kept", [135, 70])
def test_a_partial_board_listed_backwards_is_told(views, kept):
    points, pixels, sensor = views
    rows = (
        np.lexsort(np.round(points[3][:, :2].T, 6))[:kept]
        if kept == 135
        else np.flatnonzero(points[3][:, 0] + points[3][:, 1] < 3)
    )
    points[3], pixels[3] = points[3][rows], pixels[3][rows][::-1]
    result = calibrate_views(points, pixels, sensor)
    assert all(r.view == 3 for r in result.rejected)
    assert any("its corners look numbered from the other end" in r.reason for r in result.rejected)


def test_a_mirrored_board_is_warned_of(views):
    points, pixels, sensor = views
    points[3] *= (-1, 1, 1)
    (warning,) = calibrate_views(points, pixels, sensor).warnings
    assert warning.startswith("view 3: its rows or columns look numbered from the other end")


def test_a_view_without_points_is_left_out(views):
    points, pixels, sensor = views
    points[4], pixels[4] = points[4][:0], pixels[4][:0]
    (rejection,) = calibrate_views(points, pixels, sensor).rejected
    assert rejection.reason == "view 4 shows 0 points, and at least 4 are needed"


def test_one_view_shows_no_scale_factor(views):
    points, pixels, sensor = views
    with pytest.raises(
        DegenerateGeometryError, match="one view of a flat target cannot show the s"
    ):
        calibrate_views(points[5:], pixels[5:], sensor, free_scale_factor=True)
