import json

import numpy as np
import pytest

from lenscal.errors import FileError
from lenscal.formats.ulens import read_ulens, write_ulens


def tables_of(path):
    content = json.loads(path.read_text())
    entries = content["cameraParameterTables"] + content["encoderTables"]
    return {
        e["parameterName"]: [[float(w) for w in r.split(",")] for r in e["data"].split(";")]
        for e in entries
    }


def test_focal_length_is_the_image_distance(tmp_path, one):
    path, worst = write_ulens(tmp_path / "l.ulens", [one])
    tables = tables_of(path)
    # Over the width and the height of the sensor.
    assert tables["FocalLengthTable"][0] == pytest.approx([131, 98, 120 / 8.3188019, 120 / 6.6])
    centre = (one.camera.centre_px + 0.5) / [512, 480]
    assert tables["ImageCenterTable"][0] == pytest.approx([131, 98, *centre])
    assert "NodalOffsetTable" not in tables
    assert tables["Focus"] == [[131.0, 40.0]]
    content = json.loads(path.read_text())
    assert content["metadata"]["userMetadata"] == [
        {"name": "conversionErrorPx", "value": f"{worst:.2g}"}
    ]


def test_the_projection_centre_lies_behind_the_reference_one(tmp_path, several):
    path, _ = write_ulens(tmp_path / "l.ulens", several)
    tables = tables_of(path)
    # Focus 5, zoom 1: 3 + 5/7 mm further from the object, in cm along z to the scene.
    assert tables["NodalOffsetTable"][0] == pytest.approx([5, 1, 0, 0, 0, 1, 0, 0, -0.3 - 5 / 70])
    assert [row[:2] for row in tables["DistortionTable"]][:2] == [[5, 1], [5, 2]]


def test_a_table_comes_back(tmp_path, several):
    path, worst = write_ulens(tmp_path / "l.ulens", several)
    table = read_ulens(path)
    samples = table.samples
    assert samples["zoom"].tolist() == [1, 2, 7, 1, 2, 7]
    assert samples["focus"].tolist() == [5, 5, 5, 8, 8, 8]
    distances = [e.camera.image_distance_mm for e in several]
    np.testing.assert_allclose(samples["image_distance_mm"], distances, rtol=1e-13)
    centres = np.array([e.camera.centre_px for e in several])
    found = samples[["principal_point_x_px", "principal_point_y_px"]]
    np.testing.assert_allclose(found, centres, rtol=1e-13)
    kappas = [e.camera.k1_per_mm2 for e in several]
    np.testing.assert_allclose(samples["k1_per_mm2"], kappas, rtol=1e-4)
    assert samples["conversion_error_px"].max() < worst + 1e-2
    offsets = [e.nodal_offset_mm for e in several]
    np.testing.assert_allclose(samples["nodal_offset_mm"], offsets, rtol=1e-12)
    # Away from the samples, not at midpoints alone.
    first = samples[samples["focus"] == 5]
    between = np.interp(2.9, first["zoom"], first["image_distance_mm"])
    assert between == pytest.approx(np.interp(2.9, [1, 2, 7], distances[:3]))
    assert table.has_object_distance


def test_object_distances_that_depend_on_zoom_have_no_place(tmp_path, several):
    import dataclasses

    other = [dataclasses.replace(e, object_distance_mm=300.0 + e.setting.zoom) for e in several]
    path, _ = write_ulens(tmp_path / "l.ulens", other)
    assert json.loads(path.read_text())["encoderTables"] == []
    table = read_ulens(path)
    assert "magnification" not in table.samples
    assert "the object distance D is not known" in table.missing[0]


def test_older_exporters_repeat_the_table_of_nodal_offsets(tmp_path, several):
    path, _ = write_ulens(tmp_path / "l.ulens", several)
    content = json.loads(path.read_text())
    entries = content["cameraParameterTables"]
    last = next(e for e in entries if e["parameterName"] == "NodalOffsetTable")
    content["cameraParameterTables"] = [{**last, "data": last["data"].split(";")[0]}, *entries]
    path.write_text(json.dumps(content))
    assert read_ulens(path).samples["nodal_offset_mm"].notna().all()


def test_tables_in_mm_and_tables_that_lack_settings(tmp_path, several):
    path, _ = write_ulens(tmp_path / "l.ulens", several)
    content = json.loads(path.read_text())
    content["metadata"]["fxFyUnits"] = "Millimeters"
    for entry in content["cameraParameterTables"]:
        if entry["parameterName"] == "FocalLengthTable":
            rows = [
                f"{e.setting.focus}, {e.setting.zoom}, {d}, {d}"
                for e in several
                for d in [e.camera.image_distance_mm]
            ]
            entry["data"] = ";".join(rows)
        if entry["parameterName"] == "ImageCenterTable":
            entry["data"] = entry["data"].split(";")[0]
    path.write_text(json.dumps(content))
    table = read_ulens(path)
    distances = [e.camera.image_distance_mm for e in several]
    np.testing.assert_allclose(table.samples["image_distance_mm"], distances, rtol=1e-13)
    assert table.samples["principal_point_x_px"].isna().sum() == 5
    assert "ImageCenterTable does not have all settings" in table.missing


def changed(path, *way, value):
    content = json.loads(path.read_text())
    place = content
    for name in way[:-1]:
        place = place[name]
    place[way[-1]] = value
    path.write_text(json.dumps(content))


FIRST = ("cameraParameterTables", 0)


@pytest.mark.parametrize(
    ("way", "value", "message"),
    [
        (("metadata", "version"), "1.0.0", "metadata.version is '1.0.0'.*of a newer version"),
        (("metadata", "type"), "Plane", "metadata.type is 'Plane'"),
        (("metadata", "lensInfo", "distortionModel"), "Anamorphic", "only Spherical is read"),
        (("metadata", "fxFyUnits"), "Inches", "wanted is Normalized or Millimeters"),
        (("sensorDimensions", "width"), 0, "sensorDimensions.width must be a positive number"),
        (("imageDimensions", "width"), 1.5, "imageDimensions.width must be a whole number"),
        ((*FIRST, "data"), "5, 1, 0.7", "row 0 of FocalLengthTable has 3 values.* has 4"),
        ((*FIRST, "data"), "5, 1, x, 1", "Fx in row 0 of FocalLengthTable must be a finite number"),
        ((*FIRST, "data"), "5, 1, -1, 1", "wanted is a camera matrix"),
        ((*FIRST, "data"), "", "the FocalLengthTable has no rows"),
        ((*FIRST, "header"), "FocusEncoder, Fx", "header of FocalLengthTable lacks ZoomEncoder, F"),
        (("cameraParameterTables",), [], "lacks the FocalLengthTable"),
    ],
)
def test_garbled_files(tmp_path, several, way, value, message):
    path, _ = write_ulens(tmp_path / "l.ulens", several)
    changed(path, *way, value=value)
    with pytest.raises(FileError, match=f"l.ulens.*({message})"):
        read_ulens(path)


def test_a_file_that_was_cut_short(tmp_path, several):
    path, _ = write_ulens(tmp_path / "l.ulens", several)
    path.write_text(path.read_text()[:900])
    with pytest.raises(FileError, match=r"l.ulens, line \d+: no JSON .*cut short"):
        read_ulens(path)
