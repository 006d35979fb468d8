from pathlib import Path

import numpy as np
import pytest

from lenscal import cross_validate, fit_lens_map
from lenscal.calibration.table import CalibrationTable
from lenscal.errors import InputError, MapError
from lenscal.maps.prediction_pixels import pixel_errors
from lenscal.maps.validation import summarise
from lenscal.sensor import Sensor

VICON = Path(__file__).parents[3] / "data" / "vicon-1990" / "table.csv"
SENSOR = Sensor(512, 480, 0.023, 0.01375, 0.70642)
CORE = ["magnification", "object_distance_mm", "standoff_mm"]


@pytest.fixture(scope="module")
def noisy(lens, grid):
    return lens.sample(*grid, np.random.default_rng(1))


@pytest.fixture(scope="module")
def validation(noisy):
    return cross_validate(noisy)


def test_every_setting_is_predicted_by_the_others(noisy, validation):
    """The same as a map that has never heard of the setting, smoothing kept."""
    row = 17
    kept = {"core": fit_lens_map(noisy).core.log_smoothing}
    without = fit_lens_map(noisy.drop(index=row), log_smoothing=kept)
    where = noisy.loc[row, "zoom"], noisy.loc[row, "focus"]
    for name in CORE:
        # The neutral smoothing of one sample less is a little lower.
        predicted = validation[f"predicted_{name}"][row]
        assert predicted == pytest.approx(float(without.value(name, *where)), rel=2e-5)
        assert validation[f"error_{name}"][row] == pytest.approx(predicted - noisy[name][row])


def test_errors_are_as_large_as_they_are_stated(validation):
    for name in CORE:
        sigmas = validation.loc[~validation["edge"], f"error_sigmas_{name}"]
        assert 0.5 < np.sqrt((sigmas**2).mean()) < 1.5, name
        assert (validation[f"sigma_{name}"] > 0).all()


def test_only_corners_of_a_grid_are_extrapolated_to(validation):
    edge = validation[validation["edge"]]
    assert sorted(zip(edge["zoom"], edge["focus"], strict=True)) == [
        (90, 60), (90, 140), (110, 60), (110, 140),
    ]  # fmt: skip


def test_a_spoilt_setting_is_predicted_right(lens, noisy):
    table = noisy.copy()
    table.loc[17, "object_distance_mm"] *= 1.03
    found = cross_validate(table)
    assert found["relative_error_object_distance_mm"][17] == pytest.approx(-0.029, abs=0.01)


def test_folds_leave_out_several_at_a_time(noisy):
    found = cross_validate(noisy, folds=5)
    assert found["fold"].value_counts().tolist() == [7] * 5
    other = cross_validate(noisy, folds=5, rng=np.random.default_rng(7))
    assert (other["fold"] != found["fold"]).any()
    assert found["error_magnification"].notna().all()
    with pytest.raises(InputError, match="35 settings cannot be dealt into 36 folds; give 2 to 35"):
        cross_validate(noisy, folds=36)


def test_smoothing_may_be_chosen_anew(noisy):
    some = noisy[noisy["zoom"].isin([90, 100, 110]) & noisy["focus"].isin([60, 100, 140])]
    kept, anew = (cross_validate(some, choose_smoothing=c) for c in (False, True))
    assert np.isfinite(anew["error_magnification"]).all()
    assert (kept["error_magnification"] != anew["error_magnification"]).any()


def test_tables_without_sigmas(noisy):
    bare = noisy[["zoom", "focus", "magnification", "object_distance_mm"]]
    found = cross_validate(bare)
    assert not any("standoff" in c or "px" in c for c in found)
    assert 0.3 < np.sqrt((found["error_sigmas_object_distance_mm"] ** 2).mean()) < 2
    camera = bare.assign(k1_per_mm2=1e-4 + 1e-6 * np.cos(np.arange(35.0)))
    assert cross_validate(camera)["error_k1_per_mm2"].abs().max() < 4e-6


