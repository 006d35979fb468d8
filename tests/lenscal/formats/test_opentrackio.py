import dataclasses
import json

import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lenscal.camera import Camera
from lenscal.errors import FileError, InputError
from lenscal.formats.exported import ExportedSetting
from lenscal.formats.opentrackio import write_opentrackio
from lenscal.formats.opentrackio_samples import read_opentrackio
from lenscal.sensor import Sensor
from lenscal.setting import LensSetting


def test_samples_fit_the_schema(tmp_path, several, reference_data):
    schema = json.loads((reference_data / "opentrackio" / "schema.json").read_text())
    path, worst = write_opentrackio(
        tmp_path / "l.json", several, image_plane_distance_mm=85.0, history=["a map"]
    )
    samples = json.loads(path.read_text())
    assert len(samples) == 6
    for sample in samples:
        jsonschema.validate(sample, schema)
    assert worst == 0
    assert len({s["sampleId"] for s in samples}) == 6
    # The check can fail.
    samples[0]["lens"]["pinholeFocalLength"] = -1
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(samples[0], schema)


def test_focal_length_is_the_image_distance(tmp_path, one):
    path, _ = write_opentrackio(tmp_path / "l.json", [one])
    sample = json.loads(path.read_text())
    assert sample["lens"]["pinholeFocalLength"] == 120.0
    assert sample["lens"]["rawEncoders"] == {"zoom": 98, "focus": 131}
    # 0.023 · 0.70642 · 512 and 0.01375 · 480: what the sensor is on the chip.
    dimensions = sample["static"]["camera"]["activeSensorPhysicalDimensions"]
    assert dimensions == {"width": pytest.approx(8.3188019), "height": pytest.approx(6.6)}
    offset = sample["lens"]["projectionOffset"]
    assert offset["x"] == pytest.approx((250.3 + 14 - 255.5) * 0.023 * 0.70642)
    assert offset["y"] == pytest.approx((241.9 - 131 / 9 - 239.5) * 0.01375)


def test_what_a_calibration_cannot_know_is_not_written(tmp_path, one, several):
    path, _ = write_opentrackio(tmp_path / "l.json", [one])
    lens = json.loads(path.read_text())["lens"]
    assert not {"entrancePupilOffset", "focusDistance", "fStop", "tStop"} & set(lens)
    path, _ = write_opentrackio(tmp_path / "l.json", several[:1], image_plane_distance_mm=85.0)
    lens = json.loads(path.read_text())["lens"]
    # The projection centre lies 3 + 5/7 mm behind the reference one, so nearer to the image plane.
    assert lens["entrancePupilOffset"] == pytest.approx((85 - 3 - 5 / 7) / 1000)
    assert lens["focusDistance"] == pytest.approx((85 - 3 - 5 / 7 + 400) / 1000)
    with pytest.raises(InputError, match="the nodal offset at zoom 98, focus 131 is not known"):
        write_opentrackio(tmp_path / "l.json", [one], image_plane_distance_mm=85.0)


@given(
    kappa=st.floats(-1e-3, 1e-3),
    distance=st.floats(1.0, 500.0),
    setting=st.tuples(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1)),
    centre=st.tuples(st.floats(0, 511), st.floats(0, 479)),
)
def test_kappa_and_image_distance_come_back_to_the_last_bit(
    tmp_path_factory, kappa, distance, setting, centre
):
    sensor = Sensor(512, 480, 0.023, 0.01375, 0.70642)
    camera = Camera(sensor, distance, kappa, np.array(centre))
    folder = tmp_path_factory.mktemp("otio")
    path, _ = write_opentrackio(folder / "l.json", [ExportedSetting(LensSetting(*setting), camera)])
    row = read_opentrackio(path).samples.iloc[0]
    assert (row["k1_per_mm2"], row["image_distance_mm"]) == (kappa, distance)
    assert (row["zoom"], row["focus"]) == setting
    found = [row["principal_point_x_px"], row["principal_point_y_px"]]
    np.testing.assert_allclose(found, centre, atol=1e-10)


def test_a_table_comes_back_with_object_distances(tmp_path, several):
    path, _ = write_opentrackio(tmp_path / "l.json", several, image_plane_distance_mm=85.0)
    table = read_opentrackio(path)
    np.testing.assert_allclose(table.samples["object_distance_mm"], 400, rtol=1e-12)
    magnifications = [e.camera.image_distance_mm / 400 for e in several]
    np.testing.assert_allclose(table.samples["magnification"], magnifications, rtol=1e-12)
    assert table.has_object_distance
    assert table.sensor.sample_pitch_x_mm == pytest.approx(0.023 * 0.70642)
    path, _ = write_opentrackio(tmp_path / "l.json", several)
    table = read_opentrackio(path)
    assert not table.has_object_distance
    assert any("the object distance D is not known" in s for s in table.missing)


def test_lines_of_samples_are_read_and_frames_that_repeat_count_once(tmp_path, several):
    path, _ = write_opentrackio(tmp_path / "l.json", several)
    samples = json.loads(path.read_text())
    lines = [json.dumps(s) for s in (*samples, samples[2])]
    (tmp_path / "l.jsonl").write_text("\n".join(lines) + "\n")
    assert len(read_opentrackio(tmp_path / "l.jsonl").samples) == 6
    (tmp_path / "l.jsonl").write_text("\n".join(lines)[:-40])
    with pytest.raises(FileError, match=r"l.jsonl.*: no JSON"):
        read_opentrackio(tmp_path / "l.jsonl")


