from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from lenscal.calibration.table import CalibrationTable
from lenscal.cli.main import program
from lenscal.errors import FileError, InputError
from lenscal.maps.lens_map import LensMap

MAP = Path(__file__).parents[3] / "data" / "vicon-1990" / "map.json"


def run(*words):
    return CliRunner().invoke(program, [str(w) for w in words], catch_exceptions=False)


@pytest.fixture(scope="module")
def lens_map():
    return LensMap.load(MAP)


@pytest.fixture
def export(tmp_path):
    def write(form, name, *words):
        run("export", MAP, "--format", form, *(words or ("--grid", "5x4")), "-o", tmp_path / name)
        return tmp_path / name

    return write


def test_a_map_goes_out_and_comes_back(tmp_path, export, lens_map):
    """Through OpenTrackIO with the image plane known, D comes too, and a map can be fitted."""
    words = ("--grid", "6x5", "--image-plane-distance", "60 cm")
    path = export("opentrackio", "o.json", *words)
    result = run("import", path, "--format", "opentrackio", "-o", tmp_path / "t.csv")
    assert "30 settings imported from opentrackio" in result.output
    assert "note: no standard deviations are stated" in result.output
    assert "the object distance D is not known" not in result.output
    run("map", "fit", tmp_path / "t.csv", "-o", tmp_path / "map.json")
    again = LensMap.load(tmp_path / "map.json")
    rows = CalibrationTable.load(tmp_path / "t.csv").rows
    settings = zip(rows["zoom"], rows["focus"], strict=True)
    kappas = [lens_map.camera_at(*setting).k1_per_mm2 for setting in settings]
    assert rows["k1_per_mm2"].tolist() == kappas
    # At none of the settings exported, and at no midpoint.
    at = (np.array([94.2, 97.1, 106.8]), np.array([66.0, 125.0, 88.0]))
    found = again.image_distance_mm(*at) / lens_map.image_distance_mm(*at)
    np.testing.assert_allclose(found, 1, atol=0.1)
    assert again.sensor.sample_pitch_x_mm == pytest.approx(lens_map.sensor.sample_pitch_x_mm)


@pytest.mark.parametrize(
    ("form", "name", "words"),
    [
        ("ulens", "l.ulens", ()),
        ("ros", "set", ("--pitch", "13.75um")),
        ("opentrackio", "o.json", ()),
    ],
)
def test_what_a_format_does_not_know_is_said(tmp_path, export, lens_map, form, name, words):
    grid = ("--grid", "5x2") if form == "ulens" else ("--grid", "5x1")
    path = export(form, name, *grid)
    if form == "ros":
        path = path / "focus_100_zoom_%d.yaml"
    result = run("import", path, "--format", form, *words, "-o", tmp_path / "t.csv")
    assert "note: the object distance D is not known, and with it not d/D and f" in result.output
    rows = CalibrationTable.load(tmp_path / "t.csv").rows
    assert rows["object_distance_mm"].isna().all()
    focus = 100.0 if form == "ros" else rows["focus"]
    expected = lens_map.image_distance_mm(rows["zoom"], focus)
    np.testing.assert_allclose(rows["image_distance_mm"], expected, rtol=1e-12)
    result = run("map", "fit", tmp_path / "t.csv", "-o", tmp_path / "map.json")
    assert "note: no object_distance_mm in the table: the map tells d, but not d/D" in result.output
    again = LensMap.load(tmp_path / "map.json")
    # Five settings without σ: what a smooth curve cannot follow is taken for noise.
    off = np.log(again.image_distance_mm(rows["zoom"], rows["focus"]) / expected)
    assert (np.abs(off) < 3 * np.sqrt(again.core.noise_scale)).all()
    shown = run("map", "show", tmp_path / "map.json", "--zoom", 98, "--focus", rows["focus"][0])
    assert "image_distance_mm" in shown.output
    assert "magnification" not in shown.output


def test_object_distances_are_added_to_a_table_that_lacks_them(tmp_path, export, lens_map):
    path = export("ulens", "l.ulens")
    run("import", path, "--format", "ulens", "-o", tmp_path / "t.csv")
    rows = CalibrationTable.load(tmp_path / "t.csv").rows
    rows["object_distance_mm"] = lens_map.object_distance_mm(rows["zoom"], rows["focus"])
    rows.to_csv(tmp_path / "more.csv", index=False)
    words = ("--pitch", "16.24766 um x 13.75 um", "--size", "512x480", "-o", tmp_path / "d.csv")
    result = run("import", tmp_path / "more.csv", "--format", "csv", *words)
    assert "the object distance D" not in result.output
    run("map", "fit", tmp_path / "d.csv", "-o", tmp_path / "map.json")
    again = LensMap.load(tmp_path / "map.json")
    expected = lens_map.magnification(rows["zoom"], rows["focus"])
    found = again.samples["magnification"]
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert "k1_per_mm2" in again.quantities


