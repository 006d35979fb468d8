from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lenscal import check_consistency
from lenscal.calibration.table import CalibrationTable
from lenscal.errors import InputError, MapError
from lenscal.maps.consistency import _borders_of_strip
from lenscal.maps.kriging import coordinates, leave_one_out
from lenscal.rig.simulated.machine_vision import TRAVEL, machine_vision_lens
from lenscal.setting import LensSetting

VICON = Path(__file__).parents[3] / "data" / "vicon-1990" / "table.csv"
SPOILT = ["object_distance_mm", "image_distance_mm", "focal_length_mm"]


def five_by_five(lens, rng=None):
    zoom, focus = np.meshgrid(np.linspace(90, 110, 5), np.linspace(60, 140, 5))
    return lens.sample(zoom, focus, rng)


@pytest.fixture(scope="module")
def strip():
    """5 × 5 settings over the curved strip of a lens that is not parfocal, without noise."""
    lens, rows = machine_vision_lens(), []
    for zoom in np.linspace(*TRAVEL.zoom, 5):
        low, high = lens.focus_range(zoom, 300.0, 1500.0)
        for focus in np.linspace(low, high, 5):
            truth = lens.truth(LensSetting(zoom, focus, 75.0))
            names = ("magnification", "object_distance_mm", "standoff_mm")
            rows.append({"zoom": zoom, "focus": focus} | {n: getattr(truth, n) for n in names})
    return pd.DataFrame(rows)


def measured(truth, rng):
    table, count = truth.copy(), len(truth)
    distance, slip = truth["object_distance_mm"], rng.normal(0, 0.05, count)
    table["object_distance_mm"] = distance * np.exp(1.5e-3 * rng.normal(size=count)) + slip
    table["magnification"] *= np.exp(3e-5 * rng.normal(size=count)) * (1 - slip / distance)
    table["standoff_mm"] += slip
    stated = {
        "object_distance_mm": 1.5e-3 * distance,
        "magnification": 3e-5 * truth["magnification"],
        "standoff_mm": 0.05,
    }
    return table.assign(**{f"sigma_{n}": s for n, s in stated.items()}, sigma_sharpest_mm=0.05)


def spoil(table, row, columns=SPOILT, factor=1.03):
    table = table.copy()
    table.loc[row, [c for c in columns if c in table]] *= factor
    return table


def flagged(table):
    return np.flatnonzero(check_consistency(table)["flagged"]).tolist()


def test_clean_tables_raise_no_alarm_in_twenty(lens):
    rng = np.random.default_rng(1)
    assert [flagged(five_by_five(lens, rng)) for _ in range(20)] == [[]] * 20


def test_clean_curved_strips_raise_no_alarm(strip):
    rng = np.random.default_rng(2)
    assert [flagged(measured(strip, rng)) for _ in range(5)] == [[]] * 5


def test_the_session_that_the_project_carries_is_consistent():
    table = CalibrationTable.load(VICON)
    found = check_consistency(table)
    assert not found["flagged"].any()
    assert found["sigmas"].abs().max() < 4
    assert found["zoom"].tolist() == table.rows["zoom"].tolist()


@pytest.mark.parametrize("row", [0, 12, 19, 35])
@pytest.mark.parametrize("columns", [SPOILT, ["focal_length_mm"]], ids=["D, d and f", "f alone"])
def test_a_setting_spoilt_by_three_per_cent_is_named_and_no_other(row, columns):
    table = spoil(CalibrationTable.load(VICON).to_dataframe(), row, columns)
    found = check_consistency(table)
    assert np.flatnonzero(found["flagged"]).tolist() == [row]
    worst = found.loc[row]
    assert worst["worst_quantity"] in columns
    assert worst["sigmas"] > worst["threshold"]
    assert worst["error"] == pytest.approx(0.03, abs=0.01)
    assert worst["measured"] / worst["expected"] == pytest.approx(1 + worst["error"])


@pytest.mark.parametrize("row", [0, 4, 7, 12, 17])
def test_on_a_curved_strip_too(strip, row):
    assert flagged(spoil(measured(strip, np.random.default_rng(3)), row)) == [row]


def test_borders_of_a_strip_may_be_off_by_more():
    """What others tell by extrapolation is doubtful; on a grid, others share the motors."""
    points = np.stack([np.repeat(np.arange(4.0), 4), np.tile(np.arange(4.0), 4)], axis=-1)
    rows = np.arange(16)
    assert not _borders_of_strip(coordinates(points), rows).any()
    points[:, 1] += np.repeat([0.0, 1.5, 0.5, 2.0], 4)
    border = _borders_of_strip(coordinates(points), rows).reshape(4, 4)
    assert not border[1:-1, 1:-1].any()
    assert border.sum() == 12


def test_two_bad_settings_do_not_hide_each_other(lens):
    table = five_by_five(lens, np.random.default_rng(4))
    assert flagged(spoil(spoil(table, 6), 18, factor=0.97)) == [6, 18]