def test_higher_terms_and_decentring_go_where_the_lens_model_has_them(tmp_path, one):
    camera = dataclasses.replace(one.camera, radial=(1e-6, -2e-8), decentring=(1e-5, -2e-5))
    path, _ = write_opentrackio(tmp_path / "l.json", [dataclasses.replace(one, camera=camera)])
    entry = json.loads(path.read_text())["lens"]["distortion"][0]
    kappa = camera.k1_per_mm2
    assert entry["radial"] == [kappa, 0.0, 1e-6, 0.0, -2e-8]
    assert entry["tangential"] == [1e-5, -2e-5]
    row = read_opentrackio(path).samples.iloc[0]
    assert row["k1_per_mm2"] != kappa
    assert row["k1_per_mm2"] == pytest.approx(kappa, rel=0.2)
    assert 0 < row["conversion_error_px"] < 2
    more = dataclasses.replace(camera, radial=(1e-6, 1e-8, 1e-10))
    with pytest.raises(InputError, match="holds 3 radial terms, but the camera has 4"):
        write_opentrackio(path, [dataclasses.replace(one, camera=more)])


def test_coefficients_below_the_line_and_of_the_other_direction(tmp_path, one):
    """To first order, k2 counts against k1, and the other direction has the other sign."""
    path, _ = write_opentrackio(tmp_path / "l.json", [one])
    for change, sign in (
        ({"radial": [0.0, 1e-5]}, -1),
        ({"radial": [1e-5], "model": "Brown-Conrady U-D"}, -1),
        ({"radial": [1e-5, 0.0, 0.0]}, 1),
    ):
        sample = json.loads(path.read_text())
        sample["lens"]["distortion"] = [change]
        (tmp_path / "c.json").write_text(json.dumps(sample))
        row = read_opentrackio(tmp_path / "c.json").samples.iloc[0]
        assert row["k1_per_mm2"] == pytest.approx(sign * 1e-5, rel=1e-3)
        assert row["conversion_error_px"] < 1e-3


def test_settings_that_are_shares_of_the_travel(tmp_path, one):
    shares = dataclasses.replace(one, setting=LensSetting(0.25, 1.0))
    path, _ = write_opentrackio(tmp_path / "l.json", [shares])
    assert json.loads(path.read_text())["lens"]["encoders"] == {"zoom": 0.25, "focus": 1.0}
    assert read_opentrackio(path).samples["zoom"].tolist() == [0.25]
    with pytest.raises(InputError, match="whole encoder counts from 0, .* but given is 97.5"):
        write_opentrackio(path, [dataclasses.replace(one, setting=LensSetting(97.5, 100))])
    with pytest.raises(InputError, match="there is no setting to export"):
        write_opentrackio(path, [])
    other = dataclasses.replace(one, camera=Camera(Sensor(10, 10, 0.1, 0.1), 30.0))
    with pytest.raises(InputError, match="the settings have 2 different sensors"):
        write_opentrackio(path, [one, other])


def test_published_examples_are_read(reference_data):
    folder = reference_data / "opentrackio"
    table = read_opentrackio(folder / "recommended_static_example.json")
    row = table.samples.iloc[0]
    assert (row["zoom"], row["focus"], row["image_distance_mm"]) == (0.3, 0.1, 24.305)
    assert row["object_distance_mm"] == pytest.approx(10_000 - 123)
    assert table.sensor is None
    assert any("κ1 needs the size of the sensor" in s for s in table.missing)


@pytest.mark.parametrize(
    ("way", "value", "message"),
    [
        (("lens", "pinholeFocalLength"), "50 mm", "lens.pinholeFocalLength must be a positive n"),
        (("lens", "pinholeFocalLength"), None, "lens.pinholeFocalLength must be a positive number"),
        (("lens", "rawEncoders"), {}, "lacks lens.rawEncoders and lens.encoders"),
        (("lens", "distortion", 0, "model"), "Fisheye", "the distortion model 'Fisheye' is not"),
        (("lens", "distortion", 0, "radial"), [], r"lens.distortion\[0\].radial must be a list"),
        (("lens", "projectionOffset"), {"x": 1}, "lacks the field lens.projectionOffset.y|the fie"),
        (("protocol", "version"), [2, 0, 0], "has version 2.0.0 of OpenTrackIO.*install a newer"),
        (("protocol", "name"), "FreeD", "the protocol is 'FreeD', not OpenTrackIO"),
        (("static",), [], r"static must be names with values, but is \[\]"),
        (("lens", "distortion"), {}, "distortion must be a list, but is {}"),
        (("protocol",), {}, "lacks the field protocol.name"),
        (
            ("static", "camera", "activeSensorResolution", "width"),
            1.5,
            "width must be a whole number",
        ),
    ],
)
def test_garbled_files(tmp_path, one, way, value, message):
    path, _ = write_opentrackio(tmp_path / "l.json", [one])
    sample = json.loads(path.read_text())
    place = sample
    for name in way[:-1]:
        place = place[name]
    place[way[-1]] = value
    path.write_text(json.dumps(sample))
    with pytest.raises(FileError, match=f"l.json.*({message})"):
        read_opentrackio(path)


def test_files_that_are_cut_short_or_contradict_themselves(tmp_path, one):
    path, _ = write_opentrackio(tmp_path / "l.json", [one])
    whole = path.read_text()
    path.write_text(whole[: len(whole) // 2])
    with pytest.raises(FileError, match=r"l.json, line \d+: no JSON .*cut short"):
        read_opentrackio(path)
    path.write_text("[]")
    with pytest.raises(FileError, match="holds no sample"):
        read_opentrackio(path)
    other = json.loads(whole)
    other["lens"]["pinholeFocalLength"] = 121.0
    path.write_text(f"[{whole}, {json.dumps(other)}]")
    with pytest.raises(FileError, match="zoom 98, focus 131 stands more than once"):
        read_opentrackio(path)