def test_tables_of_focal_lengths_only(lens):
    zoom = np.linspace(90, 110, 8)
    table = lens.sample(zoom, np.full(8, 80.0))[["zoom", "focus"]].assign(
        focal_length_mm=np.exp(0.04 * (zoom - 90))
    )
    table["k1_per_mm2"] = [np.nan, *np.linspace(1e-4, 2e-4, 7)]
    found = cross_validate(table)
    assert found["relative_error_focal_length_mm"].abs().max() < 1e-3
    assert np.isnan(found["predicted_k1_per_mm2"][0])
    assert found["error_k1_per_mm2"][1:].abs().max() < 1e-8
    assert found.loc[found["edge"], "zoom"].tolist() == [90, 110]


def test_what_nothing_else_determines_is_not_predicted(lens):
    corners = lens.sample([90.0, 110, 90, 110], [60.0, 60, 140, 140])
    found = cross_validate(corners)
    assert found["predicted_magnification"].isna().all()
    assert found["edge"].all()
    line = cross_validate(lens.sample([90.0, 110.0], [80.0, 80.0]))
    assert line["predicted_object_distance_mm"].isna().all()


def test_pixels_of_a_table_with_its_sensor():
    found = cross_validate(CalibrationTable.load(VICON))
    assert found["error_centre_px"].max() < 2.5
    assert found["error_corner_px"].max() < 5
    # Willson's figure: the pose refitted, the camera of the map is as good as the setting's own.
    assert found["refitted_corner_px"].max() < 0.14


def pixels(**changes):
    own = {
        "object_distance_mm": 600.0,
        "image_distance_mm": 100.0,
        "principal_point_x_px": 255.5,
        "principal_point_y_px": 239.5,
        "k1_per_mm2": 0.0,
    }
    other = own | {name: own[name] + change for name, change in changes.items()}
    found = pixel_errors(SENSOR, *({n: np.array([v]) for n, v in c.items()} for c in (own, other)))
    return {name: float(value[0]) for name, value in found.items()}


def test_pixels_mean_what_is_written():
    same = pixels()
    assert max(same.values()) < 1e-6
    # d and D wrong by one share: the sharp plane is seen at the same scale.
    assert max(pixels(object_distance_mm=6.0, image_distance_mm=1.0).values()) < 1e-6
    larger = pixels(image_distance_mm=1.0)
    corner = np.hypot(255.5, 239.5)
    assert larger["error_corner_px"] == pytest.approx(0.01 * corner, rel=1e-6)
    assert larger["error_centre_px"] < 1e-6
    assert larger["refitted_corner_px"] < 1e-4
    aside = pixels(principal_point_x_px=2.0)
    assert aside["error_centre_px"] == pytest.approx(2.0)
    assert aside["refitted_corner_px"] < 0.01
    bent = pixels(k1_per_mm2=1e-4)
    assert bent["refitted_corner_px"] > 0.1
    assert bent["error_corner_px"] > bent["refitted_corner_px"]
    assert np.isnan(list(pixels(image_distance_mm=np.nan).values())).all()


def test_the_summary_names_the_worst(validation):
    summary = summarise(validation)
    inside = summary[(summary["quantity"] == "object_distance_mm") & ~summary["edge"]].iloc[0]
    part = validation[~validation["edge"]]
    row = part["relative_error_object_distance_mm"].abs().idxmax()
    assert inside["worst_error"] == part.loc[row, "relative_error_object_distance_mm"]
    assert (inside["worst_zoom"], inside["worst_focus"]) == (
        part.loc[row, "zoom"],
        part.loc[row, "focus"],
    )
    assert inside["settings"] == 31


def test_one_row_and_repeated_rows(noisy):
    with pytest.raises(MapError, match="judged by their neighbours, but the table has 1"):
        cross_validate(noisy.iloc[:1])
    with pytest.raises(InputError, match="stands more than once"):
        cross_validate(noisy.iloc[[0, 1, 2, 3, 3, 9]])