def test_single_cameras_are_put_together(tmp_path, export, lens_map):
    settings = [(92, 60), (97.3, 80), (108, 135)]
    files = [export("opencv", f"{z}.yml", "--zoom", z, "--focus", f) for z, f in settings]
    at = [word for z, f in settings for word in ("--at", f"{z},{f}")]
    words = ("--format", "opencv", "--pitch", "13.75 um", *at, "-o", tmp_path / "t.csv")
    result = run("import", *files, *words)
    assert "3 settings imported from opencv" in result.output
    table = CalibrationTable.load(tmp_path / "t.csv")
    zoom, focus = np.array(settings).T
    for name in ("image_distance_mm", "principal_point_x_px", "principal_point_y_px"):
        np.testing.assert_allclose(table.rows[name], lens_map.value(name, zoom, focus), rtol=1e-9)
    found, expected = table.rows["k1_per_mm2"], lens_map.value("k1_per_mm2", zoom, focus)
    np.testing.assert_allclose(found, expected, rtol=1e-4)
    assert table.sensor.sample_pitch_x_mm == pytest.approx(lens_map.sensor.sample_pitch_x_mm)
    with pytest.raises(InputError, match="3 cameras, but 1 settings; give --at ZOOM,FOCUS"):
        run("import", *files, *words[:4], *at[:2], "-o", tmp_path / "t.csv")


def test_cameras_of_colmap_and_mrcal(tmp_path, export):
    words = ("--zoom", 92, "--zoom", 98, "--focus", 100)
    path = export("colmap", "cameras.txt", *words)
    at = ("--at", "92,100", "--at", "98,100", "--pitch", "13.75 um", "-o", tmp_path / "t.csv")
    assert "2 settings" in run("import", path, "--format", "colmap", *at).output
    folder = export("mrcal", "m", *words)
    files = [folder / f"zoom_{z}_focus_100.cameramodel" for z in (92, 98)]
    assert "2 settings" in run("import", *files, "--format", "mrcal", *at).output


def test_a_csv_comes_back(tmp_path, export, lens_map):
    path = export("csv", "c.csv")
    words = ("--pitch", "16.24766 um x 13.75 um", "--size", "512x480", "-o", tmp_path / "t.csv")
    result = run("import", path, "--format", "csv", *words)
    assert "note" not in result.output
    rows = CalibrationTable.load(tmp_path / "t.csv").rows
    expected = lens_map.standoff_mm(rows["zoom"], rows["focus"])
    np.testing.assert_array_equal(rows["standoff_mm"], expected)
    assert "settings mapped" in run("map", "fit", tmp_path / "t.csv", "-o", tmp_path / "m").output


LENSFUN = """<lensdatabase version="2"><lens><maker>A</maker><model>Zoom</model><mount>M</mount>
<cropfactor>1</cropfactor><calibration><distortion model="poly3" focal="24" k1="0.01"/>
<distortion model="poly3" focal="70" k1="-0.01"/></calibration></lens></lensdatabase>"""


def test_a_set_of_lensfun(tmp_path):
    (tmp_path / "db.xml").write_text(LENSFUN)
    words = ("import", tmp_path / "db.xml", "--format", "lensfun", "-o", tmp_path / "t.csv")
    result = run(*words, "--size", "6000x4000", "--lens", "zoom")
    assert "the number engraved on the lens" in result.output
    assert CalibrationTable.load(tmp_path / "t.csv").rows["zoom"].tolist() == [24, 70]
    with pytest.raises(InputError, match="lensfun does not tell the size of an image; give --size"):
        run(*words)
    with pytest.raises(InputError, match="such as 6000x4000, not '6000'"):
        run(*words, "--size", "6000")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("a_%d.yaml", "--format", "ros"), "ros does not tell the size of a pixel; give --pitch"),
        (("a.yml", "--format", "opencv"), "opencv does not tell the size of a pixel"),
        (("a", "b", "--format", "ulens"), "ulens holds a table .* give one FILE and no --at"),
        (("a", "--at", "1,2", "--format", "csv"), "csv holds a table"),
    ],
)
def test_words_that_do_not_fit(tmp_path, words, message):
    with pytest.raises(InputError, match=message):
        run("import", *words, "-o", tmp_path / "t.csv")


def test_settings_and_sizes_that_do_not_fit(tmp_path, export):
    path = export("opencv", "c.yml", "--zoom", 98, "--focus", 131)
    words = ("--format", "opencv", "--pitch", "14um", "-o", tmp_path / "t.csv")
    with pytest.raises(InputError, match="--at is written as ZOOM,FOCUS, such as 98,131, not '98'"):
        run("import", path, *words, "--at", "98")
    other = tmp_path / "d.yml"
    other.write_text(path.read_text().replace("image_width: 512", "image_width: 640"))
    with pytest.raises(InputError, match="the cameras have different image sizes"):
        run("import", path, other, *words, "--at", "98,131", "--at", "99,131")
    with pytest.raises(FileError, match="cannot read"):
        run("import", tmp_path / "none.yml", *words, "--at", "98,131")
    bare = tmp_path / "o.json"
    bare.write_text(
        '{"protocol": {"name": "OpenTrackIO", "version": [1, 0, 0]}, "lens": '
        '{"encoders": {"zoom": 0.5, "focus": 0.1}, "pinholeFocalLength": 30}}'
    )
    with pytest.raises(InputError, match="the file does not tell the size of the image"):
        run("import", bare, "--format", "opentrackio", "-o", tmp_path / "t.csv")


def test_a_map_does_not_overwrite_the_evidence_of_its_table(tmp_path, export):
    path = export("ulens", "l.ulens")
    run("import", path, "--format", "ulens", "-o", tmp_path / "t.csv")
    with pytest.raises(InputError, match="holds the evidence of .*; give the map another name"):
        run("map", "fit", tmp_path / "t.csv", "-o", tmp_path / "t.json")
    CalibrationTable.load(tmp_path / "t.csv")
