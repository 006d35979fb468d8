"""Tables that know d but not D, as most foreign files do: what is not known is refused."""

import numpy as np
import pandas as pd
import pytest

from lenscal.errors import InputError, MapError
from lenscal.formats.exported import settings_of
from lenscal.formats.samples_csv import read_samples_csv, write_samples_csv
from lenscal.maps.consistency import check_consistency
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.lens_map import LensMap
from lenscal.maps.validation import cross_validate, summarise
from lenscal.sensor import Sensor
from lenscal.setting import LensSetting

SENSOR = Sensor(640, 480, 0.005, 0.005)
NOISE = 1e-3


def image_distance_mm(zoom, focus):
    return 20 * np.exp(zoom / 800 + focus / 4000)


@pytest.fixture(scope="module")
def table():
    rng = np.random.default_rng(5)
    zoom, focus = (v.ravel() for v in np.meshgrid(np.linspace(0, 1000, 6), np.linspace(0, 500, 5)))
    true = image_distance_mm(zoom, focus)
    return pd.DataFrame(
        {
            "zoom": zoom,
            "focus": focus,
            "image_distance_mm": true * (1 + NOISE * rng.normal(size=zoom.size)),
            "sigma_image_distance_mm": NOISE * true,
            "k1_per_mm2": 1e-4 + 1e-7 * zoom,
            "magnification": np.nan,
        }
    )


@pytest.fixture(scope="module")
def lens_map(table):
    return fit_lens_map(table, sensor=SENSOR)


def test_it_tells_d_and_the_camera(lens_map):
    assert lens_map.quantities == ("image_distance_mm", "k1_per_mm2")
    assert not lens_map.has_object_distance
    assert "no object_distance_mm in the table: the map tells d" in lens_map.notes[0]
    zoom, focus = (v.ravel() for v in np.meshgrid(np.linspace(9, 990, 23), np.linspace(3, 490, 17)))
    expected = image_distance_mm(zoom, focus)
    sigma = lens_map.sigma("image_distance_mm", zoom, focus)
    off = (lens_map.image_distance_mm(zoom, focus) - expected) / sigma
    assert (sigma < NOISE * expected).all()
    assert np.sqrt((off**2).mean()) < 2
    camera = lens_map.camera_at(150, 80)
    assert camera.image_distance_mm == lens_map.image_distance_mm(150, 80)
    assert camera.k1_per_mm2 == pytest.approx(1.15e-4)
    slope = lens_map.derivative("image_distance_mm", 400, 200, by="zoom")
    assert slope == pytest.approx(image_distance_mm(400, 200) / 800, rel=0.03)


def test_without_sigma_the_scatter_tells_the_noise(table):
    found = fit_lens_map(table.drop(columns="sigma_image_distance_mm"))
    assert "no sigma_image_distance_mm in the table" in found.notes[1]
    assert np.sqrt(found.core.noise_scale) == pytest.approx(NOISE, rel=0.4)


@pytest.mark.parametrize(
    "quantity",
    ["magnification", "object_distance_mm", "focal_length_mm", "standoff_mm", "nodal_offset_mm"],
)
def test_what_it_cannot_tell_is_refused(lens_map, quantity):
    with pytest.raises(MapError, match=f"no {quantity}: its samples lack .* object_distance_mm"):
        lens_map.value(quantity, 100, 100)


def test_a_file_of_it_comes_back(tmp_path, lens_map):
    again = LensMap.load(lens_map.save(tmp_path / "map.json"))
    assert again.digest == lens_map.digest


def test_contours_and_inverse(lens_map):
    (curve,) = lens_map.contour("image_distance_mm", 40.0)
    np.testing.assert_allclose(lens_map.image_distance_mm(curve.zoom, curve.focus), 40, rtol=1e-6)
    np.testing.assert_allclose(curve.value("k1_per_mm2"), 1e-4 + 1e-7 * curve.zoom, rtol=1e-6)
    wanted = {"image_distance_mm": float(lens_map.image_distance_mm(300, 122))}
    (found,) = lens_map.settings_for(**wanted, k1_per_mm2=1.3e-4)
    np.testing.assert_allclose([found.zoom, found.focus], [300, 122], rtol=1e-4)
    with pytest.raises(MapError, match="this map has no focal_length_mm"):
        lens_map.settings_for(**wanted, focal_length_mm=20)


def test_it_is_validated_in_pixels_too(table):
    validation = cross_validate(table, sensor=SENSOR)
    np.testing.assert_allclose(validation["error_centre_px"], 0, atol=1e-9)
    # A target that both see equally far away moves in the corner by the error of d.
    shares = validation["relative_error_image_distance_mm"].abs()
    np.testing.assert_allclose(validation["error_corner_px"], 400 * shares, rtol=0.02)
    summary = summarise(validation).set_index(["quantity", "edge"])
    assert summary.loc[("image_distance_mm", False), "rms_sigmas"] == pytest.approx(1, abs=0.4)


def test_a_bad_setting_is_named(table):
    assert not check_consistency(table)["flagged"].any()
    spoilt = table.copy()
    spoilt.loc[13, "image_distance_mm"] *= 1.03
    found = check_consistency(spoilt)
    assert np.flatnonzero(found["flagged"]).tolist() == [13]
    assert found["worst_quantity"][13] == "image_distance_mm"


def test_exports_leave_out_what_needs_distances(tmp_path, lens_map):
    (one,) = settings_of(lens_map, [LensSetting(200, 100)])
    assert one.object_distance_mm is None
    assert one.nodal_offset_mm is None
    path = tmp_path / "t.csv"
    write_samples_csv(path, lens_map, [LensSetting(200, 100), LensSetting(300, 90)])
    back = read_samples_csv(path, SENSOR).samples
    expected = lens_map.image_distance_mm([200, 300], [100, 90])
    np.testing.assert_array_equal(back["image_distance_mm"], expected)
    assert "magnification" not in back


def test_columns_that_are_missing_are_named(table):
    with pytest.raises(InputError, match="lacks .* or image_distance_mm, for a map of d alone"):
        fit_lens_map(table.drop(columns="image_distance_mm"))
    with pytest.raises(InputError, match="lacks the columns magnification; it has"):
        fit_lens_map(table.assign(object_distance_mm=1000.0))
    gap = table.copy()
    gap.loc[3, "image_distance_mm"] = np.nan
    with pytest.raises(InputError, match="image_distance_mm is not finite in row 3"):
        fit_lens_map(gap)
