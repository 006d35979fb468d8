from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from lenscal.errors import FileError, InputError
from lenscal.formats.samples_csv import read_samples_csv, write_samples_csv
from lenscal.maps.fit import fit_lens_map
from lenscal.maps.lens_map import LensMap
from lenscal.setting import LensSetting

MAP = Path(__file__).parents[3] / "data" / "vicon-1990" / "map.json"


@pytest.fixture(scope="module")
def lens_map():
    return LensMap.load(MAP)


@pytest.fixture(scope="module")
def settings():
    return [LensSetting(z, f) for f in (61.0, 90, 140) for z in (92, 95.3, 99, 104, 109)]


def test_a_map_comes_back_to_the_last_bit(tmp_path, lens_map, settings):
    path, worst = write_samples_csv(tmp_path / "t.csv", lens_map, settings)
    table = read_samples_csv(path, lens_map.sensor)
    zoom, focus = (np.array([getattr(s, n) for s in settings]) for n in ("zoom", "focus"))
    for name in lens_map.quantities:
        np.testing.assert_array_equal(table.samples[name], lens_map.value(name, zoom, focus))
        sigma = table.samples[f"sigma_{name}"]
        np.testing.assert_array_equal(sigma, lens_map.sigma(name, zoom, focus))
    assert worst == 0
    assert table.has_object_distance
    assert table.missing == ()


def test_a_map_can_be_fitted_to_it_again(tmp_path, lens_map, settings):
    path, _ = write_samples_csv(tmp_path / "t.csv", lens_map, settings)
    again = fit_lens_map(read_samples_csv(path, lens_map.sensor).to_calibration_table(path))
    # Away from samples and midpoints.
    at = (np.array([96.1, 101.7]), np.array([84.0, 117.0]))
    np.testing.assert_allclose(again.magnification(*at), lens_map.magnification(*at), rtol=0.05)
    assert not any("cov_magnification" in note for note in again.notes)
    with pytest.raises(InputError, match="the file does not tell the size of the image"):
        read_samples_csv(path).to_calibration_table(path)


def test_the_evidence_names_the_file_and_what_is_missing(tmp_path, lens_map):
    path = tmp_path / "t.csv"
    path.write_text("zoom,focus,image_distance_mm,fx\n1,2,30,9\n2,2,nan,9\n")
    table = read_samples_csv(path, lens_map.sensor)
    assert any("columns of unknown meaning were left aside: fx" in s for s in table.missing)
    assert any("the object distance D is not known" in s for s in table.missing)
    kept = table.to_calibration_table(path)
    kept.save(tmp_path / "kept.csv")
    loaded = type(kept).load(tmp_path / "kept.csv")
    assert loaded.evidence[0]["imported_from"] == "t.csv"
    assert loaded.evidence[1]["not_known"] == list(table.missing)
    assert loaded.rows["image_distance_mm"].tolist()[0] == 30
    assert np.isnan(loaded.rows["image_distance_mm"][1])
    assert loaded.rows["views"].tolist() == [0, 0]
    assert len(loaded.recording_sha256) == 64


def test_magnification_follows_from_both_distances(tmp_path):
    (tmp_path / "t.csv").write_text(
        "zoom,focus,image_distance_mm,object_distance_mm\n1,2,30,100\n2,2,31,\n"
    )
    table = read_samples_csv(tmp_path / "t.csv")
    pd.testing.assert_series_equal(
        table.samples["magnification"], pd.Series([0.3, np.nan], name="magnification")
    )
    assert not table.has_object_distance


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: wanted is one column zoom, but there are 0"),
        (
            "zoom,fokus\n1,2\n",
            "line 1: wanted is one column focus, but there are 0; .* zoom, fokus",
        ),
        ("zoom,focus\n", "holds no line of values; was it cut short"),
        ("zoom,focus\n1,2\n3\n", "line 3: wanted are 2 values .* holds 1; was the file cut short"),
        ("zoom,focus\n1,two\n", "line 2: focus is 'two'; wanted is a number$"),
        ("zoom,focus\n1,\n", "line 2: focus is ''"),
        ("zoom,focus,k1_per_mm2\n1,2,x\n", "k1_per_mm2 is 'x'; wanted is a number, or nothing"),
        ("zoom,focus,object_distance_mm\n1,2,-3\n", "object_distance_mm is '-3'; wanted is a posi"),
        ("zoom,focus,standoff_mm,standoff_mm\n1,2,3,4\n", "a column stands there twice"),
        ("zoom,focus\n1,2\n1,2\n", "the setting zoom 1, focus 2 stands more than once"),
        ('zoom,focus\n1,"2\n', r"t.csv, line \d: no CSV"),
    ],
)
def test_garbled_files(tmp_path, text, message):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(FileError, match=message):
        read_samples_csv(tmp_path / "t.csv")


def test_no_setting_and_no_file(tmp_path, lens_map):
    with pytest.raises(InputError, match="there is no setting to export"):
        write_samples_csv(tmp_path / "t.csv", lens_map, [])
    with pytest.raises(FileError, match="cannot read .*none.csv"):
        read_samples_csv(tmp_path / "none.csv")