def test_without_sigmas_the_scatter_stands_for_them(lens):
    table = five_by_five(lens, np.random.default_rng(5))
    bare = table[["zoom", "focus", "magnification", "object_distance_mm"]]
    assert flagged(bare) == []
    assert flagged(spoil(bare, 12)) == [12]


def test_nominal_focal_lengths_alone(reference_data):
    """A real 25× lens: its steep end is its nature; one wrong entry in its middle is not."""
    for name in ("L085", "L086"):
        curve = pd.read_csv(reference_data / "kurokesu-sce2" / f"{name}_curves.csv")
        for count in (6, 10, 15, 25):
            some = curve.iloc[np.linspace(0, len(curve) - 1, count).round().astype(int)]
            table = pd.DataFrame(
                {
                    "zoom": some["zoom_x"].to_numpy(),
                    "focus": 0.0,
                    "focal_length_mm": some["focal_range"].to_numpy(),
                }
            )
            assert flagged(table) == []
        assert flagged(spoil(table, 12)) == [12]


def test_a_nominal_focal_length_is_no_contradiction(lens):
    table = five_by_five(lens, np.random.default_rng(6))
    ratio, far = table["magnification"], table["object_distance_mm"]
    nominal = table.assign(focal_length_mm=(ratio * far / (1 + ratio) * 0.4).round(1))
    assert flagged(nominal) == []


def test_two_columns_that_contradict_each_other(lens):
    table = five_by_five(lens)
    stated = table.assign(image_distance_mm=table["magnification"] * table["object_distance_mm"])
    found = check_consistency(spoil(stated, 24, ["image_distance_mm"]))
    assert np.flatnonzero(found["flagged"]).tolist() == [24]
    assert found["worst_quantity"][24] == "image_distance_mm"


def test_too_few_settings_are_not_judged():
    table = pd.DataFrame({"zoom": [1.0, 2.0, 3.0], "focus": 0.0, "focal_length_mm": [5.0, 6, 9]})
    found = check_consistency(table)
    assert found["sigmas"].isna().all()
    assert not found["flagged"].any()


def test_a_camera_quantity_may_be_unknown_at_some_settings(lens):
    table = five_by_five(lens, np.random.default_rng(7))
    rng = np.random.default_rng(8)
    table["k1_per_mm2"] = 1e-4 + 1e-6 * rng.normal(size=25)
    table["sigma_k1_per_mm2"] = 1e-6
    table.loc[3, "k1_per_mm2"] = np.nan
    table.loc[12, "k1_per_mm2"] += 3e-5
    found = check_consistency(table)
    assert np.flatnonzero(found["flagged"]).tolist() == [12]
    assert found["worst_quantity"][12] == "k1_per_mm2"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.drop(columns="zoom"), "the table of settings lacks zoom; it has focus"),
        (lambda t: t[["zoom", "focus"]], "lacks any of magnification, object_distance_mm"),
        (lambda t: t.replace({"zoom": {90.0: np.nan}}), "zoom is not finite in row 0"),
        (lambda t: t.assign(magnification=[np.nan] + [0.1] * 24), "magnification is not finite"),
        (lambda t: t.assign(object_distance_mm=-5.0), "must be positive, but is -5 in row 0"),
        (lambda t: t.assign(sigma_magnification=0.0), "sigma_magnification must be positive"),
        (lambda t: pd.concat([t, t.iloc[[4]]]), "the setting zoom .* stands more than once"),
    ],
)
def test_tables_that_cannot_be_used(lens, change, message):
    with pytest.raises(InputError, match=message):
        check_consistency(change(five_by_five(lens)))


def test_one_setting_has_no_neighbours(lens):
    with pytest.raises(MapError, match="judged by their neighbours, but the table has 1"):
        check_consistency(five_by_five(lens).iloc[:1])


def test_leaving_out_is_what_it_says():
    """The closed form of all predictions is that of a fit without the value."""
    rng = np.random.default_rng(9)
    points = np.stack([np.linspace(0, 1, 9), np.zeros(9)], axis=1)
    values = np.sin(3 * points[:, 0]) + 0.01 * rng.normal(size=9)
    told = leave_one_out(points, values, np.full(9, 1e-4))
    moved = values.copy()
    moved[4] += 1.0
    again = leave_one_out(points, moved, np.full(9, 1e-4))
    assert again.value[4] == pytest.approx(told.value[4], abs=0.02)
    assert told.sigmas == pytest.approx((values - told.value) / told.sigma)
    assert abs(again.sigmas[4]) > 30


def test_values_that_do_not_scatter_agree():
    points = np.stack([np.arange(6.0), np.zeros(6)], axis=1)
    assert (leave_one_out(points, np.full(6, 32.0), None).sigmas == 0).all()
    straight = leave_one_out(points, np.arange(6.0), None).sigmas
    assert np.isnan(straight).all() or np.abs(straight).max() < 3
